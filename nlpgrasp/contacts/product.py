"""The force domain of several contacts, ``K = K_1 x ... x K_k``: forces stacked contact by contact, as in G."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from nlpgrasp.common.validation import FloatArray
from nlpgrasp.contacts.base import ContactModel


def ranges(contacts: Sequence[ContactModel], space: int) -> list[slice]:
    """Return where each contact's components stand among all finger forces."""
    ends = np.cumsum([0] + [c.components(space) for c in contacts])
    return [slice(int(a), int(b)) for a, b in pairwise(ends)]


def extremes(z: FloatArray, contacts: Sequence[ContactModel], space: int) -> tuple[FloatArray, FloatArray]:
    """Return each contact's largest work of unit normal force, (m, k), and the forces, (m, n)."""
    if all(c == contacts[0] for c in contacts):
        shape = (len(z), len(contacts), contacts[0].components(space))
        values, forces = contacts[0].extreme(z.reshape(shape))
        return values, forces.reshape(z.shape)
    parts = [c.extreme(z[:, where]) for c, where in zip(contacts, ranges(contacts, space), strict=True)]
    return np.stack([p[0] for p in parts], axis=1), np.concatenate([p[1] for p in parts], axis=1)


def project(z: FloatArray, contacts: Sequence[ContactModel], space: int) -> FloatArray:
    """Return the projection of finger forces (m, n) onto K."""
    if all(c == contacts[0] for c in contacts):
        shape = (len(z), len(contacts), contacts[0].components(space))
        return contacts[0].project(z.reshape(shape)).reshape(z.shape)
    parts = [c.project(z[:, where]) for c, where in zip(contacts, ranges(contacts, space), strict=True)]
    return np.concatenate(parts, axis=1)
