"""Certified quality along the path of a sliding contact, against dense certificates on the surface itself."""

import numpy as np
import pytest

import nlpgrasp as ng
from nlpgrasp.budgets.registry import force_budget
from nlpgrasp.motion.contact_path import ContactPath, PathStation, SurfaceGraph
from nlpgrasp.quality import mu
from nlpgrasp.quality.sliding_contact import ENOUGH, MOST_STATIONS, SurfacePath, least_mu_along
from tests.quick import first

BODIES = {
    "polygon": lambda rng: ng.Polygon(_convex_polygon(rng)),
    "box": lambda rng: ng.Box(rng.uniform(0.5, 2.0, 3)),
    "ellipsoid": lambda rng: ng.Ellipsoid(rng.uniform(0.4, 1.2, 3)),
    "cylinder": lambda rng: ng.Cylinder(rng.uniform(0.3, 1.0), rng.uniform(0.5, 2.0)),
    "torus": lambda rng: ng.Torus(1.0, 0.35),
}
QUICK_SEEDS = {"torus": 1}  # of 0, the path has ten times as many stations
DENSE = 24  # points of a path that are certified


def _convex_polygon(rng):
    angles = np.sort(rng.uniform(0.0, 2.0 * np.pi, 7))
    return (np.column_stack([np.cos(angles), np.sin(angles)]) * [1.0, rng.uniform(0.5, 1.0)]).tolist()


def _random_stations(body, count, rng):
    stations = []
    while len(stations) < count:
        face = body.face_names[rng.integers(len(body.face_names))]
        for point in body.sample(face, 1, rng):  # none on a face that is shorter than its margins
            stations.append(PathStation(point, -body.evaluate(face, point[None])[2][0], face))
    return stations


def random_slide(kind, seed, budget="l2"):
    """Return a random slide that the contacts that stay do not decide, with the grasp that stays and its task."""
    rng = np.random.default_rng(seed)
    body = BODIES[kind](rng)
    space, dimension = body.space, 3 * (body.space - 1)
    graph, budget, count = SurfaceGraph(body), force_budget(budget), space  # of fingers that stay
    while True:
        *stay, start, end = _random_stations(body, count + 2, rng)
        contacts = [ng.FrictionContact(0.6)] * count
        others = ng.Grasp([s.point for s in stay], [s.normal for s in stay], contacts, np.zeros(space))
        weight = ng.TaskEllipsoid([0.1] * dimension, center=np.eye(dimension)[space - 1])
        task = weight if rng.random() < 0.5 else ng.TaskEllipsoid([1.0] * space + [0.3] * (dimension - space))
        path = ContactPath(body, graph.stations(start, end), 0.2, 1e-3 * body.size, np.radians(2.0))
        floor = mu(others, task, 0.005, force_budget=budget).lower
        slid = least_mu_along(
            SurfacePath(path.points, path.normals, path.deviations()), others, task, budget, floor=floor
        )
        if slid.bounds.upper > 1.03 * floor + 1e-3:
            return body, path, others, task, budget, slid


def least_on_surface(body, path, others, task, budget, rng):
    """Return the least upper bound at random points of a path: on the surface, or rolling over an edge."""
    least = np.inf
    for _ in range(DENSE):
        i, share = rng.integers(len(path.stations) - 1), rng.random()
        a, b = path.stations[i], path.stations[i + 1]
        point, normal = ((1.0 - share) * x + share * y for x, y in ((a.point, b.point), (a.normal, b.normal)))
        if np.linalg.norm(a.point - b.point) > 1e-9 and a.face == b.face:
            point = body.snap(a.face, point[None])[0]
            normal = -body.evaluate(a.face, point[None])[2][0]
        grasp = ng.Grasp(
            [*others.points, point],
            [*others.normals, normal / np.linalg.norm(normal)],
            [*others.contacts, ng.PointContact()],
            others.torque_origin,
        )
        least = min(least, mu(grasp, task, 0.01, force_budget=budget).upper)
    return least


def check_slide(kind, seed, budget="l2"):
    body, path, others, task, budget, slid = random_slide(kind, seed, budget)
    least = least_on_surface(body, path, others, task, budget, np.random.default_rng(seed))
    assert slid.bounds.lower <= least * (1.0 + 1e-9)
    assert slid.bounds.upper >= slid.bounds.lower
    assert slid.stations <= MOST_STATIONS
    return slid


@pytest.mark.parametrize("kind", first(1, BODIES))
def test_nothing_on_the_surface_is_below_the_lower_end(kind):
    check_slide(kind, QUICK_SEEDS.get(kind, 0))


@pytest.mark.slow
@pytest.mark.parametrize(("budget", "seed"), [("shared", 3), ("per_finger", 5), ("per_finger_size", 5)])
def test_other_budgets_bound_the_same_way(budget, seed):
    check_slide("polygon", seed, budget)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "budget"),
    [("box", "per_finger"), ("ellipsoid", "shared"), ("cylinder", "per_finger_size"), ("torus", "l2")],
)
def test_none_is_below_the_lower_end_of_solid_bodies_under_other_budgets(kind, budget):
    check_slide(kind, 101, budget)


def test_on_a_flat_face_the_ends_decide_and_two_certificates_suffice():
    """A straight slide on the underside of a square: between its ends nothing is worse than at both."""
    points, normals = np.array([[-0.8, -1.0], [0.9, -1.0]]), np.array([[0.0, 1.0], [0.0, 1.0]])
    others = ng.Grasp([[0.3, 1.0]], [[0.0, -1.0]], [ng.FrictionContact(0.5)], np.zeros(2))
    task = ng.TaskEllipsoid([0.0, 0.1, 0.0], center=[0.0, 1.0, 0.0])
    slid = least_mu_along(SurfacePath(points, normals, np.zeros((1, 2))), others, task, force_budget("l2"))
    ends = [
        mu(ng.Grasp([[0.3, 1.0], p], [[0.0, -1.0], n], [*others.contacts, ng.PointContact()], np.zeros(2)), task, 0.005)
        for p, n in zip(points, normals, strict=True)
    ]
    assert slid.stations == 2
    assert slid.bounds.lower == min(end.lower for end in ends)
    assert slid.bounds.upper == min(end.upper for end in ends)


def test_an_unknown_surface_between_two_stations_leaves_what_the_others_hold():
    points, normals = np.array([[-0.8, -1.0], [0.9, -1.0]]), np.array([[0.0, 1.0], [0.0, 1.0]])
    others = ng.Grasp([[0.3, 1.0]], [[0.0, -1.0]], [ng.FrictionContact(0.5)], np.zeros(2))
    task = ng.TaskEllipsoid([0.1, 0.1, 0.0], center=[0.0, 0.5, 0.0])
    unknown = SurfacePath(points, normals, np.full((1, 2), np.inf))
    slid = least_mu_along(unknown, others, task, force_budget("l2"), floor=0.0)
    assert slid.bounds.lower == 0.0
    assert slid.bounds.gap <= 1.0


@pytest.mark.slow
def test_a_path_that_is_held_everywhere_is_known_to_a_few_per_cent():
    slid = check_slide("cylinder", 3)
    assert slid.bounds.gap <= ENOUGH + 0.005
