"""Grasps with fixed contacts, single or stacked: contact frames, ``T_f``, ``B`` and the grasp map ``G = T_f B``."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import cached_property
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from nlpgrasp.common.spatial import (
    UNIT_TOLERANCE,
    Pose,
    coordinate_size,
    rigid_transform,
    wrench_dimension,
    wrench_transform,
)
from nlpgrasp.common.user_warnings import is_called_by_user, warn
from nlpgrasp.common.validation import LONGEST_BODY, BoolArray, FloatArray, array, number, read_only
from nlpgrasp.contacts import ContactModel
from nlpgrasp.errors import InputError

ROUNDING = 1e-15  # deviation from unit norm within which normals are kept unchanged
AWAY = np.cos(np.pi / 4.0)  # cosine of the angle within which a normal points away from the mean
LONG_SPAN = 4.0  # m, median distance of a grasp's farthest contacts above which they seem not to be in metres
UNIT_RATIO = 30.0  # ratio of a grasp's size to the median above which units seem to be mixed


class ContactArrays:
    """Base of grasps and stacks of grasps: k contact models with points, normals and a torque origin.

    Attributes
    ----------
    points : (..., k, space) array
        Contact positions, metres, body frame.
    normals : (..., k, space) array
        Unit normals into the body.
    contacts : tuple of k ContactModel
    torque_origin : (space,) array
        Reference point of moments, metres, body frame.
    states_origin : bool
        Whether the torque origin was given, and is not the frame's by default.
    """

    _name: ClassVar[str]  # for messages
    _axes: ClassVar[int]  # number of array dimensions of ``points``
    _allowed: ClassVar[str]  # allowed shapes of ``points``, for messages

    def __init__(
        self,
        points: ArrayLike,
        normals: ArrayLike,
        contacts: ContactModel | Sequence[ContactModel],
        torque_origin: ArrayLike | None,
    ) -> None:
        p = array(f"{self._name}.points", points, (None,) * self._axes)
        k, space = p.shape[-2:]
        if space not in (2, 3) or k < 1:
            raise InputError(f"{self._name}.points", f"shape {p.shape}", self._allowed)
        n = unit_normals(f"{self._name}.normals", array(f"{self._name}.normals", normals, p.shape))
        self.contacts: tuple[ContactModel, ...] = contact_models(f"{self._name}.contacts", contacts, k, space)
        origin = np.zeros(space)
        if torque_origin is not None:
            origin = array(f"{self._name}.torque_origin", torque_origin, (space,))
        self.points, self.normals, self.torque_origin = read_only(p), read_only(n), read_only(origin)
        self.states_origin = torque_origin is not None

    @property
    def space(self) -> int:
        """Dimension of the points: 2 in the plane, 3 in space."""
        return int(self.points.shape[-1])

    @property
    def dimension(self) -> int:
        """Dimension d of wrench space: 3 in the plane, 6 in space."""
        return wrench_dimension(self.space)


def contact_models(
    field: str, contacts: ContactModel | Sequence[ContactModel], k: int, space: int
) -> tuple[ContactModel, ...]:
    """Return k validated contact models; a single model stands for all k."""
    try:
        models = (contacts,) * k if isinstance(contacts, ContactModel) else tuple(contacts)
    except TypeError:
        raise InputError(field, contacts, f"one contact model, or {k} of them") from None
    if len(models) != k or not all(isinstance(m, ContactModel) for m in models):
        raise InputError(field, f"{len(models)} entries", f"one contact model, or {k} of them")
    for model in models:
        model.components(space)
    return models


def unit_normals(field: str, normals: FloatArray) -> FloatArray:
    """Return normalised normals (..., space); raise if their norms deviate from 1 by more than 1e-6."""
    length = np.linalg.norm(normals, axis=-1)
    deviation = np.abs(length - 1.0)
    if deviation.size and np.max(deviation) > UNIT_TOLERANCE:
        index = np.unravel_index(int(np.argmax(deviation)), deviation.shape)
        label = f"contact {index[-1]}" + (f" of grasp {index[0]}" if len(index) > 1 else "")
        raise InputError(
            field,
            f"length {length[index]:.9g} at {label} (off by {length[index] - 1.0:+.3g})",
            "unit vectors (to 1e-6)",
        )
    # normalising twice could change a last digit, and files must round-trip: keep unit vectors unchanged
    return np.asarray(normals / np.where(deviation <= ROUNDING, 1.0, length)[..., None])


def do_all_point_away(points: FloatArray, normals: FloatArray) -> BoolArray:
    """Return whether all normals (..., k, space) of a grasp point away from the points' mean, within 45 degrees.

    This also holds for contacts in a cavity gripped from inside.
    """
    outward = points - points.mean(axis=-2, keepdims=True)
    is_away = np.sum(normals * outward, axis=-1) > AWAY * np.linalg.norm(outward, axis=-1)
    return np.asarray(np.all(is_away, axis=-1) & (points.shape[-2] > 1))


def _spans(points: FloatArray) -> FloatArray:
    """Return the distance of the farthest contacts of each grasp (b, k, space), (b,)."""
    spans = np.zeros(len(points))
    for i in range(points.shape[1]):
        spans = np.maximum(spans, np.max(np.linalg.norm(points - points[:, i : i + 1], axis=2), axis=1))
    return spans


def check_spans(name: str, points: FloatArray) -> None:
    """Raise for grasps (b, k, space) with contacts farther apart than the longest body that is taken."""
    spans = _spans(points)
    if len(spans) and spans.max() > LONGEST_BODY:
        farthest = int(np.argmax(spans))
        given = f"contacts {spans[farthest]:.3g} m apart (grasp {farthest} of {len(spans)})"
        allowed = f'at most {LONGEST_BODY:g} m: are these millimetres? unit="mm" (--unit mm) says so'
        raise InputError(f"{name}: points", given, allowed)


def warn_of_units_and_normals(name: str, points: FloatArray, normals: FloatArray) -> None:
    """Warn of grasps (b, k, space) whose points seem not to be in metres, or whose normals seem to point outwards.

    Warns
    -----
    UserWarning
        One sentence each: contacts more than 4 m apart in the median of the grasps, grasps more than 30 times as large
        as the median, and normals of a grasp that all point away from the mean of its contacts.
    """
    if not len(points):
        return
    span = _spans(points)
    median = float(np.median(span))
    indices = np.flatnonzero(span > UNIT_RATIO * median)
    if median > LONG_SPAN:
        unit = "metres, not millimetres or centimetres"
        warn(f"{name}.points: contacts {median:.3g} m apart, in the median; they have to be in {unit}")
    elif indices.size:
        first = f"grasp {indices[0]} has contacts {span[indices[0]]:.3g} m apart, the median {median:.3g} m"
        warn(f"{name}.points: units seem to be mixed, in {len(indices)} of {len(points)} grasps: {first}")
    is_away = np.flatnonzero(do_all_point_away(points, normals))
    if is_away.size:
        cases = f"of {is_away.size} of {len(points)} grasps, first {is_away[0]},"
        warn(
            f"{name}.normals: {cases} all point away from the middle of the contacts; they have to point into the body"
        )


class Grasp(ContactArrays):
    """A grasp: k contacts on a body (Definition 2-4).

    Parameters
    ----------
    points : (k, 2) or (k, 3) array
        Contact positions, metres, body frame.
    normals : same shape
        Unit normals pointing *into* the body; of unit norm within 1e-6, then normalised.
    contacts : ContactModel or sequence of k of them
        One model for all contacts, or one each.
    torque_origin : (2,) or (3,) array, optional
        Reference point of moments, metres; by default the frame's origin.
    tangents : (k, 1, 2) or (k, 2, 3) array, optional
        Unit tangents as rows; arbitrary by default. Quality measures depend on them only for line or rectangle contacts
        without a direction.
    force_unit : float
        lambda of (3.3-6): newtons per unit of force component (newton-metres for moments), at least zero.

    Raises
    ------
    InputError
        On shapes that do not match, NaN, a negative force unit, normals without unit norm (with the deviation), or a
        line or rectangle contact without a direction.

    Warns
    -----
    UserWarning
        When all normals point away from the contacts' mean, as outward normals do.
    """

    _name = "Grasp"
    _axes = 2
    _allowed = "shape (k, 2) or (k, 3) with at least one contact"

    def __init__(
        self,
        points: ArrayLike,
        normals: ArrayLike,
        contacts: ContactModel | Sequence[ContactModel],
        torque_origin: ArrayLike | None = None,
        tangents: ArrayLike | None = None,
        force_unit: float = 1.0,
    ) -> None:
        super().__init__(points, normals, contacts, torque_origin)
        self.force_unit = number("Grasp.force_unit", force_unit, at_least=0.0)
        n, k, space = self.normals, len(self.contacts), self.space
        if tangents is None:
            t = np.concatenate([m.tangents(n[i : i + 1]) for i, m in enumerate(self.contacts)])
        else:
            t = array("Grasp.tangents", tangents, (k, space - 1, space))
        frames = np.concatenate([n[:, None, :], t], axis=1)
        error = float(np.max(np.abs(frames @ frames.transpose(0, 2, 1) - np.eye(space))))
        if error > UNIT_TOLERANCE:
            raise InputError("Grasp.tangents", f"frames off orthonormal by {error:.3g}", "orthonormal contact frames")
        self.tangents = read_only(t)
        if is_called_by_user() and do_all_point_away(self.points, n):
            warn("Grasp.normals: all point away from the middle of the contacts; they have to point into the body")

    @property
    def frames(self) -> FloatArray:
        """Contact frames, (k, space, space): axes as columns, normal first."""
        return np.concatenate([self.normals[:, :, None], self.tangents.transpose(0, 2, 1)], axis=2)

    @property
    def mean_arm(self) -> float:
        """Root mean square distance of the contacts from the torque origin, metres; 1 if it is zero."""
        return float(np.sqrt(np.mean(np.sum((self.points - self.torque_origin) ** 2, axis=1)))) or 1.0

    @cached_property
    def T_f(self) -> FloatArray:
        """Wrench transformation matrix (2.3-6), (d, k d), given by the contact frames."""
        size = coordinate_size(self.points, self.torque_origin)
        return np.concatenate(list(wrench_transform(self.points - self.torque_origin, self.frames, size)), axis=1)

    @cached_property
    def B(self) -> FloatArray:
        """Constraint matrix (2.3-7), (k d, n), block diagonal, given by the contact models, times the force unit."""
        blocks = [self.force_unit * c.basis(self.space) for c in self.contacts]
        result = np.zeros((sum(b.shape[0] for b in blocks), sum(b.shape[1] for b in blocks)))
        row = column = 0
        for block in blocks:
            result[row : row + block.shape[0], column : column + block.shape[1]] = block
            row += block.shape[0]
            column += block.shape[1]
        return result

    @cached_property
    def G(self) -> FloatArray:
        """Grasp map (2.2-3), (d, n), from contact force components to body wrenches."""
        return read_only(self.T_f @ self.B)

    @cached_property
    def G_sizes(self) -> FloatArray:
        """Sums of the absolute products in the entries of G, (d, n), or more: they bound its rounding errors."""
        arms = np.full_like(self.points, 4.0 * coordinate_size(self.points, self.torque_origin))
        terms = np.abs(wrench_transform(np.zeros_like(arms), self.frames))
        terms[:, self.space :, : self.space] = arms[:, :1, None]
        return read_only(np.concatenate(list(terms), axis=1) @ np.abs(self.B))

    def contact_wrenches(self, x: FloatArray) -> FloatArray:
        """Return force and moment of each finger in the body frame, moments about the contact point.

        Parameters
        ----------
        x : (..., n) array
            Force components in the contact frames, newtons and newton-metres, as ``finger_forces`` returns them.

        Returns
        -------
        (..., k, d) array
            Newtons and newton-metres, one finger per row.
        """
        local = (x @ self.B.T).reshape(*np.shape(x)[:-1], len(self), self.dimension)
        turned = wrench_transform(np.zeros_like(self.points), self.frames)
        return np.asarray(np.einsum("kij,...kj->...ki", turned, local))

    def in_frame(self, pose: Pose) -> Grasp:
        """Return the grasp in another body frame, (2.5-4), with grasp map ``blockdiag(A, A) G``, (2.5-6).

        Torque origin, tangents and contact directions are transformed too. Quality measures are invariant if the task
        is also transformed (``task.in_frame``), (3.3-7a).

        Parameters
        ----------
        pose : (3, 3) array in the plane, (4, 4) in space, or mapping
            ``[[A, b], [0, 1]]``: a point x of this grasp's frame is ``A x + b`` in the other, metres; or a mapping with
            ``position`` and ``quaternion_wxyz`` or ``quaternion_xyzw``.

        Raises
        ------
        InputError
            When the pose is not a rigid transform of this space.
        """
        A, b = rigid_transform("pose", pose, self.space)
        models = [c.turned(A) for c in self.contacts]
        points, origin = self.points @ A.T + b, self.torque_origin @ A.T + b
        return Grasp(points, self.normals @ A.T, models, origin, self.tangents @ A.T, self.force_unit)

    def with_friction(self, factor: float) -> Grasp:
        """Return the grasp with all friction coefficients multiplied by a factor, above 0."""
        models = [contact.with_friction(factor) for contact in self.contacts]
        origin = self.torque_origin if self.states_origin else None
        return Grasp(self.points, self.normals, models, origin, self.tangents, self.force_unit)

    def scaled(self, factor: float) -> Grasp:
        """Return the grasp with forces scaled by a factor: its grasp map is ``factor G``, lambda G of (3.3-6).

        Contacts stay fixed: delta, mu, mu-tilde and mu_1 scale with ``factor``, nu with ``factor^d``.

        Parameters
        ----------
        factor : float
            lambda, at least zero.

        Raises
        ------
        InputError
            When the factor is negative or not finite.
        """
        unit = self.force_unit * number("factor", factor, at_least=0.0)
        return Grasp(self.points, self.normals, self.contacts, self.torque_origin, self.tangents, unit)

    def __repr__(self) -> str:
        kinds = ", ".join(c.kind for c in self.contacts)
        unit = "" if self.force_unit == 1.0 else f"; force_unit={self.force_unit:g}"
        return f"Grasp({len(self)} contacts: {kinds}; torque_origin={self.torque_origin.tolist()}{unit})"

    def __len__(self) -> int:
        return int(self.points.shape[0])


def _grasp_ids(ids: Sequence[str] | None, count: int) -> tuple[str, ...]:
    """Return the validated names of a stack's grasps."""
    if ids is None:
        return tuple(str(i) for i in range(count))
    names = tuple(str(name) for name in ids)
    if len(names) != count:
        raise InputError("GraspStack.ids", f"{len(names)} names", f"{count}, one for each grasp")
    check_distinct_names("GraspStack.ids", names)
    return names


def check_distinct_names(field: str, names: Sequence[str]) -> None:
    """Raise an InputError that names the field if two grasps have the same name."""
    if len(set(names)) < len(names):
        repeated = next(name for i, name in enumerate(names) if name in names[:i])
        raise InputError(field, f"{repeated!r} twice", "a name of its own for each grasp")


class GraspStack(ContactArrays):
    """A stack of b grasps with the same k contact models; a sequence of ``Grasp``.

    Parameters
    ----------
    points : (b, k, 2) or (b, k, 3) array
        Contact positions, metres, body frame.
    normals : same shape
        Unit normals pointing *into* the body; of unit norm within 1e-6, then normalised.
    contacts : ContactModel or sequence of k of them
        One model for all contacts, or one each.
    torque_origin : (2,) or (3,) array, optional
        Reference point of moments, metres; by default the frame's origin.
    ids : sequence of b str, optional
        Names of the grasps in tables; by default their numbers.

    Attributes
    ----------
    ids : tuple of b str
        Names of the grasps, pairwise distinct.

    Raises
    ------
    InputError
        On shapes that do not match, NaN, normals without unit norm (with the deviation), or ids that are repeated.

    Warns
    -----
    UserWarning
        On points that seem not to be in metres, and on normals that seem to point outwards.
    """

    _name = "GraspStack"
    _axes = 3
    _allowed = "shape (b, k, 2) or (b, k, 3), k at least 1"

    def __init__(
        self,
        points: ArrayLike,
        normals: ArrayLike,
        contacts: ContactModel | Sequence[ContactModel],
        torque_origin: ArrayLike | None = None,
        ids: Sequence[str] | None = None,
    ) -> None:
        super().__init__(points, normals, contacts, torque_origin)
        self.ids = _grasp_ids(ids, len(self.points))
        if is_called_by_user():
            warn_of_units_and_normals("GraspStack", self.points, self.normals)
        count, k, space = self.normals.shape
        if all(model == self.contacts[0] for model in self.contacts):
            flat = self.contacts[0].tangents(self.normals.reshape(-1, space))
            tangents = flat.reshape(count, k, space - 1, space)
        else:
            tangents = np.stack([m.tangents(self.normals[:, i]) for i, m in enumerate(self.contacts)], axis=1)
        self.tangents = read_only(tangents)  # (b, k, space - 1, space), unit rows

    @cached_property
    def G(self) -> FloatArray:
        """Grasp maps (2.2-3), (b, d, n)."""
        frames = np.concatenate([self.normals[:, :, None, :], self.tangents], axis=2).transpose(0, 1, 3, 2)
        size = coordinate_size(self.points, self.torque_origin)[..., None]
        full = wrench_transform(self.points - self.torque_origin, frames, size)
        maps = [full[:, i] @ model.basis(self.space) for i, model in enumerate(self.contacts)]
        return read_only(np.concatenate(maps, axis=2))

    def in_frame(self, pose: Pose) -> GraspStack:
        """Return the grasps in another body frame, (2.5-4); the pose as in ``Grasp.in_frame``."""
        A, b = rigid_transform("pose", pose, self.space)
        models = [c.turned(A) for c in self.contacts]
        return GraspStack(self.points @ A.T + b, self.normals @ A.T, models, self.torque_origin @ A.T + b, self.ids)

    def with_contacts(self, contacts: ContactModel | Sequence[ContactModel]) -> GraspStack:
        """Return the grasps with other contact models, one for all contacts or k of them."""
        origin = self.torque_origin if self.states_origin else None
        return GraspStack(self.points, self.normals, contacts, origin, self.ids)

    def __repr__(self) -> str:
        kinds = ", ".join(c.kind for c in self.contacts)
        return f"GraspStack({len(self)} grasps of {len(self.contacts)} contacts: {kinds})"

    def __len__(self) -> int:
        return len(self.points)

    def __getitem__(self, index: int) -> Grasp:
        return Grasp(self.points[index], self.normals[index], self.contacts, self.torque_origin, self.tangents[index])

    def __iter__(self) -> Iterator[Grasp]:
        return (self[i] for i in range(len(self)))
