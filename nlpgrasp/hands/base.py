"""Base classes of hands, with and without pose variables."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType

import casadi as ca
import numpy as np

from nlpgrasp.common.display import show
from nlpgrasp.common.registry import JsonPart
from nlpgrasp.common.scalar_constraints import PalmPose, ScalarConstraint, SymbolicCandidate
from nlpgrasp.common.types import Expression, Json
from nlpgrasp.common.validation import FloatArray

PAGE = ("nlpgrasp.report.hand_page", "write_hand")  # function that writes the HTML page


Values = dict[str, FloatArray]  # of the hand's variables, by name


@dataclass(frozen=True)
class HandVariable:
    """A vector of variables that a hand adds to the program, with limits.

    Parameters
    ----------
    name : str
    lower, upper : (m,) array
        Limits, in the hand's units.
    scale : float
        Typical size, for the solver's scaling.
    """

    name: str
    lower: FloatArray
    upper: FloatArray
    scale: float = 1.0


class Hand(JsonPart):
    """Base class of hands: variables and constraints of the program, with fingertip i at contact i.

    A hand either follows its contacts (``start``), or has a pose of its own from which a search begins: then it is
    a ``PosedHand``.

    Attributes
    ----------
    kind : str
        Name of this kind in files.
    count : int
        Number of fingertips.
    torque_limits : mapping of str to float
        By joint, newton-metres (newtons for sliding joints).
    """

    count: int
    torque_limits: Mapping[str, float] = MappingProxyType({})

    @property
    @abstractmethod
    def tip_radii(self) -> tuple[float, ...]:
        """Radius of each fingertip, metres; 0 for point contacts and for patches that are not round."""

    @property
    def follows_contacts(self) -> bool:
        """Whether the contacts alone determine the hand's variables."""
        return True

    @abstractmethod
    def variables(self, bounds: FloatArray) -> list[HandVariable]:
        """Return the variables that the hand adds, given the body's bounding box (2, space)."""

    def check(self, space: int) -> None:
        """Raise for bodies of a dimension that the hand cannot hold."""
        del space

    @abstractmethod
    def rows(self, placement: SymbolicCandidate, variables: dict[str, Expression]) -> list[ScalarConstraint]:
        """Return the constraints that the hand adds to the program."""

    def symbols(self, bounds: FloatArray) -> dict[str, Expression]:
        """Return a CasADi symbol for each of the hand's variables, by name, given the body's bounding box."""
        return {v.name: ca.SX.sym(v.name, len(v.lower)) for v in self.variables(bounds)}

    def start(self, tips: FloatArray) -> Values:
        """Return initial values of the variables by name, (..., m), for fingertip centres (..., k, space), metres."""
        return {}

    def tip_centres(self, variables: dict[str, Expression]) -> list[Expression | None]:
        """Return the centre of each round fingertip, body frame; None for other tips or without pose variables."""
        return [None] * self.count

    @property
    def loaded_joints(self) -> tuple[str, ...]:
        """Names of the joints that move a contact; empty for hands without joints."""
        return ()

    @property
    def closed_linkages(self) -> tuple[str, ...]:
        """Names of the equations that the joints keep, where joints form loops."""
        return ()

    @property
    def sliding_joints(self) -> dict[str, bool]:
        """Whether a joint that moves a contact is prismatic, by joint name."""
        return dict.fromkeys(self.loaded_joints, False)

    def palm(self, variables: dict[str, Expression]) -> PalmPose | None:
        """Return the palm's pose, or None for a hand without one."""
        return None

    def closing(self, positions: Sequence[Expression]) -> Expression | None:
        """Return the vector between the jaws of a gripper, metres; None for other hands."""
        return None

    def at_contacts(
        self,
        points: FloatArray,
        size: float,
        distance: Callable[[FloatArray], FloatArray],
        cones: Sequence[tuple[FloatArray, float]] = (),
    ) -> Json:
        """Return the JSON data of the hand that follow from the contacts; empty by default.

        Parameters
        ----------
        points : (k, space) array
            The contacts, metres, body frame.
        size : float
            Of the body, metres.
        distance : callable
            Points (m, space) to their distances (m,), metres, from what the hand has to keep away from: the body,
            tables, obstacles.
        cones : sequence of pairs
            A unit direction, (space,), and the angle, radians, that the approach is to be within of it.
        """
        return {}

    def describe(self, values: Values) -> Json:
        """Return the hand's part of a solution as JSON data, given values of the variables."""
        return {name: np.asarray(v).tolist() for name, v in values.items()}

    @property
    def shown_name(self) -> str:
        """Title of the HTML page that shows the hand."""
        return self.kind

    def show(self, path: str | Path | None = None) -> Path:
        """Write an HTML page that shows the hand, open it in a browser if there is one, and return its path.

        The page shows links, fingertips and movable joints, which fingertips can meet, and warnings about the
        file. It needs no network. Without a browser or a display, a message says where it is.

        Parameters
        ----------
        path : str or Path, optional
            Of the page, an HTML file; a temporary one when left out.

        Raises
        ------
        InputError
            For a hand without links, and for a path that cannot be written.
        """
        return show(self, self.shown_name, PAGE, path)


class PosedHand(Hand):
    """A hand whose pose and posture are variables of the program, with random initial values."""

    @property
    def follows_contacts(self) -> bool:
        """Always false: the hand has pose variables."""
        return False

    @abstractmethod
    def draw(self, count: int, around: FloatArray, rng: np.random.Generator) -> tuple[Values, FloatArray]:
        """Return random values of the variables, (count, m) each, and the fingertip centres, (count, k, space).

        Parameters
        ----------
        count : int
        around : (count, space) array
            Centroids of the fingertips, metres, body frame.
        rng : numpy.random.Generator
        """

    @abstractmethod
    def reach(self, places: FloatArray, near: int, rng: np.random.Generator) -> tuple[Values, FloatArray]:
        """Return variables that bring the fingertips near goals, by inverse kinematics, and the fingertip centres.

        Parameters
        ----------
        places : (g, k, space) array
            Goals for the centre of each fingertip, metres, body frame.
        near : int
            Poses for each of the g goals.
        rng : numpy.random.Generator

        Returns
        -------
        values : dict of str to (g near, m) array
        tips : (g near, k, space) array
        """

    @abstractmethod
    def tip_places(self, variables: dict[str, Expression]) -> list[Expression]:
        """Return one point of each fingertip, (space,) each, metres, body frame."""

    @abstractmethod
    def contact_motion(
        self, variables: dict[str, Expression], rates: Expression, points: Sequence[Expression]
    ) -> list[tuple[Expression, Expression]]:
        """Return velocity and angular velocity, (3,) each, body frame, of contact points that are fixed to their links.

        Parameters
        ----------
        variables : dict
        rates : (m,) expression
            Of the ``loaded_joints``.
        points : sequence of k (3,) expressions
            Metres, body frame.
        """

    @abstractmethod
    def contact_jacobians(self, values: Mapping[str, FloatArray], points: FloatArray) -> FloatArray:
        """Return contact Jacobians (k, 6, m): twists of points (k, 3), metres, per rate of the loaded joints."""

    @abstractmethod
    def values_of(self, posture: Json) -> Values:
        """Return the values of the hand's variables in a posture given in the format of ``describe``.

        Raises
        ------
        InputError
            When the posture lacks what this hand needs.
        """

    def values_at(self, posture: Json, points: FloatArray) -> Values:
        """Return the variables' values, patch coordinates included, for a posture and contacts (k, 3), metres."""
        del points
        return self.values_of(posture)
