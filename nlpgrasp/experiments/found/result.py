"""Result of an experiment over all variations."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from nlpgrasp.common.shown.text import columns
from nlpgrasp.experiments.ask.experiment import SolveId
from nlpgrasp.experiments.found.columns import Entry, Row, row_of
from nlpgrasp.experiments.found.ranking import ranks, ties
from nlpgrasp.experiments.found.record import NOT_DONE, SolveRecord
from nlpgrasp.experiments.found.stored import read_records
from nlpgrasp.experiments.found.table import frame
from nlpgrasp.experiments.found.variation_result import VariationResult
from nlpgrasp.experiments.run.folder import SOLVES, Folder
from nlpgrasp.solution.solution import GraspSolution

if TYPE_CHECKING:
    import pandas as pd

EXPLAINED = (
    "Intervals are of the grasps found, local optima: where few seeds agree with the best, more starts may find "
    "better. Gap: how much better than the best of them any grasp could be, at most, or how many times as good; "
    "loose where the bound is too far above to say."
)
NOT_COMPARABLE = "They differ in task or force budget: their values of mu measure different things."


@dataclass(frozen=True)
class ExperimentResult:
    """Result of an experiment, by variation.

    Parameters
    ----------
    name : str
        The experiment's.
    folder : Path
        Output folder with the solutions.
    variations : tuple of VariationResult
        In the experiment's order.
    notes : tuple of str
        Notes on files that could not be read or written.
    """

    name: str
    folder: Path
    variations: tuple[VariationResult, ...]
    notes: tuple[str, ...] = ()

    @classmethod
    def load(cls, folder: str | Path) -> ExperimentResult:
        """Read the result of an output folder, finished or not.

        Raises
        ------
        InputError
            When it is not the folder of an experiment.
        """
        place = Folder(folder)
        plan = place.plan()
        solves = [SolveId(name, seed) for name in plan["variations"] for seed in plan["seeds"]]
        records, notes = read_records(place, solves, plan)
        return cls.of(str(plan.get("name", "")), place, solves, records, notes)

    @classmethod
    def of(
        cls,
        name: str,
        place: Folder,
        solves: Sequence[SolveId],
        records: dict[SolveId, SolveRecord],
        notes: Sequence[str],
    ) -> ExperimentResult:
        """Return the result from the records of solves; solves without one are marked as not done."""
        by_variation: dict[str, list[SolveRecord]] = {}
        for solve in solves:
            record = records.get(solve) or SolveRecord(solve.variation, solve.seed, failure=NOT_DONE)
            by_variation.setdefault(solve.variation, []).append(record)
        variations = tuple(VariationResult(n, tuple(r)) for n, r in by_variation.items())
        return cls(name, place.path, variations, tuple(notes))

    def __getitem__(self, name: str) -> VariationResult:
        """Return a variation by name."""
        for variation in self.variations:
            if variation.name == name:
                return variation
        raise KeyError(name)

    @property
    def solves(self) -> tuple[SolveRecord, ...]:
        """Records of all solves, variation by variation."""
        return tuple(s for v in self.variations for s in v.solves)

    @property
    def failures(self) -> tuple[SolveRecord, ...]:
        """Records of the solves without a solution: failed or not done."""
        return tuple(s for s in self.solves if not s.done)

    @property
    def complete(self) -> bool:
        """Whether every solve has a solution."""
        return not self.failures

    @property
    def success(self) -> bool:
        """Whether any solve has a grasp."""
        return any(s.success for s in self.solves)

    @property
    def comparable(self) -> bool:
        """Whether all solves measure mu by the same task and kind of force budget."""
        return len({s.measured for s in self.solves if s.done}) <= 1

    def ranks(self) -> list[int]:
        """Return for each variation 1 plus the number of certainly better ones."""
        return ranks([v.mu for v in self.variations])

    def ties(self) -> list[tuple[str, ...]]:
        """Return for each variation those with overlapping certified intervals."""
        found = ties([v.mu for v in self.variations])
        return [tuple(self.variations[j].name for j in js if self.variations[j].mu.upper > 0.0) for js in found]

    def solution(self, variation: str, seed: int | None = None) -> GraspSolution:
        """Return a solution from its file: that of a seed, or the best one.

        A solution without a grasp states the reason.

        Raises
        ------
        InputError
            When there is no such file.
        KeyError
            On an unknown variation.
        """
        known = self[variation]
        best = known.best or known.solves[0]
        return GraspSolution.load(Folder(self.folder).file(SolveId(variation, best.seed if seed is None else seed)))

    def rows(self) -> list[Row]:
        """Return the table as one mapping per solve, with the keys of ``columns.COLUMNS``."""
        place, rows = Folder(self.folder), []
        for variation, rank in zip(self.variations, self.ranks(), strict=True):
            for solve in variation.solves:
                file = f"{SOLVES}/{place.file(SolveId(solve.variation, solve.seed)).name}"
                rows.append(row_of(Entry(self.name, solve, rank if variation.done else None, file)))
        return rows

    def frame(self) -> pd.DataFrame:
        """Return the table as a pandas frame (extra ``tables``).

        Raises
        ------
        MissingExtraError
            When pandas is not installed.
        """
        return frame(self.rows())

    def __str__(self) -> str:
        heads = ["rank", "variation", "mu certified in", "gap", "seeds", "seconds", "starts", "ties with", "active"]
        body = []
        for v, rank, tied in zip(self.variations, self.ranks(), self.ties(), strict=True):
            good, total = v.starts
            active = "; ".join(v.best.active) if v.best is not None else ""
            seconds = f"{v.seconds:.1f}" if v.done else ""
            place, seeds = f"{rank}" if v.done else "", f"{v.agreeing}/{len(v.solves)}"
            numbers = [v.found, v.gap_text, seeds, seconds, f"{good}/{total}"]
            body.append([place, v.name, *numbers, "; ".join(tied), active])
        lines = [f"{self.name}: {sum(v.done for v in self.variations)} of {len(self.solves)} solves done"]
        lines += [*columns(heads, body), EXPLAINED]
        if not self.comparable:
            lines.append(NOT_COMPARABLE)
        for v in self.variations:
            if v.best is not None and v.best.origin:
                lines.append(f"{v.name}: the grasp is that of {v.best.origin}")
            if v.best is not None and v.best.prices:
                lines.append(f"{v.name}: {'; '.join(str(p) for p in v.best.prices[:3])}")
        lines += [f"{s.variation}, seed {s.seed}: {s.failure}" for s in self.failures if s.failure != NOT_DONE]
        missing = sum(s.failure == NOT_DONE for s in self.failures)
        lines += [f"{missing} solves not done"] if missing else []
        return "\n".join([*lines, *self.notes])
