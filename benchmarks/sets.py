"""Sets of grasps of a 16-joint hand: CPU seconds per grasp against single solves, and bytes per grasp.

``sets:N`` makes a set of N grasps of one object; ``sets:ten`` and ``sets:ten:N`` one of N for each of ten objects.
"""

import os
import tempfile
import time
import warnings
from pathlib import Path

import nlpgrasp as ng
from tests.hands.urdf import FOUR, four_finger_hand

GRASPS, SOLVES = 12, 3
TASK = ng.TaskEllipsoid([1.0, 1.0, 1.0, 0.02, 0.02, 0.02])
AIM, QUICKER = 4.0, 3.6  # CPU seconds on the machine of the aim, which is that many times quicker than that of the docs
LIMIT = 8000  # bytes a grasp


TEN = {
    "ellipsoid": ng.Ellipsoid([0.04, 0.03, 0.03]),
    "egg": ng.Ellipsoid([0.03, 0.03, 0.045]),
    "sphere": ng.Sphere(0.035),
    "box": ng.Box([0.06, 0.05, 0.09]),
    "cube": ng.Box([0.05, 0.05, 0.05]),
    "bar": ng.Box([0.12, 0.04, 0.04]),
    "cylinder": ng.Cylinder(0.03, 0.1),
    "disc": ng.Cylinder(0.04, 0.04),
    "prism": ng.Prism([[-0.03, -0.025], [0.03, -0.025], [0.01, 0.035]], 0.08),
    "superquadric": ng.Superquadric([0.035, 0.03, 0.045], (0.5, 0.5)),
}


def problem(name="ellipsoid"):
    """Return the problem of an object in a 16-joint hand."""
    return ng.GraspProblem(TEN[name], ng.FrictionContact(0.6), TASK, hand=four_finger_hand(), name=name)


def single_solves(count):
    """Print the CPU seconds per grasp of single solves and simulations, with programs compiled before."""
    options, hand_problem = ng.SolveOptions(workers=1, global_bound=False), problem()
    ng.solve(hand_problem, starts=1, options=options)
    solving = simulating = 0.0
    for seed in range(1, count + 1):
        start_time = time.process_time()
        solution = ng.solve(hand_problem, starts=1, seed=seed, options=options)
        middle = time.process_time()
        ng.simulate_hand(solution, FOUR)
        solving, simulating = solving + middle - start_time, simulating + time.process_time() - middle
    total = (solving + simulating) / count
    print(
        f"one by one: {solving / count:.1f} CPU s to solve, {simulating / count:.1f} to simulate: {total:.1f} a grasp"
    )


def grasp_set(problems, count):
    """Print the CPU seconds and bytes per grasp of a set of ``count`` grasps a problem."""
    with tempfile.TemporaryDirectory() as folder:
        start_time = time.perf_counter()
        grasps = ng.make_set(problems, count, Path(folder) / "set", folders=[FOUR.parent])
        seconds = time.perf_counter() - start_time
        frame, grasp_count = grasps.frame(failures=True), len(grasps)
        solving, simulating = (frame[name].sum() / grasp_count for name in ("cpu_seconds", "simulation_cpu_seconds"))
        size = sum(file.stat().st_size for file in (grasps.path / "rows").iterdir()) / grasp_count
        aim = f"aim {AIM:g}, {AIM * QUICKER:.1f} on a machine {QUICKER:g} times slower"
        cost = f"{solving:.1f} CPU s to solve, {simulating:.1f} to simulate: {solving + simulating:.1f} a grasp"
        print(f"in a set of {grasp_count}: {cost} ({aim})", flush=True)
        print(f"{60.0 * grasp_count / seconds:.1f} grasps a minute on {len(os.sched_getaffinity(0))} cores")
        print(f"{size:.0f} bytes a grasp (limit {LIMIT})")
        print(f"rows: {', '.join(f'{n} {s}' for s, n in grasps.counts().items() if n)}")
        print(f"simulated: {dict(grasps.frame()['verdict'].value_counts())}")
        start_time = time.process_time()
        outcome = grasps.verify(workers=1)
        print(f"{outcome}".splitlines()[0], f"in {(time.process_time() - start_time) / grasp_count:.1f} CPU s a grasp")


def run(count=GRASPS, each=4):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        if count == "ten":
            return grasp_set([problem(name) for name in TEN], int(each))
        single_solves(SOLVES)
        return grasp_set([problem()], int(count))
