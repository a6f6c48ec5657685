"""Contacts and hand as given in a file, and comparison of its scalar constraints with recomputed ones.

A placement has contacts, hand and body, the latter two by the interfaces ``NumericHand`` and ``NumericBody``. From it
each part of the problem yields its scalar constraints (``ConstraintValue``), which ``check_stated_constraints`` matches
with those of the file.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.solution.records import ConstraintReport
from nlpgrasp.verify.check import NO_BODY, Check, NotCheckedError

ROUNDING = 1e-6  # tolerance of recomputed values, relative to the scale; rounding is below a thousandth of it
LIMIT_TOLERANCE = 1e-9  # relative tolerance of limits, which are the problem's numbers or their squares
FAR_FROM_LIMIT = 1e-2  # least distance from a limit of a constraint that cannot be active, relative to the scale
ON_LIMIT = 1e-8  # largest distance from a limit of a constraint that has to be active, relative to the scale
PROMISE = 1e-5  # the solver's feasibility tolerance, relative to the scale; ten times as much on a mesh


@dataclass(frozen=True)
class StatedPlacement:
    """Contacts and hand as given in a file.

    Parameters
    ----------
    points, normals : (k, space) arrays
        Metres, body frame; unit, into the body.
    size : float
        The body's characteristic length, metres, limited by the contacts' spread: the reference of tolerances.
    hand : NumericHand or None
    surface_of : callable
        Function of another body's JSON data to its ``NumericBody``.
    stated : mapping
        Stated values of all constraints, by name.
    """

    points: FloatArray
    normals: FloatArray
    size: float
    hand: NumericHand | None
    surface_of: Callable[[Json], NumericBody]
    stated: Mapping[str, float]

    @property
    def radii(self) -> Sequence[float]:
        """Radius of each fingertip, metres."""
        return [0.0] * len(self.points) if self.hand is None else self.hand.radii

    @property
    def tips(self) -> FloatArray:
        """Centres of the fingertips, (k, space): ``p - r n``."""
        return np.asarray(self.points - np.asarray(self.radii, dtype=float)[:, None] * self.normals)

    @property
    def palm(self) -> Palm:
        """The hand's palm pose."""
        palm = None if self.hand is None else self.hand.palm()
        if palm is None:
            raise NotCheckedError("the hand has no palm")
        return palm


def require_body(surface: NumericBody | None) -> NumericBody:
    """Return the body; raise ``NotCheckedError`` if it is missing."""
    if surface is None:
        raise NotCheckedError(NO_BODY)
    return surface


class NumericHand(Protocol):
    """Interface of numeric models of hands in one posture.

    Methods raise ``NotCheckedError`` for unknown results.
    """

    @property
    def radii(self) -> Sequence[float]:
        """Radius of each fingertip, metres; 0 for points and pads."""

    @property
    def has_links(self) -> bool:
        """Whether the hand has links and joints, which are checked separately."""

    @property
    def fixed_tip_kinds(self) -> Sequence[str | None]:
        """Kind of each fingertip that is fixed to a link; None for a free fingertip."""

    def palm(self) -> Palm | None:
        """Return the palm pose, or None if the hand has none."""

    def rows(self, placement: StatedPlacement) -> Iterable[ConstraintValue]:
        """Return the hand's scalar constraints on a placement, except limits."""

    def limits(self) -> Iterable[ConstraintValue]:
        """Return the limits of the hand's variables, which are not among a file's constraints."""


@dataclass(frozen=True)
class Palm:
    """Palm position and direction.

    Parameters
    ----------
    position : (3,) array
        Metres, body frame.
    approach : (3,) array or None
        Unit facing direction, body frame; None if not recorded.
    error : float
        Error bound of that direction, by the digits in the file.
    """

    position: FloatArray
    approach: FloatArray | None = None
    error: float = 0.0


class NumericBody(Protocol):
    """Interface of numeric models of bodies."""

    @property
    def bounds(self) -> FloatArray:
        """Bounding box, (2, space), metres."""

    def fit(self, face: str, point: FloatArray, normal: FloatArray, tip: str | None) -> Fit:
        """Return the deviation of a contact and its inward normal from a face.

        Parameters
        ----------
        face : str
            ``KeyError`` where the body has no such face.
        point, normal : (space,) arrays
        tip : str or None
            The kind of the posed fingertip at the contact, ``None`` for free contacts.
        """

    def distance(self, points: FloatArray) -> FloatArray:
        """Return the signed distances (m,) of points (m, space) from the body, metres, negative inside."""

    def edge_distance(self, face: str, point: FloatArray) -> float:
        """Return the distance of a face's point (space,) from the face's sharp edges, metres; infinite without any."""

    @property
    def rough(self) -> float:
        """Largest excess of the solver's distance from this body over the recomputed distance, metres.

        It is 0 where the solver's distance is exact, or a lower bound.
        """


@dataclass(frozen=True)
class Fit:
    """Deviation of a contact from a face: distance, normal and angle.

    Parameters
    ----------
    distance : float
        Distance of the contact from the face, metres.
    normal_difference : float or None
        Length of the difference between the stated inward normal and the face's; None where the fingertip may keep
        another normal than the face's.
    angle : float
        Angle of the stated normal to the mesh's, radians; an edge has all directions between its triangles' normals.
    """

    distance: float
    normal_difference: float | None
    angle: float = 0.0


@dataclass(frozen=True)
class ConstraintValue:
    """Scalar constraint ``lower <= value <= upper`` with a recomputed value.

    Parameters
    ----------
    name : str
        Name in the file.
    value : float or None
        In the constraint's own unit; None if unknown: then the stated value has to keep the limits.
    lower, upper : float
    scale : float
        Typical size of the value: tolerances are relative to it.
    error : float
        Error bound of the value by the digits in the file, in the constraint's own unit.
    stated_below : bool
        Whether the stated value may be smaller, as the solver uses a lower bound of some distances.
    measurement : float
        Largest difference of two measurements of the value, in the constraint's own unit: the stated value may be as
        much larger, but has to keep the limits itself.
    """

    name: str
    value: float | None
    lower: float = -np.inf
    upper: float = np.inf
    scale: float = 1.0
    error: float = 0.0
    stated_below: bool = False
    measurement: float = 0.0

    def limit_error(self, value: float, promise: float) -> str:
        """Return a message if a value violates the limits by more than the solver's tolerance, else an empty text."""
        slack = promise * self.scale + self.error + self.measurement
        is_within = self.lower - slack <= value <= self.upper + slack
        return "" if is_within else f"{self.name}: {value:.9g} is outside {self._limits}"

    def excess(self, stated: ConstraintReport) -> float:
        """Return the stored value of the constraint minus the recomputed one."""
        return 0.0 if self.value is None else stated.value - self.value

    def difference(self, stated: ConstraintReport) -> str:
        """Return a message if a stored constraint differs from the recomputed one, else an empty text."""
        if not (
            _agrees_within(stated.lower, self.lower, self.scale)
            and _agrees_within(stated.upper, self.upper, self.scale)
        ):
            return f"{self.name}: stated within [{stated.lower:g}, {stated.upper:g}], the problem says {self._limits}"
        excess = self.excess(stated)
        slack = ROUNDING * self.scale + self.error + self.measurement
        if (self.stated_below and excess < 0.0) or abs(excess) <= slack:
            return "" if self.value is None else self._activity_error(stated)
        return f"{self.name}: stated {stated.value:.9g}, recomputed {self.value:.9g}"

    def _activity_error(self, stated: ConstraintReport) -> str:
        """Return a message if the stored active flag contradicts the stored value, else an empty text.

        A solve calls a constraint active within 1e-4 of its scale from a limit, and the scale may differ here.
        """
        margin = min(stated.value - stated.lower, stated.upper - stated.value)
        if stated.multiplier != 0.0 and not stated.active:
            return f"{self.name}: a multiplier of {stated.multiplier:.3g} where no limit is active"
        if stated.active and margin > FAR_FROM_LIMIT * self.scale:
            return f"{self.name}: active, {margin:.3g} from its limits"
        return f"{self.name}: not active at its limit" if not stated.active and margin <= ON_LIMIT * self.scale else ""

    @property
    def _limits(self) -> str:
        return f"[{self.lower:g}, {self.upper:g}]"


def _agrees_within(stated: float, expected: float, scale: float) -> bool:
    """Return whether a stored limit equals the problem's, up to rounding."""
    return stated == expected or (
        np.isfinite(expected) and abs(stated - expected) <= LIMIT_TOLERANCE * max(abs(expected), scale)
    )


class StatedConstraints:
    """Scalar constraints in a file, each matched once with a recomputed one.

    Parameters
    ----------
    reports : iterable of ConstraintReport

    Attributes
    ----------
    unknown : list of str
        Names of the parts of the problem with constraints that were not recomputed.
    slack : dict
        Allowed violation of each recomputed constraint, by the report's identity.
    """

    def __init__(self, reports: Iterable[ConstraintReport]) -> None:
        self.unknown: list[str] = []
        self.slack: dict[int, float] = {}
        self._unmatched: dict[str, list[ConstraintReport]] = {}
        for report in reports:
            self._unmatched.setdefault(report.name, []).append(report)

    def match_next(self, name: str) -> ConstraintReport | None:
        """Return the next unmatched constraint with a name, or None if there is none."""
        reports = self._unmatched.get(name, [])
        return reports.pop(0) if reports else None

    def values(self) -> Mapping[str, float]:
        """Return the stored values of the unmatched constraints, by name.

        Of several constraints with the same name, the first.
        """
        return {name: reports[0].value for name, reports in self._unmatched.items() if reports}

    @property
    def unmatched(self) -> list[str]:
        """Names of the unmatched constraints."""
        return [name for name, reports in self._unmatched.items() for _ in reports]


def check_stated_constraints(
    name: str, constraints: Iterable[ConstraintValue], stated: StatedConstraints, promise: float
) -> Check:
    """Return the check that a file has the recomputed constraints, with their limits and values, all satisfied.

    Constraints are compared as they are computed: where one raises ``NotCheckedError``, those before it have been
    compared, and the check fails by them or is not made.
    """
    count, errors, reason = 0, [], ""
    largest_difference = 0.0
    try:
        for constraint in constraints:
            count += 1
            report = stated.match_next(constraint.name)
            if report is None:
                errors.append(f"{constraint.name}: not in the file")
                continue
            stated.slack[id(report)] = (promise + ROUNDING) * constraint.scale + constraint.error
            error = constraint.difference(report) or constraint.limit_error(
                report.value if constraint.value is None else constraint.value, promise
            )
            errors += [error] if error else []
            largest_difference = max(largest_difference, abs(constraint.excess(report)) / constraint.scale)
    except NotCheckedError as error_of_part:
        reason = str(error_of_part)
        stated.unknown += [] if error_of_part.every_row else [name]
    if errors:
        return Check(name, False, _format_errors(errors))
    summary = f"{count} row{'s' if count != 1 else ''} recomputed, relative difference {largest_difference:.1e}"
    if reason:
        return Check.not_made(name, f"{reason} ({summary})" if count else reason)
    return Check(name, True, summary)


def check_unstated_constraints(name: str, constraints: Iterable[ConstraintValue], promise: float) -> Check:
    """Return the check that recomputed constraints that are not in the file are satisfied."""
    values = list(constraints)
    errors = [
        error
        for constraint in values
        if constraint.value is not None and (error := constraint.limit_error(constraint.value, promise))
    ]
    return Check(name, not errors, _format_errors(errors) if errors else f"{len(values)} within their limits")


def _format_errors(errors: list[str], most: int = 4) -> str:
    """Return the first error texts and the number of the others, as text."""
    omitted = len(errors) - most
    return "; ".join(errors[:most]) + (f"; and {omitted} more" if omitted > 0 else "")
