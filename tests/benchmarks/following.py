"""Thirty random task paths followed against cold solves of every step: CPU time, quality, steps without a grasp."""

import numpy as np

from tests.studies.random_paths import COUNT, STARTS, STEPS, compared, random_path

SHARE, RATIO = 0.30, 0.97


def run(numbers=range(COUNT)):
    print(f"{len(numbers)} paths of {STEPS} steps, {STARTS} starts; CPU time")
    found = []
    for number in numbers:
        path, one = random_path(number), compared(number)
        found.append(one)
        body = f"{type(path.body).__name__}, {path.contacts} contacts"
        print(
            f"path {number:2d}: {body}, turn {abs(np.degrees(path.turn)):3.0f} deg: share of time"
            f" {one.seconds / one.cold_seconds:.2f} of {one.cold_seconds:.0f} s, least ratio {one.ratio:.3f},"
            f" without grasp {np.sum(one.followed <= 0.0)} (cold {np.sum(one.cold <= 0.0)}), lost {one.lost}",
            flush=True,
        )
    share = sum(one.seconds for one in found) / sum(one.cold_seconds for one in found)
    print(f"all: share of time {share:.3f} (aim at most {SHARE}), least ratio {min(one.ratio for one in found):.3f}")
    print(f"(aim at least {RATIO}), lost {sum(one.lost for one in found)} steps (aim 0)")
