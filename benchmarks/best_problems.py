"""Problems of the benchmark of the global bound."""

import numpy as np

import nlpgrasp as ng

FRICTION = ng.FrictionContact(0.5)
BALL, PLANE = ng.TaskEllipsoid([1.0] * 6), ng.TaskEllipsoid([1.0] * 3)
OFF = ng.TaskEllipsoid([1.0, 1.0, 1.0, 0.5, 0.5, 0.5], center=[0.0, 0.2, -0.8, 0.0, 0.1, 0.0])
FLAT = ng.TaskEllipsoid([1.0, 1.0, 1.0, 0.5, 0.5, 0.0])
TRIANGLE = [[-1.0, -0.6], [1.0, -0.6], [0.3, 0.9]]
REGULAR = [[1.0, 0.0], [-0.5, np.sqrt(0.75)], [-0.5, -np.sqrt(0.75)]]


def _contacts(count, friction=0.5):
    """Return equal contacts with friction."""
    return [ng.FrictionContact(friction)] * count


def _problem(body, contacts, task, **fields):
    """Return a problem without an edge margin, as in earlier tables."""
    return ng.GraspProblem(body, contacts, task, edge_margin=0.0, **fields)


def gap_problems():
    """Yield name, problem, target gap, and target seconds of CPU time."""
    square = ng.Polygon([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    angles = np.sort(np.random.default_rng(7).uniform(0, 2 * np.pi, 6))
    convex = ng.Polygon(np.stack([np.cos(angles), 0.7 * np.sin(angles)], axis=1))
    for name, body in (("square", square), ("triangle", ng.Polygon(TRIANGLE)), ("convex polygon", convex)):
        for k in (2, 3, 4):
            yield f"{name}, {k} contacts", _problem(body, _contacts(k), PLANE), 0.01, 10.0
    boxes = {
        "box 2:1:1": ng.Box([2, 1, 1]),
        "box 3:2:1": ng.Box([3, 2, 1]),
        "cube": ng.Box([1, 1, 1]),
        "prism": ng.Prism(REGULAR, 1.0),
        "long prism": ng.Prism(TRIANGLE, 2.5),
    }
    for name, body in boxes.items():
        for k in (3, 4):
            yield f"{name}, {k} contacts", _problem(body, _contacts(k), BALL), 0.01, 10.0
    box, four = boxes["box 2:1:1"], _contacts(4)
    for name, task in (("off-centre", OFF), ("flat", FLAT)):
        yield f"box 2:1:1, 4 contacts, {name} task", _problem(box, four, task), 0.01, 10.0
    for friction in (0.2, 1.0):
        problem = _problem(box, _contacts(4, friction), BALL)
        yield f"box 2:1:1, 4 contacts, friction {friction:g}", problem, 0.01, 10.0
    limits = {"a table": [ng.Table(-0.5)], "a forbidden face": [ng.Forbid("+z")]}
    for name, constraints in limits.items():
        problem = _problem(box, four, BALL, constraints=constraints)
        yield f"box 2:1:1, 4 contacts, {name}", problem, 0.01, 10.0
    for k in (3, 4):
        yield f"sphere, {k} contacts", _problem(ng.Sphere(1.0), _contacts(k), BALL), 0.01, 10.0
    ellipsoid = ng.Ellipsoid([2, 1, 1])
    yield "ellipsoid 2:1:1, 3 contacts", _problem(ellipsoid, _contacts(3), BALL), 0.01, 10.0
    yield "ellipsoid 2:1:1, 4 contacts", _problem(ellipsoid, four, BALL), 0.05, 60.0
    yield "cylinder, 3 contacts", _problem(ng.Cylinder(1.0, 2.0), _contacts(3), BALL), 0.02, 30.0


BODIES = {
    "box": ng.Box([2.0, 1.0, 1.0]),
    "cube": ng.Box([1.0, 1.0, 1.0]),
    "prism": ng.Prism(TRIANGLE, 1.5),
    "sphere": ng.Sphere(1.0),
    "ellipsoid": ng.Ellipsoid([1.5, 1.0, 0.8]),
    "cylinder": ng.Cylinder(0.6, 2.0),
    "polygon": ng.Polygon([[0.0, 0.0], [2.0, 0.0], [2.5, 1.0], [1.0, 2.0], [-0.3, 1.2]]),
}
TASKS = ("ball", "unequal", "flat", "0 on the edge", "0 outside", "lift")


def hit_problem(index):
    """Return name and problem of an index, with one of seven bodies and six tasks, and 3 to 5 contacts."""
    rng = np.random.default_rng([11, index])
    body_name, task_name = list(BODIES)[index % 7], TASKS[index // 2 % 6]
    body, count, friction = BODIES[body_name], int(rng.integers(3, 6)), float(rng.choice([0.3, 0.6, 0.9]))
    task = _task(task_name, body, rng)
    name = f"{body_name}, {task_name}, {count} contacts, friction {friction}"
    return name, _problem(body, [ng.FrictionContact(friction)] * count, task, name=name)


def _task(name, body, rng):
    """Return the task of a name, scaled by the body and varied at random."""
    space = body.space
    turning = 1 if space == 2 else 3
    d = space + turning
    axes = np.array([1.0] * space + [0.3 * body.size] * turning)
    if name == "ball":
        return ng.TaskEllipsoid(axes)
    axes = axes * rng.uniform(0.4, 1.0, d)
    if name == "unequal":
        return ng.TaskEllipsoid(axes)
    if name == "flat":
        axes[rng.integers(space, d)] = 0.0
        return ng.TaskEllipsoid(axes)
    towards = rng.standard_normal(d) * np.array([1.0] * space + [0.3] * turning)
    towards /= np.linalg.norm(towards)
    if name == "0 on the edge":  # just inside
        return ng.TaskEllipsoid(axes, center=0.97 * axes * towards)
    if name == "0 outside":
        return ng.TaskEllipsoid(axes, center=1.5 * axes * towards)
    weight = np.eye(d)[space - 1] * rng.uniform(1.0, 3.0)
    return ng.TaskPolytope([weight]) + ng.TaskEllipsoid(0.2 * axes)
