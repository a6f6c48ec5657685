"""Corrected projections near the rim of the Coulomb set."""

import numpy as np

import nlpgrasp as ng
from tests.memberships import components, line_inside, places


def near_the_rim(contact, count, rng):
    """Return sums of forces at the ends that slide almost the same way, moved by a billionth."""
    normal = rng.uniform(0.1, 1.0, (count, 2))
    angle = rng.uniform(-np.pi, np.pi, count)[:, None] + 10.0 ** rng.uniform(-6, -1, (count, 2))
    slip = contact.friction * normal
    forces = np.stack([normal, slip * np.cos(angle), slip * np.sin(angle)], axis=2)
    x = components(contact, places(contact), forces)
    return x + 1e-9 * rng.standard_normal(x.shape) * np.linalg.norm(x, axis=1, keepdims=True)


def test_forces_are_put_into_the_set_of_a_line():
    contact = ng.LineContact(0.4, 0.5, direction=[0, 0, 1])
    x = near_the_rim(contact, 3000, np.random.default_rng(0))
    size = np.linalg.norm(x, axis=1, keepdims=True)
    projected, corrected = (line_inside(contact, y / size, 1e-14) for y in (contact.project(x), contact.into(x)))
    assert np.sum(~projected) > 20
    assert corrected.all()
    assert np.max(np.linalg.norm(contact.into(x) - contact.project(x), axis=1) / size[:, 0]) <= 4e-8
