"""Default solves of random problems in which few placements hold the task, against the best grasp known.

The task's centre lies .7 to 1.3 semi-axes from the origin, the friction of unlike contacts is .2 to .7. The best known
grasp is that of 64 starts of another seed, of starts led by the bound over all placements, and in the plane of a grid
refined five times. ``thin:0:20`` runs the first 20 problems.
"""

import time

import numpy as np

import nlpgrasp as ng

PROBLEMS, MANY, ANOTHER = 100, 64, 1000
OPTIONS = ng.SolveOptions(workers=1, rank="mu")


def run(first=0, last=PROBLEMS):
    """Print the quality of default solves relative to the best known, and how far the bound is from it."""
    ratios = []
    for index in range(int(first), int(last)):
        problem = thin_problem(index)
        start = time.process_time()
        solution = ng.solve(problem, options=OPTIONS)
        seconds, found = time.process_time() - start, solution.mu.lower
        known = best_known(problem, index)
        if max(found, known) <= 0.0:
            print(f"{index:3d} {problem.name}: no grasp known", flush=True)
            continue
        ratios.append(found / max(found, known))
        gap = "no bound" if solution.bound is None else f"bound {solution.bound.upper / max(found, known):.2f} of it"
        print(
            f"{index:3d} {problem.name}: mu {found:.4g}, {ratios[-1]:.3f} of the best, {gap}, {seconds:.1f} s",
            flush=True,
        )
    if ratios:
        near = np.mean(np.array(ratios) >= 0.98)
        print(f"{len(ratios)} problems: {near:.0%} within 2 %, least {min(ratios):.3f}")


def thin_problem(index):
    """Return the problem of an index: in turn two and three fingers in the plane, three and four in space."""
    rng = np.random.default_rng([9, index])
    kind = ("polygon", "polygon", "solid", "solid")[index % 4]
    count = (2, 3, 3, 4)[index % 4]
    if kind == "polygon":
        angles = np.sort(rng.uniform(0.0, 2.0 * np.pi, int(rng.integers(3, 6))))
        while np.max(np.diff([*angles, angles[0] + 2.0 * np.pi])) > 0.9 * np.pi or np.min(np.diff(angles)) < 0.5:
            angles = np.sort(rng.uniform(0.0, 2.0 * np.pi, len(angles)))
        body = ng.Polygon((0.05 * np.column_stack([np.cos(angles), np.sin(angles)])).tolist())
        kind = f"{len(angles)} edges"
    else:
        a, b, c = rng.uniform(0.02, 0.06, 3)
        kind = ("box", "ellipsoid", "cylinder")[int(rng.integers(3))]
        body = {
            "box": lambda: ng.Box([2 * a, 2 * b, 2 * c]),
            "ellipsoid": lambda: ng.Ellipsoid([a, b, c]),
            "cylinder": lambda: ng.Cylinder(a, 2 * b),
        }[kind]()
    size = 3 if body.space == 2 else 6
    semi_axes = np.exp(rng.uniform(np.log(0.03), 0.0, size))
    semi_axes[body.space :] *= body.size
    off = rng.standard_normal(size)
    centre = rng.uniform(0.7, 1.3) * semi_axes * off / np.linalg.norm(off)
    contacts = [ng.FrictionContact(float(friction)) for friction in rng.uniform(0.2, 0.7, count)]
    task = ng.TaskEllipsoid(semi_axes.tolist(), center=centre.tolist())
    return ng.GraspProblem(body, contacts, task, name=f"{kind}, {count} fingers")


def best_known(problem, index):
    """Return the largest mu found by many starts, by the bound's placements, and in the plane by a grid."""
    many = ng.solve(problem, starts=MANY, seed=ANOTHER, options=OPTIONS).mu.lower
    led = ng.best_possible(problem, time_limit=15.0).mu.lower
    return max(many, led, by_grid(problem, index) if problem.body.space == 2 else 0.0)


def by_grid(problem, index, spacing=160, rounds=5, kept=40):
    """Return the largest mu of a grid over the boundary of a polygon, refined around its best placements."""
    k = len(problem.models)
    rng = np.random.default_rng([index, 1])
    perimeter = np.linspace(0.0, 1.0, spacing, endpoint=False) + 0.5 / spacing
    if k == 2:
        places = np.stack(np.meshgrid(perimeter, perimeter, indexing="ij"), axis=-1).reshape(-1, 2)
    else:
        places = rng.random((40_000, k))
    width = 1.0 / spacing
    for _ in range(rounds):
        top = _best(problem, places, kept)
        moved = top[:, None] + width * rng.uniform(-1.0, 1.0, (kept, 400, k))
        places, width = np.concatenate([top, moved.reshape(-1, k) % 1.0]), 0.4 * width
    return float(np.max(ng.mu(_grasps(problem, _best(problem, places, 5)), problem.task).lower))


def _best(problem, places, count, looked_at=2000):
    """Return the best of places (b, k) by certified mu, of the best by ``screen``, which may be far above it."""
    places = places[np.argsort(-ng.screen(_grasps(problem, places), problem.task))[:looked_at]]
    return places[np.argsort(-ng.mu(_grasps(problem, places), problem.task, 0.05).lower)[:count]]


def _grasps(problem, places):
    """Return the grasps of fingers at shares (b, k) of a polygon's perimeter."""
    vertices = np.array(problem.body.vertices)
    sides = np.roll(vertices, -1, axis=0) - vertices
    lengths = np.linalg.norm(sides, axis=1)
    ends = np.cumsum(lengths)
    along = places * ends[-1]
    side = np.searchsorted(ends, along, side="right").clip(max=len(ends) - 1)
    margin = problem.margin / lengths[side]
    share = ((along - (ends - lengths)[side]) / lengths[side]).clip(margin, 1.0 - margin)
    points = vertices[side] + share[..., None] * sides[side]
    normals = (np.stack([-sides[:, 1], sides[:, 0]], axis=1) / lengths[:, None])[side]
    return ng.GraspStack(points, normals, problem.models, problem.origin)
