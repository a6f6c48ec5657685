"""The force domain of several contacts, ``K = K_1 x ... x K_k``: forces stacked contact by contact, as in G."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from scipy.linalg import block_diag

from nlpgrasp.common.validation import FloatArray
from nlpgrasp.contacts.base import ContactModel


def ranges(contacts: Sequence[ContactModel], space: int) -> list[slice]:
    """Return where each contact's components stand among all finger forces."""
    ends = np.cumsum([0] + [c.components(space) for c in contacts])
    return [slice(int(a), int(b)) for a, b in pairwise(ends)]


def lifted(contacts: Sequence[ContactModel], space: int) -> tuple[FloatArray, list[FloatArray]]:
    """Return A, (n, m), and (r, m) matrices M: K is ``A u`` where every ``M u`` is in a second-order cone."""
    parts = [c.generators(space) for c in contacts]
    ends = np.cumsum([0] + [part.shape[1] for part in parts])
    cones = []
    for contact, a, b in zip(contacts, ends[:-1], ends[1:], strict=True):
        for M in contact.cones(space):
            cones.append(np.zeros((len(M), int(ends[-1]))))
            cones[-1][:, a:b] = M
    return np.asarray(block_diag(*parts)), cones


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


def into(z: FloatArray, contacts: Sequence[ContactModel], space: int) -> FloatArray:
    """Return finger forces of K next to the projection of finger forces (m, n)."""
    parts = [c.into(z[:, where]) for c, where in zip(contacts, ranges(contacts, space), strict=True)]
    return np.concatenate(parts, axis=1)
