"""Exchange of warm starts between the variations of an experiment, after all solves are done.

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
from typing import NamedTuple

from nlpgrasp.experiments.experiment import Experiment, SolveId
from nlpgrasp.experiments.output_folder import OutputFolder
from nlpgrasp.experiments.solve_job import Job, JobFactory, Outcome, WarmStartOffer
from nlpgrasp.experiments.solve_record import WARM_START_PREFIX, SolveRecord, body_digest
from nlpgrasp.solution.kept_grasps import FoundGrasp
from nlpgrasp.solution.solution import GraspSolution
from nlpgrasp.version import __version__

Run = Callable[[Sequence[SolveId], Callable[[SolveId], Job]], Generator[tuple[SolveId, Outcome], None, None]]
"""Function that runs jobs of solves, here or on a cluster, and yields their outcomes in any order."""

SCHEMA = "nlpgrasp-handed-on/1"
REFINED_TURNS, MOST_TURNS = 3, 20  # turns with refinement, and most turns


class _OfferId(NamedTuple):
    """Identity of an offer: receiving variation, offering solve, and version of the solve's solution."""

    receiver: str
    solve: SolveId
    version: int


@dataclass
class WarmStartExchange:
    """Exchange of grasps as warm starts between an experiment's solves.

    Parameters
    ----------
    experiment : Experiment
    output : OutputFolder
    factory : JobFactory
    run : callable
    """

    experiment: Experiment
    output: OutputFolder
    factory: JobFactory
    run: Run
    notes: list[str] = field(default_factory=list)
    _solutions: dict[SolveId, GraspSolution] = field(default_factory=dict)
    _version: Counter[SolveId] = field(default_factory=Counter)
    _offered: set[_OfferId] = field(default_factory=set)

    def exchange(self, records: dict[SolveId, SolveRecord]) -> dict[SolveId, SolveRecord]:
        """Exchange grasps between solves until nothing improves, write changed solutions, and return updated records.

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
        if state == self.output.exchange_state():
            return {}
        for solve in solves:
            if solve.variation in groups:
                self._solutions[solve] = replace(GraspSolution.load(self.output.own_result_file(solve)), drawing=None)
        texts: dict[SolveId, str] = {}
        for turn in range(MOST_TURNS):
            changed = self._turn(turn, groups)
            if not changed:
                break
            texts |= changed
        self.output.write_exchanged(texts, solves, state)
        return {
            solve: replace(SolveRecord.of(solve.variation, solve.seed, solution), earlier=records[solve].earlier)
            for solve, solution in self._solutions.items()
        }

    def _groups(self, records: dict[SolveId, SolveRecord], solves: Sequence[SolveId]) -> dict[str, str]:
        """Return the digest of the body for each variation whose body another variation shares."""
        digests: dict[str, str] = {}
        for solve in solves:
            name = solve.variation
            body = None if self.experiment.deferred(name) else self.experiment.case(name).problem.body
            digest = records[solve].body if body is None else body_digest(body.to_dict()) or f"object {id(body)}"
            digests[name] = digest
        count = Counter(digests.values())
        return {name: digest for name, digest in digests.items() if digest and count[digest] > 1}

    def _state(self, solves: Sequence[SolveId]) -> str:
        """Return a text that identifies the inputs of the exchange."""
        digests = {str(s): hashlib.sha256(self.output.own_result_file(s).read_bytes()).hexdigest() for s in solves}
        return json.dumps({"schema": SCHEMA, "nlpgrasp": __version__, "solves": digests}, indent=1) + "\n"

    def _turn(self, turn: int, groups: dict[str, str]) -> dict[SolveId, str]:
        """Offer each new grasp to the other variations with the same body, and return changed solutions as JSON texts.

        Parameters
        ----------
        turn : int
            Number of earlier turns.
        groups : dict of str to str
            Digest of the body by variation.
        """
        offer_by_solve: dict[SolveId, WarmStartOffer] = {}
        for name in groups:
            best = self._best(name)  # the offers can improve a variation only where they beat its best solve
            solution = self._solutions[best]
            offers = self._new_offers(name, groups, contacts=len(solution.problem["contacts"]))
            if offers:
                improve = turn < REFINED_TURNS
                offer_by_solve[best] = WarmStartOffer(solution=solution, offers=offers, improve=improve, turn=turn)
        texts: dict[SolveId, str] = {}  # solution files of the improved solves

        def job_with_offer(solve: SolveId) -> Job:
            return replace(self.factory(solve), offer=offer_by_solve[solve])

        for solve, outcome in self.run(list(offer_by_solve), job_with_offer):
            if outcome.failure:
                self.notes.append(f"{solve}: grasps of other variations were not looked at: {outcome.failure}")
            elif outcome.text:
                texts[solve] = outcome.text
        for solve, text in texts.items():
            self._solutions[solve] = replace(GraspSolution.from_dict(json.loads(text), str(solve)), drawing=None)
            self._version[solve] += 1
        return texts

    def _best(self, name: str) -> SolveId:
        """Return the solve with the best grasp of a variation, the first of equal ones."""
        solves = [solve for solve in self._solutions if solve.variation == name]
        return max(solves, key=lambda s: self._rank(self._solutions[s]))

    @staticmethod
    def _rank(solution: GraspSolution) -> tuple[float, float]:
        return (solution.mu.upper, solution.mu.lower) if solution.success else (0.0, 0.0)

    def _new_offers(self, receiver: str, groups: dict[str, str], contacts: int) -> dict[str, FoundGrasp]:
        """Return the grasps that a variation has not been offered yet, by their origin, and mark them as offered.

        Parameters
        ----------
        receiver : str
            Name of the variation.
        groups : dict of str to str
            Digest of the body by variation; only grasps on the same body are offered.
        contacts : int
            Number of contacts of the variation; grasps with more are not offered.
        """
        offers = dict[str, FoundGrasp]()
        for solve, solution in self._solutions.items():
            source, offer = solve.variation, _OfferId(receiver, solve, self._version[solve])
            if source == receiver or groups.get(source) != groups[receiver] or offer in self._offered:
                continue
            if solution.success and len(solution.require_grasp()) <= contacts:
                self._offered.add(offer)
                origin = f"{WARM_START_PREFIX}{source}, seed {solve.seed}"
                offers[origin] = FoundGrasp(solution.require_grasp(), solution.faces, solution.mu, hand=solution.hand)
        return offers
