"""Cartesian product of contact force domains, ``K = K_1 x ... x K_k``."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from scipy.linalg import block_diag

from nlpgrasp.common.validation import FloatArray
from nlpgrasp.contacts.base import ContactModel

ROUNDED_UP = 1.0 + 1e-12  # factor on added normal forces


def component_slices(contacts: Sequence[ContactModel], space: int) -> list[slice]:
    """Return the slice of each contact's components in the stacked vector of finger forces."""
    ends = np.cumsum([0] + [c.components(space) for c in contacts])
    return [slice(int(a), int(b)) for a, b in pairwise(ends)]


def have_one_domain(contacts: Sequence[ContactModel], space: int) -> bool:
    """Return whether all contacts have the same force domain."""
    return all(c is contacts[0] or c.has_domain_of(contacts[0], space) for c in contacts)


def planar_edges(contacts: Sequence[ContactModel]) -> list[FloatArray] | None:
    """Return the forces of unit normal force along the edges of each contact's cone in the plane, (2 or 1, n_i).

    None where some cone is not spanned by one or two edges: that of bilateral contacts, or of lines, which is round.
    """
    sizes = [contact.components(2) for contact in contacts]
    if max(sizes) > 2 or not all(contact.unilateral for contact in contacts):
        return None
    sides = np.array([[1e-3, 1.0], [1e-3, -1.0]])
    return [np.unique(c.extreme(sides[:, :size])[1], axis=0) for c, size in zip(contacts, sizes, strict=True)]


def conic_lift(contacts: Sequence[ContactModel], space: int) -> tuple[FloatArray, list[FloatArray]]:
    """Return A (n, m) and matrices M (r, m) with ``K = {A u : every M u in a second-order cone}``."""
    parts = [c.generators(space) for c in contacts]
    ends = np.cumsum([0] + [part.shape[1] for part in parts])
    cones = []
    for contact, a, b in zip(contacts, ends[:-1], ends[1:], strict=True):
        for M in contact.cones(space):
            cones.append(np.zeros((len(M), int(ends[-1]))))
            cones[-1][:, a:b] = M
    return np.asarray(block_diag(*parts)), cones


def is_lifted(lift: FloatArray) -> bool:
    """Return whether variables are not the force components themselves, for A (n, m) of ``conic_lift``."""
    return not np.array_equal(lift, np.eye(len(lift)))


def contact_supports(z: FloatArray, contacts: Sequence[ContactModel], space: int) -> tuple[FloatArray, FloatArray]:
    """Return each contact's support for normal force at most 1, (m, k), and maximisers (m, n)."""
    if have_one_domain(contacts, space):
        shape = (len(z), len(contacts), contacts[0].components(space))
        values, forces = contacts[0].extreme(z.reshape(shape))
        return values, forces.reshape(z.shape)
    parts = [c.extreme(z[:, block]) for c, block in zip(contacts, component_slices(contacts, space), strict=True)]
    return np.stack([p[0] for p in parts], axis=1), np.concatenate([p[1] for p in parts], axis=1)


def project(z: FloatArray, contacts: Sequence[ContactModel], space: int) -> FloatArray:
    """Return the projection of finger forces (m, n) onto K."""
    if have_one_domain(contacts, space):
        shape = (len(z), len(contacts), contacts[0].components(space))
        return contacts[0].project(z.reshape(shape)).reshape(z.shape)
    parts = [c.project(z[:, block]) for c, block in zip(contacts, component_slices(contacts, space), strict=True)]
    return np.concatenate(parts, axis=1)


def project_lifted(z: FloatArray, contacts: Sequence[ContactModel], space: int) -> FloatArray:
    """Return variables (m, l) of ``conic_lift`` of which A u is the projection of finger forces (m, n) onto K."""
    if have_one_domain(contacts, space):
        shape = (len(z), len(contacts), contacts[0].components(space))
        u = contacts[0].project_lifted(z.reshape(shape))
        return u.reshape(len(z), len(contacts) * u.shape[-1])
    slices = component_slices(contacts, space)
    return np.concatenate([c.project_lifted(z[:, block]) for c, block in zip(contacts, slices, strict=True)], axis=1)


def derivative(z: FloatArray, contacts: Sequence[ContactModel], space: int) -> list[FloatArray]:
    """Return the diagonal blocks (m, n_i, n_i) of a generalised Jacobian of the projection of finger forces (m, n)."""
    if have_one_domain(contacts, space):
        shape = (len(z), len(contacts), contacts[0].components(space))
        return list(contacts[0].derivative(z.reshape(shape)).transpose(1, 0, 2, 3))
    return [c.derivative(z[:, block]) for c, block in zip(contacts, component_slices(contacts, space), strict=True)]


def derivative_entries(z: FloatArray, contacts: Sequence[ContactModel], space: int) -> FloatArray:
    """Return the upper triangles of the blocks of ``derivative``, row by row, of each contact in turn, (m, entries)."""
    if have_one_domain(contacts, space):
        shape = (len(z), len(contacts), contacts[0].components(space))
        entries = contacts[0].derivative_entries(z.reshape(shape))
        return np.ascontiguousarray(entries.transpose(1, 2, 0)).reshape(len(z), -1)
    slices = component_slices(contacts, space)
    parts = [c.derivative_entries(z[:, block]) for c, block in zip(contacts, slices, strict=True)]
    return np.concatenate(parts).T


def project_strictly(z: FloatArray, contacts: Sequence[ContactModel], space: int) -> FloatArray:
    """Return the projection of finger forces (m, n) onto K, moved inside if numerical errors leave it outside."""
    parts = [c.into(z[:, block]) for c, block in zip(contacts, component_slices(contacts, space), strict=True)]
    return np.concatenate(parts, axis=1)


def press_into_cones(u: FloatArray, contacts: Sequence[ContactModel], space: int) -> FloatArray:
    """Return variables (m, l) of ``conic_lift`` in their cones from ``u`` (m, l), which a solver left near the cones.

    All normal forces of a contact, at its point or at the corners of its pad, grow by the least amount that puts the
    variables into their second-order cones. A projection of the forces instead has errors of its own.
    """
    parts, start = [], 0
    for contact in contacts:
        A = contact.generators(space)
        own, normal = u[:, start : start + A.shape[1]], A[0]  # of the normal force: 1 at each point
        start += A.shape[1]
        more = np.zeros(len(u))
        for M in contact.cones(space):
            if (gain := float(M[0] @ normal)) > 0.0:  # a cone that normal forces do not widen is left as it is
                missing = np.linalg.norm(own @ M[1:].T, axis=1) - own @ M[0]
                more = np.maximum(more, missing / gain)
        parts.append(own + ROUNDED_UP * more[:, None] * normal)
    return np.concatenate(parts, axis=1)
