"""Bounds on mu that a checker proves: those of a proof file, or of a proof that is made anew."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from nlpgrasp.budgets import ForceBudget
from nlpgrasp.budgets.base import ForceSet
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.errors import InputError
from nlpgrasp.quality.arguments import task_for
from nlpgrasp.quality.confirmation import ROUNDING, RecomputedBounds
from nlpgrasp.quality.grasp import Grasp
from nlpgrasp.quality.measures import bound_in_closed_form, mu
from nlpgrasp.quality.proof import prove, state_claim
from nlpgrasp.quality.wrench_set import WrenchSet
from nlpgrasp.tasks import Task
from nlpgrasp.verify.check import Check
from nlpgrasp.verify.proof_checker.check import check_proof, compiled_checker, read_proof

OTHER_SEED = 7919  # seed of search directions, other than the solver's
CLOSED_FORM = "singular values give mu in closed form"
NO_COMPILER = "there is no C compiler, and rational arithmetic takes half a minute for a proof in space"
CLAIM_ROUNDING = 1e-12  # difference of numbers of a claim that counts as rounding of another machine, relative


def prove_anew(
    grasp: Grasp, task: Task, rtol: float, budget: str | ForceBudget, direction: FloatArray | None = None
) -> RecomputedBounds:
    """Return bounds on mu to a relative gap, by a proof that the checker accepts.

    Where there is no such proof, they are a certificate with other search directions than the solver's.

    Parameters
    ----------
    grasp : Grasp
    task : Task
    rtol : float
    budget : str or ForceBudget
    direction : (d,) array, optional
        Known direction with a small support ratio, which then bounds mu from above.
    """
    task = task_for(task, grasp)
    bounds = _prove_and_check(grasp, task, rtol, budget, direction)
    if bounds.unproved:
        certified = mu(grasp, task, rtol, force_budget=budget, seed=OTHER_SEED)
        ratio = (
            np.inf
            if direction is None
            else support_ratio(grasp, task, WrenchSet.of(grasp, budget).force_set, direction)
        )
        upper = min(certified.upper, max(ratio * (1.0 + ROUNDING), certified.lower))
        y, limit, trust = certified.worst_direction, certified.limit, certified.trust
        bounds = replace(bounds, lower=certified.lower, upper=upper, worst_direction=y, limit=limit, trust=trust)
    return replace(bounds, kind=task.measure, task_beta=task.paper_beta)


def _prove_and_check(
    grasp: Grasp, task: Task, rtol: float, budget: str | ForceBudget, direction: FloatArray | None
) -> RecomputedBounds:
    """Return bounds on mu from a proof that the checker accepts, or the reason why there is none."""
    if bound_in_closed_form(WrenchSet.of(grasp, budget), task) is not None:
        return RecomputedBounds(0.0, np.inf, unproved=CLOSED_FORM)
    if grasp.space == 3 and compiled_checker() is None:
        return RecomputedBounds(0.0, np.inf, unproved=NO_COMPILER)
    try:
        proof = prove(grasp, task, rtol, budget, RecomputedBounds(0.0, np.inf, direction))
    except InputError as error:
        reason = error.given if isinstance(error.given, str) else "the task is given by a function"
        return RecomputedBounds(0.0, np.inf, unproved=reason)
    except np.linalg.LinAlgError:
        return RecomputedBounds(0.0, np.inf, unproved="a cell of its polytope is flat")
    checked = check_proof(proof.to_bytes())
    if not (checked.lower > 0.0 or checked.upper == 0.0):
        flat = "no lower end is provable, as where wrenches do not span wrench space"
        return RecomputedBounds(0.0, np.inf, unproved=checked.reason or flat)
    if checked.upper > checked.lower * (1.0 + rtol):
        return RecomputedBounds(0.0, np.inf, unproved="its proof reaches no smaller gap")
    return RecomputedBounds(checked.lower, checked.upper, proof.above.direction)


def support_ratio(grasp: Grasp, task: Task, force_set: ForceSet, y: FloatArray) -> float:
    """Return an upper bound on mu: the wrench set's support over the task's in a direction (d,), inf where it is 0."""
    task_support = float(task.support(y[None])[0][0])
    if task_support <= 0.0:
        return np.inf
    contact_velocities = (grasp.G.T @ y)[None, :]
    supports, maximisers = force_set.support(contact_velocities)
    return max(0.0, float(max(supports[0], maximisers[0] @ contact_velocities[0]))) / task_support


@dataclass(frozen=True)
class ProofFile:
    """Content of a proof file that goes with a solution.

    Parameters
    ----------
    content : bytes
    name : str
        In messages.
    """

    content: bytes
    name: str

    @classmethod
    def of(cls, proof: str | Path | bytes | None, file: Path | None) -> ProofFile | None:
        """Return the requested proof, or else the one beside a solution file; None if there is none.

        Raises
        ------
        InputError
            When it cannot be read.
        """
        if isinstance(proof, bytes):
            return cls(proof, "the proof given")
        if proof is not None:
            return cls(read_proof(proof), Path(proof).name)
        beside = None if file is None else file.with_suffix(".proof")
        if beside is None or beside == file or not beside.is_file():
            return None
        return cls(read_proof(beside), f"{beside.name} (found beside the file)")

    def check(self, grasp: Grasp, task: Task, budget: ForceBudget) -> tuple[RecomputedBounds | None, Check]:
        """Return the bounds on mu of a grasp that the proof proves, if it does, and the check of the proof.

        The checker gets the proof with the claim of this grasp, so that what it accepts is proved of this grasp. The
        proof's own claim has to be the same, but for the rounding of another machine.
        """
        task = task_for(task, grasp)
        try:
            claim = state_claim(grasp, task, budget)
        except InputError:
            return None, Check("proof", False, f"{self.name}: the task is given by a function, which no proof states")
        bounds_word = re.search(rb"\sbounds\s", self.content)
        if bounds_word is None:
            return None, Check("proof", False, f"{self.name}: the file ends before its bounds")
        own_claim = self.content[: bounds_word.start()].decode("ascii", "replace")
        if part := _differing_part(claim, own_claim, len(grasp)):
            remedy = "`nlpgrasp prove` writes a new one"
            return None, Check(
                "proof", False, f"{self.name} is of another claim: {part} differs from the file's; {remedy}"
            )
        checked = check_proof(claim.encode("ascii") + self.content[bounds_word.start() + 1 :])
        text = f"{self.name}: contacts, forces and task are those of the grasp; {checked}"
        if not checked:
            return None, Check("proof", False, text)
        bounds = RecomputedBounds(checked.lower, checked.upper, kind=task.measure, task_beta=task.paper_beta)
        return bounds, Check("proof", True, text)


def _differing_part(claim: str, other: str, contacts: int) -> str:
    """Return the name of the first part in which another claim differs from one of a number of contacts."""
    words = iter(other.split())
    for name, part in _parts(claim, contacts):
        tolerance = CLAIM_ROUNDING * max(abs(x) for x in map(_as_number, part) if np.isfinite(x))
        for word in part:
            given = next(words, "")
            if word != given and not abs(_as_number(word) - _as_number(given)) <= tolerance:
                return name
    return "" if next(words, None) is None else "the task"


def _parts(claim: str, contacts: int) -> Iterator[tuple[str, list[str]]]:
    """Yield the parts of a claim, with names: words that a proof file states, in their order."""
    version, coordinates, origin, count, *lines = (line.split() for line in claim.splitlines())
    yield "the version of the format", version
    yield "the dimension", coordinates
    yield "the torque origin", origin
    yield "the number of contacts", count
    for i, words in enumerate(lines[:contacts]):
        yield f"the position of contact {i}", words[:3]
        yield f"the frame of contact {i}", words[3:12]
        yield f"the model of contact {i}", words[12:]
    variables, lift, cones, *task = lines[contacts:]
    yield "the force components of the contact models", [*variables, *lift]
    yield "the friction or the force budget", cones
    yield "the task", [word for words in task for word in words]


def _as_number(word: str) -> float:
    """Return the number that a word states, NaN if it states none."""
    try:
        return float(word)
    except ValueError:
        return np.nan
