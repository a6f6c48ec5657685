"""What a quick solve left out, added to its solution later."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import replace

from nlpgrasp.common.stopping.stop import Stop
from nlpgrasp.errors import InputError
from nlpgrasp.grasp.grasp import Grasp
from nlpgrasp.hands.base import Hand
from nlpgrasp.hands.posed_hand import PosedHand
from nlpgrasp.problem.from_dict import problem_from_dict
from nlpgrasp.problem.problem import GraspProblem
from nlpgrasp.quality import delta
from nlpgrasp.solution.given import given_solution
from nlpgrasp.solution.records import StartRecord, Status
from nlpgrasp.solution.solution import GraspSolution
from nlpgrasp.solve.after.look_back import extras
from nlpgrasp.solve.answer import OTHER_RTOL, volume_of
from nlpgrasp.solve.ascent.state import Effort
from nlpgrasp.solve.options import SolveOptions
from nlpgrasp.solve.squeeze import with_squeeze, with_squeezes
from nlpgrasp.solve.start.result import StartGrasp
from nlpgrasp.solve.start.run import with_hand
from nlpgrasp.solve.surface.on_body import OnBody
from nlpgrasp.solve.workbench.clock import Clock
from nlpgrasp.solve.workbench.placed import Placed
from nlpgrasp.solve.workbench.workbench import Workbench
from nlpgrasp.solve.workers.one_thread import one_thread

PARTS = ("body", "contacts", "task", "constraints")  # of a problem, that a file's has to agree with


def with_extras(solution: GraspSolution, problem: GraspProblem | None = None) -> GraspSolution:
    """Return a solution together with what a solve with ``extras=False`` left out.

    delta and nu need the grasp alone; robustness, the drawing and shadow prices need the problem: one without a hand is
    read from the solution as far as it holds it (no mesh, no expressions of the user's).
    What is there already stays as it is, and so does all of a solution without a grasp.

    Parameters
    ----------
    solution : GraspSolution
        What was found, of ``solve`` or from a file.
    problem : GraspProblem, optional
        That was solved.

    Raises
    ------
    InputError
        When ``problem`` is not the one that the solution states.
    """
    solution = given_solution(solution)
    if problem is not None:
        _check_same(solution, problem)
    grasp = solution.grasp
    if grasp is None:
        return solution
    with one_thread():
        small = solution.delta or delta(grasp, grasp.mean_arm, OTHER_RTOL, force_budget=solution.budget)
        volume = solution.nu or volume_of(grasp, solution.budget)
        measured = replace(solution, delta=small, nu=volume, stated_first=None)
        asked = problem or _told(solution)
        if asked is None or (solution.robust is not None and solution.drawing is not None):
            return _squeezed(measured, None if asked is None else asked.hand)
        bench = Workbench(asked, SolveOptions(workers=1))
        found = extras(bench, _as_start(bench, solution, grasp), Stop(), Clock())
    whole = replace(
        measured,
        prices=solution.prices or found.prices,
        robust=solution.robust or (found.robust and found.robust.beside(solution.mu)),
        drawing=solution.drawing or found.drawing,
    )
    return _squeezed(whole, asked.hand)


def _squeezed(solution: GraspSolution, hand: Hand | None) -> GraspSolution:
    """Return a solution whose answer and other grasps state a squeeze, as files of earlier versions may not."""
    return with_squeezes(with_squeeze(solution, hand), hand)


def _check_same(solution: GraspSolution, problem: GraspProblem) -> None:
    """Refuse a problem that differs from what a solution states."""
    given, stated = problem.to_dict(), solution.problem
    for part in PARTS:
        if _plain(given[part]) != _plain(stated[part]):
            raise InputError(f"problem.{part}", "another than the solution's", "the problem that was solved")
    if (problem.hand is None) != (stated.get("hand") is None):
        raise InputError("problem.hand", "another than the solution's", "the problem that was solved")


def _plain(data: object) -> object:
    """Return data as a file holds it."""
    return json.loads(json.dumps(data))


def _told(solution: GraspSolution) -> GraspProblem | None:
    """Return the problem as the solution holds it, None where it does not hold all of it."""
    grasp = solution.grasp
    if solution.problem.get("hand") is not None or grasp is None:
        return None
    try:
        return problem_from_dict(solution.problem, grasp.torque_origin)
    except InputError:
        return None


def _as_start(bench: Workbench, solution: GraspSolution, grasp: Grasp) -> StartGrasp:
    """Return the grasp as the start that found it ended with it."""
    hand = bench.problem.hand
    placed = Placed(solution.faces, grasp.points)
    if isinstance(hand, PosedHand) and isinstance(solution.hand, Mapping):
        placed = replace(placed, hand=hand.values_of(solution.hand))
    elif hand is not None:
        placed = with_hand(bench, placed)
    record = StartRecord(0, Status.SOLVED, solution.faces, solution.mu)
    found = OnBody.of(bench, placed, grasp, solution.surface)
    return StartGrasp(record, found, solution.constraints, Effort(), solution.robust, placed)
