"""Records of the analyses of a grasp: robustness, infeasibility, shadow prices, joint-limit margins."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Annotated, Self

from nlpgrasp.common.formatting import format_lower, format_number, format_upper
from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import array, integer
from nlpgrasp.quality.bounds import Bounds
from nlpgrasp.quality.critical_friction import LARGEST, HoldingForce
from nlpgrasp.solution.record_fields import (
    LEFT_OUT,
    NULL_IF_INFINITE,
    Count,
    Form,
    NonNegative,
    Points,
    Record,
    Share,
    Wrench,
)

FRAGILE = 0.2  # remaining share of mu below which a grasp is fragile: the task then takes over five times the force
LEAST_SHARE = 1e-4  # smaller shares are written as "less than"
RANGE = " of range"  # suffix of the unit of a joint's limits, which have two sides
SMALL = 1e-6  # relative tolerance of a margin
WORTH_A_WORD = 0.005  # share of mu above which the cost of margins is reported


@dataclass(frozen=True)
class Robustness(Record):
    """Remaining quality under contact displacement and friction loss, at the worst displacement found.

    Parameters
    ----------
    offset : float
        Largest displacement of each contact along its face, metres.
    friction_share : float
        Largest relative loss of friction and torsional friction.
    mu : Bounds
        Certified, of the worst displacement found with the least friction: its upper bound holds for the worst case
        too.
    points, normals : (k, space) array
        The displaced contacts, metres, and unit inward normals, body frame.
    lost : tuple of int
        Contacts that slip over an edge of their face: they exert no force; their original positions are stated.
    stated_share : float or None
        Remaining share of mu as the solution states it; None in files of earlier versions.
    stated_fragile : bool or None
        Whether that share is below 0.2, a fragile grasp.
    """

    offset: NonNegative
    friction_share: Annotated[float, Form(minimum=0, exclusiveMaximum=1)]
    mu: Bounds
    points: Points = field(metadata={"key": "positions"})
    normals: Points
    lost: tuple[Count, ...] = field(default=(), metadata=LEFT_OUT)
    stated_share: Share | None = field(default=None, repr=False, compare=False, metadata={**LEFT_OUT, "key": "share"})
    stated_fragile: bool | None = field(
        default=None, repr=False, compare=False, metadata={**LEFT_OUT, "key": "fragile"}
    )

    def share(self, mu: Bounds) -> float:
        """Return the fraction of a grasp's certified quality that is left: the ratio of the upper bounds."""
        return min(self.mu.upper / mu.upper, 1.0) if mu.upper > 0.0 else 0.0

    def is_fragile(self, mu: Bounds) -> bool:
        """Return whether the fraction of quality that is left is below ``FRAGILE``, a fifth."""
        return self.share(mu) < FRAGILE

    def fragile_words(self, mu: Bounds, label: str) -> str:
        """Return a text on the fraction of a grasp's quality that is left.

        ``mu`` is the certified quality, ``label`` the name of the measure.
        """
        fraction = self.share(mu)
        negligible = f"less than {100.0 * LEAST_SHARE:g} %" if fraction > 0.0 else "nothing"
        remaining = f"{100.0 * fraction:.2g} %" if fraction >= LEAST_SHARE else negligible
        disturbance = f"contacts are {1e3 * self.offset:g} mm off and friction {100.0 * self.friction_share:g} % less"
        return f"fragile: {remaining} of {label} is left when {disturbance}"

    def beside(self, mu: Bounds) -> Robustness:
        """Return a copy that also stores remaining fraction and fragility for a grasp of certified quality ``mu``."""
        return replace(self, stated_share=self.share(mu), stated_fragile=self.is_fragile(mu))

    @classmethod
    def from_dict(cls, data: Json, name: str = "") -> Self:
        """Return the record that ``to_dict`` wrote.

        Raises
        ------
        InputError
            When its interval is empty or its arrays do not fit each other; ``name`` is shown in the message.
        """
        record = super().from_dict(data, name)
        array(f"{name}.normals", record.normals, record.points.shape)
        for contact in record.lost:
            integer(f"{name}.lost", contact, at_least=0, at_most=len(record.points) - 1)
        return record

    def __str__(self) -> str:
        disturbance = f"contacts {1e3 * self.offset:g} mm off and {self.friction_share:.0%} less friction"
        slipped = f"; {len(self.lost)} slip over an edge" if self.lost else ""
        return f"with {disturbance}, {self.mu} is left (worst case found{slipped})"


def fragility_warning(robust: Robustness | None, mu: Bounds, label: str) -> str:
    """Return a warning that a grasp is fragile, or an empty text if it is not or its robustness is unknown.

    Parameters
    ----------
    robust : Robustness or None
        Remaining quality of the grasp.
    mu : Bounds
        Certified quality of the grasp.
    label : str
        The measure's name.
    """
    return "" if robust is None or not robust.is_fragile(mu) else robust.fragile_words(mu, label)


@dataclass(frozen=True)
class ForceAtFriction(Record):
    """Least force that holds a task with one friction coefficient of all contacts.

    Parameters
    ----------
    friction : float
    force : Bounds
        Certified: newtons as the force budget counts them, of jaws the normal force of each; under torque limits a
        share of these. The upper end is enough for every larger friction.
    """

    friction: NonNegative
    force: Bounds


@dataclass(frozen=True)
class CriticalFriction(Record):
    """Least friction with which allowed forces hold a task, and the least force at other frictions than the contacts'.

    Parameters
    ----------
    least : Bounds
        Certified: the task is lost below the lower end, 0 where a thousandth of the contacts' friction is enough, and
        held above the upper end. Null in a file where no friction up to 10 is enough.
    curve : tuple of ForceAtFriction
        In the order of their frictions.
    """

    least: Bounds = field(default=Bounds(LARGEST, math.inf), metadata=NULL_IF_INFINITE)
    curve: tuple[ForceAtFriction, ...] = ()

    def words(self, holding: HoldingForce, friction: float, force: Bounds | None) -> str:
        """Return a text on the least friction, and on the force at two frictions.

        Parameters
        ----------
        holding : HoldingForce
            How the force is counted and limited.
        friction : float
            Of the contacts.
        force : Bounds or None
            Least force with it; None where none is known to hold the task.
        """
        if math.isinf(self.least.upper):
            return f"the task is lost with every friction up to {LARGEST:g}, {holding.scope} (certified)"
        lost = f" and is lost below {format_lower(self.least.lower)}" if self.least.lower > 0.0 else ""
        held = f"the task is held above friction {format_upper(self.least.upper)}{lost}, {holding.scope} (certified)"
        points = [] if force is None else [(friction, force)]
        points += [(point.friction, point.force) for point in self.curve[:1]]
        forces = [f"{format_upper(need.upper)} {holding.unit} at {format_number(at)}" for at, need in points]
        return f"{held}; it needs {' and '.join(forces)} ({holding.amount})" if forces else held


@dataclass(frozen=True)
class Conflict(Record):
    """A constraint that conflicts with the others.

    Parameters
    ----------
    name : str
        The constraint.
    row : str
        Its most violated scalar constraint.
    value, bound : float
        Value of that constraint at the point of least violation, and its limit.
    relation : {"at least", "at most", "exactly"}
        Required relation of the value to the bound.
    unit : {"", "m", "degrees"}
    """

    name: str
    row: str
    value: float
    bound: float
    relation: Annotated[str, Form(enum=["at least", "at most", "exactly"])]
    unit: str = ""

    @property
    def excess(self) -> float:
        """Violation of the bound: distance of the value beyond it."""
        return abs(self.value - self.bound)

    @property
    def amount(self) -> str:
        """Violation with its unit as text, lengths in millimetres."""
        return self._text(self.excess, 3)

    def __str__(self) -> str:
        return f"{self.row}: {self._text(self.value, 4)}, wanted {self.relation} {self._text(self.bound, 4)}."

    def _text(self, value: float, digits: int) -> str:
        scale, unit = (1e3, " mm") if self.unit == "m" else (1.0, f" {self.unit}" if self.unit else "")
        return f"{scale * value:.{digits}g}{unit}"


@dataclass(frozen=True)
class WhyNot(Record):
    """Infeasibility diagnosis: conflicting constraints, or a wrench direction along which no finger force does work.

    Parameters
    ----------
    conflicts : tuple of Conflict
        A minimal set of violated constraints; empty where all can be kept.
    direction : (d,) array or None
        Where the constraints can be kept: a direction y of wrench space along which no finger force does work.
    reasons, advice : tuple of str
        Sentences.
    locally_infeasible : bool
        Whether every start ended with violated constraints.
    """

    conflicts: tuple[Conflict, ...] = ()
    direction: Wrench | None = None
    reasons: tuple[str, ...] = ()
    advice: tuple[str, ...] = ()
    locally_infeasible: bool = False

    def __str__(self) -> str:
        return "\n".join([*self.reasons, *self.advice])


@dataclass(frozen=True)
class StatedMeasure(Record):
    """Value of a measure from outside the package (``GraspMeasure``).

    Parameters
    ----------
    name : str
    value : float
    unit : str
    """

    name: str
    value: float
    unit: str

    def __str__(self) -> str:
        return " ".join(filter(None, (self.name, format_number(self.value, 4), self.unit)))


@dataclass(frozen=True)
class ShadowPrice(Record):
    """Shadow price of a limit.

    Parameters
    ----------
    name : str
        The limit, for example ``"Spread.max"``.
    value : float
        Current limit, SI units.
    step : float
        Step of the limit, SI units.
    unit : str
        The step as text, for example ``"1 mm"``.
    gain : float
        First-order rise of mu with the step, on the solver's surface.
    """

    name: str
    value: float
    step: float
    unit: str
    gain: float

    @property
    def what(self) -> str:
        """Step of the limit as text, such as ``"raising Spread.max by 1 mm"``."""
        if self.unit.endswith(RANGE):
            return f"{self.unit.removesuffix(RANGE)} more at {self.name}"
        return f"raising {self.name} by {self.unit}"

    def words(self, label: str) -> str:
        """Return the effect of the step on a quality measure as text.

        ``label`` is the name of the measure.
        """
        return f"{self.what} changes {label} by {self.gain:+.3g}"

    def __str__(self) -> str:
        return self.words("mu")


@dataclass(frozen=True)
class JointMargins:
    """Required joint-limit margins, and the joints' distances from their limits.

    Parameters
    ----------
    margin : float
        The requested margin, radians.
    margins : mapping of str to float
        Margin of each free joint: at most a tenth of its range. Radians, metres for sliding joints.
    left : mapping of str to float
        Distance of each of them from its nearer limit.
    price : float
        Largest share of mu that might be traded for the margins.
    """

    margin: float
    margins: Mapping[str, float]
    left: Mapping[str, float]
    price: float

    @property
    def joints_near_limit(self) -> dict[str, float]:
        """Distance from the nearer limit of each joint that lacks its required margin."""
        required = {name: (1.0 - SMALL) * margin for name, margin in self.margins.items()}
        return {name: distance for name, distance in self.left.items() if distance < required[name]}

    def to_dict(self) -> Json:
        """Return the margins as JSON data."""
        return {
            "margin": self.margin,
            "margins": dict(self.margins),
            "near": self.joints_near_limit,
            "price": self.price,
        }


def mu_before_margins(margins: Json) -> float:
    """Return the mu before the search for joint-limit margins, from a file of an earlier version; else 0."""
    bounds = margins.get("mu_without")
    return 0.0 if bounds is None else float(bounds["upper"])


def format_joint_margins(margins: Json) -> list[str]:
    """Return text lines about the joints near a limit, from the data in ``hand.room``.

    For files of earlier versions, also about the loss of mu.
    """
    lines = []
    if margins["near"]:
        distances = (
            f"{name} ({distance:.2g} of {margins['margins'][name]:.2g})" for name, distance in margins["near"].items()
        )
        lines.append("joints near a limit: " + ", ".join(distances))
    if margins.get("cost", 0.0) > WORTH_A_WORD:
        lines.append(f"room to the joints' limits took {margins['cost']:.1%} of mu")
    return lines
