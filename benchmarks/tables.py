"""Tables of grasps: rate of certificates for each budget, and CPU time of one command for many tasks."""

import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

import nlpgrasp as ng
from tests.samples import ellipsoid_grasp

COUNT, TABLE = 10_000, 200  # grasps certified in one stack, and in one table
TASKS = ("any small disturbance", "peg in hole", "opening a bottle", "plugging in a connector")
RTOL = 0.05


def random_arrays(count, axes):
    """Return points and normals of random grasps of an ellipsoid."""
    rng = np.random.default_rng(0)
    grasps = [ellipsoid_grasp(rng, 4, axes=axes) for _ in range(count)]
    return {name: np.stack([getattr(grasp, name) for grasp in grasps]) for name in ("points", "normals")}


def certificates(count):
    """Print the number of certificates per CPU second for mu and epsilon of one stack."""
    stack = ng.GraspStack(**random_arrays(count, (2.0, 1.0, 1.0)), contacts=ng.FrictionContact(0.5))
    ball = ng.TaskEllipsoid([1.0] * 6)
    measures = {
        "mu, l2": lambda: ng.mu(stack, ball, RTOL),
        "mu, per_finger": lambda: ng.mu(stack, ball, RTOL, force_budget="per_finger"),
        "epsilon": lambda: ng.delta(stack, 0.5, RTOL, force_budget="shared"),
    }
    for name, measure in measures.items():
        start_time = time.process_time()
        bounds = measure()
        rate = count / (time.process_time() - start_time)
        print(f"{name}: {rate:.0f} grasps a CPU second, {np.sum(bounds.lower > 0.0)} of {count} closed")


def command():
    """Print the CPU seconds of one command for many grasps, tasks and two friction coefficients."""
    with tempfile.TemporaryDirectory() as folder:
        np.savez(Path(folder, "grasps.npz"), **random_arrays(TABLE, (0.04, 0.03, 0.03)))
        line = [sys.executable, "-m", "nlpgrasp", "quality", "grasps.npz", "--friction", "0.5", "--friction", "0.8"]
        line += ["--measures", "mu,epsilon", "--out", "table.csv"]
        line += [part for task in TASKS for part in ("--task", task)]
        code = f"import resource, subprocess; subprocess.run({line!r}, check=True, capture_output=True); "
        code += "used = resource.getrusage(resource.RUSAGE_CHILDREN); print(used.ru_utime + used.ru_stime)"
        completed = subprocess.run([sys.executable, "-c", code], cwd=folder, check=True, capture_output=True, text=True)
        rows = len(Path(folder, "table.csv").read_text().splitlines()) - 1
    print(f"{rows} rows of mu and epsilon by one command: {float(completed.stdout):.1f} CPU seconds")


def run(count=COUNT):
    certificates(int(count))
    command()
