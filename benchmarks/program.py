"""Default solves with and without the global bound: quality, KKT residuals, and cost of the last solver step.

``program:0:20`` runs the first 20 problems, ``program:hands`` those with a hand. ``program:refine:0:30:20`` solves the
program of the first 30 by directions by need, from 20 random starts each and from the answer, under three budgets.
"""

import time
from dataclasses import replace

import numpy as np

import nlpgrasp as ng
from benchmarks.outside import MESHES, MISSING, load_mesh
from tests.hands.urdf import four_finger_hand, three_finger_hand
from tests.kkt_by_differences import kkt_by_differences

PROBLEMS, WITH_HAND, STARTS = 40, 10, 8
NEAR, SMALL = 0.01, 1e-6
ANALYTIC = ("box", "prism", "sphere", "ellipsoid", "cylinder", "torus", "superquadric")
WITH_A_HAND = (0, 3, 4, 9, 10)  # kinds of bodies with a hand: box, ellipsoid, cylinder, two scans


def run(first=0, *further):
    if first == "refine":
        by_need(*map(int, further))
        return
    last = further[0] if further else PROBLEMS
    indices = range(PROBLEMS - WITH_HAND, PROBLEMS) if first == "hands" else range(int(first), int(last))
    is_near, seconds, residuals, last_step_shares = [], [], [], []
    for index in indices:
        name, problem = random_problem(index)
        if problem is None:
            print(f"{index} {name}: skipped, {MISSING}")
            continue
        (default, spent), (alone, spent_alone) = (solve_timed(problem, bound) for bound in (True, False))
        is_near.append(alone.mu.lower >= (1.0 - NEAR) * default.mu.lower)
        seconds.append((spent, spent_alone))
        last_step_shares.append(default.solver["seconds"]["last step"] / default.solver["seconds"]["total"])
        residuals += [kkt(problem, default), kkt(problem, alone)]
        print(
            f"{index} {name}: default {default.mu.lower:.4f} ({spent:.1f} s of CPU), without the bound"
            f" {alone.mu.lower:.4f} ({spent_alone:.1f} s); KKT {residuals[-2]:.0e}, {residuals[-1]:.0e}; last step"
            f" {last_step_shares[-1]:.0%}{'' if is_near[-1] else f'  {alone.mu.lower / default.mu.lower:.1%}'}",
            flush=True,
        )
    medians = np.median(np.array(seconds), axis=0)
    print(f"without the bound {sum(is_near)} of {len(is_near)} answers are within 1 % of the default's (aim 95 %)")
    counts = [sum(r < SMALL for r in residuals[i::2]) for i in (0, 1)]
    print(f"KKT residuals by differences below 1e-6 in {counts[0]} and {counts[1]} of {len(is_near)} (aim 38 of 40)")
    print(f"the last step takes {np.median(last_step_shares):.0%} of a call in the median (aim 10 %)")
    print(f"CPU seconds in the median: {medians[0]:.1f} and {medians[1]:.1f}")


def by_need(first=0, last=PROBLEMS - WITH_HAND, starts=20, rtol=0.01):
    """Print how near beta is to its certificate, and the best start and that from the answer over the answer's mu."""
    certified, reached, kept = [], [], []
    for index in range(first, last):
        name, problem = random_problem(index)
        if problem is None:
            print(f"{index} {name}: skipped, {MISSING}")
            continue
        problem = replace(problem, force_budget=("l2", "shared", "per_finger")[index % 3])
        answer = ng.solve(problem, options=ng.SolveOptions(workers=1, rank="mu", global_bound=False))
        start_time = time.process_time()
        results = [ng.formulate(problem).solve(seed, refine=True, rtol=rtol) for seed in range(starts)]
        seconds = (time.process_time() - start_time) / starts
        certified += [result.mu.lower >= (1.0 - rtol - 1e-9) * result.beta for result in results]
        best = max(result.mu.lower for result in results)
        again = ng.formulate(problem).solve(answer, refine=True, rtol=rtol).mu.lower
        reached.append(best / answer.mu.lower)
        kept.append(again / answer.mu.lower)
        print(
            f"{index} {name}, {problem.force_budget}: answer {answer.mu.lower:.4f}, best of {starts}"
            f" {reached[-1]:.3f}, from the answer {kept[-1]:.4f}; certified {sum(certified[-starts:])} of {starts},"
            f" {seconds:.1f} s a start",
            flush=True,
        )
    near = sum(ratio >= 0.98 for ratio in reached)
    print(f"certified within {rtol:.0%} of its beta {sum(certified)} of {len(certified)} (aim all)")
    print(f"the best start at least 98 % of the answer in {near} of {len(reached)} (aim 27 of 30)")
    print(f"from the answer least {min(kept):.4f} (aim 1)")


def solve_timed(problem, bound):
    """Solve with or without the global bound, and return the solution and the CPU seconds."""
    start_time = time.process_time()
    options = ng.SolveOptions(workers=1, rank="mu", joint_margin=0.0, global_bound=bound)
    return ng.solve(problem, starts=STARTS, options=options), time.process_time() - start_time


def kkt(problem, solution):
    """Return the largest KKT residual by central differences.

    It is infinite, and the reason is printed, if the solution states no small residual.
    """
    if solution.kkt is None or not solution.kkt.is_small:
        print(f"    {solution.status.name.lower()}: {solution.kkt and solution.kkt.words}")
        return np.inf
    residuals = kkt_by_differences(problem, solution)
    return max(residuals.stationarity, residuals.complementarity)


def random_problem(index):
    """Return name and random problem of an index.

    The problem is ``None`` if its mesh is missing.
    """
    rng = np.random.default_rng(index)
    has_hand = index >= PROBLEMS - WITH_HAND
    kind = index % 13 if not has_hand else WITH_A_HAND[index % len(WITH_A_HAND)]
    body = analytic_body(ANALYTIC[kind], rng) if kind < len(ANALYTIC) else shared_mesh(kind - len(ANALYTIC))
    k, friction, is_centred = int(rng.integers(3, 6)), float(rng.uniform(0.3, 0.9)), bool(rng.integers(2))
    name = (
        f"{ANALYTIC[kind] if kind < len(ANALYTIC) else 'mesh'}, {'hand, ' if has_hand else ''}friction {friction:.2f}"
    )
    if body is None:
        return name, None
    size = body.size
    axes = rng.uniform(0.4, 1.0, 6) * np.repeat([1.0, size], 3)
    centre = np.zeros(6) if is_centred else np.concatenate([rng.normal(size=3), 0.2 * size * rng.normal(size=3)])
    centre[:3] *= 0.0 if is_centred else 1.2 / np.linalg.norm(centre[:3])
    task = ng.TaskEllipsoid(axes, center=centre)
    contacts = [ng.FrictionContact(friction)] * ((4 if index % 2 else 3) if has_hand else k)
    hand_model = None if not has_hand else four_finger_hand() if index % 2 else three_finger_hand()
    return f"{name}, {len(contacts)} contacts, {'centred' if is_centred else 'one-sided'}", ng.GraspProblem(
        body, contacts, task, hand=hand_model
    )


def analytic_body(kind, rng):
    """Return an analytic body of random size, about 3 to 8 cm."""
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


def shared_mesh(index):
    """Load the shared mesh of an index, or return ``None`` if it is missing."""
    paths = sorted(MESHES.glob("*.stl"))
    if index >= len(paths):
        return None
    path = paths[index]
    return load_mesh(path)
