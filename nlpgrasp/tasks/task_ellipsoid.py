"""Task ellipsoids (Section 3.3.1), given or fitted to wrenches."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from nlpgrasp.common.formatting import vector
from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import SMALLEST, BoolArray, FloatArray, array, number, read_only
from nlpgrasp.errors import InputError
from nlpgrasp.tasks.base import Task
from nlpgrasp.tasks.enclosing_ellipsoid import GAP, EnclosingEllipsoid, enclose


class TaskEllipsoid(Task):
    """An ellipsoid of wrenches, ``{c + L u, |u| <= 1}`` with semi-axes as the columns of ``L``.

    Its support function is ``phi(y) = <c, y> + ||L^T y||``. A zero semi-axis gives a flat ellipsoid, which the
    quadratic form of (3.3-3) cannot express.

    Parameters
    ----------
    semi_axes : (m,) array
        Semi-axis lengths, in newtons and newton-metres, at least zero and not all zero.
    center : (d,) array, optional
        Centre c, newtons and newton-metres; by default the origin.
    directions : (m, d) array, optional
        Orthonormal directions of the semi-axes, one per row. By default the coordinate axes: m is then 3 (planar
        ``f_x, f_y, m_z``) or 6 (``f_x, f_y, f_z, m_x, m_y, m_z``).

    Attributes
    ----------
    center : (d,) array
        Newtons and newton-metres.
    axes : (m, d) array
        One semi-axis vector per row, in the same units.
    beta : float
        The paper's scale of the given set, (3.3-3): 1 for semi-axes, else the argument of ``from_quadratic``. ``mu`` is
        the scale of the given task; the paper's mu (3.3-4a) is that times beta.

    Raises
    ------
    InputError
        On shapes that do not match, negative lengths, directions that are not orthonormal, zero size.
    """

    kind: ClassVar[str] = "ellipsoid"
    center: FloatArray
    axes: FloatArray
    beta: float = 1.0

    def __init__(
        self, semi_axes: ArrayLike, center: ArrayLike | None = None, directions: ArrayLike | None = None
    ) -> None:
        lengths = array("TaskEllipsoid.semi_axes", semi_axes, (None,))
        if np.any(lengths < 0.0) or not np.any(lengths > SMALLEST):
            raise InputError("TaskEllipsoid.semi_axes", semi_axes, "lengths of at least 0, not all of them 0")
        if directions is None:
            if lengths.size not in (3, 6):
                raise InputError("TaskEllipsoid.semi_axes", semi_axes, "3 (planar) or 6 (spatial) lengths")
            axes = np.diag(lengths)
        else:
            rows = array("TaskEllipsoid.directions", directions, (lengths.size, None))
            if rows.shape[1] not in (3, 6):
                raise InputError("TaskEllipsoid.directions", f"shape {rows.shape}", "rows of length 3 or 6")
            error = float(np.max(np.abs(rows @ rows.T - np.eye(lengths.size))))
            if error > 1e-6:
                raise InputError("TaskEllipsoid.directions", f"rows off orthonormal by {error:.3g}", "orthonormal rows")
            axes = lengths[:, None] * rows
        self._set(axes, None if center is None else array("TaskEllipsoid.center", center, (axes.shape[1],)))

    def _set(self, axes: FloatArray, center: FloatArray | None) -> None:
        self.axes = read_only(axes)
        self.center = read_only(np.zeros(axes.shape[1]) if center is None else center)

    @classmethod
    def from_quadratic(cls, Q: ArrayLike, a: ArrayLike | None = None, beta: float = 1.0) -> TaskEllipsoid:
        """Return the ellipsoid ``{y : <y, Q y> + <a, y> <= beta^2}``, (3.3-3).

        The centre is ``-Q^-1 a / 2`` and the semi-axes are ``sqrt(beta^2 + <a, Q^-1 a>/4)`` over the square
        roots of Q's eigenvalues (docs/corrections.md: (3.4-4) is the support function of another set).

        Parameters
        ----------
        Q : (d, d) array
            Symmetric positive definite.
        a : (d,) array, optional
            By default zero.
        beta : float
            Greater than zero; stored in the task.

        Raises
        ------
        InputError
            When Q is not symmetric or not positive definite, shapes differ, or beta is not positive.
        """
        matrix = array("TaskEllipsoid.Q", Q, (None, None))
        rows = len(matrix)
        if matrix.shape not in ((3, 3), (6, 6)):
            raise InputError("TaskEllipsoid.Q", f"shape {matrix.shape}", "a 3 x 3 (planar) or 6 x 6 matrix")
        skew = float(np.max(np.abs(matrix - matrix.T)))
        if skew > 1e-9 * float(np.max(np.abs(matrix))):
            raise InputError("TaskEllipsoid.Q", f"a matrix off symmetric by {skew:.3g}", "a symmetric matrix")
        values, vectors = np.linalg.eigh(0.5 * (matrix + matrix.T))
        size = np.sqrt(np.maximum(np.diag(matrix), 0.0))  # force and torque have different units: equilibrate
        balanced = matrix / np.outer(size, size) if np.all(size > 0.0) else matrix
        if np.linalg.eigvalsh(0.5 * (balanced + balanced.T))[0] <= 1e-12 or values[0] <= 0.0:
            raise InputError("TaskEllipsoid.Q", f"smallest eigenvalue {values[0]:.3g}", "a positive definite matrix")
        linear = np.zeros(rows) if a is None else array("TaskEllipsoid.a", a, (rows,))
        beta = number("TaskEllipsoid.beta", beta, above=0.0)
        half = vectors @ ((vectors.T @ linear) / values) / 2.0  # Q^-1 a / 2
        radius = np.sqrt(beta**2 + 0.5 * float(linear @ half))
        return cls.from_axes((radius / np.sqrt(values))[:, None] * vectors.T, -half)._with_beta(beta)

    @classmethod
    def fit(
        cls,
        wrenches: ArrayLike,
        *,
        outliers: float = 0.0,
        probability: float | None = None,
        center: ArrayLike | None = None,
    ) -> TaskEllipsoid:
        """Return the minimum-volume ellipsoid around wrenches; see ``fit_ellipsoid``.

        Parameters
        ----------
        wrenches : (m, d) array
            Newtons and newton-metres.
        outliers : float
            Share of wrenches that may be left outside.
        probability : float, optional
            Instead, return the covariance ellipsoid that contains this share of normally distributed wrenches.
        center : (d,) array, optional
            Fixed centre, in the same units; free by default.
        """
        ellipsoid = enclose(wrenches, outliers, probability, center, GAP)
        return cls.from_axes(ellipsoid.axes, ellipsoid.center)

    @classmethod
    def from_axes(cls, axes: ArrayLike, center: ArrayLike | None = None) -> TaskEllipsoid:
        """Return the ellipsoid ``{c + sum_j u_j axes_j, |u| <= 1}``; semi-axes need not be orthogonal.

        Parameters
        ----------
        axes : (m, d) array
            Newtons and newton-metres.
        center : (d,) array, optional
            In the same units; by default the origin.
        """
        rows = array("task.axes", axes, (None, None))
        if rows.shape[1] not in range(1, 7) or rows.shape[0] < 1 or not np.any(rows):
            raise InputError("task.axes", f"shape {rows.shape}", "at least one non-zero row of length 3 or 6")
        result = cls.__new__(cls)
        result._set(rows, None if center is None else array("task.center", center, (rows.shape[1],)))
        return result

    @property
    def dimension(self) -> int:
        """Dimension d of wrench space: 3 in the plane, 6 in space."""
        return int(self.axes.shape[1])

    @property
    def is_centred(self) -> bool:
        """Whether the centre is the origin."""
        return not np.any(self.center)

    @property
    def paper_beta(self) -> float | None:
        """Scale ``beta`` if the ellipsoid is centred, so that (3.3-4a) applies; else ``None``."""
        return self.beta if self.is_centred else None

    def support(self, y: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the support ``<c, y> + ||L^T y||`` (m,) along ``y`` (m, d), and the maximisers (m, d)."""
        local = y @ self.axes.T  # (m, axes)
        size = np.sqrt(np.einsum("ij,ij->i", local, local))
        maximisers = self.center + (local / np.where(size > 0.0, size, 1.0)[:, None]) @ self.axes
        return y @ self.center + size, maximisers

    def transformed(self, matrix: FloatArray) -> TaskEllipsoid:
        """Return the linear image; ``matrix`` may lower the dimension."""
        return TaskEllipsoid.from_axes(self.axes @ matrix.T, matrix @ self.center)._with_beta(self.beta)

    def __mul__(self, factor: float) -> TaskEllipsoid:
        """Return the task and its beta scaled by a positive number."""
        scale = number("factor", factor, above=0.0)
        scaled = self.transformed(scale * np.eye(self.dimension))._set_origin(self.torque_origin)
        return scaled._with_beta(scale * self.beta)

    __rmul__ = __mul__

    def _moved(self, wrench: FloatArray) -> TaskEllipsoid:
        return TaskEllipsoid.from_axes(self.axes, self.center + wrench)._with_beta(self.beta)

    def _with_beta(self, beta: float) -> TaskEllipsoid:
        self.beta = beta
        return self

    def support_rows(self) -> tuple[bool, FloatArray]:
        """Return false, for an ellipsoid, and its centre and semi-axes (m + 1, d)."""
        return False, np.vstack([self.center, self.axes])

    def second_moment(self) -> FloatArray:
        """Return ``L L^T + c c^T``, (d, d)."""
        return self.axes.T @ self.axes + np.outer(self.center, self.center)

    def ends(self) -> FloatArray:
        """Return the end points ``c + axes`` and ``c - axes`` of the nonzero semi-axes, (2 m, d)."""
        axes = self.axes[np.any(self.axes != 0.0, axis=1)]
        return np.asarray(self.center + np.concatenate([axes, -axes]))

    def boundary(self, directions: FloatArray) -> FloatArray:
        """Return boundary wrenches ``c + L u_j``, (m, d), for unit vectors ``u`` (m, r) over the r semi-axes."""
        return self.center + directions @ self.axes

    def to_dict(self) -> Json:
        """Return centre, semi-axes and, if it is not 1, beta as JSON data."""
        data = {"type": self.kind, "center": self.center.tolist(), "axes": self.axes.tolist()}
        return data if self.beta == 1.0 else {**data, "beta": self.beta}

    @classmethod
    def from_dict(cls, data: Json) -> TaskEllipsoid:
        """Return the ellipsoid from the data of its ``to_dict``."""
        beta = number("task.beta", data.get("beta", 1.0), above=0.0)
        return cls.from_axes(data["axes"], data["center"])._with_beta(beta)

    def __repr__(self) -> str:
        beta = "" if self.beta == 1.0 else f", beta={self.beta:g}"
        center = f", center=[{vector(self.center, relative=0.0)}]" if np.any(self.center) else ""
        is_axis_aligned = np.array_equal(self.axes, np.diag(np.diag(self.axes)))  # the coordinate axes
        lengths = np.diag(self.axes) if is_axis_aligned else np.linalg.norm(self.axes, axis=1)
        rotation = "" if is_axis_aligned else ", directions=..."
        return f"TaskEllipsoid([{vector(lengths, relative=0.0)}]{center}{rotation}{beta})"

    def __eq__(self, other: object) -> bool:
        return (
            isinstance(other, TaskEllipsoid)
            and np.array_equal(self.axes, other.axes)
            and np.array_equal(self.center, other.center)
            and self.beta == other.beta
        )

    def __hash__(self) -> int:
        return hash((self.axes.tobytes(), self.center.tobytes(), self.beta))


@dataclass(frozen=True)
class EllipsoidFit:
    """Task ellipsoid fitted to wrenches, with a certified bound on its excess volume.

    Parameters
    ----------
    task : TaskEllipsoid
        The fitted ellipsoid.
    inside : (m,) bool array
        Which wrenches it contains.
    gap : float or None
        Certified relative excess of its volume over the minimum around the wrenches it was fitted to; ``None`` for a
        covariance.
    flat : (s, d) array
        Unit directions, components normalised by their extents, along which the wrenches are constant.
    """

    task: TaskEllipsoid
    inside: BoolArray
    gap: float | None
    flat: FloatArray

    @classmethod
    def of(cls, ellipsoid: EnclosingEllipsoid) -> EllipsoidFit:
        """Return the fit of an enclosing ellipsoid."""
        return cls(
            TaskEllipsoid.from_axes(ellipsoid.axes, ellipsoid.center), ellipsoid.inside, ellipsoid.gap, ellipsoid.flat
        )

    @property
    def share(self) -> float:
        """Fraction of the wrenches inside the ellipsoid."""
        return float(np.mean(self.inside))

    def __str__(self) -> str:
        volume = "" if self.gap is None else f", volume within {self.gap:.2g} of the least around those it keeps"
        return f"{self.share:.2%} of {len(self.inside)} wrenches inside{volume}"


def fit_ellipsoid(
    wrenches: ArrayLike,
    *,
    outliers: float = 0.0,
    probability: float | None = None,
    center: ArrayLike | None = None,
    gap: float = GAP,
) -> EllipsoidFit:
    """Return the minimum-volume ellipsoid around wrenches, or their covariance ellipsoid.

    Parameters
    ----------
    wrenches : (m, d) array
        Wrenches that the fingers are to exert, newtons and newton-metres, d = 3 (planar) or 6.
    outliers : float
        Share of the wrenches, below 0.5, that may be left outside: the farthest are trimmed iteratively until the
        choice is stable (a local optimum).
    probability : float, optional
        Instead, take the wrenches as normally distributed, and return the covariance ellipsoid that contains this
        share of them.
    center : (d,) array, optional
        Fixed centre, in the same units: zeros for a symmetric task.
    gap : float
        Certified relative excess of volume, the stopping tolerance.

    Raises
    ------
    InputError
        On shapes that do not match, wrenches that are not finite (the rows are named), or all equal.

    Warns
    -----
    UserWarning
        When the wrenches are constant along some directions: the ellipsoid is flat, and the directions are named.
    """
    return EllipsoidFit.of(enclose(wrenches, outliers, probability, center, gap))
