"""Single starts of hands with 7 to 22 joints on scans and primitives: quality beside the best of all, CPU seconds.

Of each hand and body 20 starts, one a call, and one call of eight starts. ``hands:leap,four:box,012_strawberry`` takes
these hands and bodies alone, ``hands:leap:box:5`` five seeds. Scans are those of the folder that NLPGRASP_TEST_DATA
names, and those of a further folder that NLPGRASP_SCANS names, in metres. Hands are those of ``hand_zoo``.
"""

import multiprocessing
import os
import time
import warnings
from pathlib import Path

import numpy as np
import pytest

import nlpgrasp as ng
from benchmarks.hand_zoo import HANDS as PUBLIC
from benchmarks.outside import MESHES
from tests.hands.urdf import four_finger_hand, three_finger_hand

SEEDS, EIGHT, FRICTION = 20, 8, 0.7
HANDS = ("allegro", "leap", "shadow", "four", "three")
PRIMITIVES = {
    "box": lambda: ng.Box([0.08, 0.05, 0.04]),
    "thin box": lambda: ng.Box([0.1, 0.07, 0.025]),
    "ellipsoid": lambda: ng.Ellipsoid([0.05, 0.03, 0.03]),
    "cylinder": lambda: ng.Cylinder(0.03, 0.12),
}


def run(hands=None, bodies=None, seeds=SEEDS):
    scans = {path.stem.removeprefix("ycb_"): path for path in _scans()}
    names = [*scans, *PRIMITIVES] if bodies is None else bodies.split(",")
    chosen = HANDS if hands is None else hands.split(",")
    arguments = [(hand, body, scans.get(body), int(seeds)) for hand in chosen for body in names]
    print(f"{'':34}none  least  tenth  median  eight  kkt  deepest mm  CPU s: median  most  eight")
    os.environ["OMP_NUM_THREADS"] = "1"
    with multiprocessing.get_context("spawn").Pool(os.cpu_count(), maxtasksperchild=1) as pool:
        rows = [row for row in pool.imap(_row, arguments, chunksize=1) if row is not None]
    if rows:
        shares, eights = np.concatenate([row[0] for row in rows]), np.array([row[1] for row in rows])
        tenth = np.quantile(shares, 0.1)
        print(f"single starts, share of the best: median {np.median(shares):.3f}, a tenth below {tenth:.3f}")
        print(f"eight starts: median {np.median(eights):.3f}, least {eights.min():.3f}")


def _scans():
    """Return the files of scans."""
    folders = [MESHES, *(Path(folder) for folder in [os.environ.get("NLPGRASP_SCANS")] if folder)]
    return sorted(
        path for folder in folders if folder.is_dir() for path in folder.iterdir() if path.suffix in (".stl", ".obj")
    )


def _hand(name):
    """Return a hand by name; None, saying so, where its file is missing."""
    if name in ("four", "three"):
        return {"four": four_finger_hand, "three": three_finger_hand}[name]()
    make, locate = PUBLIC[name]
    try:
        return make(locate())
    except pytest.skip.Exception as reason:
        print(f"{name}: {reason}")
        return None


def _row(job):
    """Solve a hand on a body with all seeds, print a row, and return the shares of the best mu."""
    name, body_name, path, seeds = job
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        hand = _hand(name)
        if hand is None:
            return None
        parts = path is not None and "ycb" not in path.stem and path.parent == MESHES
        body = PRIMITIVES[body_name]() if path is None else ng.Mesh.load(path, unit="in" if parts else "m")
        task = ng.TaskEllipsoid([1.0, 1.0, 1.0, *[body.size] * 3])
        problem = ng.GraspProblem(body, ng.FrictionContact(FRICTION), task, hand=hand)
        solutions, seconds = list[ng.GraspSolution](), list[float]()
        for seed in range(seeds + 1):
            start_time = time.process_time()
            starts = EIGHT if seed == seeds else 1
            solutions.append(ng.solve(problem, starts, seed, ng.SolveOptions(workers=1)))
            seconds.append(time.process_time() - start_time)
    mu = np.array([solution.mu.lower if solution.success else 0.0 for solution in solutions])
    best = float(np.max(mu)) or 1.0
    shares, solved = mu[:seeds] / best, [solution for solution in solutions[:seeds] if solution.success]
    small = np.mean([solution.kkt is not None and solution.kkt.is_small for solution in solved] or [0.0])
    deepest = max((solution.link_depth.depth for solution in solved if solution.link_depth is not None), default=0.0)
    print(
        f"{f'{name}, {body_name}':34}{np.sum(mu[:seeds] == 0.0):4}  {shares.min():.3f}  {np.quantile(shares, 0.1):.3f}"
        f"  {np.median(shares):6.3f}  {mu[-1] / best:.3f}  {small:.0%}  {1e3 * deepest:10.2f}"
        f"  {np.median(seconds[:-1]):13.2f}  {max(seconds[:-1]):4.1f}  {seconds[-1]:5.1f}  (best mu {best:.4g})",
        flush=True,
    )
    return shares, mu[-1] / best
