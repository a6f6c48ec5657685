"""Solution of a grasp problem: immutable result of a solve, with its JSON form."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

from nlpgrasp.budgets import ForceBudget, budget_from_dict
from nlpgrasp.common.display import InNotebook, live, show
from nlpgrasp.common.drawing import Drawing
from nlpgrasp.common.files import write_bytes
from nlpgrasp.common.formatting import format_measure, format_ranges
from nlpgrasp.common.spatial import Pose
from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray, number, prefix_errors
from nlpgrasp.errors import InputError
from nlpgrasp.quality.bounds import Bounds
from nlpgrasp.quality.critical_friction import HoldingForce, common_friction
from nlpgrasp.quality.grasp import Grasp
from nlpgrasp.quality.proof import prove_stated
from nlpgrasp.quality.volume import Volume
from nlpgrasp.solution.analysis_records import (
    CriticalFriction,
    ForceAtFriction,
    Robustness,
    ShadowPrice,
    StatedMeasure,
    WhyNot,
    format_joint_margins,
    fragility_warning,
    mu_before_margins,
)
from nlpgrasp.solution.file import SCHEMA_NAME, read_solution_data, write_solution
from nlpgrasp.solution.force_records import ForcesNeeded, excess_force_warning, forces_and_moments, held_wrenches
from nlpgrasp.solution.grip_record import GripForce, force_limit, holding_force, read_grip
from nlpgrasp.solution.kept_grasps import Accepts, FoundGrasp, first_accepted, grasp_table, read_kept_grasps
from nlpgrasp.solution.kkt import KKT
from nlpgrasp.solution.obstructions import (
    GRIPPER_POSE,
    LinkPenetration,
    approach_obstructions,
    approach_penetration,
    format_gripper_frame,
    format_jaw_approach,
    format_link_penetrations,
    format_unshaped_links,
    grasp_obstructions,
    grasp_penetration,
    jaws_depth,
    links_are_free,
    missing_approach_reason,
    unseen_patches,
    unusable_reason,
)
from nlpgrasp.solution.phase_record import Phase, read_phases
from nlpgrasp.solution.placed_grasp import PlacedGrasp, SurfaceMatch
from nlpgrasp.solution.quality_record import GlobalBound, Quality, check_beta, format_quality
from nlpgrasp.solution.record_fields import to_json
from nlpgrasp.solution.records import (
    UNKNOWN,
    ConstraintReport,
    StartRecord,
    Status,
    format_status,
    read_starts,
    status_message,
)
from nlpgrasp.solution.squeeze_record import (
    JointSqueeze,
    Squeeze,
    format_squeeze,
    missing_squeeze,
    read_squeeze,
    task_efforts,
)
from nlpgrasp.solution.start_summary import answer_start, better_start_text, ipopt_lines, starts_lines
from nlpgrasp.solution.stored_problem import (
    check_dimension,
    fingertip_links,
    objective_text,
    palm_link,
    restore_problem,
)
from nlpgrasp.solution.world_frame import SolutionInFrame, transform_grasp
from nlpgrasp.tasks import Task, task_from_dict
from nlpgrasp.tasks.base import component_ranges

if TYPE_CHECKING:
    from nlpgrasp.hands.base import Hand
    from nlpgrasp.problem.problem import GraspProblem

# module and function of each display, imported on use
PAGE = ("nlpgrasp.report.solution_page", "write_solution")
CARD = ("nlpgrasp.report.solution_page", "solution_card")
LIVE = ("nlpgrasp.report.live_viewer", "show_live")


@dataclass(frozen=True, repr=False)
class GraspSolution(InNotebook):
    """Grasp with certified quality and the data that support it, or an infeasibility diagnosis.

    Parameters
    ----------
    status : Status
        How the solve ended.
    name : str
        The problem's name.
    problem : mapping
        The problem as JSON data (see ``to_dict``).
    grasp : Grasp or None
        The grasp's contacts.
    faces : tuple of str
        The face each contact is on.
    mu : Bounds
        Certified quality of the grasp; ``[0, inf]`` without one.
    kind : {"mu", "mu_tilde"}
        Which measure ``mu`` holds: (3.3-4a) for a centred task, (3.3-4b) otherwise.
    delta : Bounds or None
        Certified, with its torque scale, where requested (``ng.analyse``).
    nu : Volume or None
        With the same torque scale, where requested.
    forces : sequence of (wrench, forces)
        Task wrenches ``mu.lower * (c + semi-axis)`` (d,) and finger forces (k, space), newtons.
    moments : sequence of (k, d - space) array
        Newton-metres about the contact points, with the forces; empty when no contact exerts any.
    constraints : tuple of ConstraintReport
        Values and limits of the constraints, by name.
    prices : tuple of ShadowPrice
        Shadow prices of limits, where requested, binding ones first.
    robust : Robustness or None
        Remaining quality under contact displacement and friction loss.
    bound : GlobalBound or None
        Upper bound on mu over all placements; None for a problem that it does not cover.
    kkt : KKT or None
        Residuals of the KKT conditions of the paper's program (3.5-4) at the grasp, along its weakest directions; None
        without a grasp, after an early stop, and in files of earlier versions.
    needed : ForcesNeeded or None
        Finger forces for the task at full size; None in files of earlier versions.
    friction : CriticalFriction or None
        Least friction with which the task is held, and the force at others, where requested.
    measures : tuple of StatedMeasure
        Those from outside the package (``GraspMeasure``), where requested.
    why_not : WhyNot or None
        Infeasibility diagnosis, where no grasp was found.
    hand : mapping or None
        The hand at the solution: a URDF hand's joint positions, palm pose, pregrasp and squeeze.
    surface : SurfaceMatch or None
        For meshes.
    drawing : Drawing or None
        Triangles of body and hand, for pictures, where requested; ``require_drawing`` makes one otherwise.
    starts : tuple of StartRecord
        All starts, in order.
    best_start : int or None
        Index of the start whose grasp this is; None without a grasp, and in files of earlier versions.
    others : tuple of FoundGrasp
        Alternative grasps, best first.
    stated_first : FoundGrasp or None
        First of the kept grasps as stated in a file; None where it keeps one.
    solver : mapping
        Seed, seconds, options, versions.
    source : GraspProblem or None
        The problem itself, of a solve; None of a file.
    """

    status: Status
    name: str
    problem: Json
    grasp: Grasp | None = None
    faces: tuple[str, ...] = ()
    mu: Bounds = UNKNOWN
    kind: str = "mu"
    delta: Bounds | None = None
    nu: Volume | None = None
    forces: Sequence[tuple[FloatArray, FloatArray]] = ()
    moments: Sequence[FloatArray] = ()
    constraints: tuple[ConstraintReport, ...] = ()
    prices: tuple[ShadowPrice, ...] = ()
    robust: Robustness | None = None
    bound: GlobalBound | None = None
    kkt: KKT | None = None
    needed: ForcesNeeded | None = None
    friction: CriticalFriction | None = None
    measures: tuple[StatedMeasure, ...] = ()
    why_not: WhyNot | None = None
    hand: Json | None = None
    surface: SurfaceMatch | None = None
    drawing: Drawing | None = None
    starts: tuple[StartRecord, ...] = ()
    best_start: int | None = None
    others: tuple[FoundGrasp, ...] = ()
    stated_first: FoundGrasp | None = field(default=None, repr=False, compare=False)
    solver: Json = field(default_factory=dict)
    source: GraspProblem | None = field(default=None, repr=False, compare=False)

    _card: ClassVar[tuple[str, str]] = CARD

    # The problem's parts

    @cached_property
    def task(self) -> Task:
        """Task of the problem, about the grasp's torque origin, which it carries."""
        task = task_from_dict(self.problem["task"])
        if self.grasp is None or task.dimension != self.grasp.dimension:  # check_against refuses another dimension
            return task
        return task.about(self.grasp.torque_origin)

    @cached_property
    def budget(self) -> ForceBudget:
        """Force budget of the problem.

        For joint torques, in the solution's posture.
        """
        return budget_from_dict(self.problem["force_budget"])

    @property
    def body(self) -> Json:
        """The body as JSON data: its type and parameters."""
        return dict(self.problem["body"])

    @property
    def max_force(self) -> float | None:
        """Lower of the force limits of problem and hand, newtons; None if neither has one.

        For parallel jaws, of the normal force.
        """
        return force_limit(self.problem)

    @property
    def finger_limit(self) -> float | None:
        """Limit of each finger's force, newtons, or None if nothing limits it.

        It is ``max_force``, but for parallel jaws with a grip force: there ``max_force`` limits the grip force alone,
        so that this is None.
        """
        return self.max_force if self.grip is None else None

    @property
    def fingers(self) -> tuple[str, ...]:
        """Names of the links of the contacts' fingertips; empty for hands without links."""
        return fingertip_links(self.problem)

    @property
    def palm(self) -> str:
        """Name of the hand's root link, ``"palm"`` if the file has none."""
        return palm_link(self.problem)

    @property
    def objective(self) -> str:
        """Objective of the solve: ``"mu"``, ``"nu"``, or ``"delta"`` as mu of the unit ball of wrenches."""
        return str(self.problem.get("objective", "mu"))

    def task_line(self) -> str:
        """Return a text on the ranges of the task's wrench components, and on an objective other than mu."""
        text = f"the task: exert {format_ranges(*component_ranges(self.task))}"
        return text if self.objective == "mu" else f"{objective_text(self.problem)}; {text}"

    @property
    def known_problem(self) -> GraspProblem | None:
        """The solved problem; None if the file lacks data of its mesh, hand or expression."""
        return self.source if self.source is not None else restore_problem(self.problem, self.grasp)

    def check_against(self, grasp: Grasp | None, name: str) -> None:
        """Raise ``InputError`` if task or force budget are invalid or do not fit a grasp.

        Raises
        ------
        InputError
            Naming the field; ``name`` is put before it.
        """
        with prefix_errors(f"{name}: problem."):
            task = self.task
        check_dimension(task, grasp, name)
        with prefix_errors(f"{name}: problem."):
            budget = self.budget
            if grasp is not None:
                budget.check(grasp.contacts, grasp.space)

    # The hand in the grasp

    @cached_property
    def squeeze(self) -> Squeeze | None:
        """Squeeze forces and commands of the hand; None if there is no squeeze."""
        return read_squeeze(self.hand, self.problem.get("hand"), self.grasp)

    def require_squeeze(self) -> Squeeze:
        """Return the squeeze, or raise ``InputError`` if there is none.

        Raises
        ------
        InputError
            Where it states none, with the reason if known.
        """
        if self.squeeze is None:
            raise missing_squeeze(self.hand)
        return self.squeeze

    @cached_property
    def grip(self) -> GripForce | None:
        """Grip force of parallel jaws with its margin; None for other hands and in files of earlier versions."""
        return read_grip(self.hand)

    @property
    def grip_force(self) -> float | None:
        """Least normal force of each of two parallel jaws that holds the task, newtons; None without ``grip``."""
        return None if self.grip is None else self.grip.force.upper

    @cached_property
    def phases(self) -> tuple[Phase, ...]:
        """Keyframes of the hand's motion, from approach to lift.

        Empty without a hand with links, and in older files.
        """
        return read_phases((self.hand or {}).get("phases", ()), "hand.phases")

    @property
    def link_depth(self) -> LinkPenetration | None:
        """Deepest penetration of the hand's links in the grasp; None if unknown or without links."""
        return grasp_penetration(self.hand)

    @property
    def way_in(self) -> LinkPenetration | None:
        """Deepest penetration of the hand's links on the approach; None if no path is known."""
        return approach_penetration(self.hand)

    @property
    def way_blocked(self) -> float:
        """Penetration depth of parallel jaws on their straight approach, metres; 0 if it is free."""
        return jaws_depth(self.hand)

    @property
    def touches(self) -> bool:
        """Whether a link is known to penetrate something beyond its tolerance, in the grasp or on the approach."""
        return not links_are_free(self.hand)

    @property
    def has_free_way(self) -> bool:
        """Whether no obstruction of the straight approach is known."""
        return not approach_obstructions(self.hand)

    @property
    def beyond_effort(self) -> str:
        """Text on the joints whose effort limit the task exceeds; empty if there are none or unknown.

        Other finger forces for the same wrench may need less.
        """
        efforts = self._efforts
        return "" if efforts is None or not efforts.exceeded else f"the task takes {efforts.words()}"

    def effort_line(self) -> str:
        """Return a text on the joint efforts for the task's hardest wrench; empty if unknown.

        By virtual work from the stated finger forces: other forces for the same wrench may need smaller efforts.
        """
        return "" if self._efforts is None else f"these forces take {self._efforts.words()}"

    def squeeze_line(self) -> str:
        """Return a text on the squeeze, or on why there is none; empty if neither is known."""
        return format_squeeze(self.squeeze, self.hand, self.max_force)

    def links_line(self) -> str:
        """Return a text on the links' penetration in the grasp and on the approach; empty if unknown."""
        return format_link_penetrations(self.hand)

    def gripper_line(self) -> str:
        """Return a text on the approach of parallel jaws; empty for other hands."""
        return format_jaw_approach(self.hand)

    def gripper_frame_line(self, pose: str = GRIPPER_POSE) -> str:
        """Return a text on a gripper's pose with the axes and tool centre point of its frame; empty for other hands."""
        return format_gripper_frame(self.hand, self.problem.get("hand"), pose)

    def approach_line(self) -> str:
        """Return a text on why there is no straight approach; empty if there is one or the reason is unknown."""
        return missing_approach_reason(self.hand)

    def lines_by_hand(self) -> list[str]:
        """Return text lines about the hand: joint efforts, squeeze, links and approach."""
        gripper = self.gripper_line(), self.gripper_frame_line()
        return list(filter(None, (self.effort_line(), self.squeeze_line(), self.links_line(), *gripper)))

    # Status and quality

    @property
    def success(self) -> bool:
        """Whether there is a grasp with certified quality above zero and no penetrating link."""
        return self.is_certified and not self.touches

    @property
    def is_certified(self) -> bool:
        """Whether there is a grasp with certified quality above zero, even if links penetrate something."""
        return self.grasp is not None and self.mu.lower > 0.0

    @property
    def label(self) -> str:
        """Name of the quality measure: ``"mu"`` or ``"mu-tilde"``."""
        return format_measure(self.kind)

    @property
    def beta(self) -> Bounds | None:
        """Certified interval of the paper's mu, (3.3-4a); None unless the task is a centred ellipsoid."""
        return self._quality.mu.beta

    @property
    def best_possible(self) -> float:
        """Certified upper bound on mu over all placements of the contacts; inf without a bound."""
        return math.inf if self.bound is None else self.bound.upper

    @property
    def gap(self) -> float:
        """Upper bound on the relative optimality gap, ``best_possible / mu.lower - 1``."""
        return math.inf if self.bound is None else self.bound.gap(self.mu.lower)

    @property
    def is_fragile(self) -> bool:
        """Whether less than a fifth of the quality is left under contact displacement; False if unknown."""
        return self.robust is not None and self.robust.is_fragile(self.mu)

    @property
    def is_too_weak(self) -> bool:
        """Whether the task at full size needs a finger force above ``max_force``; False if either is unknown."""
        if self.grip is not None:
            return self.grip.is_within(self.max_force) is False
        return self.needed is not None and self.needed.is_within(self.max_force) is False

    @property
    def winner(self) -> StartRecord | None:
        """Record of the start that found the grasp; None without a grasp or starts.

        In files of earlier versions, which do not state it, the start with the largest certified upper bound.
        """
        return answer_start(self.starts, self.best_start)

    # Text

    @property
    def message(self) -> str:
        """Meaning of the status as text; for a solved grasp, with its local optimality."""
        return status_message(self.status, "" if self.kkt is None else self.kkt.words)

    @property
    def told(self) -> str:
        """Status as text, with the gap if it is closed, warnings about the grasp, and the error of a failed start."""
        text = format_status(self.status, self.message, self.gap, self.caveats)
        errors = [start.message for start in self.starts if start.status is Status.FAILED and start.message]
        return f"{text} The first: {errors[0]}" if self.status is Status.FAILED and errors else text

    @property
    def caveats(self) -> list[str]:
        """Warnings about the grasp, as text; mostly empty."""
        no_squeeze = self.squeeze is None and bool(self.squeeze_line())
        warnings = (
            *grasp_obstructions(self.hand),
            *approach_obstructions(self.hand),
            unusable_reason(self.hand),
            "" if self.grasp is None else unseen_patches(self.hand, self.grasp.contacts),
            format_unshaped_links(self.hand),
            fragility_warning(self.robust, self.mu, self.label),
            excess_force_warning(self.needed, self.finger_limit),
            self.grip_warning,
            "the hand cannot squeeze the body" if no_squeeze else "",
            self.beyond_effort,
        )
        return list(filter(None, warnings))

    @property
    def title(self) -> str:
        """Name of the problem and status as one line of text."""
        return f"{self.name}: {self.told}"

    def quality_lines(self) -> list[str]:
        """Return text lines about certified quality, optimality gap, forces and hand."""
        lines = [*filter(None, [self.grip_line()]), *format_quality(self._quality, self.task.paper_beta, self.budget)]
        margins = [] if self._joint_margins is None else format_joint_margins(self._joint_margins)
        needed = [*self.needed_lines(), *filter(None, [self.friction_line()])]
        return [f"  {line}" for line in (*lines, *needed, *self.lines_by_hand(), *margins)]

    def needed_lines(self) -> list[str]:
        """Return text lines about the finger forces for the task at full size; empty if unknown."""
        return [] if self.needed is None else self.needed.lines(self.budget, self.finger_limit, self.fingers)

    @property
    def holding(self) -> HoldingForce:
        """How the force that holds the task is counted, and the largest that is allowed."""
        return holding_force(self.problem, self.budget)

    def force_curve(self) -> list[ForceAtFriction]:
        """Return the least force at each friction, that of the contacts included; empty if unknown."""
        if self.friction is None:
            return []
        own = [] if self._least_force is None else [ForceAtFriction(self._contact_friction, self._least_force)]
        return sorted([*own, *self.friction.curve], key=lambda point: point.friction)

    def friction_line(self) -> str:
        """Return a text on the least friction with which the task is held; empty if unknown."""
        if self.friction is None or (self.grip is not None and not self.grip.holds):
            return ""
        return self.friction.words(self.holding, self._contact_friction, self._least_force)

    def grip_line(self) -> str:
        """Return a text on the grip force to set, its margin and its limit; empty if unknown."""
        return "" if self.grip is None else self.grip.words(self.max_force)

    @property
    def grip_warning(self) -> str:
        """Warning on the grip force: above its limit, without margin, or none that holds; empty if there is none."""
        return "" if self.grip is None else self.grip.warning(self.max_force)

    def starts_lines(self) -> list[str]:
        """Return text lines about how the starts ended, better starts passed over, and failed IPOPT calls."""
        mu = 0.0 if self._joint_margins is None else mu_before_margins(self._joint_margins)
        by_remaining = bool(self.solver.get("options", {}).get("maximise_robust"))
        if self.objective == "nu":  # no start was passed over for its mu
            return [*starts_lines(self.starts), *ipopt_lines(self.solver)]
        better = better_start_text(self.starts, self.winner, mu, self.label, by_remaining, self.squeeze is not None)
        return [*starts_lines(self.starts), *better, *ipopt_lines(self.solver)]

    def __str__(self) -> str:
        lines = [self.title, f"  {self.task_line()}"]
        if self.grasp is not None:
            lines += [*self.quality_lines(), *PlacedGrasp(self.grasp, self.faces, self.surface).lines(self.fingers)]
        elif self.bound is not None:
            lines.append(f"  {self.bound.line(0.0, self.label)}")
        if self.robust is not None:
            lines.append(f"  {self.robust}")
        if self.delta is not None:
            lines.append(f"  delta certified in {self.delta} (torque scale {self.delta.torque_scale:.4g} m)")
        if self.nu is not None:
            lines.append(f"  nu {self.nu}")
        lines += [f"  {measure}" for measure in self.measures]
        lines += [f"  {line}" for line in self.starts_lines()]
        lines += [f"  {price.words(self.label)}" for price in self.prices[:3]]
        if self.why_not is not None:
            lines += [f"  {line}" for line in (*self.why_not.reasons, *self.why_not.advice)]
        return "\n".join([*lines, *grasp_table(self.grasps, self.solver.get("keep", 1))])

    def __repr__(self) -> str:
        summary = "no grasp" if self.grasp is None else f"{self.label} in {self.mu}, {len(self.grasp)} contacts"
        return f"{type(self).__name__}({self.name!r}: {self.status.name.lower()}, {summary})"

    # Kept grasps and frames

    @property
    def grasps(self) -> tuple[FoundGrasp, ...]:
        """All kept grasps, best first; the first is the answer.

        Empty without a grasp.
        """
        return () if self.grasp is None else (self._answer, *self.others)

    def require_grasp(self) -> Grasp:
        """Return the grasp, or raise ``InputError`` if there is none.

        Raises
        ------
        InputError
            Where the solution has no grasp.
        """
        if self.grasp is None:
            ending = "" if self.status is Status.NO_GRASP else f" ({self.status.name.lower().replace('_', ' ')})"
            raise InputError("solution", f"no grasp{ending}", "a solution with a grasp")
        return self.grasp

    def select(self, accepts: Accepts) -> GraspSolution:
        """Return a copy whose answer is the best kept grasp that a function accepts.

        Parameters
        ----------
        accepts : callable
            Predicate of an ``ng.FoundGrasp``, for example whether an arm reaches it: returns True or False.

        Raises
        ------
        InputError
            Where it accepts none, raises, or returns something else; where no grasp was found.
        """
        return self.with_answer(first_accepted(self.grasps, accepts))

    def with_answer(self, kept: FoundGrasp) -> GraspSolution:
        """Return a copy with a given kept grasp as its answer.

        Data that hold for the first answer alone are removed.
        """
        if kept.grasp is self.grasp and kept.hand == self.hand:  # a gripper's flips and turns share the contacts
            return replace(self, others=(), stated_first=None)
        return replace(
            self,
            **{name: value for name, value in vars(kept).items() if name != "start"},
            status=_status_with(self.status, kept.hand),
            delta=None,
            nu=None,
            friction=None,
            measures=(),
            prices=(),
            kkt=None,
            bound=None if self.bound is None else replace(self.bound, stated_gap=None),
            drawing=None if self.drawing is None else replace(self.drawing, links=()),
            starts=tuple(start for start in self.starts if start.index == kept.start),
            best_start=kept.start,
            others=(),
            stated_first=None,
        )

    def in_frame(self, pose: Pose) -> SolutionInFrame:
        """Return the grasp in a world frame, given the body's pose in that frame.

        For an alternative grasp: ``solution.with_answer(solution.grasps[i]).in_frame(pose)``.

        Parameters
        ----------
        pose : (4, 4) array or mapping, (3, 3) array in the plane
            Pose of the body in the world, ``[[A, b], [0, 1]]``: a point x of the body is at ``A x + b``, metres; or a
            mapping with ``position`` and ``quaternion_wxyz`` or ``quaternion_xyzw``.

        Raises
        ------
        InputError
            When the pose is no rotation and translation, or no grasp was found.
        """
        grasp = self.require_grasp()
        return transform_grasp(
            self.name, pose, grasp, self.faces, self.task, self.mu, self.forces, self.hand, self.phases
        )

    # Display

    def show(self, path: str | Path | None = None, port: int | None = None, hand: Hand | None = None) -> Path | str:
        """Show the grasp in a browser, and return the address or the file of its page.

        With the extra ``view`` (viser), a local server shows a page with sliders for the task's wrenches, their size
        and the hand's approach; a script waits until Ctrl-C. Without the extra, with a port in use, or without a
        browser or display, a message says so, and the report is written to a file and opened if there is a browser.
        With a port, the page is served without a local browser too, for a remote one (``ssh -L 8080:127.0.0.1:8080``).

        Parameters
        ----------
        path : str or Path, optional
            An HTML file: the report is written there instead.
        port : int, optional
            Of the page on this computer; a free one when left out.
        hand : Hand, optional
            The hand of the problem, for a slider over its approach: a solution does not contain the hand's file.

        Returns
        -------
        str or Path
            The address of the page on this computer, or the file.

        Raises
        ------
        InputError
            On a path that cannot be written, an invalid port, and another hand.
        """
        address = None if path is not None else live(self, LIVE, port, hand)
        return show(self, self.name, PAGE, path) if address is None else address

    def drawn(self) -> Drawing | None:
        """Return the drawing of the grasp, stored or made from a known problem; None if neither is possible."""
        problem = None if self.drawing is not None or self.grasp is None else self.known_problem
        if problem is None:
            return self.drawing
        from nlpgrasp.solution.stored_drawing import draw_problem

        return draw_problem(problem, self.hand)

    def require_drawing(self) -> Drawing:
        """Return the drawing of the grasp, stored or made now; raise ``InputError`` if neither is possible.

        Raises
        ------
        InputError
            Where there is no grasp; where no drawing is stored and the file lacks the data for one.
        """
        self.require_grasp()
        drawing = self.drawn()
        if drawing is None:
            expected = 'one with its drawing: ng.analyse(solution, "drawing", problem=problem) adds it'
            raise InputError("solution", "a grasp without a drawing, from a file without its body", expected)
        return drawing

    # Files

    def to_dict(self) -> Json:
        """Return the solution as JSON data, schema 1 (docs/json.md)."""
        solver = {**self.solver, "starts": to_json(self.starts)}
        versions = solver.pop("versions", {})
        data = {
            "schema": SCHEMA_NAME,
            "created_by": dict(versions),
            "status": self.status.name.lower(),
            "message": self.message,
            "name": self.name,
            "problem": dict(self.problem),
            "grasp": None if self.grasp is None else PlacedGrasp(self.grasp, self.faces, self.surface).to_dict(),
            "hand": None if self.hand is None else dict(self.hand),
            "quality": self._quality.to_dict(),
            "forces": to_json(held_wrenches(self.forces, self.moments)),
            "constraints": to_json(self.constraints),
            "shadow_prices": to_json(self.prices),
            "why_not": to_json(self.why_not),
            "drawing": to_json(self.drawing),
            "solver": solver,
        }
        if self.others:
            data["grasps"] = to_json(self.grasps)
        if self.kkt is not None:
            data["kkt"] = self.kkt.to_dict()
        return data if self.best_start is None else {**data, "best_start": self.best_start}

    @classmethod
    def from_dict(cls, data: Json, name: str = "solution") -> GraspSolution:
        """Return the solution that ``to_dict`` wrote.

        ``name`` is shown in messages, such as a file's path.

        Raises
        ------
        InputError
            When numbers contradict each other.
        """
        solution = _read_solution(data, name)
        _check_parts(solution, name)
        check_beta(data["quality"], solution.beta, f"{name}: quality")
        if data.get("message", solution.message) != solution.message:
            raise InputError(
                f"{name}: message", data["message"], f"that of its status and residuals: {solution.message}"
            )
        return solution

    def write_proof(self, path: str | Path, rtol: float = 0.01) -> Bounds:
        """Write a proof of the bounds on mu of the answer, which anyone can check (docs/proof_format.md).

        Parameters
        ----------
        path : str or Path
            File to write.
        rtol : float
            Largest relative width of the proved interval, which is narrower where the stated bounds require it.

        Returns
        -------
        Bounds
            The interval as proved: its lower end is at least that of ``mu``.

        Raises
        ------
        InputError
            When there is no grasp, nothing can be proved, as for a task given by a function, or no proof reaches the
            stated lower end.
        """
        rtol = number("rtol", rtol, above=0.0)
        proof = prove_stated(self.mu, self.require_grasp(), self.task, rtol, self.budget)
        write_bytes(path, proof.to_bytes())
        return proof.bounds.of_measure(self.kind, self.task.paper_beta)

    def save(self, path: str | Path, *, proof: bool = False) -> Path:
        """Write the solution to a JSON file (schema 1) atomically, and return its path.

        With ``proof`` a proof of the bounds on mu goes beside it, ``F.proof`` for ``F.json``, and ``verify`` finds it.

        The file contains a drawing of what it does not state whole: a mesh, an expression or a hand. A certificate of
        the global bound above 200 kB goes to a bound file beside it, ``F.bound.json`` for ``F.json``, which the
        solution names with its digest.

        Raises
        ------
        InputError
            When the folder does not exist or cannot be written, or the path is that of a mesh, a hand or a script;
            after the solution is written, when there is no proof.
        """
        bound = None if self.bound is None else self.bound.saved_beside(self.problem, Path(path))
        is_restorable = self.source is None or restore_problem(self.problem, self.grasp) is not None
        drawing = self.drawing if is_restorable else self.drawn()
        written = write_solution(replace(self, bound=bound, drawing=drawing).to_dict(), path)
        if proof:
            self.write_proof(Path(path).with_suffix(".proof"))
        return written

    @classmethod
    def load(cls, path: str | Path) -> GraspSolution:
        """Return the solution in a file that ``save`` wrote.

        Raises
        ------
        InputError
            When the file is missing, not JSON, too large, too deeply nested, or not of schema 1.
        """
        return cls.from_dict(read_solution_data(path), str(path))

    # Parts in the form of records

    @property
    def _answer(self) -> FoundGrasp:
        """The answer in the form of a kept grasp."""
        return FoundGrasp(
            self.require_grasp(),
            self.faces,
            self.mu,
            self.kind,
            self.hand,
            self.robust,
            self.forces,
            self.moments,
            self.needed,
            self.constraints,
            self.surface,
            self.best_start,
        )

    @property
    def _quality(self) -> Quality:
        """Quality measures as a record; mu with the paper's scale of the task."""
        scale = self.task.paper_beta if self.kind == "mu" and self.grasp is not None else None
        mu = self.mu.of_measure(self.kind, scale)
        further = self.robust, self.bound, self.needed, self.friction, self.measures
        return Quality(mu, self.kind, self.delta, self.nu, *further)

    @property
    def _contact_friction(self) -> float:
        """Friction coefficient of the contacts."""
        return common_friction(self.require_grasp().contacts)

    @property
    def _least_force(self) -> Bounds | None:
        """Least force that holds the task, as ``holding`` counts it; None where none is known to."""
        if self.holding.jaws:
            return self.grip.force if self.grip is not None and self.grip.holds else None
        return Bounds(1.0 / self.mu.upper, 1.0 / self.mu.lower) if self.mu.lower > 0.0 else None

    @property
    def _efforts(self) -> JointSqueeze | None:
        """Joint efforts for the task's hardest wrench; None if these or all effort limits are unknown."""
        return None if self.needed is None else task_efforts(self.squeeze, self.needed, self.budget)

    @property
    def _joint_margins(self) -> Json | None:
        """Joint-limit margins as JSON data of the hand; None if there are none."""
        return (self.hand or {}).get("room")


def _read_solution(data: Json, name: str) -> GraspSolution:
    """Return the solution of a file's data, without checks that its parts fit each other."""
    placed = None if data["grasp"] is None else PlacedGrasp.from_dict(data["grasp"], f"{name}: grasp")
    dimension = None if placed is None else placed.grasp.dimension
    quality = Quality.from_dict(data["quality"], dimension, f"{name}: quality")
    forces, moments = forces_and_moments(data.get("forces", []), name)
    starts, best_start, solver = read_starts(data, name)
    why_not, kkt = data.get("why_not"), data.get("kkt")
    grasps = read_kept_grasps(data, f"{name}: grasps")
    return GraspSolution(
        status=Status[data["status"].upper()],
        name=data["name"],
        problem=data["problem"],
        **({} if placed is None else vars(placed)),
        **vars(quality),
        forces=forces,
        moments=moments,
        constraints=tuple(map(ConstraintReport.from_dict, data.get("constraints", []))),
        prices=tuple(map(ShadowPrice.from_dict, data.get("shadow_prices", []))),
        kkt=None if kkt is None else KKT.from_dict(kkt, f"{name}: kkt"),
        why_not=None if why_not is None else WhyNot.from_dict(why_not, f"{name}: why_not"),
        hand=data.get("hand"),
        drawing=Drawing.from_dict(data.get("drawing"), f"{name}: drawing"),
        starts=starts,
        best_start=best_start,
        others=tuple(grasps[1:]),
        stated_first=grasps[0] if grasps else None,
        solver={**solver, "versions": data.get("created_by", {})},
    )


def _check_parts(solution: GraspSolution, name: str) -> None:
    """Raise ``InputError`` if parts of a solution do not fit each other.

    ``name``, that of the file, is put before the field.
    """
    kept_grasps = (solution.stated_first, *solution.others) if solution.stated_first is not None else ()
    for grasp in (solution.grasp, *(entry.grasp for entry in kept_grasps)):
        solution.check_against(grasp, name)
    needed, grasp = solution.needed, solution.grasp
    if needed is not None and grasp is not None and needed.forces.shape != grasp.points.shape:
        given = f"forces of shape {needed.forces.shape}"
        raise InputError(f"{name}: quality.forces_needed.fingers", given, f"one force a contact, {grasp.points.shape}")
    with prefix_errors(f"{name}: "):
        _ = solution.grip, solution.squeeze, solution.phases, solution.link_depth, solution.way_in


def _status_with(status: Status, hand: Json | None) -> Status:
    """Return the status of a solution after its answer is replaced by a grasp with this hand data."""
    if status not in (Status.SOLVED, Status.OPTIMAL, Status.TOUCHES):
        return status
    return Status.SOLVED if links_are_free(hand) else Status.TOUCHES


def require_solution(value: object) -> GraspSolution:
    """Return the argument if it is a solution, else raise ``InputError`` with advice."""
    if isinstance(value, GraspSolution):
        return value
    if isinstance(value, SolutionInFrame):
        raise InputError("solution", repr(value), "the GraspSolution that in_frame was asked of, in the body's frame")
    source = "a GraspSolution, which ng.solve returns and ng.GraspSolution.load reads"
    raise InputError("solution", value if isinstance(value, str) else f"a {type(value).__name__}", source)
