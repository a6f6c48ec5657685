"""Comparison of solutions by certified quality."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from itertools import chain, count

from nlpgrasp.common.formatting import columns
from nlpgrasp.errors import InputError
from nlpgrasp.experiments.experiment_result import NOT_COMPARABLE, overlapping_intervals, rank_intervals
from nlpgrasp.experiments.solve_record import SolveRecord
from nlpgrasp.quality import Bounds
from nlpgrasp.solution.solution import GraspSolution


@dataclass(frozen=True)
class Comparison:
    """Solutions ranked by certified quality, the best first.

    Parameters
    ----------
    names : tuple of str
        Of the solutions, the best first.
    records : tuple of SolveRecord
        Record of each, in the same order.
    ranks : tuple of int
        1 plus the number of solutions that are certainly better.
    ties : tuple of tuple of str
        Names of the solutions with overlapping certified intervals.
    comparable : bool
        Whether all measure mu by the same task and kind of force budget.
    """

    names: tuple[str, ...]
    records: tuple[SolveRecord, ...]
    ranks: tuple[int, ...]
    ties: tuple[tuple[str, ...], ...]
    comparable: bool

    @property
    def bounds(self) -> tuple[Bounds, ...]:
        """Certified bounds on mu of each solution; ``[0, 0]`` without a grasp."""
        return tuple(r.mu for r in self.records)

    def __str__(self) -> str:
        heads = ["rank", "solution", "mu certified in", "gap", "contacts", "seconds", "starts", "ties with", "active"]
        body = []
        for name, record, rank, ties in zip(self.names, self.records, self.ranks, self.ties, strict=True):
            starts = f"{record.succeeded}/{len(record.starts)}" if record.starts else ""
            quality = str(record.mu) if record.success else "no grasp"
            seconds = f"{record.seconds:.1f}" if record.seconds else ""
            row = [f"{rank}", name, quality, record.gap_text, f"{record.contacts}", seconds, starts, "; ".join(ties)]
            body.append([*row, "; ".join(record.active)])
        lines = columns(heads, body)
        if not self.comparable:
            lines.append(NOT_COMPARABLE)
        return "\n".join(lines)


def compare(solutions: Mapping[str, GraspSolution] | Iterable[GraspSolution]) -> Comparison:
    """Compare solutions by certified quality.

    Solutions whose certified intervals overlap are ties.

    Parameters
    ----------
    solutions : mapping of str to GraspSolution, or iterable of GraspSolution
        Without names, those of the problems are used, numbered where equal.

    Raises
    ------
    InputError
        On anything else, or without solutions.
    """
    solution_by_name = _check_solutions(solutions)
    records = {name: SolveRecord.of(name, 0, s) for name, s in solution_by_name.items()}
    bounds = [r.mu for r in records.values()]
    names = list(records)
    ranks, ties = rank_intervals(bounds), overlapping_intervals(bounds)
    order = sorted(range(len(names)), key=lambda i: (ranks[i], -bounds[i].upper))
    return Comparison(
        tuple(names[i] for i in order),
        tuple(records[names[i]] for i in order),
        tuple(ranks[i] for i in order),
        tuple(tuple(names[j] for j in ties[i] if bounds[j].upper > 0.0) for i in order),
        len({r.measured for r in records.values()}) <= 1,
    )


def _check_solutions(solutions: Mapping[str, GraspSolution] | Iterable[GraspSolution]) -> dict[str, GraspSolution]:
    """Return the validated solutions by distinct names."""
    if isinstance(solutions, Mapping):
        solution_by_name = dict(solutions)
    else:
        try:
            items = list(solutions)
        except TypeError:
            raise InputError("solutions", solutions, "solutions, or a mapping of names to solutions") from None
        names = [getattr(s, "name", "") for s in items]
        solution_by_name = {}
        for name, item in zip(names, items, strict=True):
            numbered_names = (f"{name} ({i})" for i in count(1))
            candidates = chain([name] if names.count(name) == 1 else [], numbered_names)
            solution_by_name[next(text for text in candidates if text not in solution_by_name)] = item
    if not solution_by_name:
        raise InputError("solutions", "none", "at least one solution")
    for name, solution in solution_by_name.items():
        if not isinstance(name, str) or not isinstance(solution, GraspSolution):
            raise InputError(f"solutions[{name!r}]", solution, "a GraspSolution, named by a text")
    return solution_by_name
