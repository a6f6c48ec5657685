"""Dynamic grasping (Section 3.6): grasps for a task that changes with a parameter.

The contacts for one task are a few refinement steps away from a local optimum for a slightly different task: the
program is the same except for its cuts. At each step, a short branch and bound shows whether another local optimum is
much better, so that a regrasp pays; for smaller gains the fingers stay where they are.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from nlpgrasp.common.validation import array, number
from nlpgrasp.errors import InputError
from nlpgrasp.problem.problem import GraspProblem
from nlpgrasp.solve.options import SolveOptions, check_search
from nlpgrasp.solve.workbench.workbench import Workbench
from nlpgrasp.solve.workers.one_thread import one_thread
from nlpgrasp.studies.dynamic_grasp import DynamicGrasp
from nlpgrasp.studies.follower import Follower
from nlpgrasp.studies.sliding import CUTS


def follow_task(
    problem_at: Callable[[float], GraspProblem],
    parameters: ArrayLike,
    starts: int = 8,
    seed: int = 0,
    options: SolveOptions | None = None,
    regrasp_gain: float = 0.02,
) -> DynamicGrasp:
    """Return the grasps for a task that changes with a parameter, each warm-started from the previous one.

    Each is certified for its own parameter value; nothing is certified between two values, nor while fingers slide.

    Parameters
    ----------
    problem_at : callable
        Function of the parameter that returns the problem. Only its task and its name may differ.
    parameters : (m,) array
        At least 2, in the order in which the task changes.
    starts : int
        Starts of a cold solve, at steps where no followed grasp holds. Where branch and bound does not cover the
        problem, the first programs of as many starts search for local optima at both ends of the path, and those of a
        third at each step in between.
    seed : int
        Of the starts at the first task, and of cold solves.
    options : SolveOptions, optional
        Of the solves.
    regrasp_gain : float
        Least relative gain for which the fingers move, by sliding or by a regrasp to another local optimum; at least
        zero.

    Returns
    -------
    DynamicGrasp
        One step per parameter value, with a global bound where branch and bound covers the problem
        (``step.solution.gap``). A step without a grasp, even of a cold solve, has the status ``NO_GRASP``.

    Raises
    ------
    InputError
        When more than the task changes, a task is empty, or no grasp is found for any.
    """
    if not callable(problem_at):
        raise InputError("problem_at", problem_at, "a function of the parameter")
    starts, seed, options = check_search(starts, seed, options)
    values = array("parameters", parameters, (None,))
    if len(values) < 2:
        raise InputError("parameters", f"{len(values)} values", "at least 2")
    gain = number("regrasp_gain", regrasp_gain, at_least=0.0)
    problems = [_problem(problem_at, value) for value in values.tolist()]
    for problem, value in zip(problems[1:], values[1:].tolist(), strict=True):
        _check_same(problems[0], problem, value)
    first = Workbench(problems[0], options, CUTS)
    benches = [first, *(first.with_task(problem) for problem in problems[1:])]
    with one_thread():
        follower = Follower(benches, starts, seed, gain)
        steps = tuple(follower.step(i, value) for i, value in enumerate(values.tolist()))
    if not any(step.solution.mu.lower > 0.0 for step in steps):
        raise InputError("problem_at", "no grasp found for any of the parameters", "tasks with a grasp")
    return DynamicGrasp(problems[0].name, steps)


def _problem(problem_at: Callable[[float], GraspProblem], value: float) -> GraspProblem:
    problem = problem_at(value)
    if not isinstance(problem, GraspProblem):
        raise InputError("problem_at", problem, f"a GraspProblem at {value:g}")
    if not np.any(problem.task.second_moment()):
        raise InputError("problem_at", f"a task that asks for nothing at {value:g}", "tasks with some wrench")
    return problem


def _check_same(one: GraspProblem, other: GraspProblem, value: float) -> None:
    """Refuse problems that differ in more than their task."""
    a, b = one.to_dict(), other.to_dict()
    differ = [name for name in a if name != "task" and a[name] != b[name]]
    if not np.array_equal(one.origin, other.origin):
        differ.append("torque_origin")
    if differ:
        raise InputError(
            "problem_at", f"another {', '.join(differ)} at {value:g}", "problems that differ in their task"
        )
