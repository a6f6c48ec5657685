"""Rule-based choice of number and type of contacts, force and opening from a body's weight and size (Section 4)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from nlpgrasp.bodies import Body, Mesh
from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray, array, number
from nlpgrasp.contacts import ContactModel, FrictionContact, SoftContact
from nlpgrasp.errors import InputError
from nlpgrasp.hands import Hand, ParallelJaw
from nlpgrasp.problem.problem import GraspProblem
from nlpgrasp.solution.solution import GraspSolution
from nlpgrasp.tasks import Task, TaskEllipsoid, task_to_dict
from nlpgrasp.tasks.tools import WEIGHT

LARGEST_WIDTH, LARGEST_MASS = 0.07, 0.5  # metres, kilograms: 96 % of human grasp widths, 92 % of object masses
FINGERS, MOST_CONTACTS = 5, 12  # most contacts of a precision grasp, and of any: G_2 of (4-2) has twelve
LEAST_CLEARANCE, CLEARANCE_SHARE = 0.005, 0.1  # clearance on each side of the body: metres, share of its width
LONG, FLAT = 2.0, 3.0  # least ratios: longest over middle side, middle over shortest
SMALL, LARGE = 0.025, 0.05  # diameters of wraps, metres
DISTURBANCE = 0.1  # share of the weight: disturbance at the far end of the body
CELLS = 48  # cells along each side of the box in which a volume is counted
# sources of the rules; the first two are parts 1 and 2 of one study
FEIX_1 = "Feix, Bullock and Dollar 2014, DOI 10.1109/TOH.2014.2326871"
FEIX_2 = "Feix, Bullock and Dollar 2014, DOI 10.1109/TOH.2014.2326867"
CUTKOSKY = "Cutkosky 1989, DOI 10.1109/70.34763; the thresholds are this package's"
SALISBURY = "Salisbury and Craig 1982, DOI 10.1177/027836498200100102"
PRESSURE = "Howe and Cutkosky 1996, DOI 10.1177/027836499601500603: even pressure on a disc"
STATICS = "statics: each of k contacts on upright walls lifts friction times its normal force"
PAPER = "Li and Sastry 1986, Section 4: light tasks few contacts, heavy ones many"


@dataclass(frozen=True)
class Reason:
    """Rule and reference behind one part of a proposal.

    Parameters
    ----------
    what : str
        The proposal, with its value.
    rule : str
        The rule, with its numbers.
    source : str
        Reference.
    """

    what: str
    rule: str
    source: str

    def __str__(self) -> str:
        return f"{self.what}: {self.rule} ({self.source})"


@dataclass(frozen=True)
class FirstChoice:
    """Rule-based proposal for a grasp, not solved or certified.

    Parameters
    ----------
    body : Body
        The held body.
    mass : float
        Kilograms.
    grasp_type : {"precision", "power"}
        Fingertips alone, or links and palm as well.
    name : str
        The grasp's name in Cutkosky's taxonomy.
    contact : ContactModel
        Contact model of every contact.
    count : int
        Number of contacts.
    normal_force : float
        Required normal force of each contact, newtons, with the safety factor, if all contacts are on vertical walls
        and share the load evenly.
    opening : float
        Gripper opening, metres: the body's shortest side plus clearance on both sides.
    safety : float
        Factor on the forces that the weight requires.
    task : Task
        The weight, accelerations and a disturbance, about ``torque_origin``.
    torque_origin : (3,) tuple
        The centre of mass, metres, body frame.
    reasons : tuple of Reason
        Rule and source of each number.
    """

    body: Body
    mass: float
    grasp_type: str
    name: str
    contact: ContactModel
    count: int
    normal_force: float
    opening: float
    safety: float
    task: Task
    torque_origin: tuple[float, float, float]
    reasons: tuple[Reason, ...]

    @property
    def hand(self) -> Hand | None:
        """Parallel gripper for two contacts, or ``None`` (free fingertips) for more."""
        return ParallelJaw(self.opening) if self.count == 2 else None

    def problem(self) -> GraspProblem:
        """Return the problem to solve, with normal forces of at most 1 N.

        With this budget ``needed_force`` is in newtons.
        """
        return GraspProblem(
            self.body,
            [self.contact] * self.count,
            self.task,
            hand=self.hand,
            force_budget="per_finger",
            torque_origin=self.torque_origin,
            name=f"first choice: {self.name}",
        )

    def needed_force(self, solution: GraspSolution) -> float:
        """Return the normal force per contact that certainly exerts the task, times the safety factor, newtons.

        Raises
        ------
        InputError
            Where the solution has no grasp that exerts the task, or another budget than normal forces.
        """
        if not isinstance(solution, GraspSolution) or not solution.success:
            raise InputError("solution", solution, "a solution with a grasp that exerts the task's wrenches")
        if solution.budget.kind != "per_finger":
            raise InputError("solution", f"force budget {solution.budget.kind!r}", "'per_finger', as problem() has")
        return self.safety / solution.mu.lower

    def to_dict(self) -> Json:
        """Return the proposal as JSON data."""
        return {
            "mass": self.mass,
            "grasp_type": self.grasp_type,
            "name": self.name,
            "contact": self.contact.to_dict(),
            "count": self.count,
            "normal_force": self.normal_force,
            "opening": self.opening,
            "safety": self.safety,
            "task": task_to_dict(self.task),
            "reasons": [{"what": r.what, "rule": r.rule, "source": r.source} for r in self.reasons],
        }

    def __str__(self) -> str:
        lines = [f"{self.count} {self.contact.label} contacts, {self.grasp_type} grasp: {self.name}"]
        return "\n".join([*lines, *(f"  {reason}" for reason in self.reasons)])


@dataclass(frozen=True)
class _BodyData:
    """Body data and finger limits for the rules, SI units."""

    body: Body
    mass: float
    friction: float
    safety: float
    load: float
    finger_force: float
    pad_radius: float

    @property
    def sides(self) -> FloatArray:
        """Sides of the bounding box, (3,), metres, the shortest first."""
        return np.asarray(np.sort(self.body.bounds[1] - self.body.bounds[0]))

    def normal_force(self, count: int) -> float:
        """Return the normal force that each of ``count`` contacts needs, newtons."""
        return self.safety * self.load / (count * self.friction)


def first_choice(
    body: Body,
    *,
    friction: float,
    mass: float | None = None,
    density: float | None = None,
    center_of_mass: ArrayLike | None = None,
    up: ArrayLike = (0.0, 0.0, 1.0),
    acceleration: float = 2.0,
    safety: float = 2.0,
    finger_force: float = 10.0,
    pad_radius: float = 0.008,
) -> FirstChoice:
    """Propose a grasp from a body's size, weight and friction, with a rule and a reference for each part.

    These are rules of thumb: size, mass and task predict human grasp types in less than half of the cases (Feix et al.
    2014). They are a starting point: ``ng.solve(choice.problem())`` finds and certifies the contacts,
    ``ng.how_many_contacts`` and ``ng.choose_contact_types`` compare numbers and types.

    Parameters
    ----------
    body : Body
        In space. Its bounding box in its own frame counts as its size.
    friction : float
        Coulomb coefficient.
    mass, density : float
        Kilograms, or kilograms per cubic metre: one of the two.
    center_of_mass : (3,) array, optional
        Metres, body frame; the centre of volume when left out.
    up : (3,) array
        In the body frame.
    acceleration : float
        In any direction, m / s^2, at least 0.
    safety : float
        Factor on the normal forces, at least 1.
    finger_force : float
        Largest normal force of a finger, newtons.
    pad_radius : float
        Of a soft fingertip's contact patch, metres.

    Returns
    -------
    FirstChoice
        With a reason for each proposal.

    Raises
    ------
    InputError
        On planar bodies, neither or both of mass and density, and numbers out of range.
    """
    if not isinstance(body, Body) or body.space != 3:
        raise InputError("body", body, "a body in space such as ng.Box or ng.Mesh")
    kilograms = _mass(body, mass, density)
    centre = body.centroid if center_of_mass is None else array("center_of_mass", center_of_mass, (3,))
    upwards = array("up", up, (3,))
    if not np.linalg.norm(upwards) > 0.0:
        raise InputError("up", up, "a direction of some length")
    acceleration_bound = number("acceleration", acceleration, at_least=0.0)
    data = _BodyData(
        body,
        kilograms,
        number("friction", friction, above=0.0),
        number("safety", safety, at_least=1.0),
        kilograms * (WEIGHT + acceleration_bound),
        number("finger_force", finger_force, above=0.0),
        number("pad_radius", pad_radius, above=0.0),
    )
    return _make_proposal(data, centre, *_task(data, upwards / np.linalg.norm(upwards), acceleration_bound))


def _make_proposal(data: _BodyData, centre: FloatArray, task: TaskEllipsoid, task_reason: Reason) -> FirstChoice:
    """Return the proposal with the rule and the reference of each part."""
    count, count_reason = _fewest_contacts(data)
    contact, contact_reason = _contact_model(data, count)
    grasp_type, type_reason = _grasp_type(data, count)
    name = _choice_name(data, count, grasp_type)
    opening, opening_reason = _finger_opening(data)
    force = data.normal_force(count)
    formula = f"safety x mass x (g + a) / (contacts x friction) = {data.safety:g} x {data.load:.4g} N / "
    force_reason = Reason(f"{force:.3g} N a contact", f"{formula}({count} x {data.friction:g})", STATICS)
    name_reason = Reason(
        name, "by grasp type, number of contacts, and whether the body is long, flat or compact", CUTKOSKY
    )
    return FirstChoice(
        data.body,
        data.mass,
        grasp_type,
        name,
        contact,
        count,
        force,
        opening,
        data.safety,
        task.given_about(centre),
        (float(centre[0]), float(centre[1]), float(centre[2])),
        (count_reason, contact_reason, type_reason, name_reason, force_reason, opening_reason, task_reason),
    )


def _mass(body: Body, mass: float | None, density: float | None) -> float:
    """Return the validated mass, or the mass that follows from a density, kg."""
    if (mass is None) == (density is None):
        raise InputError("mass", f"mass {mass}, density {density}", "one of the two")
    if mass is not None:
        return number("mass", mass, above=0.0)
    return number("density", density, above=0.0) * volume_of(body)


def volume_of(body: Body) -> float:
    """Return the volume of a body, cubic metres.

    The volume of a mesh is exact; others are estimated by counting cells, to some percent.
    """
    if isinstance(body, Mesh):
        return abs(float(body.mesh.volume))
    lower, upper = body.bounds
    steps = [(np.arange(CELLS) + 0.5) / CELLS * (b - a) + a for a, b in zip(lower, upper, strict=True)]
    points = np.stack(np.meshgrid(*steps, indexing="ij"), axis=-1).reshape(-1, 3)
    return float(np.mean(body.signed_distance(points) < 0.0) * np.prod(upper - lower))


def _fewest_contacts(data: _BodyData) -> tuple[int, Reason]:
    """Return the least number of contacts that lift the load, at least three for a wide body, with the reason."""
    least_count = 2 if data.sides[0] <= LARGEST_WIDTH else 3
    sufficient_count = int(np.ceil(data.safety * data.load / (data.friction * data.finger_force) - 1e-9))
    count = min(max(least_count, sufficient_count), MOST_CONTACTS)
    if data.normal_force(count) > data.finger_force * (1.0 + 1e-9):
        rule = f"even {MOST_CONTACTS} contacts need more than the {data.finger_force:g} N that a finger has"
        return count, Reason(f"{count} contacts", rule, PAPER)
    if count > least_count:
        rule = f"{count - 1} would each need {data.normal_force(count - 1):.3g} N, above {data.finger_force:g} N"
        return count, Reason(f"{count} contacts", rule, PAPER)
    side = f"the shortest side, {1e3 * data.sides[0]:.3g} mm, is"
    rule = (
        f"{side} at most {1e3 * LARGEST_WIDTH:g} mm"
        if least_count == 2
        else f"{side} above {1e3 * LARGEST_WIDTH:g} mm, too wide for two"
    )
    return count, Reason(f"{count} contacts", rule, FEIX_1)


def _contact_model(data: _BodyData, count: int) -> tuple[ContactModel, Reason]:
    """Return the contact model for a number of contacts, with the reason."""
    if count > 2:
        rule = "three points with friction, not on a line, hold a body; more only share the load"
        return FrictionContact(data.friction), Reason("hard fingers", rule, SALISBURY)
    radius = min(data.pad_radius, data.sides[1] / 4.0)
    torsion = 2.0 / 3.0 * data.friction * radius
    rule = "two hard fingers exert no torque about the line between them; torsion 2/3 x friction x radius of the patch"
    return SoftContact(data.friction, float(torsion)), Reason("soft fingers", rule, f"{SALISBURY}; {PRESSURE}")


def _grasp_type(data: _BodyData, count: int) -> tuple[str, Reason]:
    """Return ``"power"`` or ``"precision"``, with the reason."""
    if data.mass > LARGEST_MASS or count > FINGERS:
        rule = f"heavier than {LARGEST_MASS:g} kg" if data.mass > LARGEST_MASS else f"more than {FINGERS} contacts"
        return "power", Reason("power grasp", rule, FEIX_2)
    if data.sides[0] > LARGEST_WIDTH:
        return "power", Reason("power grasp", f"wider than {1e3 * LARGEST_WIDTH:g} mm", FEIX_2)
    rule = f"at most {LARGEST_MASS:g} kg, {1e3 * LARGEST_WIDTH:g} mm and {FINGERS} contacts: dexterity before strength"
    return "precision", Reason("precision grasp", rule, CUTKOSKY)


def _choice_name(data: _BodyData, count: int, grasp_type: str) -> str:
    """Return the name of the grasp type in Cutkosky's taxonomy."""
    short, middle, long = data.sides.tolist()
    is_flat, is_slender = middle >= FLAT * short, long >= LONG * middle
    if grasp_type == "power":
        if is_slender:
            return "small diameter" if short < SMALL else "large diameter" if short > LARGE else "medium wrap"
        return "power disk" if is_flat else "power sphere"
    if count == 2:
        return "thumb-index finger"
    if is_slender:
        return f"thumb-{count - 1} finger"
    if count == 3:
        return "tripod"
    return "precision disk" if is_flat else "precision sphere"


def _finger_opening(data: _BodyData) -> tuple[float, Reason]:
    """Return the opening of the fingers, metres, with the reason."""
    width = float(data.sides[0])
    clearance = max(LEAST_CLEARANCE, CLEARANCE_SHARE * width)
    rule = f"the shortest side, {1e3 * width:.3g} mm, and {1e3 * clearance:.3g} mm on both sides"
    source = f"{FEIX_1}: 94 % of grasps are across the shortest side; the room is this package's"
    return width + 2.0 * clearance, Reason(f"opening {1e3 * (width + 2.0 * clearance):.3g} mm", rule, source)


def _task(data: _BodyData, up: FloatArray, acceleration: float) -> tuple[TaskEllipsoid, Reason]:
    """Return the task of carrying the body against accelerations and a disturbance, with the reason.

    The task is about the centre of mass; the disturbance acts at the body's far end.
    """
    weight, arm = data.mass * WEIGHT, 0.5 * float(data.sides[-1])
    force, torque = data.mass * acceleration + DISTURBANCE * weight, DISTURBANCE * weight * arm
    task = TaskEllipsoid([force] * 3 + [torque] * 3, center=np.concatenate([weight * up, np.zeros(3)]))
    rule = f"weight {weight:.3g} N, with {force:.3g} N and {torque:.3g} N m in any direction about it"
    return task, Reason("task", rule, f"weight and inertia as in Section 4; a knock of {DISTURBANCE:.0%} of the weight")
