"""One timed call: ``python -m benchmarks.one_call BODY [HAND [STARTS]]`` prints the seconds of each stage as JSON.

``HAND`` is ``none``, ``four`` (four fingers, 16 joints) or ``leap``. More starts than one run on two workers.
"""

import json
import os
import resource
import sys
import time

STATED = ("box", "ellipsoid")


def main(name, hand_name="none", starts="1"):
    """Print CPU seconds of imports, reading, the first solve and a second one, on one core; wall time on two."""
    workers = 1 if starts == "1" else 2
    os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[:workers])
    clock = time.process_time if workers == 1 else time.perf_counter
    took, stage_start = {}, clock()

    def mark(stage):
        nonlocal stage_start
        stage_end = clock()
        took[stage], stage_start = stage_end - stage_start, stage_end

    import nlpgrasp as ng

    mark("import")
    parts = ng.GraspProblem, ng.TaskEllipsoid, ng.FrictionContact, ng.Box, ng.Ellipsoid, ng.Mesh, ng.solve
    mark("names")
    if name == "box":
        body = ng.Box([0.08, 0.04, 0.04])
    elif name == "ellipsoid":
        body = ng.Ellipsoid([0.06, 0.03, 0.03])
    else:
        body = ng.Mesh.load(name, unit="m" if "ycb" in name else "in")
    mark("body")
    hand, contacts = None, [ng.FrictionContact(0.7)] * 4
    if hand_name != "none":
        contacts = ng.FrictionContact(0.7)
    if hand_name == "four":
        from tests.hands.urdf import four_finger_hand

        hand = four_finger_hand()
    elif hand_name == "leap":
        from benchmarks.outside import HANDS

        hand = ng.hands.leap(HANDS / "leap_hand" / "leap_hand_right.urdf")
    mark("hand")
    problem = ng.GraspProblem(body, contacts, ng.TaskEllipsoid([1, 1, 1, *[body.size] * 3]), hand=hand)
    mark("problem")
    solution = ng.solve(problem, starts=int(starts), options=ng.SolveOptions(workers=workers))
    mark("solve")
    ng.solve(problem, starts=int(starts), seed=1, options=ng.SolveOptions(workers=workers))
    mark("second")
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0
    seconds = solution.solver["seconds"]
    print(json.dumps({"took": took, "stages": seconds, "mu": solution.mu.lower, "peak": peak, "names": len(parts)}))


if __name__ == "__main__":
    main(*sys.argv[1:])
