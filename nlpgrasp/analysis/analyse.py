"""Optional analyses of a solution: shadow prices, robustness, delta, nu, friction, phases of the hand, a drawing."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

from nlpgrasp.analysis.critical_friction import critical_friction
from nlpgrasp.analysis.shadow_prices import shadow_prices
from nlpgrasp.analysis.squeeze import add_squeeze, add_squeezes
from nlpgrasp.common.deadline import Deadline, Stopwatch
from nlpgrasp.common.files import json_round_trip
from nlpgrasp.common.user_warnings import warn
from nlpgrasp.contacts import ContactModel
from nlpgrasp.errors import InputError, NlpgraspError
from nlpgrasp.hands import URDFHand
from nlpgrasp.hands.base import Hand, PosedHand
from nlpgrasp.optimize.candidate import GraspCandidate, SolverEffort
from nlpgrasp.optimize.compiled_problem import CompiledProblem
from nlpgrasp.optimize.grasp_on_body import GraspOnBody
from nlpgrasp.optimize.hand_approach import add_hand_record
from nlpgrasp.optimize.options import ANALYSES, SolveOptions, check_analyses
from nlpgrasp.optimize.processes import single_thread
from nlpgrasp.optimize.robustness import robustness
from nlpgrasp.optimize.start import follow_with_hand
from nlpgrasp.optimize.start_result import StartGrasp, attempt
from nlpgrasp.problem.problem import GraspProblem
from nlpgrasp.quality import Bounds, Volume, delta, nu
from nlpgrasp.quality.critical_friction import HoldingForce, common_friction
from nlpgrasp.quality.grasp import Grasp
from nlpgrasp.quality.own_measures import OWN_MEASURES
from nlpgrasp.solution.analysis_records import CriticalFriction, StatedMeasure
from nlpgrasp.solution.grip_record import holding_force
from nlpgrasp.solution.obstructions import links_are_free
from nlpgrasp.solution.records import StartRecord, Status
from nlpgrasp.solution.solution import GraspSolution, require_solution
from nlpgrasp.solution.stored_drawing import draw_body_and_hand
from nlpgrasp.tasks import Task

RTOL = 0.02  # relative gap of delta, error bar of nu
PARTS = ("body", "contacts", "task", "constraints")  # of a problem, compared with those that a solution states
FIELDS = {"robustness": "robust", "phases": "hand"}  # of a solution, where an analysis has another name
OF_PHASES = ("pregrasp", "approach", "way_in", "phases", "lift")  # of a hand, as files state it
FAILED = "{}: not computed, as numerics failed ({})"
OF_SQUEEZE = ("squeeze", "no_squeeze")  # the same; the commands of a squeeze are the last phases


def analyse(solution: GraspSolution, *analyses: str, problem: GraspProblem | None = None) -> GraspSolution:
    """Return a solution with requested analyses of its grasp added.

    Analyses that the solution states already stay as they are.

    Parameters
    ----------
    solution : GraspSolution
        With a grasp.
    *analyses : str
        ``"prices"``: shadow prices of limits. ``"robustness"``: remaining quality under contact displacement and
        friction loss. ``"delta"``, ``"nu"``: two other measures of quality. ``"friction"``: the least friction with
        which the task is held, and the least force at others. ``"phases"``: keyframes of a hand with links, from
        approach to lift. ``"drawing"``: triangles of body and hand, for pages and exports. The name of a
        ``GraspMeasure``: its value. Without a name: all that the solution lacks, as far as its problem is known.
    problem : GraspProblem, optional
        That was solved. A solution of ``ng.solve`` knows its own; one from a file that has a mesh, a hand or a function
        of the user's does not, and takes ``"delta"``, ``"nu"`` and ``"friction"`` alone without it.

    Raises
    ------
    InputError
        On a name that is none of these, without a grasp, on ``"phases"`` without a hand that has links, on
        ``"friction"`` of contacts without one friction coefficient, on an analysis whose problem is not known, and on a
        problem that is not the one that the solution states.
    """
    solution = require_solution(solution)
    if problem is not None:
        _check_same_problem(solution, problem)
    names = check_analyses("analyses", analyses)
    contacts = solution.require_grasp().contacts
    problem = problem or solution.known_problem
    hand = None if problem is None else problem.hand
    check_possible("analyses", names, contacts, hand, problem is not None)
    lacking = [name for name in _applicable(names, problem) if not is_stated(solution, name)]
    of_problem = [name for name in lacking if analysis_of_grasp(name) is None]
    if of_problem and problem is None:
        requirement = "the problem that was solved, as the file does not hold its mesh, hand or function"
        raise InputError("problem", None, f"{requirement}: {', '.join(of_problem)} need it")
    analysed = solution
    for _, result in analyse_one_by_one(solution, lacking, problem):
        analysed = result
    return add_analyses_to(analysed, {}, hand)


def analyse_one_by_one(
    solution: GraspSolution, names: Iterable[str], problem: GraspProblem | None
) -> Iterator[tuple[str, GraspSolution]]:
    """Yield the name of each analysis, in order, with the solution extended by it.

    The problem's programs are built once.
    """
    grasp, prepared = solution.require_grasp(), list[tuple[CompiledProblem, StartGrasp]]()
    for name in names:
        if not is_stated(solution, name):
            with single_thread():
                of_grasp = analysis_of_grasp(name)
                if of_grasp is None and not prepared and problem is not None:
                    compiled = CompiledProblem(problem, SolveOptions(workers=1))
                    prepared.append((compiled, _start_of_solution(compiled, solution, grasp)))
                if of_grasp is not None:
                    value, message = of_grasp(grasp, solution.task, solution.holding), ""
                else:
                    value, message = _analyse_problem(name, *prepared[0], Deadline())
            if message:
                warn(message)
            solution = add_analyses_to(solution, {name: value}, None if problem is None else problem.hand)
        yield name, solution


def analyses_of(
    compiled: CompiledProblem, start: StartGrasp, names: Iterable[str], deadline: Deadline
) -> tuple[dict[str, Any], Mapping[str, float], list[str]]:
    """Return the results of analyses of a grasp by name, their times in seconds, and messages of failures.

    A numerical failure, or a stop, leaves one out.
    """
    clock, values, messages = Stopwatch(), dict[str, Any](), list[str]()
    with single_thread():
        for name in names:
            if deadline.should_stop():
                break
            if (of_grasp := analysis_of_grasp(name)) is not None:
                holding = holding_force(compiled.problem.to_dict(), compiled.budget(start.on_body.candidate))
                values[name] = of_grasp(start.on_body.grasp, compiled.problem.task, holding)
            else:
                values[name], message = _analyse_problem(name, compiled, start, deadline)
                messages += [message] if message else []
            clock.mark(name)
    return values, clock.seconds, messages


def add_analyses_to(solution: GraspSolution, results: Mapping[str, Any], hand: Hand | None) -> GraspSolution:
    """Return a solution with results of analyses added, and with squeezes if the hand can squeeze."""
    fields = {
        FIELDS.get(name, name): value
        for name, value in results.items()
        if value is not None and name not in OWN_MEASURES
    }
    if added := [value for name, value in results.items() if name in OWN_MEASURES]:
        fields["measures"] = (*solution.measures, *added)
    if "robust" in fields:
        fields["robust"] = fields["robust"].beside(solution.mu)
    if "hand" in fields:
        hand_data = {name: value for name, value in (solution.hand or {}).items() if name not in OF_SQUEEZE}
        fields["hand"] = hand_data | {name: value for name, value in fields["hand"].items() if name in OF_PHASES}
        if solution.status in (Status.SOLVED, Status.OPTIMAL) and not links_are_free(fields["hand"]):
            fields["status"] = Status.TOUCHES
    changed = replace(solution, **fields, stated_first=None) if fields else solution
    return add_squeezes(add_squeeze(changed, hand), hand)


def add_friction(solution: GraspSolution) -> GraspSolution:
    """Return a solution with the critical friction added; unchanged if it states one, or is not certified."""
    if solution.friction is not None or not solution.is_certified:
        return solution
    return replace(solution, friction=_friction(solution.require_grasp(), solution.task, solution.holding))


def requested_analyses(options: SolveOptions, solution: GraspSolution, hand: Hand | None) -> tuple[str, ...]:
    """Return the requested analyses that the solution does not yet contain."""
    names = all_analyses(hand) if options.extras else options.analyses
    return tuple(name for name in names if not is_stated(solution, name))


def all_analyses(hand: Hand | None) -> tuple[str, ...]:
    """Return the names of all analyses that are possible with a given hand, or without one."""
    names = (*ANALYSES, *OWN_MEASURES)
    return tuple(name for name in names if name != "phases" or isinstance(hand, URDFHand))


def is_stated(solution: GraspSolution, name: str) -> bool:
    """Return whether a solution contains an analysis."""
    if name in OWN_MEASURES:
        return any(measure.name == name for measure in solution.measures)
    if name == "phases":
        return "approach" in (solution.hand or {})
    return bool(getattr(solution, FIELDS.get(name, name)))


def format_added(before: GraspSolution, after: GraspSolution) -> str:
    """Return the analyses that one solution contains and an earlier one does not, as text."""
    names = (*ANALYSES, *OWN_MEASURES)
    added = [name for name in names if is_stated(after, name) and not is_stated(before, name)]
    return ", ".join(ANALYSES.get(name, name) for name in added)


def check_possible(
    field: str, names: Iterable[str], contacts: Sequence[ContactModel], hand: Hand | None, is_known: bool = True
) -> None:
    """Raise InputError if phases are requested without linked hand, or friction of contacts without one coefficient.

    Of phases nothing is raised if the problem is not known.
    """
    if "friction" in names:
        common_friction(contacts, field)
    if "phases" in names and is_known and not isinstance(hand, URDFHand):
        value = "phases" if hand is None else f"phases of an ng.{type(hand).__name__}"
        raise InputError(field, value, "no phases without a hand that has links, such as an ng.URDFHand")


def _applicable(names: tuple[str, ...], problem: GraspProblem | None) -> tuple[str, ...]:
    """Return the requested analyses, or all possible ones if none is requested."""
    if names:
        return names
    if problem is None:
        return (*OF_GRASP, *OWN_MEASURES)
    return all_analyses(problem.hand)


def _check_same_problem(solution: GraspSolution, problem: GraspProblem) -> None:
    """Raise for a problem that differs from the one that a solution states."""
    if not isinstance(problem, GraspProblem):
        raise InputError("problem", problem, "the GraspProblem that was solved")
    data, stated = problem.to_dict(), solution.problem
    for key in PARTS:
        if json_round_trip(data[key]) != json_round_trip(stated[key]):
            raise InputError(f"problem.{key}", "another than the solution's", "the problem that was solved")
    if (problem.hand is None) != (stated.get("hand") is None):
        raise InputError("problem.hand", "another than the solution's", "the problem that was solved")


def _start_of_solution(compiled: CompiledProblem, solution: GraspSolution, grasp: Grasp) -> StartGrasp:
    """Return the grasp of a solution as the result of a start."""
    hand, posture = compiled.problem.hand, solution.hand
    candidate = GraspCandidate(solution.faces, grasp.points)
    if isinstance(hand, PosedHand) and isinstance(posture, Mapping):  # the solution states the hand's posture
        candidate = replace(candidate, hand=hand.values_at(posture, grasp.points))
    elif hand is not None:  # the contacts determine the hand's variables
        candidate = follow_with_hand(compiled, candidate)
    record = StartRecord(0, Status.SOLVED, solution.faces, solution.mu)
    placed = GraspOnBody.of(compiled, candidate, grasp, solution.surface)
    return StartGrasp(record, placed, solution.constraints, SolverEffort(), solution.robust, candidate)


def _analyse_problem(name: str, compiled: CompiledProblem, start: StartGrasp, deadline: Deadline) -> tuple[Any, str]:
    """Return the result of one analysis and an empty message; on failure, None and a message."""
    value, message = attempt(partial(OF_PROBLEM[name], compiled, start, deadline))
    return value, message and FAILED.format(name, message)


def _delta(grasp: Grasp, _: Task, holding: HoldingForce) -> Bounds:
    """Return the quality delta with the mean arm as torque scale."""
    return delta(grasp, grasp.mean_arm, RTOL, force_budget=holding.budget)


def _nu(grasp: Grasp, _: Task, holding: HoldingForce) -> Volume | None:
    """Return the quality nu; None if it is too costly or fails."""
    if holding.budget.at(grasp.frames, grasp.contacts).costly:
        return None
    try:
        return nu(grasp, grasp.mean_arm, RTOL, force_budget=holding.budget)
    except NlpgraspError:
        return None


def _friction(grasp: Grasp, task: Task, holding: HoldingForce) -> CriticalFriction | None:
    """Return the critical friction; None of contacts without one friction coefficient."""
    try:
        return critical_friction(grasp, task, holding)
    except InputError:
        return None


# analyses by name: of a grasp, its task and the force that holds it, and those that take the compiled problem
OF_GRASP: Mapping[str, Callable[[Grasp, Task, HoldingForce], Any]] = {
    "delta": _delta,
    "nu": _nu,
    "friction": _friction,
}


def analysis_of_grasp(name: str) -> Callable[[Grasp, Task, HoldingForce], Any] | None:
    """Return the analysis of a name that takes grasp, task and holding force alone; None of others."""
    if name not in OWN_MEASURES:
        return OF_GRASP.get(name)
    measure = OWN_MEASURES[name]
    return lambda grasp, task, holding: StatedMeasure(name, measure.value(grasp, task, holding.budget), measure.unit)


OF_PROBLEM: Mapping[str, Callable[[CompiledProblem, StartGrasp, Deadline], Any]] = {
    "prices": shadow_prices,
    "robustness": lambda compiled, start, _: robustness(compiled, start.on_body.candidate, start.on_body.grasp),
    "phases": lambda compiled, start, _: add_hand_record(compiled, replace(start, hand=None)).hand,
    "drawing": lambda compiled, start, _: draw_body_and_hand(
        compiled.problem.body, compiled.problem.hand, start.on_body.candidate.hand
    ),
}
