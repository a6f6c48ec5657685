"""Verification of solution and bound files, independent of the solver's code.

The grasp map is rebuilt from positions and normals as sums of ``(f, (p - o) x f)``, the certified bounds are proved by
a checker that knows nothing but the proof, the finger forces are inserted into the equilibrium equations, and contacts,
constraints and hand are recomputed from the problem by this package's own formulas.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import partial
from pathlib import Path

import numpy as np

from nlpgrasp.common.validation import number
from nlpgrasp.errors import InputError
from nlpgrasp.quality.bounds import Bounds
from nlpgrasp.quality.grasp import Grasp
from nlpgrasp.solution.solution import GraspSolution, require_solution
from nlpgrasp.tasks.task_set import MISSING, is_sampled
from nlpgrasp.verify.bound.bound_checks import global_bound_checks, read_bound_file, verify_bound
from nlpgrasp.verify.check import BROKEN, NO_GRASP, Check, Verification, broken_data_message, guard
from nlpgrasp.verify.force_checks import force_checks, needed_checks, wrench_checks
from nlpgrasp.verify.grip_checks import grip_checks
from nlpgrasp.verify.outcome_checks import kept_grasp_checks, outcome_checks
from nlpgrasp.verify.proved_bounds import ProofFile
from nlpgrasp.verify.quality_checks import (
    bounds_check,
    check_other_measures,
    critical_friction_checks,
    direction_checks,
    grasp_map_check,
    interval_check,
    model_checks,
    mu_width_checks,
    recompute_mu,
    requested_rtol,
    robustness_checks,
)
from nlpgrasp.verify.recomputation import recompute
from nlpgrasp.verify.sources import SourceFolders
from nlpgrasp.verify.surface_checks import half_diagonal


def verify(
    solution: GraspSolution | str | Path,
    rtol: float = 0.01,
    folders: Iterable[str | Path] = (),
    proof: str | Path | bytes | None = None,
) -> Verification:
    """Verify a solution, a solution file or a bound file against its own problem, grasp, hand and certificate.

    Parameters
    ----------
    solution : GraspSolution, str or Path
        A file is one written by ``GraspSolution.save`` or ``BestPossible.save``.
    rtol : float
        Largest relative gap of a new proof, greater than zero: it is tightened as far as the stated bounds require.
    folders : iterable of str or Path
        Further folders to search for mesh and URDF, after the file's own folder and the current one.
    proof : str, Path or bytes, optional
        Proof file of the bounds on mu, or its content; ``F.proof`` beside ``F.json`` is found. Without one the proof is
        made anew.

    Returns
    -------
    Verification
        Fails when there is no grasp, or one that contradicts status and starts; when the proof is of another claim or
        does not hold; when a stated interval is not what the checker proves (or, where there is no proof, a new
        certificate confirms), is empty or is wider than its certificate allows; when a stated direction
        contradicts the stated bounds; when stated forces do not produce their wrench within cones and force budget, are
        for wrenches outside the task, or are missing from the file of a solve; when contacts are off their faces or
        have other normals; when a constraint of problem or hand is missing, has another limit than the problem's,
        another value than positions and hand give, or is violated. What cannot be recomputed (a missing mesh or URDF,
        one with another fingerprint, an expression in a script) counts as a check that was not made: the verdict is
        then "partly verified", ``complete`` is false, and ``missing`` names the files.
        A bound file, or the bound in a solution file, fails when it does not follow from its certificate
        (docs/how_close.md). Alternative grasps are checked like the answer, for their order, and for being
        distinct.

    Raises
    ------
    InputError
        When a file cannot be read or is not of schema 1, rtol is not greater than zero, or a proof is given of a bound.
    """
    file = Path(solution) if isinstance(solution, str | Path) else None
    rtol = number("rtol", rtol, above=0.0)
    bound = None if file is None else read_bound_file(file)
    if bound is not None:
        if proof is not None:
            raise InputError("proof", f"one of {solution}", "none with a bound file, which has its own certificate")
        return verify_bound(bound, rtol, SourceFolders.of_file(file, folders))
    solution = require_solution(solution) if file is None else GraspSolution.load(file)
    outcome = guard("outcome", lambda: outcome_checks(solution))
    grasp = solution.grasp
    if grasp is None:
        status = solution.status.name.lower()
        return Verification((Check(NO_GRASP, False, f"there is no grasp to check ({status})"), *outcome), None)
    sources = SourceFolders.of_file(file, folders)
    proof_file = ProofFile.of(proof, file)
    with np.errstate(all="ignore"):  # invalid numbers give NaN, which fails every comparison
        quality, checks = _verify_answer(solution, rtol, sources, proof_file)
        if quality is not None:
            checks += guard("bound", partial(global_bound_checks, solution, grasp, quality, sources))
        elif solution.bound is not None:
            checks.append(Check.not_made("bound", MISSING))
        size = half_diagonal(solution, sources)
        checks += guard(
            "grasps kept", partial(kept_grasp_checks, solution, partial(_verify_kept_grasp, rtol, sources), size)
        )
    return Verification((*checks, *outcome), quality, tuple(dict.fromkeys(sources.missing)), tuple(solution.caveats))


def _verify_answer(
    solution: GraspSolution, rtol: float, sources: SourceFolders, proof: ProofFile | None = None, is_kept: bool = False
) -> tuple[Bounds | None, list[Check]]:
    """Return the recomputed quality of a solution's answer, and the checks of this answer."""
    grasp = solution.require_grasp()
    quality, checks = _check_quality(solution, grasp, rtol, proof, None if is_kept else requested_rtol(solution, rtol))
    return quality, [*checks, *recompute(solution, grasp, sources)]


def _verify_kept_grasp(rtol: float, sources: SourceFolders, solution: GraspSolution) -> list[Check]:
    """Return the checks of a solution whose answer was replaced by another kept grasp."""
    return [*_verify_answer(solution, rtol, sources, is_kept=True)[1], *outcome_checks(solution)]


def _check_quality(
    solution: GraspSolution, grasp: Grasp, rtol: float, proof: ProofFile | None, requested: float | None
) -> tuple[Bounds | None, list[Check]]:
    """Return the recomputed quality, and the checks of the quality measures and of what depends on them.

    A task whose function this process does not have leaves the quality None, and its checks not made.
    """
    task, budget = solution.task, solution.budget
    quality, proof_check = None, list[Check]()
    try:
        force_set = budget.at(grasp.frames, grasp.contacts)
        if proof is not None:
            quality, check = proof.check(grasp, task, budget)
            proof_check = [check]
        if quality is None and not is_sampled(task):
            quality = recompute_mu(solution.mu, grasp, task, budget, rtol, requested)
    except BROKEN as error:
        return None, [Check("certified quality", False, broken_data_message(error))]
    parts: dict[str, Callable[[], list[Check]]] = {
        "grasp map": lambda: [grasp_map_check(grasp)],
        "interval": lambda: [interval_check(solution.mu)],
    }
    if quality is None:
        names = ["certified quality", "worst direction", "forces needed", "robustness"]
        names += [] if solution.friction is None else ["critical friction"]
        parts["certified quality"] = lambda: [Check.not_made(name, MISSING) for name in names]
    else:
        parts |= {
            "certified quality": lambda: [bounds_check("certified quality", solution.mu, quality)],
            "width": lambda: mu_width_checks(solution, quality),
            "worst direction": lambda: direction_checks(solution, grasp, task, force_set),
            "wrenches": lambda: wrench_checks(solution, grasp, task, force_set),
            "forces needed": lambda: needed_checks(solution, grasp, task, force_set),
            "grip force": lambda: grip_checks(solution, grasp, task),
            "robustness": lambda: robustness_checks(solution, grasp, task, budget, rtol),
            "critical friction": lambda: critical_friction_checks(solution, grasp, task),
        }
    parts |= {
        "forces": lambda: force_checks(solution, grasp, force_set),
        "delta and nu": lambda: check_other_measures(solution, grasp, budget, rtol),
        "contact models": lambda: model_checks(solution, grasp, task),
    }
    return quality, [*proof_check, *(check for name, checks in parts.items() for check in guard(name, checks))]
