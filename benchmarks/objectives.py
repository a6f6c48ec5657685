"""Best nu and delta of default solves against 10,000 random placements: 20 problems of each objective.

``objectives:nu`` and ``objectives:delta`` measure one of them, ``objectives:nu:3`` one problem. Random placements are
ranked by an estimate that shares no code with the search: for delta the least support in random directions, for nu the
radial function in random directions, bounded by supports. The first few by rank are certified.
"""

import time

import numpy as np

import nlpgrasp as ng
from benchmarks.peers.surface import random_points

COUNT, PLACEMENTS, CERTIFIED = 20, 10_000, 25
POOL, BATCH, DIRECTIONS, RAYS = 4096, 500, 600, 300
BETTER = 1.01  # factor by which no random placement may be better
BODIES = {
    "square": ng.Polygon([[-0.05, -0.05], [0.05, -0.05], [0.05, 0.05], [-0.05, 0.05]]),
    "polygon": ng.Polygon([[0.0, 0.0], [0.1, 0.0], [0.125, 0.05], [0.05, 0.1], [-0.015, 0.06]]),
    "box": ng.Box([0.1, 0.06, 0.04]),
    "ellipsoid": ng.Ellipsoid([0.05, 0.04, 0.03]),
    "cylinder": ng.Cylinder(0.03, 0.1),
}


def run(part="", index=""):
    print(f"{COUNT} problems an objective, {PLACEMENTS:,} random placements each; best certified value of both")
    for objective in [part] if part else ["nu", "delta"]:
        chosen = [int(index)] if index else range(COUNT)
        ratios = [_compare(objective, n) for n in chosen]
        better = sum(ratio > BETTER for ratio in ratios)
        print(f"{objective}: random placements better by more than 1 % in {better} of {len(ratios)} (aim 0)")
        print(f"    random over solved: median {np.median(ratios):.3f}, most {max(ratios):.3f}", flush=True)


def _compare(objective, index):
    """Print a problem's best values, and return the best random one over the solved one."""
    rng = np.random.default_rng([17, index])
    name = list(BODIES)[index % len(BODIES)]
    body, friction = BODIES[name], float(rng.uniform(0.3, 0.9))
    count = int(rng.integers(2, 5) if body.space == 2 else rng.integers(3, 5))
    scale = float(body.size * rng.uniform(0.5, 1.5))
    contacts = [ng.FrictionContact(friction)] * count
    problem = ng.GraspProblem(body, contacts, objective=objective, torque_scale=scale, edge_margin=0.0)
    start_time = time.process_time()
    solution = ng.solve(problem, options=ng.SolveOptions(workers=1))
    seconds = time.process_time() - start_time
    solved = _value(objective, solution.grasp, scale) if solution.grasp is not None else 0.0
    placements = _ranked_placements(problem, objective, scale, rng)
    drawn = max((_value(objective, grasp, scale) for grasp in placements), default=0.0)
    ratio = drawn / solved if solved > 0.0 else np.inf
    print(
        f"{objective} {index:2d}: {name}, {count} contacts, friction {friction:.2f}: solved {solved:.4g}"
        f" in {seconds:.1f} s, random {drawn:.4g}, ratio {ratio:.3f}",
        flush=True,
    )
    return ratio


def _value(objective, grasp, scale):
    """Return the middle of a grasp's certified bounds."""
    bounds = (ng.nu if objective == "nu" else ng.delta)(grasp, scale)
    return 0.5 * (bounds.lower + bounds.upper)


def _ranked_placements(problem, objective, scale, rng):
    """Return the stable ones among the first random placements by rank."""
    body, count = problem.body, len(problem.contacts)
    points, normals, _ = random_points(body, POOL, rng)
    index = rng.integers(POOL, size=(PLACEMENTS, count))
    friction, space = problem.contacts[0].friction, body.space
    dimension = 3 if space == 2 else 6
    v = rng.standard_normal((DIRECTIONS, dimension))
    v /= np.linalg.norm(v, axis=1, keepdims=True)
    u = rng.standard_normal((RAYS, dimension))
    u /= np.linalg.norm(u, axis=1, keepdims=True)
    along = np.maximum(u @ v.T, 1e-9)  # of rays and directions
    ranks = []
    for chosen in np.array_split(index, PLACEMENTS // BATCH):
        h = _supports(points[chosen], normals[chosen], friction, scale, body.centroid, v)
        if objective == "delta":
            ranks.append(h.min(axis=1))
        else:
            radii = np.array([np.min(row / along, axis=1) for row in h])
            ranks.append(np.mean(radii**dimension, axis=1) * (h.min(axis=1) > 0.0))
    order = np.argsort(-np.concatenate(ranks))[:CERTIFIED]
    grasps = [ng.Grasp(points[index[i]], normals[index[i]], problem.contacts, body.centroid) for i in order]
    return [grasp for grasp in grasps if ng.is_stable(grasp)]


def _supports(points, normals, friction, scale, origin, v):
    """Return the supports (b, m) of the wrench sets of placements (b, k, space) in directions v (m, d), torques scaled.

    The support of ``sqrt(sum |f|^2) <= 1`` is the root of the sum of squares of the distances of each contact's
    direction from the polar of its friction cone.
    """
    space, arms = points.shape[2], points - origin
    if space == 2:
        turned = np.stack([-arms[..., 1], arms[..., 0]], axis=-1) / scale
        pulls = v[:, :2] + v[:, 2:] * turned[:, :, None]
    else:
        pulls = v[:, :3] + np.cross(v[None, None, :, 3:] / scale, arms[:, :, None])
    normal = np.einsum("bkmi,bki->bkm", pulls, normals)
    tangential = np.sqrt(np.maximum(np.sum(pulls**2, axis=3) - normal**2, 0.0))
    on_edge = np.maximum(normal + friction * tangential, 0.0) / np.sqrt(1.0 + friction**2)
    inside = tangential <= friction * normal
    return np.sqrt(np.sum(np.where(inside, normal**2 + tangential**2, on_edge**2), axis=1))
