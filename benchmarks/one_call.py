"""One timed call: ``python -m benchmarks.one_call BODY [hand]`` prints the seconds of each stage as JSON."""

import json
import os
import resource
import sys
import time

STATED = ("box", "ellipsoid")


def main(name, with_hand):
    """Print the seconds of imports, reading, the first solve and a second one, each of one start on one core."""
    os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
    took, stage_start = {}, time.perf_counter()

    def mark(stage):
        nonlocal stage_start
        stage_end = time.perf_counter()
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
    if with_hand:
        from tests.hands.urdf import four_finger_hand

        hand, contacts = four_finger_hand(), ng.FrictionContact(0.7)
    mark("hand")
    problem = ng.GraspProblem(body, contacts, ng.TaskEllipsoid([1, 1, 1, *[body.size] * 3]), hand=hand)
    mark("problem")
    solution = ng.solve(problem, starts=1, options=ng.SolveOptions(workers=1))
    mark("solve")
    ng.solve(problem, starts=1, seed=1, options=ng.SolveOptions(workers=1))
    mark("second")
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0
    seconds = solution.solver["seconds"]
    print(json.dumps({"took": took, "stages": seconds, "mu": solution.mu.lower, "peak": peak, "names": len(parts)}))


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2:] == ["hand"])
