"""The program alone beside the default: 40 problems with and without the bound, KKT residuals, cost of the last step.

``program:0:20`` runs the first 20 problems, ``program:hands`` those with a hand.
"""

import time

import numpy as np

import nlpgrasp as ng
from benchmarks.outside import MESHES, MISSING
from tests.hands.urdf import four_finger_hand, three_finger_hand
from tests.kkt_by_differences import kkt_by_differences

PROBLEMS, WITH_HAND, STARTS = 40, 10, 8
NEAR, SMALL = 0.01, 1e-6
ANALYTIC = ("box", "prism", "sphere", "ellipsoid", "cylinder", "torus", "superquadric")
WITH_A_HAND = (0, 3, 4, 9, 10)  # box, ellipsoid, cylinder, two scans


def run(first=0, last=PROBLEMS):
    numbers = range(PROBLEMS - WITH_HAND, PROBLEMS) if first == "hands" else range(int(first), int(last))
    near, seconds, residuals, shares = [], [], [], []
    for number in numbers:
        name, problem = random_problem(number)
        if problem is None:
            print(f"{number} {name}: skipped, {MISSING}")
            continue
        (found, spent), (alone, spent_alone) = (solved(problem, bound) for bound in (True, False))
        near.append(alone.mu.lower >= (1.0 - NEAR) * found.mu.lower)
        seconds.append((spent, spent_alone))
        shares.append(found.solver["seconds"]["last step"] / found.solver["seconds"]["total"])
        residuals += [kkt(problem, found), kkt(problem, alone)]
        print(
            f"{number} {name}: default {found.mu.lower:.4f} ({spent:.1f} s of CPU), without the bound"
            f" {alone.mu.lower:.4f} ({spent_alone:.1f} s); KKT {residuals[-2]:.0e}, {residuals[-1]:.0e}; last step"
            f" {shares[-1]:.0%}{'' if near[-1] else f'  {alone.mu.lower / found.mu.lower:.1%}'}",
            flush=True,
        )
    medians = np.median(np.array(seconds), axis=0)
    print(f"without the bound {sum(near)} of {len(near)} answers are within 1 % of the default's (aim 95 %)")
    small = [sum(r < SMALL for r in residuals[i::2]) for i in (0, 1)]
    print(f"KKT residuals by differences below 1e-6 in {small[0]} and {small[1]} of {len(near)} (aim 38 of 40)")
    print(f"the last step takes {np.median(shares):.0%} of a call in the median (aim 10 %)")
    print(f"CPU seconds in the median: {medians[0]:.1f} and {medians[1]:.1f}")


def solved(problem, bound):
    """Return the solution of eight starts in this process, with or without the bound, and the CPU seconds."""
    begun = time.process_time()
    options = ng.SolveOptions(workers=1, rank="mu", joint_margin=0.0, global_bound=bound)
    return ng.solve(problem, starts=STARTS, options=options), time.process_time() - begun


def kkt(problem, solution):
    """Return the largest KKT residual by central differences; inf, and the reason printed, where none is stated."""
    if solution.kkt is None or not solution.kkt.is_small:
        print(f"    {solution.status.name.lower()}: {solution.kkt and solution.kkt.words}")
        return np.inf
    found = kkt_by_differences(problem, solution)
    return max(found.stationarity, found.complementarity)


def random_problem(number):
    """Return a name and the problem; None where its mesh is missing."""
    rng = np.random.default_rng(number)
    hand = number >= PROBLEMS - WITH_HAND
    kind = number % 13 if not hand else WITH_A_HAND[number % len(WITH_A_HAND)]
    body = analytic_body(ANALYTIC[kind], rng) if kind < len(ANALYTIC) else shared_mesh(kind - len(ANALYTIC))
    k, friction, centred = int(rng.integers(3, 6)), float(rng.uniform(0.3, 0.9)), bool(rng.integers(2))
    name = f"{ANALYTIC[kind] if kind < len(ANALYTIC) else 'mesh'}, {'hand, ' if hand else ''}friction {friction:.2f}"
    if body is None:
        return name, None
    size = body.size
    axes = rng.uniform(0.4, 1.0, 6) * np.repeat([1.0, size], 3)
    middle = np.zeros(6) if centred else np.concatenate([rng.normal(size=3), 0.2 * size * rng.normal(size=3)])
    middle[:3] *= 0.0 if centred else 1.2 / np.linalg.norm(middle[:3])
    task = ng.TaskEllipsoid(axes, center=middle)
    contacts = [ng.FrictionContact(friction)] * ((4 if number % 2 else 3) if hand else k)
    mount = None if not hand else four_finger_hand() if number % 2 else three_finger_hand()
    return f"{name}, {len(contacts)} contacts, {'centred' if centred else 'one-sided'}", ng.GraspProblem(
        body, contacts, task, hand=mount
    )


def analytic_body(kind, rng):
    """Return a body of a random size and shape, some 3 to 8 cm large."""
    a, b, c = rng.uniform(0.02, 0.045, 3)
    outline = [[np.cos(t), np.sin(t)] for t in np.arange(5) * 2.0 * np.pi / 5.0]
    return {
        "box": lambda: ng.Box([2 * a, 2 * b, 2 * c]),
        "prism": lambda: ng.Prism(a * np.array(outline), height=2 * c),
        "sphere": lambda: ng.Sphere(a),
        "ellipsoid": lambda: ng.Ellipsoid([a, b, c]),
        "cylinder": lambda: ng.Cylinder(a, 2 * c),
        "torus": lambda: ng.Torus(a + 0.02, 0.01),
        "superquadric": lambda: ng.Superquadric([a, b, c], [0.7, 0.8]),
    }[kind]()


def shared_mesh(number):
    """Return one of the shared meshes, None where there are none."""
    paths = sorted(MESHES.glob("*.stl"))
    if number >= len(paths):
        return None
    path = paths[number]
    return ng.Mesh.load(path, unit="m" if path.name.startswith("ycb") else "in")
