"""Base class of grasps and grasp stacks: validated contacts with points and normals."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from nlpgrasp.common.spatial import UNIT_TOLERANCE, wrench_dimension
from nlpgrasp.common.validation import FloatArray, array, read_only
from nlpgrasp.contacts import ContactModel
from nlpgrasp.errors import InputError

ROUNDING = 1e-15  # deviation from unit norm within which normals are kept unchanged
AWAY = np.cos(np.pi / 4.0)  # cosine of the angle within which a normal points away from the mean


class ContactPlaces:
    """k contact models with points and normals, and a torque origin.

    Attributes
    ----------
    points : (..., k, space) array
        Contact positions, metres, body frame.
    normals : (..., k, space) array
        Unit normals into the body.
    contacts : tuple of k ContactModel
    torque_origin : (space,) array
        Reference point of moments, metres, body frame.
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
    """Return k validated contact models, from one or k of them."""
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
    off = np.abs(length - 1.0)
    if off.size and np.max(off) > UNIT_TOLERANCE:
        where = np.unravel_index(int(np.argmax(off)), off.shape)
        place = f"contact {where[-1]}" + (f" of grasp {where[0]}" if len(where) > 1 else "")
        raise InputError(
            field,
            f"length {length[where]:.9g} at {place} (off by {length[where] - 1.0:+.3g})",
            "unit vectors (to 1e-6)",
        )
    # normalising twice could change a last digit, and files must round-trip: keep unit vectors unchanged
    return np.asarray(normals / np.where(off <= ROUNDING, 1.0, length)[..., None])


def all_point_away(points: FloatArray, normals: FloatArray) -> bool:
    """Return whether all of several normals (k, space) point away from the points' mean, within 45 degrees.

    This also holds for contacts in a cavity gripped from inside.
    """
    away = points - points.mean(axis=0)
    return len(points) > 1 and bool(np.all(np.sum(normals * away, axis=1) > AWAY * np.linalg.norm(away, axis=1)))
