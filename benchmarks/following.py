"""Followed tasks along random paths against cold solves of the steps: CPU time and quality."""

import numpy as np

from tests.studies.random_paths import COUNT, STARTS, STEPS, compared, random_path

SHARE, RATIO = 0.30, 0.97
FRESH = (30, 31, 33, 34, 36, 37)  # paths on which no constant was tuned
COLD_IN_SPACE = (0, 3, 7)  # steps of a spatial path that are solved cold, up to a minute each


def run(indices=(*range(COUNT), *FRESH)):
    print(f"paths of {STEPS} steps, {STARTS} starts; CPU time of a step")
    planar = [index for index in indices if index % 3 < 2]
    _run("planar, tuned on", [n for n in planar if n < COUNT], range(STEPS))
    _run("planar, fresh", [n for n in planar if n >= COUNT], range(STEPS))
    _run(f"spatial, cold at steps {COLD_IN_SPACE}", [n for n in indices if n not in planar], COLD_IN_SPACE)


def _run(title, indices, steps):
    """Print time and quality of some paths relative to cold solves, and their summary."""
    results = []
    for index in indices:
        path, result = random_path(index), compared(index, steps)
        results.append(result)
        body = f"{type(path.body).__name__}, {path.contacts} contacts"
        print(
            f"path {index:2d}: {body}, turn {abs(np.degrees(path.turn)):3.0f} deg: share of time"
            f" {result.seconds / result.cold_seconds:.2f} of {result.cold_seconds:.1f} s,"
            f" least ratio {result.ratio:.3f},"
            f" without grasp {np.sum(result.followed <= 0.0)} (cold {np.sum(result.cold <= 0.0)}), lost {result.lost}",
            flush=True,
        )
    if not results:
        return
    time_ratio = sum(result.seconds for result in results) / sum(result.cold_seconds for result in results)
    print(
        f"{title}: share of time {time_ratio:.3f} (aim at most {SHARE}),"
        f" least ratio {min(result.ratio for result in results):.3f}"
    )
    print(f"(aim at least {RATIO}), lost {sum(result.lost for result in results)} steps (aim 0)")
