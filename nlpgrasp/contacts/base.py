"""What every contact model states about itself."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import ClassVar, Self

import numpy as np

from nlpgrasp.common.registry import Registry
from nlpgrasp.common.spatial import tangents as any_tangents
from nlpgrasp.common.types import Expression, Json, Ops
from nlpgrasp.common.validation import FloatArray, names
from nlpgrasp.contacts.cones.terms import Blocks, Work, upper_triangle
from nlpgrasp.errors import InputError

MISSING = float("nan")  # in place of a number that a file lacks: refused by every model that needs it


@dataclass(frozen=True)
class ContactModel(ABC):
    """A contact model: its force components and its force domain K_i, a closed convex cone (Section 2.4).

    Force components are written in the contact frame, normal force first: some of
    ``(f_n, f_t1, f_t2, m_n, m_t1, m_t2)`` in space, of ``(f_n, f_t, m)`` in the plane. Methods marked *symbolic* use
    arithmetic only, so that they serve CasADi expressions and numpy arrays alike. A kind has a ``kind``, its name in
    files, and is registered (``nlpgrasp.contacts.registry``); nothing else lists kinds.

    Parameters
    ----------
    faces : str or sequence of str, optional
        Names of the body's faces this contact may use; ``None`` means all.
    """

    kind: ClassVar[str]
    unilateral: ClassVar[bool] = True  # whether it presses only: a bilateral contact pulls too
    faces: str | Iterable[str] | None = field(default=None, kw_only=True)

    def __post_init__(self) -> None:
        object.__setattr__(self, "faces", names(f"{type(self).__name__}.faces", self.faces))

    @property
    def label(self) -> str:
        """Name of the model in tables."""
        return self.kind

    @abstractmethod
    def axes(self, space: int) -> tuple[int, ...]:
        """Return which components of a contact-frame wrench this model can exert, normal force first."""

    def components(self, space: int) -> int:
        """Return n_i, the number of independent force components in the plane (2) or in space (3)."""
        return len(self.axes(space))

    def basis(self, space: int) -> FloatArray:
        """Return ``B_i`` of (2.3-5): which contact-frame wrenches this model can exert.

        Returns
        -------
        (3, n_i) array in the plane, (6, n_i) in space
            One column for each force component, contact frame.
        """
        return np.eye(3 if space == 2 else 6)[:, list(self.axes(space))]

    @property
    def coefficients(self) -> dict[str, float]:
        """Coefficients that the model has: ``friction`` and ``torsional_friction`` (metres), by their names."""
        return {}

    def with_coefficients(self, **values: float) -> Self:
        """Return the contact with other coefficients, checked.

        Raises
        ------
        InputError
            On a value that the field does not allow.
        """
        changes: Json = values
        return replace(self, **changes)

    def with_friction(self, factor: float) -> Self:
        """Return the contact with friction and torsional friction times a factor; itself where it has neither."""
        scaled = {name: factor * value for name, value in self.coefficients.items()}
        return self.with_coefficients(**scaled) if scaled else self

    @property
    def needs_tangents(self) -> bool:
        """Whether the model has a direction along the surface that nobody has stated yet."""
        return False

    def tangents(self, normals: FloatArray) -> FloatArray:
        """Return unit tangents at contacts with these inward normals: (b, space) to (b, space - 1, space)."""
        return any_tangents(normals)

    def turned(self, rotation: FloatArray) -> Self:
        """Return the contact in a body frame of coordinates ``rotation x``, (2.5-4); itself without a direction."""
        del rotation
        return self

    @abstractmethod
    def project(self, z: FloatArray) -> FloatArray:
        """Return the Euclidean projection of force components ``z`` (..., n_i) onto K_i."""

    def into(self, z: FloatArray) -> FloatArray:
        """Return forces of K_i next to the projection of ``z`` (..., n_i), which iterations find to billionths."""
        return self.project(z)

    @abstractmethod
    def derivative_entries(self, z: FloatArray) -> FloatArray:
        """Return the upper triangle of ``derivative``, entries first and row by row, (n_i (n_i + 1) / 2, ...)."""

    def derivative(self, z: FloatArray) -> FloatArray:
        """Return the Jacobian of the projection at ``z`` (..., n_i), (..., n_i, n_i); at its kinks, one of them."""
        n = z.shape[-1]
        result = np.empty((*z.shape, n))
        for (a, b), entry in zip(upper_triangle(n), self.derivative_entries(z), strict=True):
            result[..., a, b] = result[..., b, a] = entry
        return result

    def blocks(self, components: int) -> Blocks:
        """Return blocks of components and how far unit normal force lets each go, ``|x_j| <= c_j x_n``.

        Raises
        ------
        InputError
            Where the force domain is of another shape.
        """
        raise InputError("contacts", self, "contacts that press")

    def left_for_moments(self, normal: float, tangential: float) -> float:
        """Return the normal force that moments have to themselves, newtons, beside a tangential force."""
        del tangential
        return normal

    def pyramid(self, components: int, edges: int, first_edge: float) -> FloatArray:
        """Return forces of unit normal force along the edges of a pyramid inside the cone, (m, n_i).

        Parameters
        ----------
        components : int
            n_i.
        edges : int
            Of the tangential force's circle.
        first_edge : float
            Angle of the first from the first tangent, radians.

        Raises
        ------
        InputError
            On models for which other tools have no pyramid.
        """
        raise InputError("Grasp.contacts", self.kind, "point, friction or soft contacts in a friction pyramid")

    @abstractmethod
    def extreme(self, z: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return ``max <z, x>`` over x in K_i with normal force at most 1, and a force that attains it.

        Returns
        -------
        values : (...) array
            At least zero.
        forces : (..., n_i) array

        Raises
        ------
        InputError
            When the set is unbounded: normal force does not limit a bilateral contact.
        """

    def generators(self, space: int) -> FloatArray:
        """Return A, (n_i, m): K_i is all ``A u`` with u in ``cones``."""
        return np.eye(self.components(space))

    @abstractmethod
    def cones(self, space: int) -> list[FloatArray]:
        """Return (r, m) matrices M: every ``M u`` is in a second-order cone (one row: at least 0)."""

    @abstractmethod
    def split(self, x: Expression, normal: Expression) -> tuple[Expression, Expression]:
        """Return the force and the moment about the contact point of NLP variables ``x`` (symbolic, body frame).

        The moment is a scalar in the plane, a column in space, or ``None``.
        """

    @abstractmethod
    def membership(self, x: Expression, normal: Expression) -> list[tuple[str, Expression]]:
        """Return named expressions that are all non-negative exactly when ``x`` is in K_i (symbolic)."""

    def squared_size(self, x: Expression, normal: Expression) -> Expression:
        """Return the squared length of the force components of NLP variables ``x`` (symbolic)."""
        return x.T @ x

    def squared_support(self, work: Work, ops: Ops) -> Expression | None:
        """Return ``||P_K(z)||^2`` in closed form (symbolic), or ``None`` when there is none.

        ``work`` is z, as far as it matters; ``ops`` is ``numpy`` or ``casadi``.
        """
        return None

    def linear_support(self, work: Work, ops: Ops) -> Expression | None:
        """Return the work of unit normal force at its best, ``z_n + mu |z_t|`` and so on (symbolic).

        Arguments as in ``squared_support``. Negative where no pressing pays; ``None`` when there is no closed form.
        """
        return None

    @abstractmethod
    def variables(self, space: int) -> int:
        """Return how many NLP variables carry this contact's force."""

    def pressing(self, normal: FloatArray) -> FloatArray:
        """Return the NLP variables of a unit force along the inward normal ``(space,)``."""
        size = self.variables(normal.shape[0])
        return np.concatenate([normal, np.zeros(max(0, size - normal.shape[0]))])[:size]

    def normal_force(self, x: Expression, normal: Expression) -> Expression:
        """Return ``f_n`` of NLP variables ``x`` (symbolic)."""
        return normal.T @ self.split(x, normal)[0]

    @abstractmethod
    def to_dict(self) -> Json:
        """Return the model as JSON data: ``model``, its ``kind``, and its coefficients."""

    @classmethod
    @abstractmethod
    def from_dict(cls, data: Json) -> ContactModel:
        """Return the model that ``to_dict`` wrote; coefficients that are missing are refused as ``MISSING`` is."""


CONTACTS: Registry[ContactModel] = Registry("contact.model")


def contact_from_dict(data: Json) -> ContactModel:
    """Return the contact model that ``to_dict`` wrote, of any registered kind.

    Raises
    ------
    InputError
        When the model is unknown or a coefficient is missing or out of range.
    """
    given = data.get("model") if isinstance(data, Mapping) else data
    model = CONTACTS.find(given) if isinstance(data, Mapping) else None
    if model is None:
        raise CONTACTS.unknown(given)
    return model.from_dict(data)
