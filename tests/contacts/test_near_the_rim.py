"""Projections of points next to the rim of Coulomb's set, where forces at both ends slide in like directions."""

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


def test_projections_onto_a_line_are_in_its_set():
    contact = ng.LineContact(0.04, 0.5, direction=[0, 0, 1])
    x = near_the_rim(contact, 3000, np.random.default_rng(0))
    nearest = contact.project(x)
    size = np.linalg.norm(x, axis=1, keepdims=True)
    assert line_inside(contact, nearest / size, 1e-12).all()
    off = np.linalg.norm(nearest - x, axis=1) / size[:, 0]
    assert np.mean(off < 1e-8) > 0.999  # of the others the last method finds a point of the set that is near
    assert np.max(off) < 1e-4
