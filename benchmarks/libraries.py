"""A library's entry updated with 1,000 wrenches: time of the whole call, and volume against a fit of all."""

import tempfile
import time
import warnings
from pathlib import Path

import numpy as np

import nlpgrasp as ng
from tests.tasks.clouds import CLOUDS

NEW, SEEDS, BEFORE = 1000, 10, (2000, 10_000, 30_000)
KINDS = {**CLOUDS, "in a box": lambda rng, n, t: rng.uniform(-1, 1, (n, 6))}


def volume(task):
    return float(np.prod(np.linalg.svd(task.axes)[1][: np.linalg.matrix_rank(task.axes, 1e-6)]))


def one(kind, before, seed, folder):
    """Return seconds of the last update, of its own work and of a fit of all, the excess of volume, the stated gap."""
    rng = np.random.default_rng(seed)
    library = ng.TaskLibrary(folder)
    given = [KINDS[kind](rng, NEW, i * NEW / before) for i in range(before // NEW + 1)]
    library.add("task", given[0])
    for rows in given[1:]:
        begun, worked = time.perf_counter(), time.process_time()
        entry = library.update("task", rows)
        seconds, of_its_own = time.perf_counter() - begun, time.process_time() - worked
    begun = time.perf_counter()
    whole = ng.fit_ellipsoid(np.concatenate(given)).task
    all_at_once = time.perf_counter() - begun
    return seconds, of_its_own, all_at_once, volume(entry.task) / volume(whole) - 1.0, entry.learnt.gap


def run():
    warnings.simplefilter("ignore")  # of flat ellipsoids
    for kind in KINDS:
        for before in BEFORE:
            found = []
            for seed in range(SEEDS if before < BEFORE[-1] else 3):
                with tempfile.TemporaryDirectory() as folder:
                    found.append(one(kind, before, seed, Path(folder) / "library"))
            seconds, work, whole, excess, gap = np.array(found).T
            print(
                f"{kind}, {before} before: {1e3 * np.median(seconds):.0f} ms (most {1e3 * seconds.max():.0f}, aim 50), "
                f"{1e3 * np.median(work):.0f} ms of work (most {1e3 * work.max():.0f}), "
                f"a fit of all {1e3 * np.median(whole):.0f} ms, volume at most {excess.max():+.1e} (aim 1e-2), "
                f"stated {gap.max():.1e}"
            )
