"""Grasps with two nearly coincident contacts: duration, validity and width of certificates."""

import time
from itertools import product

import numpy as np
import pytest

import nlpgrasp as ng
from nlpgrasp.quality import sandwich

BUDGETS = ("l2", "per_finger", "shared", "per_finger_size")
DIRECTIONS = 400


def drawn(seed):
    """Return a grasp with two of its contacts 1e-12 to 1e-3 apart, semi-axes of a task, and a budget."""
    rng = np.random.default_rng(seed)
    k = int(rng.integers(3, 6))
    points, normals = rng.standard_normal((2, k, 3))
    points[1] = points[0] + 10 ** rng.uniform(-12, -3) * rng.standard_normal(3)
    if rng.random() < 0.5:  # normals about inwards: most of these close
        normals = 0.3 * normals - points
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    kinds = [
        lambda: ng.FrictionContact(float(rng.uniform(0.1, 3.0))),
        lambda: ng.SoftContact(float(rng.uniform(0.1, 3.0)), float(10 ** rng.uniform(-3, 0))),
        ng.PointContact,
    ]
    models = [kinds[rng.choice(3, p=[0.5, 0.35, 0.15])]() for _ in range(k)]
    return ng.Grasp(points, normals, models), 10 ** rng.uniform(-1, 1, 6), BUDGETS[seed % len(BUDGETS)]


def components(grasp, y):
    """Normal, tangential and turning work along directions y of each contact, (m, k) each, without a frame."""
    v = y[:, None, :3] + np.cross(y[:, None, 3:], grasp.points - grasp.torque_origin)
    normal = np.sum(v * grasp.normals, axis=2)
    return normal, np.linalg.norm(v - normal[..., None] * grasp.normals, axis=2), np.abs(y[:, 3:] @ grasp.normals.T)


def limits(model):
    """Bounds of tangential force and turning moment, for a unit of normal force."""
    return float(getattr(model, "friction", 0.0)), float(getattr(model, "torsional_friction", 0.0))


def projected(normal, sizes, limited):
    """Length of the projection onto the cone, by trying which of its limits are active."""
    best = np.zeros_like(normal)
    for active in product((False, True), repeat=2):
        total = normal + sum(c * s for c, s, on in zip(limited, sizes, active, strict=True) if on)
        n = total / (1.0 + sum(c**2 for c, on in zip(limited, active, strict=True) if on))
        ends = [c * n if on else s for c, s, on in zip(limited, sizes, active, strict=True)]
        fits = n >= 0.0
        for c, s, on in zip(limited, sizes, active, strict=True):
            fits &= (s >= c * n - 1e-12 * s) if on else (s <= c * n + 1e-12 * s)
        best = np.where(fits, np.maximum(best, np.sqrt(n**2 + sum(e**2 for e in ends))), best)
    return best


def support(grasp, budget, y):
    normal, slip, turn = components(grasp, y)
    if budget in ("per_finger", "shared"):
        each = [
            np.maximum(normal[:, i] + mu * slip[:, i] + gamma * turn[:, i], 0.0)
            for i, (mu, gamma) in enumerate(map(limits, grasp.contacts))
        ]
        return np.sum(each, axis=0) if budget == "per_finger" else np.max(each, axis=0)
    each = [projected(normal[:, i], (slip[:, i], turn[:, i]), limits(model)) for i, model in enumerate(grasp.contacts)]
    return np.sum(each, axis=0) if budget == "per_finger_size" else np.linalg.norm(each, axis=0)


def check(seed):
    """Check an interval against supports that share no code with it; return the seconds and the interval."""
    grasp, axes, budget = drawn(seed)
    begun = time.process_time()
    bounds = ng.mu(grasp, ng.TaskEllipsoid(axes), force_budget=budget)
    seconds = time.process_time() - begun
    y = np.random.default_rng(seed).standard_normal((DIRECTIONS, 6)) / axes
    y = np.concatenate([y, bounds.worst_direction[None]])
    ratios = support(grasp, budget, y) / np.linalg.norm(y * axes, axis=1)
    scale = np.max(ratios)
    assert bounds.lower <= np.min(ratios) * (1 + 1e-9) + 1e-9 * scale, seed
    assert ratios[-1] == pytest.approx(bounds.upper, rel=1e-6, abs=1e-9 * scale), seed
    assert (bounds.limit != "") == (bounds.upper > bounds.lower * 1.01 * (1 + 1e-6)), (seed, bounds)
    return seconds, bounds


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:Grasp.normals")
def test_four_hundred_of_them():
    """A third are force-closed; none takes more than a few seconds of CPU, whatever else the machine does."""
    seconds, bounds = zip(*map(check, range(400)), strict=True)
    assert sum(b.lower > 0.0 for b in bounds) > 120
    assert max(seconds) < 6.0


def test_a_certificate_that_is_wide_says_why(tmp_path, monkeypatch):
    u = np.random.default_rng(3).standard_normal((5, 3))
    u /= np.linalg.norm(u, axis=1, keepdims=True)
    grasp, task = ng.Grasp(u, -u, ng.SoftContact(0.5, 0.1)), ng.TaskEllipsoid([1.0] * 6)
    assert ng.mu(grasp, task, 0.05).limit == ""
    late = ng.mu(grasp, task, 0.05, deadline=0.0)
    assert late.limit == "the time was up"
    assert late.lower <= ng.mu(grasp, task, 0.05).upper <= late.upper * 1.05
    monkeypatch.setattr(sandwich, "MOST_POINTS", 60)
    assert "points of its polytope" in ng.mu(grasp, task, 0.001).limit
