"""Warm starts between the variations of an experiment, after all solves are done.

A grasp of one variation may be feasible for another: the same body with less friction, a larger task, more constraints
or fewer contacts is more demanding. Each grasp is certified under every other variation that it fits, and replaces a
worse one there after refinement. Every turn uses the results before it, and turns repeat until nothing changes, so the
result does not depend on the order of the solves.
"""

from __future__ import annotations

import hashlib
import json
from collections import Counter
from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass, field, replace

from nlpgrasp.experiments.experiment import Experiment, SolveId
from nlpgrasp.experiments.output_folder import OutputFolder
from nlpgrasp.experiments.solve_job import Job, JobFactory, Outcome, WarmStartOffer
from nlpgrasp.experiments.solve_record import HANDED, SolveRecord, body_digest
from nlpgrasp.solution.kept_grasps import FoundGrasp
from nlpgrasp.solution.solution import GraspSolution
from nlpgrasp.version import __version__

Run = Callable[[Sequence[SolveId], Callable[[SolveId], Job]], Generator[tuple[SolveId, Outcome], None, None]]
"""Does jobs of solves, here or on a cluster, and yields their outcomes in any order."""

SCHEMA = "nlpgrasp-handed-on/1"
IMPROVED, TURNS = 3, 20  # turns with refinement, and most turns


@dataclass
class WarmStartExchange:
    """Exchange of grasps between an experiment's solves.

    Parameters
    ----------
    experiment : Experiment
    place : OutputFolder
    pack : JobFactory
    run : callable
    """

    experiment: Experiment
    place: OutputFolder
    pack: JobFactory
    run: Run
    notes: list[str] = field(default_factory=list)
    _now: dict[SolveId, GraspSolution] = field(default_factory=dict)
    _version: Counter[SolveId] = field(default_factory=Counter)
    _told: set[tuple[str, SolveId, int]] = field(default_factory=set)

    def done(self, records: dict[SolveId, SolveRecord]) -> dict[SolveId, SolveRecord]:
        """Run the exchange between recorded solves, write the changed solutions, and return updated records.

        Raises
        ------
        InputError, OSError
            When a solution cannot be read or written.
        """
        solves = [solve for solve in self.experiment.solves if solve in records and records[solve].done]
        groups = self._groups(records, solves)
        if not groups:
            return {}
        state = self._state(solves)
        if state == self.place.exchange_state():
            return {}
        for solve in solves:
            if solve.variation in groups:
                self._now[solve] = replace(GraspSolution.load(self.place.own(solve)), drawing=None)
        texts: dict[SolveId, str] = {}
        for turn in range(TURNS):
            new = self._turn(turn, groups)
            if not new:
                break
            texts |= new
        self.place.write_exchanged(texts, solves, state)
        return {s: self._record(s, found, records[s].earlier) for s, found in self._now.items()}

    def _record(self, solve: SolveId, found: GraspSolution, earlier: bool) -> SolveRecord:
        return replace(SolveRecord.of(solve.variation, solve.seed, found), earlier=earlier)

    def _groups(self, records: dict[SolveId, SolveRecord], solves: Sequence[SolveId]) -> dict[str, str]:
        """Return the body's digest for each variation that shares its body with another."""
        held: dict[str, str] = {}
        for solve in solves:
            name = solve.variation
            body = None if self.experiment.deferred(name) else self.experiment.case(name).problem.body
            key = records[solve].body if body is None else body_digest(body.to_dict()) or f"object {id(body)}"
            held[name] = key
        count = Counter(held.values())
        return {name: key for name, key in held.items() if key and count[key] > 1}

    def _state(self, solves: Sequence[SolveId]) -> str:
        """Return the exchange's inputs as text."""
        own = {str(s): hashlib.sha256(self.place.own(s).read_bytes()).hexdigest() for s in solves}
        return json.dumps({"schema": SCHEMA, "nlpgrasp": __version__, "solves": own}, indent=1) + "\n"

    def _turn(self, turn: int, groups: dict[str, str]) -> dict[SolveId, str]:
        """Offer every new grasp to every other variation that it may fit; return the changed solutions."""
        asked: dict[SolveId, WarmStartOffer] = {}
        for name in groups:
            best = self._best(name)
            if offers := self._grasps_for(name, best, groups):
                asked[best] = WarmStartOffer(self._now[best], offers, turn < IMPROVED, turn)
        found: dict[SolveId, str] = {}
        for solve, outcome in self.run(list(asked), lambda s: replace(self.pack(s), handed=asked[s])):
            if outcome.failure:
                self.notes.append(f"{solve}: grasps of other variations were not looked at: {outcome.failure}")
            elif outcome.text:
                found[solve] = outcome.text
        for solve, text in found.items():
            self._now[solve] = replace(GraspSolution.from_dict(json.loads(text), str(solve)), drawing=None)
            self._version[solve] += 1
        return found

    def _best(self, name: str) -> SolveId:
        """Return the solve of a variation with the best grasp, the first among equals."""
        solves = [solve for solve in self._now if solve.variation == name]
        return max(solves, key=lambda s: self._rank(self._now[s]))

    @staticmethod
    def _rank(found: GraspSolution) -> tuple[float, float]:
        return (found.mu.upper, found.mu.lower) if found.success else (0.0, 0.0)

    def _grasps_for(self, name: str, best: SolveId, groups: dict[str, str]) -> dict[str, FoundGrasp]:
        """Return the grasps of other variations with the same body that a variation has not yet tried."""
        contacts = len(self._now[best].problem["contacts"])
        offers = dict[str, FoundGrasp]()
        for solve, found in self._now.items():
            other, seen = solve.variation, (name, solve, self._version[solve])
            if other == name or groups.get(other) != groups[name] or seen in self._told:
                continue
            if found.success and len(found.require_grasp()) <= contacts:
                self._told.add(seen)
                origin = f"{HANDED}{other}, seed {solve.seed}"
                offers[origin] = FoundGrasp(found.require_grasp(), found.faces, found.mu, hand=found.hand)
        return offers
