"""What an experiment shows while it runs."""

from __future__ import annotations

from types import TracebackType

from rich.console import Console, Group
from rich.live import Live
from rich.markup import escape
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from rich.table import Table

from nlpgrasp.cli.progress import emit, pair
from nlpgrasp.experiments import Experiment
from nlpgrasp.experiments.record import NOTHING, SolveRecord
from nlpgrasp.quality import Bounds

MOST_ROWS = 15  # variations shown at a time


class LiveExperiment:
    """Reports each finished solve, the best mu of each variation and when the rest should be done.

    Parameters
    ----------
    experiment : Experiment
    as_json : bool
        One JSON object a line on standard output instead of a table on standard error.
    """

    def __init__(self, experiment: Experiment, as_json: bool) -> None:
        self.experiment, self.as_json = experiment, as_json
        self._best: dict[str, Bounds] = dict.fromkeys(experiment.names, NOTHING)
        self._count: dict[str, int] = dict.fromkeys(experiment.names, 0)
        self._failed = 0
        self._recent: list[str] = []
        self._live: Live | None = None
        self._bar = Progress(
            TextColumn("{task.description}"),
            BarColumn(),
            MofNCompleteColumn(),
            TimeElapsedColumn(),
            TextColumn("left:"),
            TimeRemainingColumn(elapsed_when_finished=False),
        )
        self._task = self._bar.add_task(escape(str(experiment.name)), total=len(experiment.solves))

    def __enter__(self) -> LiveExperiment:
        if not self.as_json:
            self._live = Live(self._shown(), console=Console(stderr=True), refresh_per_second=4)
            self._live.start()
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, tb: TracebackType | None) -> None:
        if self._live is not None:
            self._live.update(self._bar)
            self._live.transient = kind is not None  # an error stands alone
            self._live.stop()

    def solve_done(self, record: SolveRecord) -> None:
        """Report one solve."""
        name, best = record.variation, self._best[record.variation]
        self._best[name] = Bounds(max(best.lower, record.mu.lower), max(best.upper, record.mu.upper))
        self._count[name] += 1
        self._failed += not record.done
        self._recent = [name, *(other for other in self._recent if other != name)][:MOST_ROWS]
        if self._live is not None:
            self._bar.advance(self._task)
            self._live.update(self._shown())
            return
        emit(
            {
                "event": "solve",
                "variation": name,
                "seed": record.seed,
                "status": "failed" if record.status is None else record.status.name.lower(),
                "mu": pair(record.mu) if record.success else None,
                "seconds": record.seconds,
                "best": pair(self._best[name]) if self._best[name].lower > 0.0 else None,
                **({"failure": record.failure} if record.failure else {}),
            }
        )

    def _shown(self) -> Group:
        """Return the bar over the best of each variation; of many, those that changed last."""
        table = Table(box=None, padding=(0, 2, 0, 0))
        for head in ("variation", "best mu certified in", "solves"):
            table.add_column(head)
        names = [n for n in self.experiment.names if len(self._count) <= MOST_ROWS or n in self._recent]
        for name in names:
            best = self._best[name]
            shown = str(best) if best.lower > 0.0 else "no grasp yet" if self._count[name] else ""
            table.add_row(escape(name), escape(shown), f"{self._count[name]}/{len(tuple(self.experiment.seeds))}")
        failed = [f"{self._failed} solves failed"] if self._failed else []
        return Group(table, *failed, self._bar)
