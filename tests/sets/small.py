"""Small sets of grasps: planar squares without a hand, a tenth of a second a start."""

import nlpgrasp as ng
from nlpgrasp.experiments.solve_job import Outcome, run_job
from nlpgrasp.sets.grasp_rows import COST, LABELS
from nlpgrasp.sets.grasp_unit import run_starts
from tests.experiments.small import base

UNREFINED = ng.SolveOptions(rounds=0, rtol=0.3, final_rtol=0.3, global_bound=False, rank="mu")
SETTINGS = {"options": UNREFINED, "simulate": False, "distinct": 0.2}
_results = {}  # of the starts, by problem and first start: each is run once in all tests


def square(friction):
    return ng.GraspProblem(base().body, [ng.FrictionContact(friction)] * 2, base().task, name=f"square {friction}")


def squares():
    return {"rough": square(0.8), "smooth": square(0.5)}


def run_starts_once(compiled, unit, starts):
    """Return what ``run_starts`` yields, computed once for each problem and unit."""
    key = compiled.problem.name, unit.seed, starts
    if key not in _results:
        _results[key] = list(run_starts(compiled, unit, starts))
    return iter(_results[key])


def run_here(units, factory, workers):
    """Run units one after another in this process."""
    for unit in units:
        job = factory(unit)
        if job is not None:
            yield unit, run_job(job)


def run_backwards(units, factory, workers):
    """Run units in the reverse order, so that no job knows the grasps before it."""
    yield from run_here(units[::-1], factory, workers)


def crash_in(problem, unit_index=None):
    """Return a runner in which the workers of one problem, or of one of its units, die twice."""

    def run(units, factory, workers):
        for unit, outcome in run_here(units, factory, workers):
            is_lost = unit.problem == problem and unit_index in (None, unit.index)
            yield unit, Outcome(failure="its process ended, twice (SIGKILL(-9))") if is_lost else outcome

    return run


def labels(grasps):
    """The rows of a set as text, without their cost."""
    rows = grasps.frame(failures=True)[[name for name in LABELS if name not in COST]]
    return rows.to_json(orient="records", double_precision=15)
