"""Base class of contact models."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, fields, replace
from typing import ClassVar, NamedTuple, Self

import numpy as np

from nlpgrasp.common.registry import Registry
from nlpgrasp.common.spatial import tangents as any_tangents
from nlpgrasp.common.types import Expression, Json, Ops
from nlpgrasp.common.validation import FloatArray, face_names, number
from nlpgrasp.errors import InputError

MISSING = float("nan")  # stands for a coefficient missing in a file: every model that needs it raises

Blocks = tuple[tuple[slice, float], ...]  # of components with coefficients c_j: ``|x_j| <= c_j x_n``


@dataclass(frozen=True)
class ContactModel(ABC):
    """A contact model: force components and force domain ``K_i``, a closed convex cone (Section 2.4).

    Force components are written in the contact frame, normal force first: some of
    ``(f_n, f_t1, f_t2, m_n, m_t1, m_t2)`` in space, of ``(f_n, f_t, m)`` in the plane. Methods marked *symbolic* use
    only arithmetic, so they accept CasADi expressions and numpy arrays. Each model has a ``kind``, its name in files,
    and is registered in ``nlpgrasp.contacts.registry``.

    Parameters
    ----------
    faces : str or sequence of str, optional
        Names of the body's faces this contact may use; ``None`` means all.
    """

    kind: ClassVar[str]
    unilateral: ClassVar[bool] = True  # whether it can only push; a bilateral contact can also pull
    faces: str | Iterable[str] | None = field(default=None, kw_only=True)

    def __new__(cls, *args: object, **parameters: object) -> Self:
        """Return a new contact; every model has to state its friction coefficients."""
        del args, parameters
        require_coefficients(cls)
        return super().__new__(cls)

    def __post_init__(self) -> None:
        object.__setattr__(self, "faces", face_names(f"{type(self).__name__}.faces", self.faces))

    @property
    def label(self) -> str:
        """Name of the model in tables."""
        return self.kind

    @abstractmethod
    def axes(self, space: int) -> tuple[int, ...]:
        """Return the indices of the contact-frame wrench components that the contact exerts, normal force first."""

    def components(self, space: int) -> int:
        """Return n_i, the number of force components in the plane (2) or in space (3)."""
        return len(self.axes(space))

    def basis(self, space: int) -> FloatArray:
        """Return the wrench basis ``B_i`` of (2.3-5) in the contact frame.

        Returns
        -------
        (3, n_i) array in the plane, (6, n_i) in space
            One column for each force component, contact frame.
        """
        return np.eye(3 if space == 2 else 6)[:, list(self.axes(space))]

    @property
    @abstractmethod
    def coefficients(self) -> dict[str, float]:
        """Friction coefficients by name of their fields, such as ``friction``; empty without friction.

        A loss of friction multiplies all of them.
        """

    def with_coefficients(self, **values: float) -> Self:
        """Return a copy with other friction coefficients.

        Raises
        ------
        InputError
            On an invalid value.
        """
        changes: Json = values
        return replace(self, **changes)

    def with_friction(self, factor: float) -> Self:
        """Return a copy with all friction coefficients multiplied by a factor.

        A contact without coefficients is returned itself.

        Raises
        ------
        InputError
            When the coefficients are no numbers by name of the model's fields.
        """
        name, values, known = f"{type(self).__name__}.coefficients", self.coefficients, {f.name for f in fields(self)}
        if not isinstance(values, Mapping) or not known.issuperset(values):
            raise InputError(name, values, f"numbers by name of its fields, among {', '.join(sorted(known))}")
        scaled = {key: factor * number(f"{name}[{key!r}]", value) for key, value in values.items()}
        return self.with_coefficients(**scaled) if scaled else self

    @property
    def needs_tangents(self) -> bool:
        """Whether the model needs a tangent direction that has not been given."""
        return False

    def tangents(self, normals: FloatArray) -> FloatArray:
        """Return unit tangents (b, space - 1, space) at contacts with inward normals (b, space)."""
        return any_tangents(normals)

    def turned(self, rotation: FloatArray) -> Self:
        """Return the contact in a rotated body frame, whose coordinates are ``rotation x``, (2.5-4)."""
        del rotation
        return self

    def isotropic_relaxation(self, space: int) -> ContactModel | None:
        """Return a contact whose force domain contains this one's and is symmetric about the normal; or None.

        The larger force domain is the same in all directions around the normal, so that the global bound needs no
        tangents. It is the contact itself where its own force domain is; ``None`` if none is known.
        """
        del space
        return None

    def has_domain_of(self, other: ContactModel, space: int) -> bool:
        """Return whether the force domain equals that of another contact, in contact-frame components."""
        del space
        names = [parameter.name for parameter in fields(self) if parameter.name != "faces"]
        return type(self) is type(other) and all(getattr(self, name) == getattr(other, name) for name in names)

    @abstractmethod
    def project(self, z: FloatArray) -> FloatArray:
        """Return the Euclidean projection of force components ``z`` (..., n_i) onto ``K_i``."""

    def into(self, z: FloatArray) -> FloatArray:
        """Return the projection of ``z`` (..., n_i) onto ``K_i``, moved inside if numerical errors leave it outside."""
        return self.project(z)

    def project_lifted(self, z: FloatArray) -> FloatArray:
        """Return variables u (..., m) in ``cones`` of which A u is the projection of ``z`` (..., n_i) onto ``K_i``.

        They are the projection itself; models with ``generators`` A of their own have others.
        """
        return self.project(z)

    @abstractmethod
    def derivative_entries(self, z: FloatArray) -> FloatArray:
        """Return the upper triangle of the matrix ``derivative``, row by row, (n_i (n_i + 1) / 2, ...)."""

    def derivative(self, z: FloatArray) -> FloatArray:
        """Return a generalised Jacobian (..., n_i, n_i) of the projection at ``z`` (..., n_i)."""
        n = z.shape[-1]
        result = np.empty((*z.shape, n))
        for (a, b), entry in zip(upper_triangle(n), self.derivative_entries(z), strict=True):
            result[..., a, b] = result[..., b, a] = entry
        return result

    def blocks(self, components: int) -> Blocks:
        """Return the blocks j of components and their coefficients c_j, with ``|x_j| <= c_j x_n``.

        Raises
        ------
        InputError
            If the force domain has another shape.
        """
        raise InputError("contacts", self, "contacts that press")

    def left_for_moments(self, normal: float, tangential: float) -> float:
        """Return the part of the normal force, newtons, that a tangential force leaves available for moments."""
        del tangential
        return normal

    def pyramid(self, components: int, edges: int, first_edge: float) -> FloatArray:
        """Return the edges of an inscribed friction pyramid as forces of unit normal force, (m, n_i).

        Parameters
        ----------
        components : int
            n_i.
        edges : int
            Number of edges around the normal.
        first_edge : float
            Angle of the first edge from the first tangent, radians.

        Raises
        ------
        InputError
            On models without a friction pyramid.
        """
        raise InputError("Grasp.contacts", self.kind, "point, friction or soft contacts in a friction pyramid")

    @abstractmethod
    def extreme(self, z: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return ``max <z, x>`` over x in ``K_i`` with normal force at most 1, and a maximiser.

        Returns
        -------
        values : (...) array
            At least zero.
        forces : (..., n_i) array

        Raises
        ------
        InputError
            When the set is unbounded, as for a bilateral contact.
        """

    def generators(self, space: int) -> FloatArray:
        """Return the matrix A, (n_i, m), with ``K_i = {A u : M u in a second-order cone for M in cones()}``."""
        return np.eye(self.components(space))

    @abstractmethod
    def cones(self, space: int) -> list[FloatArray]:
        """Return matrices M (r, m): ``M u`` must be in a second-order cone (for r = 1: nonnegative)."""

    @abstractmethod
    def split(self, x: Expression, normal: Expression) -> tuple[Expression, Expression]:
        """Return force and moment about the contact point from NLP variables ``x`` (symbolic, body frame).

        The moment is a scalar in the plane, a column in space, or ``None``.
        """

    @abstractmethod
    def membership(self, x: Expression, normal: Expression) -> list[tuple[str, Expression]]:
        """Return named expressions that are all nonnegative if and only if ``x`` is in ``K_i`` (symbolic)."""

    def squared_size(self, x: Expression, normal: Expression) -> Expression:
        """Return the squared norm of the force components, given NLP variables ``x`` (symbolic)."""
        return x.T @ x

    def squared_support(self, work: Work, ops: Ops) -> Expression | None:
        """Return the closed form of ``||P_K(z)||^2`` (symbolic), or None.

        ``work`` holds the needed parts of z; ``ops`` is ``numpy`` or ``casadi``.
        """
        return None

    def linear_support(self, work: Work, ops: Ops) -> Expression | None:
        """Return the largest ``<z, x>`` over forces x with unit normal force (symbolic), or None.

        With friction, ``z_n + friction |z_t|``. Arguments as in ``squared_support``. It may be negative; ``None`` if
        there is no closed form.
        """
        return None

    @abstractmethod
    def variables(self, space: int) -> int:
        """Return the number of NLP variables of the contact force."""

    def pressing(self, normal: FloatArray) -> FloatArray:
        """Return the NLP variables of a unit force along the inward normal ``(space,)``."""
        size = self.variables(normal.shape[0])
        return np.concatenate([normal, np.zeros(max(0, size - normal.shape[0]))])[:size]

    def normal_force(self, x: Expression, normal: Expression) -> Expression:
        """Return the normal force ``f_n``, given NLP variables ``x`` (symbolic)."""
        return normal.T @ self.split(x, normal)[0]

    @abstractmethod
    def to_dict(self) -> Json:
        """Return the model as JSON data: ``model``, its ``kind``, and its coefficients."""

    @classmethod
    @abstractmethod
    def from_dict(cls, data: Json) -> ContactModel:
        """Return the model from the data of its ``to_dict``; raise for missing coefficients."""


def require_coefficients(model: type[ContactModel]) -> None:
    """Raise ``InputError`` for a class of contact models that does not state its friction coefficients."""
    is_abstract = getattr(model.coefficients, "__isabstractmethod__", False)
    if is_abstract or not isinstance(model.coefficients, property):
        expected = "a property with the friction coefficients by name of their fields, {} without friction"
        raise InputError(f"{model.__name__}.coefficients", None, expected)


class Work(NamedTuple):
    """Work ``z = G_i^T y`` of a contact's unit forces on a twist y: normal, tangential and torsional parts.

    Numbers or symbols.

    Parameters
    ----------
    normal : expression
        ``z_n``.
    tangential, torsion : expression
        ``|z_t|`` and ``|z_torsion|``, at least zero.
    """

    normal: Expression
    tangential: Expression
    torsion: Expression


def upper_triangle(n: int) -> list[tuple[int, int]]:
    """Return the index pairs of a symmetric matrix's upper triangle, row by row."""
    return [(a, b) for a in range(n) for b in range(a, n)]


def unit_tangential_forces(count: int, first: float) -> FloatArray:
    """Return evenly spaced unit tangential forces (count, 3), the first at a given angle from the first tangent."""
    angles = first + 2.0 * np.pi * np.arange(count) / count
    return np.stack([np.zeros(count), np.cos(angles), np.sin(angles)], axis=1)


CONTACTS: Registry[ContactModel] = Registry("contact.model")


def contact_from_dict(data: Json) -> ContactModel:
    """Return a contact model of any registered type from the data of its ``to_dict``.

    Raises
    ------
    InputError
        When the model is unknown or a coefficient is missing or out of range.
    """
    name = data.get("model") if isinstance(data, Mapping) else data
    model = CONTACTS.find(name) if isinstance(data, Mapping) else None
    if model is None:
        raise CONTACTS.unknown(name)
    return model.from_dict(data)
