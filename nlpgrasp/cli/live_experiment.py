"""Live display of a running experiment's progress."""

from __future__ import annotations

import time
from types import TracebackType

from rich.console import Console, Group
from rich.live import Live
from rich.markup import escape
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table

from nlpgrasp.cli.console import bounds_pair, write_json_line
from nlpgrasp.experiments import Experiment
from nlpgrasp.experiments.solve_record import NOTHING, SolveRecord
from nlpgrasp.quality import Bounds

MOST_ROWS = 15  # variations shown at a time
OTHER_ROWS = 6  # of the terminal: heads, bar, failures


class LiveExperiment:
    """Live display of an experiment: finished solves, best mu of each variation, remaining time.

    A terminal gets a table that changes, other outputs a line a solve.

    Parameters
    ----------
    experiment : Experiment
    as_json : bool
        One JSON object a line on standard output instead.
    """

    def __init__(self, experiment: Experiment, as_json: bool) -> None:
        self.experiment, self.as_json = experiment, as_json
        self._total = len(experiment.solves)
        self._seeds = self._total // len(experiment.names)
        self._best: dict[str, Bounds] = dict.fromkeys(experiment.names, NOTHING)
        self._count: dict[str, int] = dict.fromkeys(experiment.names, 0)
        self._failed = self._earlier = 0
        self._recent: list[str] = []
        self._start_time = time.monotonic()
        self._console = Console(stderr=True)
        self._live: Live | None = None
        self._is_closed = False  # the output's reader has gone
        columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
        self._bar = Progress(*columns, TextColumn("{task.fields[left]}"))
        self._task = self._bar.add_task(escape(str(experiment.name)), total=self._total, left="")

    def __enter__(self) -> LiveExperiment:
        if not self.as_json and self._console.is_terminal:
            self._live = Live(self._best_rows(), console=self._console, refresh_per_second=4)
            self._live.start()
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, tb: TracebackType | None) -> None:
        if self._live is not None:
            self._live.update(self._bar)
            self._live.transient = kind is not None  # an error stands alone
            self._live.stop()

    def solve_done(self, record: SolveRecord) -> None:
        """Report a finished solve.

        A closed output does not end the experiment.
        """
        name, best = record.variation, self._best[record.variation]
        self._best[name] = Bounds(max(best.lower, record.mu.lower), max(best.upper, record.mu.upper))
        self._count[name] += 1
        self._failed += not record.done
        self._earlier += record.earlier
        self._recent = [name, *(other for other in self._recent if other != name)]
        try:
            if self.as_json:
                self._write_record(record)
            elif self._live is not None:
                self._bar.update(self._task, advance=1, left=self.remaining_time)
                self._live.update(self._best_rows())
            elif not self._is_closed:
                outcome = f"mu in {record.mu}" if record.success else record.failure or "no grasp"
                count = f"{sum(self._count.values())}/{self._total}"
                self._console.print(
                    f"{count} {name}, seed {record.seed}: {outcome} {self.remaining_time}", markup=False
                )
        except OSError:
            self._is_closed = True

    @property
    def remaining_time(self) -> str:
        """Text on the remaining time, estimated from the solves of this run."""
        solved = sum(self._count.values()) - self._earlier
        remaining = self._total - sum(self._count.values())
        if solved == 0 or remaining == 0:
            return ""
        seconds = round((time.monotonic() - self._start_time) / solved * remaining)
        return f"about {seconds // 3600}:{seconds // 60 % 60:02d}:{seconds % 60:02d} left"

    def _write_record(self, record: SolveRecord) -> None:
        best = self._best[record.variation]
        if self._is_closed:
            return
        write_json_line(
            {
                "event": "solve",
                "variation": record.variation,
                "seed": record.seed,
                "status": "failed" if record.status is None else record.status.name.lower(),
                "mu": bounds_pair(record.mu) if record.success else None,
                "seconds": record.seconds,
                "best": bounds_pair(best) if best.lower > 0.0 else None,
                **({"failure": record.failure} if record.failure else {}),
            }
        )

    def _best_rows(self) -> Group:
        """Return a table of the variations' best grasps above the progress bar.

        Of many variations the table shows those that changed last.
        """
        table = Table(box=None, padding=(0, 2, 0, 0))
        table.add_column("variation", no_wrap=True, overflow="ellipsis")
        for head in ("best mu certified in", "solves"):
            table.add_column(head, no_wrap=True)
        rows = max(1, min(MOST_ROWS, self._console.height - OTHER_ROWS))
        recent = set(self._recent[:rows])
        for name in self.experiment.names if len(self._count) <= rows else (n for n in self._count if n in recent):
            best = self._best[name]
            text = str(best) if best.lower > 0.0 else "no grasp yet" if self._count[name] else ""
            table.add_row(escape(name), escape(text), f"{self._count[name]}/{self._seeds}")
        failed = [f"{self._failed} solves failed"] if self._failed else []
        return Group(table, *failed, self._bar)
