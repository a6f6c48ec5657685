"""Text summaries of the starts of a solve, and selection of the winning start."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence

from nlpgrasp.common.types import Json
from nlpgrasp.solution.records import UNKNOWN, StartRecord, Status

ALLOWED = 1e-4  # largest relative violation of grasps on a mesh; elsewhere a tenth of it
SOLVER_WORD = re.compile(r"\b[A-Z][A-Za-z]*(?:_[A-Z][A-Za-z]*)+\b")  # a status name of IPOPT in a message
SOLVED = ("Solve_Succeeded", "Solved_To_Acceptable_Level")  # statuses of a successful run of IPOPT
WORDS = {  # IPOPT's status to text, of the first program
    "Solve_Succeeded": "solved",
    "Solved_To_Acceptable_Level": "solved to a looser tolerance",
    "Maximum_Iterations_Exceeded": "stopped at the iteration limit",
    "Maximum_CpuTime_Exceeded": "stopped at the time limit",
    "Maximum_WallTime_Exceeded": "stopped at the time limit",
    "User_Requested_Stop": "stopped on request",
    "Infeasible_Problem_Detected": "found nothing that keeps the constraints",
    "Restoration_Failed": "did not get back to the constraints",
    "Search_Direction_Becomes_Too_Small": "stopped, as its steps became too small",
    "Diverging_Iterates": "diverged",
    "Error_In_Step_Computation": "could not compute a step",
    "Invalid_Number_Detected": "met a number that is not finite",
    "Invalid_Option": "did not run, as an option is invalid or the library of the linear solver does not load",
    "Insufficient_Memory": "did not run, for want of memory",
    "Internal_Error": "did not run, by an error of its own",
}
# how starts without a grasp end
BROKEN, UNHELD, NOWHERE = "broke a constraint", "could not hold the task", "found no placement"
INSIDE = "got a link inside something"
ERROR, CUT = "ended with an error", "ended before a grasp was found"


def solver_words(message: str) -> str:
    """Return a start's message with IPOPT's status names in plain words."""
    return SOLVER_WORD.sub(lambda word: WORDS.get(word[0], word[0].replace("_", " ").lower()), message)


def failure_reason(start: StartRecord) -> str:
    """Return a text on why a start is not solved; empty for a solved start."""
    ending = _failure_kind(start)
    if ending is None:
        return ""
    if ending == ERROR:
        return solver_words(start.message) or ERROR
    if ending == CUT:
        return start.message or CUT
    if ending == INSIDE:
        return start.obstruction or INSIDE
    violation = f"constraint violation {start.violation:.2g}"
    if ending == BROKEN:
        return violation if start.mu.lower > 0.0 else f"{violation}, and the task is not held"
    return "the task is not held" if ending == UNHELD else ending


def starts_lines(starts: Sequence[StartRecord]) -> list[str]:
    """Return text lines about how many starts found a grasp and how the others ended.

    Empty for a single start that found one.
    """
    failures = [s for s in starts if _failure_kind(s) is not None]
    count, successes = len(starts), len(starts) - len(failures)
    if count == successes:
        return [f"{'both' if count == 2 else f'all {count}'} starts found a grasp"] if count > 1 else []
    sentence = "the only start found no grasp"
    head = sentence if count == 1 else f"{successes or 'none'} of {count} starts found a grasp"
    counts = [_count_ended(ending, group) for ending, group in _group_by_reason(failures).items()]
    statuses = [word[0] for s in failures if (word := SOLVER_WORD.search(s.message)) and word[0] not in SOLVED]
    solver_counts = [
        f"{WORDS.get(status, solver_words(status))} ({statuses.count(status)})" for status in dict.fromkeys(statuses)
    ]
    solves = f"; their first solves: {', '.join(solver_counts)}" if solver_counts else ""
    return [f"{head}: {', '.join(counts)}{solves}"]


def ipopt_lines(solver: Json) -> list[str]:
    """Return a text line on the calls of a solve in which IPOPT did not run; empty if it always did.

    Parameters
    ----------
    solver : mapping
        ``solver`` of a solution.
    """
    failures = solver.get("ipopt_failures", {})
    if not failures:
        return []
    failed, calls = sum(failures.values()), max(sum(failures.values()), solver.get("ipopt_calls", 0))
    reasons = ", ".join(f"{status}: {count}" for status, count in failures.items())
    remainder = "steps" if failed == calls else "calls and steps"
    return [f"IPOPT did not run in {failed} of {calls} calls ({reasons}); the answer comes from the other {remainder}"]


def answer_start(starts: Sequence[StartRecord], best_start: int | None) -> StartRecord | None:
    """Return the start with the index ``best_start``; for None, the one with the largest certified upper bound."""
    if best_start is not None:
        return next((s for s in starts if s.index == best_start), None)
    solved = [s for s in starts if s.has_grasp and s.mu != UNKNOWN]
    return max(solved, key=lambda s: s.mu.upper, default=None)


def better_start_text(
    starts: Sequence[StartRecord],
    winner: StartRecord | None,
    before: float = 0.0,
    label: str = "mu",
    by_remaining_quality: bool = False,
    squeezed: bool = False,
) -> list[str]:
    """Return a text line on a start with a larger mu than the answer, and on why it did not win.

    Empty if there is none.

    Parameters
    ----------
    starts : sequence of StartRecord
    winner : StartRecord or None
        The start whose grasp is the answer.
    before : float
        The answer's mu before its joint-limit margins were improved.
    label : str
        The measure's name.
    by_remaining_quality : bool
        Whether starts were ranked by their remaining quality in the worst case.
    squeezed : bool
        Whether the answer had to be one that a hand can squeeze.
    """
    solved = [s for s in starts if s.status is Status.SOLVED and math.isfinite(s.mu.upper)]
    best = max(solved, key=lambda s: s.mu.upper, default=None)
    if winner is None or best is None or best.mu.upper <= max(winner.mu.upper, before):
        return []
    if best.obstruction:
        reason = best.obstruction
    elif by_remaining_quality:
        reason = "starts were ranked by what is left when contacts are off, which is more of the answer"
    elif best.mu.lower >= winner.mu.lower:
        reason = "less of it is left when contacts are off and friction is less"
        reason += ", or its contacts cannot press against each other" if squeezed else ""
    else:
        reason = "less of it is certified than of the answer"
    return [f"start {best.index} found {label} in {best.mu}: passed over, as {reason}"]


def _failure_kind(start: StartRecord) -> str | None:
    """Return how a start failed; None for a solved start."""
    if start.status is Status.SOLVED:
        return None
    if start.status is Status.TOUCHES:
        return INSIDE
    if start.status is Status.FAILED:
        return ERROR
    if start.status in (Status.TIME_LIMIT, Status.INTERRUPTED):
        return CUT
    if not math.isfinite(start.mu.upper):
        return NOWHERE
    return BROKEN if start.mu.lower > 0.0 or start.violation > ALLOWED else UNHELD


def _group_by_reason(starts: Sequence[StartRecord]) -> dict[str, list[StartRecord]]:
    """Return failed starts, grouped by how they failed."""
    groups: dict[str, list[StartRecord]] = {}
    for start in starts:
        groups.setdefault(_failure_kind(start) or "", []).append(start)
    return groups


def _count_ended(ending: str, starts: Sequence[StartRecord]) -> str:
    """Return the number of starts that failed in a given way as text, with violations if a constraint was broken."""
    if ending != BROKEN:
        return f"{len(starts)} {ending}"
    violations = [f"{extreme(s.violation for s in starts):.2g}" for extreme in (min, max)]
    return f"{len(starts)} {ending} (violation {' to '.join(dict.fromkeys(violations))})"
