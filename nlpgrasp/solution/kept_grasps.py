"""Records of the grasps that a solve kept, with their selection and their table."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from nlpgrasp.common.formatting import error_line, format_percent, format_upper
from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.errors import InputError
from nlpgrasp.quality.bounds import Bounds
from nlpgrasp.quality.grasp import Grasp
from nlpgrasp.solution.analysis_records import Robustness
from nlpgrasp.solution.force_records import ForcesNeeded, forces_and_moments, held_wrenches
from nlpgrasp.solution.grip_record import DIGITS, read_grip
from nlpgrasp.solution.obstructions import approach_obstructions, obstruction_rank, way_obstructions
from nlpgrasp.solution.placed_grasp import PlacedGrasp, SurfaceMatch
from nlpgrasp.solution.quality_record import Quality
from nlpgrasp.solution.record_fields import to_json
from nlpgrasp.solution.records import ConstraintReport

DISTINCT_ANGLE = np.radians(30.0)  # radians: least rotation between distinct poses of jaws at the same contacts
ROUNDING = 1e-6  # radians: added to a rotation, so that rounding does not lower it

Accepts = Callable[["FoundGrasp"], bool]  # whether a kept grasp may be the answer


@dataclass(frozen=True)
class FoundGrasp:
    """Grasp that a solve kept: the answer or an alternative.

    Parameters
    ----------
    grasp : Grasp
        Of k contacts.
    faces : tuple of k str
        The face each contact is on.
    mu : Bounds
        Certified quality.
    kind : {"mu", "mu_tilde"}
        Which measure ``mu`` holds.
    hand : mapping or None
        The hand in this grasp: a URDF hand's joint positions, palm pose and pregrasp.
    robust : Robustness or None
        Remaining quality under contact displacement and friction loss; the search is coarser than for the answer.
    forces : sequence of (wrench, forces)
        Task wrenches ``mu.lower * (c + semi-axis)`` (d,) and finger forces (k, space), newtons.
    moments : sequence of (k, d - space) array
        Newton-metres about the contact points, with the forces; empty when no contact exerts any.
    needed : ForcesNeeded or None
        Finger forces for the task at its full size.
    constraints : tuple of ConstraintReport
        Values and limits of the constraints at this grasp, by name.
    surface : SurfaceMatch or None
        For meshes.
    start : int or None
        Index of the start that ended with it; None for an intermediate iterate, which is not a local optimum.
    """

    grasp: Grasp
    faces: tuple[str, ...]
    mu: Bounds
    kind: str = "mu"
    hand: Json | None = None
    robust: Robustness | None = None
    forces: Sequence[tuple[FloatArray, FloatArray]] = ()
    moments: Sequence[FloatArray] = ()
    needed: ForcesNeeded | None = None
    constraints: tuple[ConstraintReport, ...] = ()
    surface: SurfaceMatch | None = None
    start: int | None = None

    @property
    def grip_force(self) -> float | None:
        """Least grip force of parallel jaws that holds the task, newtons; None for other hands."""
        grip = read_grip(self.hand)
        return None if grip is None else grip.force.upper

    @property
    def has_free_way(self) -> bool:
        """Whether no obstruction of the straight approach is known, and no pad hangs over its face."""
        return not approach_obstructions(self.hand)

    @property
    def is_fragile(self) -> bool:
        """Whether less than a fifth of the quality is left under contact displacement; False if unknown."""
        return self.robust is not None and self.robust.is_fragile(self.mu)

    def to_dict(self) -> Json:
        """Return the grasp as JSON data, with the keys of a solution."""
        bounds = replace(self.mu, task_beta=None)  # the file states the task's beta once
        return {
            "start": self.start,
            "grasp": PlacedGrasp(self.grasp, self.faces, self.surface).to_dict(),
            "hand": None if self.hand is None else dict(self.hand),
            "quality": Quality(bounds, self.kind, robust=self.robust, needed=self.needed).to_dict(),
            "forces": to_json(held_wrenches(self.forces, self.moments)),
            "constraints": to_json(self.constraints),
        }

    @classmethod
    def from_dict(cls, data: Json, name: str) -> FoundGrasp:
        """Return the grasp that ``to_dict`` wrote.

        ``name`` is shown in messages.

        Raises
        ------
        InputError
            When numbers contradict each other.
        """
        contacts = PlacedGrasp.from_dict(data["grasp"], f"{name}.grasp")
        quality = Quality.from_dict(data["quality"], contacts.grasp.dimension, f"{name}.quality")
        forces, moments = forces_and_moments(data.get("forces", []), name)
        return cls(
            contacts.grasp,
            contacts.faces,
            quality.mu,
            quality.kind,
            data.get("hand"),
            quality.robust,
            forces,
            moments,
            quality.needed,
            tuple(map(ConstraintReport.from_dict, data.get("constraints", []))),
            contacts.surface,
            data.get("start"),
        )


def read_kept_grasps(data: Json, name: str) -> list[FoundGrasp]:
    """Return the kept grasps in a file's data.

    ``name`` is shown in messages.

    Raises
    ------
    InputError
        When numbers contradict each other, and where grasps are kept without an answer.
    """
    grasps = [FoundGrasp.from_dict(entry, f"{name}.{i}") for i, entry in enumerate(data.get("grasps", []))]
    if grasps and data["grasp"] is None:
        raise InputError(name, f"{len(grasps)} beside no grasp", "none in a file without a grasp")
    return grasps


def rank_by(options: Json) -> Callable[[FoundGrasp], tuple[bool, bool, float, bool, float]]:
    """Return the sort key by which the alternatives of a solve are ranked, best first.

    Grasps without links inside anything come first, then those with a free approach, then those with more of a
    gripper's pads on their faces (from 90 % on alike), then those that are not fragile (with ``rank="robust"``), then
    those of higher certified quality (with ``maximise_robust`` the remaining one).

    Parameters
    ----------
    options : mapping
        Of the solve, as ``SolveOptions.to_dict`` writes them.
    """
    by_robustness, by_fragility = bool(options.get("maximise_robust")), weighs_fragility(options)

    def key(grasp: FoundGrasp) -> tuple[bool, bool, float, bool, float]:
        bounds = grasp.robust.mu if by_robustness and grasp.robust is not None else grasp.mu
        return *obstruction_rank(grasp.hand), by_fragility and grasp.is_fragile, -bounds.lower

    return key


def weighs_fragility(options: Json) -> bool:
    """Return whether a solve with these options may prefer a robust grasp with less mu to a fragile one."""
    return options.get("rank") == "robust" and options.get("gap") is None and not options.get("maximise_robust")


def first_accepted(grasps: Sequence[FoundGrasp], accepts: Accepts) -> FoundGrasp:
    """Return the first grasp for which a function returns True.

    Raises
    ------
    InputError
        Where it accepts none, raises, or returns neither True nor False.
    """
    if not callable(accepts):
        raise InputError("select", accepts, "a function of an ng.FoundGrasp that returns True or False")
    for i, grasp in enumerate(grasps):
        try:
            answer = accepts(grasp)
        except Exception as error:  # whatever the user's function raises
            raise InputError(f"select, at grasps[{i}]", error_line(error), "a function that raises nothing") from error
        if not isinstance(answer, bool | np.bool_):
            raise InputError(f"select, at grasps[{i}]", answer, "True or False")
        if answer:
            return grasp
    count = f"{len(grasps)} grasp{'s' * (len(grasps) != 1)}" if grasps else "no grasps"
    raise InputError("select", f"a function that is true for none of {count}", "one that accepts a grasp, or more kept")


def _format_approach(grasp: FoundGrasp) -> str:
    """Return a text of fixed width on the approach of parallel jaws: direction, state and pads on the face."""
    data = (grasp.hand or {}).get("approach") or {}
    direction = ", ".join(f"{x + 0.0:.2f}" for x in np.round(data.get("direction") or (), 2))
    state = "blocked" if way_obstructions(grasp.hand) else "free, flipped" if data.get("flip") else "free"
    pad_fractions = (grasp.hand or {}).get("pads")
    pads = f", {format_percent(min(pad_fractions))} on the face" if pad_fractions else ""
    return f"{f'[{direction}] {state}{pads}':{56 if pad_fractions else 37}}  "


def angle_between_poses(a: Json | None, b: Json | None) -> float:
    """Return the angle of rotation between the palms of two hands, radians; 0 if a pose is missing.

    It is rounded up.
    """
    p, q = ((hand or {}).get("palm_pose") for hand in (a, b))
    if p is None or q is None:
        return 0.0
    cosine = abs(float(np.dot(p["quaternion_wxyz"], q["quaternion_wxyz"])))
    return float(2.0 * np.arccos(min(cosine, 1.0))) + ROUNDING


def grasp_table(grasps: Sequence[FoundGrasp], requested: int = 1) -> list[str]:
    """Return a table of the kept grasps as text lines: certified and remaining quality, faces.

    Where there are fewer grasps than requested, the first line says so.
    """
    shortfall = (
        f"  {len(grasps)} of the {requested} grasps asked for: more starts, or a smaller distinct, may find others"
    )
    header = [shortfall] if 0 < len(grasps) < requested else []
    if len(grasps) < 2:
        return header
    forces = [grasp.grip_force for grasp in grasps]
    has_jaws = any(force is not None for force in forces)
    columns = f"certified quality, {'force to set, way in, ' if has_jaws else ''}what is left at worst, faces"
    lines = [*header, f"  {len(grasps)} grasps kept, best first ({columns}):"]
    for i, (grasp, force) in enumerate(zip(grasps, forces, strict=True)):
        remaining = "" if grasp.robust is None else f"{grasp.robust.mu.upper:.4g} left"
        fragile = ", fragile" if grasp.is_fragile else ""
        setting = ""
        if has_jaws:
            needed = "" if force is None else f"{format_upper(force, DIGITS)} N"
            setting = f"{needed:9}  {_format_approach(grasp)}"
        row = f"  {i:4d}  {grasp.mu!s:20}  {setting}{remaining + fragile:20}  {', '.join(grasp.faces)}"
        lines.append(row.rstrip())
    return lines
