"""Which forces the contact models allow, written from their definitions alone."""

import numpy as np


def ranges(contact, n):
    """Return the blocks of components and how far normal force lets them go, from the models' definitions."""
    mu, mu_t = getattr(contact, "friction", None), getattr(contact, "torsional_friction", None)
    rough = [((1, 2), mu), ((3,), mu_t)]
    return {
        "point": lambda: [],
        "friction": lambda: [(tuple(range(1, n)), mu)],
        "soft": lambda: rough,
        "line": lambda: [*(rough if mu else []), ((n - 1,), contact.length / 2)],
        "plane": lambda: [
            *(rough if mu else []),
            *(
                [((n - 2, n - 1), contact.radius)]
                if contact.radius
                else [((n - 2,), contact.extents[1] / 2), ((n - 1,), contact.extents[0] / 2)]
            ),
        ],
    }[contact.kind]()


def inside(contact, x, tolerance=0.0):
    """Return whether force components are in the force domain, by its definition in (2.4-1)."""
    if contact.kind == "bilateral":
        return np.ones(x.shape[:-1], dtype=bool)
    normal = x[..., 0]
    good = normal >= -tolerance
    if getattr(contact, "model", None) == "elliptic":
        sliding, torsion = np.linalg.norm(x[..., 1:3], axis=-1), np.abs(x[..., 3])
        size = np.hypot(sliding / contact.friction, torsion / contact.torsional_friction)
        return good & (size <= normal + tolerance / contact.torsional_friction)
    for block, most in ranges(contact, x.shape[-1]):
        good &= np.linalg.norm(x[..., list(block)], axis=-1) <= most * normal + tolerance
    return good


def most_work(contact, z):
    """Return the most that a force of unit normal force does along z: no force works where it is not above 0."""
    if contact.kind == "bilateral":
        return np.where(np.linalg.norm(z, axis=-1) > 0.0, np.inf, 0.0)
    if getattr(contact, "model", None) == "elliptic":
        sliding = contact.friction * np.linalg.norm(z[..., 1:3], axis=-1)
        return z[..., 0] + np.hypot(sliding, contact.torsional_friction * z[..., 3])
    parts = [most * np.linalg.norm(z[..., list(block)], axis=-1) for block, most in ranges(contact, z.shape[-1])]
    return z[..., 0] + sum(parts)
