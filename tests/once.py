"""Solutions that several tests look at: one process of a run solves, the others read its file."""

import hashlib
import json
import os
from pathlib import Path

import nlpgrasp as ng

ALONE = ng.SolveOptions(workers=1, extras=True)
# where no bound, price or other quality than mu is looked at
GRASP = ng.SolveOptions(workers=1, global_bound=False, analyses=("drawing",))
# all but the volume nu, whose integral in six dimensions takes as long as a solve
WITHOUT_VOLUME = ng.SolveOptions(workers=1, analyses=("prices", "robustness", "delta", "drawing"))


def solve_once(problem, starts, options=ALONE, **more):
    """Return what ``ng.solve`` finds, from this run's folder where another test has asked the same."""
    asked = json.dumps([problem.to_dict(), starts, repr(options), repr(more)], sort_keys=True)
    path = Path(os.environ["NLPGRASP_CACHE"]) / f"once-{hashlib.sha256(asked.encode()).hexdigest()[:24]}.json"
    if not path.exists():
        ng.solve(problem, starts=starts, options=options, **more).save(path)
    return ng.GraspSolution.load(path)
