"""Records of a grasp's quality measures and of the global bound."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from nlpgrasp.budgets import ForceBudget
from nlpgrasp.common.files import write_text
from nlpgrasp.common.formatting import format_headroom, format_measure, format_upper
from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import array, number
from nlpgrasp.errors import InputError
from nlpgrasp.quality.bounds import Bounds
from nlpgrasp.quality.volume import Volume
from nlpgrasp.solution.analysis_records import CriticalFriction, Robustness, StatedMeasure
from nlpgrasp.solution.force_records import ForcesNeeded
from nlpgrasp.solution.record_fields import to_json
from nlpgrasp.solution.records import UNKNOWN

SCHEMA = "nlpgrasp-bound/1"  # of a bound file
SMALL = 200_000  # bytes: largest certificate stored inside another file
LOOSE = 0.5  # gap above which a bound of a relaxed problem counts as loose


@dataclass(frozen=True)
class Quality:
    """Quality measures of a grasp.

    Parameters
    ----------
    mu : Bounds
        ``[0, inf]`` where there is no grasp. Its ``beta`` is stated too where the task's own is not 1.
    kind : {"mu", "mu_tilde"}
        Which measure ``mu`` holds: (3.3-4a) or (3.3-4b).
    delta : Bounds or None
    nu : Volume or None
    robust : Robustness or None
    bound : GlobalBound or None
        Upper bound on mu over all placements.
    needed : ForcesNeeded or None
        Finger forces for the task at full size.
    friction : CriticalFriction or None
        Least friction with which the task is held.
    measures : tuple of StatedMeasure
        Those from outside the package.
    """

    mu: Bounds
    kind: str
    delta: Bounds | None = None
    nu: Volume | None = None
    robust: Robustness | None = None
    bound: GlobalBound | None = None
    needed: ForcesNeeded | None = None
    friction: CriticalFriction | None = None
    measures: tuple[StatedMeasure, ...] = ()

    def to_dict(self) -> Json:
        """Return the measures as JSON data, None for unknown ones."""
        mu = {
            "lower": self.mu.lower,
            "upper": self.mu.upper,
            "kind": self.kind,
            "worst_direction": to_json(self.mu.worst_direction),
        }
        mu |= {name: text for name in ("limit", "trust") if (text := getattr(self.mu, name))}
        if self.mu.task_beta not in (None, 1.0):
            mu["beta"] = to_json(self.mu.beta)
        data = {
            "mu": mu if math.isfinite(self.mu.upper) else None,
            "delta": to_json(self.delta),
            "nu": to_json(self.nu),
            "robust": to_json(self.robust),
        }
        if self.needed is not None:
            data["forces_needed"] = self.needed.to_dict()
        if self.friction is not None:
            data["critical_friction"] = self.friction.to_dict()
        if self.measures:
            data["measures"] = [measure.to_dict() for measure in self.measures]
        return data if self.bound is None else {**data, "best_possible": self.bound.to_dict(self.mu.lower)}

    @classmethod
    def from_dict(cls, data: Json, dimension: int | None, name: str) -> Quality:
        """Return the measures that ``to_dict`` wrote.

        Parameters
        ----------
        data : mapping
        dimension : int or None
            Of wrench space; None where it is not known.
        name : str
            Shown in messages.

        Raises
        ------
        InputError
            On an empty interval, or arrays that do not fit the dimension or each other.
        """
        mu, delta, nu, robust = data["mu"], data.get("delta"), data.get("nu"), data.get("robust")
        bound, forces, friction = (data.get(key) for key in ("best_possible", "forces_needed", "critical_friction"))
        return cls(
            UNKNOWN if mu is None else _read_mu(mu, dimension, f"{name}.mu"),
            "mu" if mu is None else mu["kind"],
            None if delta is None else Bounds.from_dict(delta, f"{name}.delta"),
            None if nu is None else Volume.from_dict(nu, f"{name}.nu"),
            None if robust is None else Robustness.from_dict(robust, f"{name}.robust"),
            None if bound is None else GlobalBound.from_dict(bound, f"{name}.best_possible"),
            None if forces is None else ForcesNeeded.from_dict(forces, f"{name}.forces_needed"),
            None if friction is None else CriticalFriction.from_dict(friction, f"{name}.critical_friction"),
            tuple(StatedMeasure.from_dict(stated) for stated in data.get("measures", ())),
        )


def _read_mu(data: Json, dimension: int | None, name: str) -> Bounds:
    """Return the certified interval of mu with its worst direction, from JSON data."""
    components, direction = data.get("worst_direction"), None
    if components is not None:
        direction = array(f"{name}.worst_direction", components, (dimension,))
        if not np.any(direction):
            raise InputError(f"{name}.worst_direction", "zero", "a direction")
    bounds = Bounds.from_dict({"lower": data["lower"], "upper": data["upper"]}, name)
    return replace(bounds, worst_direction=direction, limit=data.get("limit", ""), trust=data.get("trust", ""))


def format_quality(quality: Quality, task_beta: float | None, budget: ForceBudget) -> list[str]:
    """Return text lines about a grasp's certified quality and optimality gap.

    Parameters
    ----------
    quality : Quality
        Of the grasp.
    task_beta : float or None
        The paper's scale of the task, for a centred ellipsoid.
    budget : ForceBudget
        Meaning of one unit of finger force.
    """
    mu, label = quality.mu, format_measure(quality.kind)
    paper = "" if task_beta in (None, 1.0) else f", beta of the paper in {mu.beta}"
    reason = f": {mu.limit}" if mu.limit else ""
    meaning = measure_meaning(quality.kind, budget)
    line = f"{label} certified in {mu} (gap {mu.gap:.1%}{reason}){paper}: {meaning}"
    return [line] if quality.bound is None else [line, quality.bound.line(mu.lower, label)]


def measure_meaning(kind: str, budget: ForceBudget) -> str:
    """Return a text that explains a quality measure, ``"mu"`` or ``"mu_tilde"``, under a force budget."""
    task = "the task, its centre included," if kind == "mu_tilde" else "the task"
    if budget.absolute:
        return f"the joints' torque limits hold {task} scaled by this factor"
    return f"1 {budget.unit} ({budget.amount}) holds {task} scaled by this factor"


def check_beta(data: Json, beta: Bounds | None, name: str) -> None:
    """Raise ``InputError`` if a file's interval of the paper's mu is not its mu times the task's beta.

    Raises
    ------
    InputError
        When the two contradict each other.
    """
    interval_data = None if data["mu"] is None else data["mu"].get("beta")
    if interval_data is None:
        return
    interval = None if beta is None else [beta.lower, beta.upper]
    if interval is None or not np.allclose(
        [interval_data["lower"], interval_data["upper"]], interval, rtol=1e-9, atol=0.0
    ):
        expected = "none for this task" if beta is None else f"mu times the task's beta, {beta}"
        raise InputError(f"{name}.mu.beta", f"[{interval_data['lower']:g}, {interval_data['upper']:g}]", expected)


@dataclass(frozen=True)
class GlobalBound:
    """Certified upper bound on mu over all placements of a problem's contacts (docs/how_close.md).

    Parameters
    ----------
    upper : float
        Upper bound on mu.
    nodes : int
        Nodes of the search tree.
    dropped : tuple of str
        Relaxed parts of the problem: they only lower mu.
    certificate : dict
        Data from which the bound can be recomputed, or the name and digest of the bound file that holds them; empty if
        they were not kept.
    stated_gap : float or None
        Gap as stated in a file, inf for null; None for a bound from a search.
    """

    upper: float
    nodes: int
    dropped: tuple[str, ...] = ()
    certificate: Json = field(default_factory=dict, repr=False, compare=False)
    stated_gap: float | None = field(default=None, repr=False, compare=False)

    def gap(self, mu: float) -> float:
        """Return the relative optimality gap ``upper / mu - 1`` of a grasp with certified quality ``mu``."""
        return max(0.0, self.upper / mu - 1.0) if mu > 0.0 else math.inf

    def to_dict(self, mu: float) -> Json:
        """Return the bound as JSON data, with the gap of a grasp with quality ``mu``.

        An infinite gap is null.
        """
        gap = self.gap(mu) if self.stated_gap is None else self.stated_gap
        data: Json = {
            "upper": self.upper,
            "gap": gap if math.isfinite(gap) else None,
            "nodes": self.nodes,
            "dropped": list(self.dropped),
        }
        return {**data, "certificate": self.certificate} if self.certificate and is_small(self.certificate) else data

    def saved_beside(self, problem: Mapping[str, object], path: Path) -> GlobalBound:
        """Write a large certificate to a bound file, and return the bound with a reference to the file.

        A small certificate is not written.

        Parameters
        ----------
        problem : mapping
            As JSON data.
        path : Path
            Of the solution file; ``F.json`` has its bound in ``F.bound.json``.

        Raises
        ------
        InputError
            When the file cannot be written.
        """
        if not self.certificate or is_small(self.certificate):
            return self
        data = {
            "schema": SCHEMA,
            "upper": self.upper,
            "gap": None,
            "closed": False,
            "nodes": self.nodes,
            "seconds": 0.0,
            "dropped": list(self.dropped),
            "problem": dict(problem),
            "grasp": None,
            "certificate": self.certificate,
        }
        return replace(self, certificate=bound_file_reference(write_bound(data, path.with_suffix(".bound.json"))))

    @classmethod
    def from_dict(cls, data: Json, name: str) -> GlobalBound:
        """Return the bound that ``to_dict`` wrote.

        The gap in the data is not checked here, but by ``verify``.
        """
        upper, gap = number(f"{name}.upper", data["upper"], at_least=0.0), data.get("gap")
        dropped, certificate = tuple(data.get("dropped", ())), data.get("certificate", {})
        return cls(upper, int(data.get("nodes", 0)), dropped, certificate, math.inf if gap is None else gap)

    def line(self, mu: float, label: str = "mu") -> str:
        """Return a text on the optimality gap of a grasp with certified quality ``mu``.

        Parameters
        ----------
        mu : float
            Certified quality of the grasp.
        label : str
            The measure's name.
        """
        bound, gap = f"{label} is at most {format_upper(self.upper, 4)} anywhere", self.gap(mu)
        if not math.isfinite(gap):
            return f"{bound}{self.ignored()}"
        if self.is_loose(gap):
            return f"a loose bound on the best possible: {bound}{self.ignored()}"
        return f"{format_headroom(gap)}{self.ignored()}: {bound}"

    def is_loose(self, gap: float) -> bool:
        """Return whether the bound ignores parts of the problem and its gap is too wide to rate a grasp."""
        return bool(self.dropped) and LOOSE < gap < math.inf

    def ignored(self) -> str:
        """Return the end of a sentence that names the ignored parts of the problem; empty if there are none."""
        *others, last = self.dropped or ("",)
        names = " and ".join(filter(None, (", ".join(others), last)))
        return f", even ignoring {names}" if names else ""


def is_small(certificate: Json) -> bool:
    """Return whether a certificate is small enough to be stored in a solution file."""
    return len(json.dumps(certificate, separators=(",", ":"))) <= SMALL


def write_bound(data: Json, path: str | Path) -> Path:
    """Write the data of a bound file atomically, and return the path.

    Raises
    ------
    InputError
        When the folder does not exist or cannot be written.
    """
    return write_text(path, json.dumps(data, allow_nan=False, separators=(",", ":")) + "\n")


def bound_file_reference(path: str | Path) -> Json:
    """Return name and SHA-256 of a bound file, by which a solution file refers to it.

    Raises
    ------
    InputError
        When it cannot be read.
    """
    file = Path(path)
    try:
        return {"file": file.name, "sha256": hashlib.sha256(file.read_bytes()).hexdigest()}
    except OSError as error:
        raise InputError("file", f"{path}: {error.strerror}", "a saved bound") from None
