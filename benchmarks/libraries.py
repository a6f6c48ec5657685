"""Update of a task library's entry with 1,000 wrenches: time, and volume relative to a complete fit."""

import tempfile
import time
import warnings
from pathlib import Path

import numpy as np

import nlpgrasp as ng
from tests.tasks.clouds import CLOUDS

NEW, SEEDS, PREVIOUS_COUNTS = 1000, 10, (2000, 10_000, 100_000)
KINDS = {**CLOUDS, "in a box": lambda rng, n, t: rng.uniform(-1, 1, (n, 6))}


def volume(task):
    """Return the product of a task's nonzero semi-axes."""
    return float(np.prod(np.linalg.svd(task.axes)[1][: np.linalg.matrix_rank(task.axes, 1e-6)]))


def measure_update(kind, previous_count, seed, folder):
    """Return wall and CPU seconds of the last update, seconds of a complete fit, excess volume, and certified gap."""
    rng = np.random.default_rng(seed)
    library = ng.TaskLibrary(folder)
    batches = [KINDS[kind](rng, NEW, i * NEW / previous_count) for i in range(previous_count // NEW + 1)]
    library.add("task", batches[0])
    for rows in batches[1:]:
        start_time, cpu_start_time = time.perf_counter(), time.process_time()
        entry = library.update("task", rows)
        seconds, cpu_seconds = time.perf_counter() - start_time, time.process_time() - cpu_start_time
    start_time = time.perf_counter()
    complete_fit = ng.fit_ellipsoid(np.concatenate(batches)).task
    fit_seconds = time.perf_counter() - start_time
    return seconds, cpu_seconds, fit_seconds, volume(entry.task) / volume(complete_fit) - 1.0, entry.learnt.gap


def run():
    warnings.simplefilter("ignore")  # of flat ellipsoids
    for kind in KINDS:
        for previous_count in PREVIOUS_COUNTS:
            results = []
            for seed in range(SEEDS if previous_count < PREVIOUS_COUNTS[-1] else 3):
                with tempfile.TemporaryDirectory() as folder:
                    results.append(measure_update(kind, previous_count, seed, Path(folder) / "library"))
            seconds, cpu_seconds, fit_seconds, excess, gap = np.array(results).T
            print(
                f"{kind}, {previous_count} before: {1e3 * np.median(seconds):.0f} ms "
                f"(most {1e3 * seconds.max():.0f}, aim 1000), "
                f"{1e3 * np.median(cpu_seconds):.0f} ms of work (most {1e3 * cpu_seconds.max():.0f}), "
                f"a fit of all {1e3 * np.median(fit_seconds):.0f} ms, volume at most {excess.max():+.1e} (aim 1e-2), "
                f"stated {gap.max():.1e}"
            )
