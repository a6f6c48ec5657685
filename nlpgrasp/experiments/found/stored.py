"""Reader of solve records from an output folder."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from nlpgrasp.common.shown.text import plain
from nlpgrasp.errors import InputError
from nlpgrasp.experiments.ask.experiment import SolveId
from nlpgrasp.experiments.found.digest import asked_of
from nlpgrasp.experiments.found.record import SolveRecord
from nlpgrasp.experiments.run.folder import Folder
from nlpgrasp.experiments.run.plan import Plan


def _record(place: Folder, solve: SolveId) -> SolveRecord | None:
    """Return the record of a solve from its file; None without one."""
    solution = place.load(solve)
    if solution is None:
        return None
    return replace(SolveRecord.of(solve.variation, solve.seed, solution), earlier=True)


def read_records(place: Folder, solves: Sequence[SolveId], plan: Plan) -> tuple[dict[SolveId, SolveRecord], list[str]]:
    """Return the records of the solves with a file, and a note for each unusable file.

    All solves of a variation have to belong to the plan's problem, or to one and the same problem if it is deferred.
    """
    variations = plan["variations"].items()
    asked = {name: asked_of(v["problem"]) for name, v in variations if isinstance(v.get("problem"), Mapping)}
    records: dict[SolveId, SolveRecord] = {}
    notes = []
    for solve in solves:
        try:
            record = _record(place, solve)
            if record is not None and record.asked != asked.setdefault(solve.variation, record.asked):
                raise InputError(str(place.file(solve)), "another problem", "the problem of its variation")
        except InputError as error:
            notes.append(f"{solve}: not used, {plain(str(error))}")
            record = SolveRecord(solve.variation, solve.seed, failure="its file cannot be used")
        if record is not None:
            records[solve] = record
        elif (why := place.failure(solve)) is not None:
            records[solve] = SolveRecord(solve.variation, solve.seed, failure=why)
    return records, notes
