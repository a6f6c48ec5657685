"""Small random problems that the bound covers, with independent tests of their constraints."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

import numpy as np
import trimesh

import nlpgrasp as ng
from nlpgrasp.bodies import Body

PLANAR_SHARE = 0.65
MARGIN = 0.06  # edge margin relative to the shortest extent, in a third of the problems


@dataclass(frozen=True)
class Case:
    """A problem with the faces and the points (m, space) that it allows each contact."""

    problem: ng.GraspProblem
    usable: Callable[[int], tuple[str, ...]]
    allowed: Callable[[int, np.ndarray], np.ndarray]


def random_case(number):
    """Return random problem ``number`` as a case."""
    rng = np.random.default_rng([2026, number])
    body = _planar(rng) if rng.random() < PLANAR_SHARE else _spatial(rng)
    contacts = _contacts(body, rng)
    constraints, tests, forbidden = _constraints(body, len(contacts), rng)
    origin = None if rng.random() < 0.7 else (body.centroid + 0.2 * body.size * rng.standard_normal(body.space))
    task = _task(body, rng)
    budget = str(rng.choice(["l2", "l2", "per_finger", "per_finger_size", "shared"]))
    margin = MARGIN * float(np.min(np.ptp(body.bounds, axis=0))) if number % 3 == 0 and type(body) in INSIDE else 0.0
    problem = ng.GraspProblem(
        body,
        contacts,
        task,
        constraints=constraints,
        force_budget=budget,
        torque_origin=origin,
        name=f"case {number}",
        edge_margin=margin,
    )
    if margin > 0.0:
        tests.append(lambda i, points: INSIDE[type(body)](body, points) >= margin)

    def usable(i):
        names = body.face_names if contacts[i].faces is None else contacts[i].faces
        return tuple(name for name in names if name not in forbidden)

    def allowed(i, points):
        return np.all([np.ones(len(points), dtype=bool), *(test(i, points) for test in tests)], axis=0)

    return Case(problem, usable, allowed)


def _from_corners(body, points):
    """Return distances of points (m, 2) of a polygon from corners of more than 30 degrees."""
    v = body.corners
    incoming, outgoing = v - np.roll(v, 1, axis=0), np.roll(v, -1, axis=0) - v
    cosines = np.sum(incoming * outgoing, axis=1) / np.linalg.norm(incoming, axis=1) / np.linalg.norm(outgoing, axis=1)
    distances = np.linalg.norm(points[:, None] - v[None], axis=2)[:, cosines < np.cos(np.pi / 6)]
    return np.min(distances, axis=1, initial=np.inf)


INSIDE = {
    ng.Polygon: _from_corners,
    ng.Box: lambda body, points: np.sort(body.half_size - np.abs(points), axis=1)[:, 1],
    ng.Cylinder: lambda body, points: np.maximum(
        body.height / 2.0 - np.abs(points[:, 2]), body.radius - np.hypot(points[:, 0], points[:, 1])
    ),
}
"""Distances of a body's points from its sharp edges, by kind of body."""


def _planar(rng) -> Body:
    kind = rng.integers(5)
    if kind == 0:
        return ng.Polygon([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    if kind == 1:
        w, h = rng.uniform(0.3, 1.5, 2)
        return ng.Polygon([[-w, -h], [w, -h], [w, h], [-w, h]])
    if kind == 2:  # regular
        m = int(rng.integers(3, 7))
        angles = 2 * np.pi * np.arange(m) / m
        return ng.Polygon(np.stack([np.cos(angles), np.sin(angles)], axis=1))
    if kind == 3:  # not convex
        a, b = rng.uniform(0.3, 0.9, 2)
        return ng.Polygon([[0, 0], [1.5, 0], [1.5, a], [b, a], [b, 1.2], [0, 1.2]])
    return ng.Polygon(_convex(rng))


def _convex(rng):
    angles = np.sort(rng.uniform(0, 2 * np.pi, 3) * 0.25 + 2 * np.pi * np.arange(3) / 3)
    if rng.random() < 0.5:
        angles = np.sort(np.append(angles, np.mean(angles[:2])))
    return np.stack([np.cos(angles), np.sin(angles)], axis=1) * rng.uniform(0.6, 1.2, 2)


def _spatial(rng) -> Body:
    kind = rng.integers(9)
    if kind == 0:
        return ng.Box(np.full(3, rng.uniform(0.5, 2.0)))
    if kind == 1:
        return ng.Box(rng.choice([[2.0, 1.0, 1.0], [1.0, 1.0, 3.0], rng.uniform(0.4, 2.0, 3)]))
    if kind == 2:
        regular = np.array([[1.0, 0.0], [-0.5, np.sqrt(0.75)], [-0.5, -np.sqrt(0.75)]])
        return ng.Prism(regular if rng.random() < 0.4 else _convex(rng), rng.uniform(0.4, 2.0))
    if kind == 3:
        return ng.Sphere(rng.uniform(0.5, 2.0))
    if kind == 4:
        return ng.Ellipsoid(rng.choice([[2.0, 1.0, 1.0], [1.0, 1.0, 0.6], rng.uniform(0.5, 2.0, 3)]))
    if kind in (5, 6):
        return ng.Cylinder(rng.uniform(0.3, 1.2), rng.uniform(0.5, 2.5))
    if kind == 7:
        return ng.Torus(rng.uniform(1.0, 1.5), rng.uniform(0.2, 0.6))
    return mesh(int(rng.integers(3)))


@cache
def mesh(number):
    """Return a mesh of few triangles: a box, a coarse ball or a dented one."""
    if number == 0:
        return ng.Mesh(trimesh.creation.box([2, 1, 1]), resolution=8)
    ball = trimesh.creation.icosphere(1, 1.0)
    if number == 2:
        ball.vertices *= 1.0 + 0.25 * np.random.default_rng(5).uniform(-1, 1, (len(ball.vertices), 1))
    return ng.Mesh(ball, resolution=8)


def _contacts(body, rng):
    count = int(rng.integers(2, 4)) if body.space == 2 else int(rng.integers(2, 5))
    models = [_contact(body, rng) for _ in range(count)]
    if rng.random() < 0.6:
        return [models[0]] * count
    return models if rng.random() < 0.5 or count < 3 else [models[0], *[models[1]] * (count - 1)]


def _contact(body, rng):
    friction = rng.uniform(0.2, 1.0)
    has_faces = len(body.face_names) > 2
    faces = rng.choice(body.face_names, len(body.face_names) - 1, replace=False).tolist() if has_faces else None
    options = {"faces": faces} if has_faces and rng.random() < 0.2 else {}
    kind = rng.integers(8)
    if kind == 0:
        return ng.PointContact(**options)
    if body.space == 2 or kind < 4:
        return ng.FrictionContact(friction, **options)
    torsion = rng.uniform(0.05, 0.5)
    return ng.SoftContact(friction, torsion, model="box" if kind < 6 else "elliptic", **options)


def _task(body, rng):
    space, size = body.space, body.size
    turning = 1 if space == 2 else 3
    d = space + turning
    kind = rng.integers(8)
    if kind == 0:
        return ng.TaskEllipsoid([1.0] * d)
    if kind == 1:  # as a body of revolution is
        axes = [1.0, 1.0, rng.uniform(0.3, 2.0), 0.5, 0.5, rng.uniform(0.3, 2.0)] if d == 6 else [1.0, 1.0, 0.4]
        return ng.TaskEllipsoid(axes, center=None if rng.random() < 0.5 else np.eye(d)[space - 1] * rng.uniform(-2, 2))
    axes = rng.uniform(0.3, 1.0, d) * np.array([1.0] * space + [rng.uniform(0.2, 0.6) * size] * turning)
    if kind == 2:
        return ng.TaskEllipsoid(axes)
    if kind == 3:  # flat
        axes[rng.permutation(d)[: rng.integers(1, d)]] = 0.0
        return ng.TaskEllipsoid(axes)
    if kind == 4:  # off its centre, 0 inside or outside
        return ng.TaskEllipsoid(axes, center=rng.uniform(0.3, 1.4) * axes * _unit(rng.standard_normal(d)))
    if kind == 5:  # flat and off its centre
        axes[rng.integers(d)] = 0.0
        return ng.TaskEllipsoid(axes, center=0.5 * axes + 0.2 * rng.standard_normal(d))
    if kind == 6:
        wrenches = rng.standard_normal((int(rng.integers(2, 6)), d)) * axes
        return ng.TaskPolytope(np.concatenate([wrenches, -wrenches]) if rng.random() < 0.5 else wrenches)
    lift = ng.TaskPolytope([np.eye(d)[space - 1] * rng.uniform(0.2, 1.0)])
    return lift + ng.TaskEllipsoid(0.2 * axes)


def _unit(v):
    return v / np.linalg.norm(v)


def _constraints(body, count, rng):
    """Return constraints, tests of a contact's points, and forbidden faces."""
    constraints, tests, forbidden = [], [], ()
    if rng.random() < 0.4:
        return constraints, tests, forbidden
    lower, upper = body.bounds
    space, extent = body.space, upper - lower
    kind = rng.integers(6)
    if kind == 0:
        height, clearance = lower[-1] + rng.uniform(0.0, 0.4) * extent[-1], rng.choice([0.0, 0.01])
        constraints.append(ng.Table(height, clearance))
        tests.append(lambda i, p: p[:, -1] >= height + clearance)
    if kind == 1 and len(body.face_names) > 2:
        forbidden = (str(rng.choice(body.face_names)),)
        constraints.append(ng.Forbid(forbidden[0]))
    if kind == 2:
        a = body.centroid + rng.uniform(-0.4, 0.2, space) * extent
        b = a + rng.uniform(0.2, 0.8, space) * extent
        constraints.append(ng.Forbid(ng.BoxRegion(a, b)))
        tests.append(lambda i, p: np.any((p <= a) | (p >= b), axis=1))
    if kind == 3:
        normal = _unit(rng.standard_normal(space))
        offset = normal @ body.centroid + rng.uniform(0.1, 0.4) * np.min(extent)
        constraints.append(ng.Forbid(ng.HalfSpace(normal, offset)))
        tests.append(lambda i, p: p @ normal <= offset)
    if kind == 4:
        a = lower - rng.uniform(-0.2, 0.1, space) * extent
        b = upper + rng.uniform(-0.2, 0.1, space) * extent
        fingers = None if rng.random() < 0.5 else [int(rng.integers(count))]
        constraints.append(ng.Workspace(ng.BoxRegion(a, b), fingers=fingers))
        tests.append(lambda i, p: (fingers is not None and i not in fingers) | np.all((p >= a) & (p <= b), axis=1))
    if kind == 5 and space == 3:
        centre = body.centroid + _unit(rng.standard_normal(3)) * 0.5 * np.max(extent)
        radius, clearance = rng.uniform(0.1, 0.4) * np.max(extent), rng.choice([0.0, 0.05])
        constraints.append(ng.Obstacle(ng.Sphere(radius), clearance, position=centre))
        tests.append(lambda i, p: np.linalg.norm(p - centre, axis=1) >= radius + clearance)
    return constraints, tests, forbidden
