"""The exchange: maximise mu itself with cutting planes in a trust region (theory, Section 6).

The support inequalities hold in the directions where the current grasp is weakest; solving moves the
contacts, which then are weakest elsewhere, and those directions join the cuts. Early cuts are too loose to be
trusted far from where they were found, hence the trust region on the positions.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from nlpgrasp.common.validation import FloatArray
from nlpgrasp.nlp import CompiledProgram, Program, face_parameters
from nlpgrasp.nlp.forces import pressing_forces
from nlpgrasp.solve.ascent.state import ExchangeState, with_known
from nlpgrasp.solve.ascent.weakest import Weakest, weakest_directions
from nlpgrasp.solve.workbench.workbench import FEASIBLE, Workbench
from nlpgrasp.solve.workers.stop import Stop

LAST_RADIUS = 1e-4  # of the body's size
SAME = 1.0 - 1e-7  # cosine above which a direction is already among the cuts


def exchange(
    bench: Workbench, faces: tuple[str, ...], state: ExchangeState, rng: np.random.Generator, stop: Stop
) -> ExchangeState:
    """Improve the contacts until the model promises nothing more, the rounds are used up, or a stop."""
    compiled = bench.cut_program(faces)
    task, budget = bench.problem.task, bench.budget(state.points, state.hand)
    weakest = weakest_directions(bench.grasp(faces, state.points), task, np.zeros((0, task.dimension)), rng, budget)
    cuts, state.value, radius = with_known(state.cuts, weakest.directions, task), weakest.value, state.radius
    while state.rounds < bench.options.exchange_rounds and radius > LAST_RADIUS and not stop.requested() and len(cuts):
        state.begin_round()
        cuts = most_relevant(bench, faces, state, cuts)
        result = compiled.solve(*trust_region(bench, compiled, faces, state, cuts, radius))
        state.multipliers = result.multipliers[compiled.program.placement]
        state.iterations += result.iterations
        state.function_seconds += result.function_seconds
        state.solver_seconds += result.seconds
        promised = result.objective / bench.scaling.beta - state.value
        trial, hand = contacts_of(bench, compiled, faces, result.z)
        found = evaluated(bench, faces, trial, hand, cuts, rng)
        if found is None:
            radius *= 0.4
            continue
        fresh = found.directions[new_directions(bench, cuts, found.directions)]
        gained = found.value - state.value
        cuts = np.concatenate([cuts, fresh])
        if gained > 0.0:
            state.points, state.hand, state.value = trial, hand, found.value
            radius *= 1.5 if gained > 0.5 * promised else 1.0 if gained > 0.1 * promised else 0.6
        else:
            radius *= 0.4
        if promised < state.least_gain * state.value:
            break
    return state.end(cuts)


def contacts_of(
    bench: Workbench, compiled: CompiledProgram, faces: tuple[str, ...], z: FloatArray
) -> tuple[FloatArray, dict[str, FloatArray]]:
    """Return the contacts of a program's variables, put exactly onto their faces, and the hand's variables."""
    return bench.snap(faces, points_of(bench, compiled.program, z)), hand_values(compiled.program, z)


def points_of(bench: Workbench, program: Program, z: FloatArray) -> FloatArray:
    """Return the contact positions of a program's variables, metres, (k, space)."""
    k = len(bench.problem.models)
    return bench.scaling.metres(np.stack([z[program.block(f"position {i}").range] for i in range(k)]))


def hand_values(program: Program, z: FloatArray) -> dict[str, FloatArray]:
    """Return the hand's variables of a program's variables, in the hand's units."""
    return {name: b.scale * z[b.range] for name, b in program.hand_blocks}


def fill_start(
    bench: Workbench,
    compiled: CompiledProgram,
    faces: tuple[str, ...],
    points: FloatArray,
    hand: dict[str, FloatArray],
) -> FloatArray:
    """Return a vector of starting values with contacts, normals, the hand and pressing forces filled in."""
    program = compiled.program
    normals = bench.inward_normals(faces, points)
    z = np.zeros(program.variables[-1].stop)
    for i, p in enumerate(bench.scaling.position(points)):
        z[program.block(f"position {i}").range] = p
        z[program.block(f"normal {i}").range] = normals[i]
    forces = pressing_forces(bench.problem.models, normals, 0.6 / np.sqrt(len(points)))
    for name, b in program.hand_blocks:
        z[b.range] = np.ravel(hand[name]) / b.scale
    for b in program.variables:
        if b.name.startswith("forces "):
            z[b.range] = forces
    return z


def trust_region(
    bench: Workbench,
    compiled: CompiledProgram,
    faces: tuple[str, ...],
    state: ExchangeState,
    cuts: FloatArray,
    radius: float,
) -> tuple[FloatArray, FloatArray, tuple[FloatArray, FloatArray]]:
    """Return start, parameters and trust-region bounds of one solve."""
    program = compiled.program
    z = fill_start(bench, compiled, faces, state.points, state.hand)
    z[program.block("beta").range] = state.value * bench.scaling.beta
    lower, upper = (b.copy() for b in program.bounds)
    for i in range(len(faces)):
        block = program.block(f"position {i}").range
        lower[block] = np.maximum(lower[block], z[block] - radius)
        upper[block] = np.minimum(upper[block], z[block] + radius)
    return z, slot_parameters(bench, faces, cuts), (lower, upper)


def most_relevant(bench: Workbench, faces: tuple[str, ...], state: ExchangeState, cuts: FloatArray) -> FloatArray:
    """Return as many cuts as the program holds: those nearest to binding at the current contacts."""
    if len(cuts) <= bench.slots:
        return cuts
    support = bench.wrench_set(faces, state.points, state.hand).support(cuts)[0]
    return cuts[np.sort(np.argsort(support, kind="stable")[: bench.slots])]


def evaluated(
    bench: Workbench,
    faces: tuple[str, ...],
    points: FloatArray,
    hand: dict[str, FloatArray],
    cuts: FloatArray,
    rng: np.random.Generator,
    allowed: float = FEASIBLE,
) -> Weakest | None:
    """Return the weakest directions of trial contacts, or None when they break a constraint."""
    if not np.all(np.isfinite(points)):
        return None
    normals = bench.inward_normals(faces, points)
    if not np.all(np.isfinite(normals)):
        return None
    batched = {name: v[None, :] for name, v in hand.items()}
    if bench.violations(points[None], normals[None], batched)[0] > allowed:
        return None
    budget = bench.budget(points, hand)
    return weakest_directions(bench.grasp(faces, points), bench.problem.task, cuts, rng, budget, 60, 30)


def new_directions(bench: Workbench, known: FloatArray, directions: FloatArray) -> NDArray[np.bool_]:
    """Return a mask of the directions that are not yet among the known ones, compared in solver units."""
    a, b = known / bench.scaling.wrench, directions / bench.scaling.wrench
    a = a / np.linalg.norm(a, axis=1, keepdims=True)
    b = b / np.linalg.norm(b, axis=1, keepdims=True)
    return np.asarray(np.max(b @ a.T, axis=1) < SAME)


def no_cuts(bench: Workbench, faces: tuple[str, ...], points: FloatArray) -> FloatArray:
    """Return the program's parameters with every slot empty: for its rows of constraints and hand alone."""
    nothing = np.zeros((0, bench.problem.dimension))
    return slot_parameters(bench, faces, nothing, bench.pieces(bench.grasp(faces, points), nothing))


def slot_parameters(
    bench: Workbench, faces: tuple[str, ...], cuts: FloatArray, pieces: FloatArray | None = None
) -> FloatArray:
    """Return the program's parameters for cuts with ``phi_A = 1``; the other slots stay empty.

    Parameters
    ----------
    bench : Workbench
    faces : tuple of k str
    cuts : (m, d) array
    pieces : (m, k) array, optional
        The contacts' own supports along the cuts, where the program wants the largest of them.
    """
    if bench.problem.budget.follows_hand:  # the program holds no cuts
        return face_parameters(bench.problem, faces)
    directions = np.zeros((bench.slots, bench.problem.dimension))
    directions[: len(cuts)] = cuts * bench.scaling.task / bench.scaling.wrench
    reach = np.zeros(bench.slots)
    reach[: len(cuts)] = 1.0
    weights = np.zeros(0)
    if pieces is not None:
        weights = np.zeros((bench.slots, pieces.shape[1]))
        weights[np.arange(len(cuts)), np.argmax(pieces, axis=1)] = 1.0
    return np.concatenate([directions.ravel(), reach, weights.ravel(), face_parameters(bench.problem, faces)])
