"""Certified quality along motions: slides of a finger, followed task paths, and finger moves of a hand.

``along:slides``, ``along:paths`` and ``along:hands`` print one table each.
"""

import time

import numpy as np

import nlpgrasp as ng
from tests.hands.urdf import four_finger_hand
from tests.quality.test_sliding_contact import BODIES, least_on_surface, random_slide
from tests.studies.random_paths import UNLIKE, compared, random_path

SLIDES = 12  # of each kind of body
PATHS = (*range(UNLIKE, UNLIKE + 12), 2, 5, 8, 11, 14, 17, 20, 23)  # planar with unlike fingers, then spatial
COLD_AT = (0, 3, 5, 7)  # steps that are solved cold, of 8
EXTENTS, MIDDLE = [0.08, 0.04, 0.04], 0.024  # metres: a box, and half the part of it that a pick-up may touch
HAND_SEEDS = range(4)


def run(part=""):
    tables = {"slides": slides, "paths": paths, "hands": hands}
    for table in [tables[part]] if part else tables.values():
        table()


def slides():
    """Print certified bounds of random slides against the least quality at random positions."""
    print(f"slides, {SLIDES} a body: certified bounds against random places of each path (aim: none below)")
    print(f"{'body':10} {'below':>5} {'widest':>7} {'stations':>8} {'s':>6}")
    for kind in BODIES:
        start_time, below, widths, stations = time.process_time(), 0, [], []
        for seed in range(SLIDES):
            body, path, others, task, budget, slid = random_slide(kind, seed)
            least = least_on_surface(body, path, others, task, budget, np.random.default_rng(seed))
            below += slid.bounds.lower > least * (1.0 + 1e-9)
            widths.append(slid.bounds.gap if slid.bounds.lower > 0.0 else 0.0)
            stations.append(slid.stations)
        seconds = (time.process_time() - start_time) / SLIDES
        print(f"{kind:10} {below:5d} {max(widths):7.1%} {np.mean(stations):8.1f} {seconds:6.2f}", flush=True)


def paths(indices=PATHS):
    """Print quality and CPU time of followed task paths relative to cold solves."""
    print("followed paths of 8 steps against cold solves of 6 starts (aim: 0.98 at least, 35 % of the CPU time)")
    print(f"{'path':>4} {'body':10} {'contacts':>8} {'turn':>5} {'least':>6} {'share':>6} {'lost':>4}")
    results = []
    for index in map(int, indices):
        path, result = random_path(index), compared(index, COLD_AT)
        results.append(result)
        turn, time_ratio = abs(np.degrees(path.turn)), result.seconds / result.cold_seconds
        print(
            f"{index:4d} {type(path.body).__name__:10} {path.contacts:8d} {turn:5.0f} {result.ratio:6.3f}"
            f" {time_ratio:6.0%} {result.lost:4d}",
            flush=True,
        )
    time_ratio = sum(result.seconds for result in results) / sum(result.cold_seconds for result in results)
    print(f"all: least {min(result.ratio for result in results):.3f}, share of time {time_ratio:.0%}")


def hands():
    """Print the finger moves of a hand from a pick-up to the best reachable grasp."""
    print("moves of a 16-joint hand from a pick-up at a box's middle to the best grasp within reach")
    print(f"{'seed':>4} {'picked':>7} {'reached':>7} {'moves':>5} {'longest mm':>10} {'held':>6} {'s':>5}  not reached")
    body, options = ng.Box(EXTENTS), ng.SolveOptions(workers=1, robust_offset=0.0, robust_friction=0.0)
    task = ng.TaskEllipsoid([1.0, 1.0, 1.0, *[body.size] * 3])
    goal = ng.GraspProblem(body, ng.FrictionContact(0.7), task, hand=four_finger_hand())
    near = ng.Workspace(ng.BoxRegion([-MIDDLE, -1.0, -1.0], [MIDDLE, 1.0, 1.0]))
    pick = ng.GraspProblem(body, ng.FrictionContact(0.7), task, hand=four_finger_hand(), constraints=[near])
    for seed in HAND_SEEDS:
        start_time = time.process_time()
        plan = ng.fine_manipulation(pick, goal, starts=1, seed=seed, options=options)
        longest = 1e3 * max((move.length for move in plan.moves), default=0.0)
        least_quality = min((move.least for move in plan.moves), default=np.inf)
        print(
            f"{seed:4d} {plan.pick.mu.lower:7.4f} {plan.goal.mu.lower:7.4f} {len(plan.moves):5d} {longest:10.1f}"
            f" {least_quality:6.3f} {time.process_time() - start_time:5.0f}  {'; '.join(plan.unreached)}",
            flush=True,
        )
