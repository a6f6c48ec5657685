"""Velocity and force ellipsoids of a Jacobian from joint rates to twists."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from nlpgrasp.common.validation import FloatArray, array
from nlpgrasp.errors import InputError

RANK = 1e-9  # share of the largest singular value below which others count as zero


@dataclass(frozen=True)
class Transmission:
    """Linear map of joint rates to twists, ``twist = A rates``, and of wrenches to torques, ``A^T wrench``.

    By virtual work the least torques that exert a wrench w have norm ``|A^T w|``: rates of norm 1 reach the ellipsoid
    ``A {|q'| <= 1}`` of twists, torques of norm 1 the set ``{|A^T w| <= 1}`` of wrenches. Both have the same axes, with
    reciprocal lengths; a wrench orthogonal to all possible motions is borne by the structure and needs no torque.

    Parameters
    ----------
    matrix : (d, p) array
        A, unscaled: velocities in m/s and angular velocities in rad/s per unit of the joints' rates.
    torque_scale : float
        Metres: the length that makes angular velocities comparable with velocities, and torques with forces.
    space : int
        Number of components that are velocities.
    """

    matrix: FloatArray
    torque_scale: float
    space: int

    @property
    def scaled(self) -> FloatArray:
        """The matrix with angular velocities times the torque scale, (d, p), m/s."""
        scale = np.ones(len(self.matrix))
        scale[self.space :] = self.torque_scale
        return np.asarray(scale[:, None] * self.matrix)

    @property
    def singular_values(self) -> FloatArray:
        """Lengths of the scaled velocity ellipsoid's semi-axes, (d,), longest first, 0 for impossible motions."""
        d, p = self.matrix.shape
        found = np.zeros(d)
        values = np.linalg.svd(self.scaled, compute_uv=False) if p else np.zeros(0)
        found[: len(values)] = values
        found[found <= RANK * np.max(found, initial=0.0)] = 0.0
        return found

    @property
    def rank(self) -> int:
        """Dimension of the possible motions."""
        return int(np.count_nonzero(self.singular_values))

    @property
    def measure(self) -> float:
        """Yoshikawa's manipulability ``sqrt(det(A A^T))`` of the scaled matrix: 0 where some motion is impossible.

        DOI 10.1177/027836498500400201, equation (5).
        """
        return float(np.prod(self.singular_values))

    @property
    def isotropy(self) -> float:
        """Shortest over longest semi-axis, from 0 to 1: 1 where all motions are equally easy.

        The reciprocal of the condition number of Salisbury and Craig, DOI 10.1177/027836498200100102.
        """
        values = self.singular_values
        return float(values[-1] / values[0]) if values[0] > 0.0 else 0.0

    @property
    def condition(self) -> float:
        """Longest over shortest semi-axis; inf where some motion is impossible."""
        return 1.0 / self.isotropy if self.isotropy > 0.0 else np.inf

    @property
    def velocity_axes(self) -> FloatArray:
        """Semi-axes of the scaled ellipsoid of twists for rates of norm 1, (d, d), one per row, longest first."""
        return np.asarray(self.singular_values[:, None] * self._directions)

    @property
    def force_axes(self) -> FloatArray:
        """Semi-axes of the scaled set of wrenches for torques of norm 1, (d, d), in the same order: shortest first.

        inf in a direction that the structure bears without torque.
        """
        with np.errstate(divide="ignore", invalid="ignore"):
            lengths = 1.0 / self.singular_values
            axes = lengths[:, None] * self._directions
        return np.asarray(np.where(np.abs(self._directions) > 0.0, axes, 0.0))

    @property
    def _directions(self) -> FloatArray:
        d, p = self.matrix.shape
        return np.asarray(np.linalg.svd(self.scaled)[0].T) if p else np.eye(d)

    def velocity_ratio(self, twist: ArrayLike) -> float:
        """Return the largest multiple of a twist that rates of norm 1 reach; 0 where it is impossible (Chiu 1988).

        Parameters
        ----------
        twist : (d,) array
            m/s and rad/s. DOI 10.1177/027836498800700502.
        """
        wanted = self._direction("twist", twist)
        wanted[self.space :] *= self.torque_scale
        rates, *_ = np.linalg.lstsq(self.scaled, wanted, rcond=RANK)
        size = float(np.linalg.norm(rates))
        reached = np.linalg.norm(self.scaled @ rates - wanted) <= 1e-7 * np.linalg.norm(wanted)
        return 1.0 / size if reached and size > 0.0 else 0.0

    def force_ratio(self, wrench: ArrayLike) -> float:
        """Return the largest multiple of a wrench that torques of norm 1 exert; inf where the structure bears it.

        Parameters
        ----------
        wrench : (d,) array
            Newtons and newton-metres. Friction and unilateral contact are ignored:
            see ``hand_torques``.
        """
        w = self._direction("wrench", wrench)
        torques = float(np.linalg.norm(self.matrix.T @ w))
        size = float(np.linalg.norm(np.concatenate([w[: self.space], w[self.space :] / self.torque_scale])))
        return 1.0 / torques if torques > RANK * float(self.singular_values[0]) * size else np.inf

    def _direction(self, name: str, value: ArrayLike) -> FloatArray:
        """Return a twist or a wrench, (d,), refusing zero."""
        given = array(name, value, (len(self.matrix),))
        if not given.any():
            raise InputError(name, value, "some direction other than zero")
        return given
