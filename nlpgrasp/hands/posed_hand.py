"""Base class of hands whose pose is a variable."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping, Sequence

import numpy as np

from nlpgrasp.common.types import Expression, Json
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.hands.base import Hand, Values


class PosedHand(Hand):
    """A hand whose pose and posture are variables with random starting values."""

    @property
    def follows_contacts(self) -> bool:
        """False, because the hand has a pose of its own."""
        return False

    @abstractmethod
    def draw(self, count: int, around: FloatArray, rng: np.random.Generator) -> tuple[Values, FloatArray]:
        """Return random values of the variables, (count, m) each, and the fingertips' centres, (count, k, space).

        Parameters
        ----------
        count : int
        around : (count, space) array
            Centroids of the fingertips, metres, body frame.
        rng : numpy.random.Generator
        """

    @abstractmethod
    def reach(self, places: FloatArray, near: int, rng: np.random.Generator) -> tuple[Values, FloatArray]:
        """Return values of the variables with the fingertips near some places, and the fingertips' centres.

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
        """Return a point of each fingertip, (space,) each, metres, body frame."""

    @abstractmethod
    def contact_motion(
        self, variables: dict[str, Expression], rates: Expression, points: Sequence[Expression]
    ) -> list[tuple[Expression, Expression]]:
        """Return velocity and angular velocity, (3,) each, body frame, of contact points fixed to their links.

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
        """Return contact Jacobians (k, 6, m): velocities of points (k, 3), metres, per rate of the loaded joints."""

    @abstractmethod
    def values_of(self, posture: Json) -> Values:
        """Return the variables' values in a posture in the format of ``describe``.

        Raises
        ------
        InputError
            When the posture lacks what this hand needs.
        """

    def values_at(self, posture: Json, points: FloatArray) -> Values:
        """Return the same with the fingertips' patch coordinates, if any, at contacts (k, 3), metres."""
        del points
        return self.values_of(posture)
