"""Random task paths followed against cold solves of their steps: CPU time, quality, steps without a grasp."""

import numpy as np

from tests.studies.random_paths import COUNT, STARTS, STEPS, compared, random_path

SHARE, RATIO = 0.30, 0.97
FRESH = (30, 31, 33, 34, 36, 37)  # paths that no constant was tuned on
COLD_IN_SPACE = (0, 3, 7)  # steps of a spatial path that are solved cold: each takes up to a minute


def run(numbers=(*range(COUNT), *FRESH)):
    print(f"paths of {STEPS} steps, {STARTS} starts; CPU time of a step")
    planar = [number for number in numbers if number % 3 < 2]
    _run("planar, tuned on", [n for n in planar if n < COUNT], range(STEPS))
    _run("planar, fresh", [n for n in planar if n >= COUNT], range(STEPS))
    _run(f"spatial, cold at steps {COLD_IN_SPACE}", [n for n in numbers if n not in planar], COLD_IN_SPACE)


def _run(title, numbers, at):
    found = []
    for number in numbers:
        path, one = random_path(number), compared(number, at)
        found.append(one)
        body = f"{type(path.body).__name__}, {path.contacts} contacts"
        print(
            f"path {number:2d}: {body}, turn {abs(np.degrees(path.turn)):3.0f} deg: share of time"
            f" {one.seconds / one.cold_seconds:.2f} of {one.cold_seconds:.1f} s, least ratio {one.ratio:.3f},"
            f" without grasp {np.sum(one.followed <= 0.0)} (cold {np.sum(one.cold <= 0.0)}), lost {one.lost}",
            flush=True,
        )
    if not found:
        return
    share = sum(one.seconds for one in found) / sum(one.cold_seconds for one in found)
    print(
        f"{title}: share of time {share:.3f} (aim at most {SHARE}), least ratio {min(one.ratio for one in found):.3f}"
    )
    print(f"(aim at least {RATIO}), lost {sum(one.lost for one in found)} steps (aim 0)")
