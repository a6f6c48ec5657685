"""Local search: maximisation of the volume nu (3.2-1) by quadratic steps in a trust region.

log nu and its gradient come from rays that are fixed during a search (``RadialVolume``), so that the samples' error
hardly changes from one candidate to the next. A step maximises the linearised log nu inside the trust
region, with the constraints and the restoration of the cutting-plane method, whose cuts keep mu of the task at a floor:
at the largest volumes it is often 0. Grasps without force closure are not entered: their wrench set has the origin on
its boundary.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.special import ndtri

from nlpgrasp.common.deadline import Deadline
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.optimize.candidate import GraspCandidate
from nlpgrasp.optimize.compiled_problem import FEASIBLE, CompiledProblem
from nlpgrasp.optimize.coordinate_exchange import draw_contacts, screening_directions
from nlpgrasp.optimize.cutting_planes import weakest_directions_of
from nlpgrasp.optimize.support_gradients import support_gradients
from nlpgrasp.optimize.trust_region import Linearisation
from nlpgrasp.quality.grasp import Grasp, GraspStack
from nlpgrasp.quality.ratio_minimisation import random_directions
from nlpgrasp.quality.screening import sampled_supports
from nlpgrasp.quality.volume import RadialVolume, whitening
from nlpgrasp.quality.wrench_set import WrenchSet, wrench_rank

RAYS = {3: 256, 6: 768}  # rays of a search, by dimension
FEW_RAYS, MANY_RAYS = 96, 4096  # rays that rank candidates; that compare the results of starts
DRAWN, SCREENED = 4000, 40  # random candidates of a start; those whose volume is sampled
PLANES = 200  # by which random candidates are screened
APART = 0.1  # distance of some contact, over the body's size, from which candidates are distinct
ROUNDS = 80  # trust-region steps, at most
RADIUS, LARGEST_RADIUS, LEAST_RADIUS = 0.05, 0.3, 1e-4  # trust-region radius over the body's size
EXPANSION, CONTRACTION = 1.7, 0.4  # factors of the radius after an accepted and a rejected step
FAIR = 0.25  # ratio of actual to predicted gain of a step after which the radius may grow
LEAST_GAIN, IDLE = 2e-4, 3  # gain of log nu below which a round is idle; idle rounds in a row that end a search


class SampledVolume:
    """Estimate of log nu by fixed rays from the origin.

    Parameters
    ----------
    compiled : CompiledProblem
    grasp : Grasp
        Of full rank; the rays are spread in coordinates in which its ``G G^T`` is the identity.
    count : int
        Number of rays, evenly spread.
    """

    def __init__(self, compiled: CompiledProblem, grasp: Grasp, count: int) -> None:
        self._compiled, self._matrix = compiled, whitening(grasp)
        from scipy.stats import qmc  # slow to import, and used here alone

        x = ndtri(qmc.Halton(grasp.dimension, scramble=False).fast_forward(1).random(count))
        self._rays = x / np.linalg.norm(x, axis=1, keepdims=True)

    def at(self, grasp: Grasp) -> RadialVolume:
        """Return the sampled volume of a grasp."""
        return RadialVolume.of(WrenchSet.of(grasp, self._compiled.problem.budget), self._matrix, self._rays)

    def gradient(self, candidate: GraspCandidate, z: FloatArray, volume: RadialVolume) -> FloatArray:
        """Return the gradient (n,) of log nu in the program's variables z at a candidate with this volume."""
        used = volume.weights > 0.0
        support, slopes = support_gradients(self._compiled, candidate, z, volume.normals[used])
        return np.asarray(volume.normals.shape[1] * (volume.weights[used] / support) @ slopes)


def sampled_volume(compiled: CompiledProblem, grasp: Grasp, rays: int = MANY_RAYS) -> float:
    """Return log nu of a grasp at a torque scale of 1 m, estimated by rays; minus infinity without force closure."""
    if wrench_rank(grasp.G.T) < grasp.dimension:
        return -np.inf
    return SampledVolume(compiled, grasp, rays).at(grasp).log


def largest_volumes(
    compiled: CompiledProblem, candidates: Sequence[GraspCandidate], rng: np.random.Generator, count: int
) -> list[GraspCandidate]:
    """Return distinct feasible candidates of largest sampled nu among given and random ones.

    All have the floor of mu. The first given one where none is feasible.
    """
    least = floor_of_mu(compiled)
    drawn = draw_contacts(compiled, DRAWN, rng)
    scored = [(sampled_volume(compiled, compiled.grasp(candidate), FEW_RAYS), candidate) for candidate in candidates]
    stack = GraspStack(drawn.points, drawn.normals, compiled.problem.models, compiled.problem.origin)
    random = random_directions(PLANES, compiled.problem.dimension, rng) * compiled.scaling.wrench
    y = np.concatenate([screening_directions(compiled), random])
    supports, reach = sampled_supports(stack, y, compiled.screening_budget), compiled.problem.task.support(y)[0]
    qualities = np.min(supports[:, reach > 0.0] / reach[reach > 0.0], axis=1)
    promises = _outer_volumes(supports, y / compiled.scaling.wrench, rng)
    closed = np.argsort(np.where(qualities >= least, -promises, np.inf), kind="stable")[:SCREENED]
    for faces, points, normals in zip(drawn.faces[closed], drawn.points[closed], drawn.normals[closed], strict=True):
        hand = compiled.hand_functions.start(points[None], normals[None])
        candidate = GraspCandidate(tuple(faces), points, {name: value[0] for name, value in hand.items()})
        scored.append((sampled_volume(compiled, compiled.grasp_at(points, normals), FEW_RAYS), candidate))
    scored.sort(key=lambda pair: -pair[0])
    chosen = list[GraspCandidate]()
    for _, candidate in scored:
        if len(chosen) == count:
            break
        moves = (np.max(np.abs(candidate.points - other.points)) for other in chosen if candidate.faces == other.faces)
        is_distinct = min(moves, default=np.inf) >= APART * compiled.scaling.length
        if (
            is_distinct
            and compiled.violation(candidate) <= FEASIBLE
            and weakest_directions_of(compiled, candidate, rng).value >= least
        ):
            chosen.append(candidate)
    return chosen or [candidates[0]]


def _outer_volumes(
    supports: FloatArray, directions: FloatArray, rng: np.random.Generator, count: int = 200
) -> FloatArray:
    """Return nu (b,), but for a constant factor, of the polytopes with planes of unit directions (m, d).

    By random rays from the origin, with the supports (b, m) of each.
    """
    rays = random_directions(count, directions.shape[1], rng)
    slopes = np.maximum(directions @ rays.T, 0.0)
    nearest = [np.max(slopes / np.maximum(row, 1e-300)[:, None], axis=0) for row in supports]
    return np.asarray(np.mean(np.array(nearest) ** -directions.shape[1], axis=1))


def floor_of_mu(compiled: CompiledProblem) -> float:
    """Return the mu that candidates keep, so that its certificate is above the problem's ``least_mu``."""
    return (compiled.problem.least_mu or 0.0) * (1.0 + 1.2 * compiled.options.final_rtol)


def maximise_volume(compiled: CompiledProblem, candidate: GraspCandidate, deadline: Deadline) -> GraspCandidate:
    """Return a candidate improved in log nu by trust-region steps; unchanged without force closure.

    Its mu stays above the floor, or at what it is below.
    """
    grasp = compiled.grasp(candidate)
    if wrench_rank(grasp.G.T) < grasp.dimension:
        return candidate
    sampled = SampledVolume(compiled, grasp, RAYS[grasp.dimension])
    volume, radius, idle = sampled.at(grasp), RADIUS, 0
    rng = np.random.default_rng(0)
    weakest = weakest_directions_of(compiled, candidate, rng)
    least = min(floor_of_mu(compiled), weakest.value)
    for _ in range(ROUNDS):
        if not np.isfinite(volume.log) or radius < LEAST_RADIUS or idle == IDLE or deadline.should_stop():
            break
        linear = Linearisation(compiled, candidate, weakest.directions[: compiled.cutting_planes.slots])
        gradient = sampled.gradient(candidate, linear.z, volume)
        first = linear.quadratic_step(radius, cost=-gradient, least_beta=compiled.scaling.beta * least)
        if first is None:
            break
        step, predicted = linear.step(first, radius), float(gradient @ first.d)
        if step is None or compiled.violation(step.candidate) > FEASIBLE:
            radius *= CONTRACTION
            continue
        weakest_there = weakest_directions_of(compiled, step.candidate, rng, weakest.directions)
        if weakest_there.value < least:
            radius *= CONTRACTION
            continue
        trial = sampled.at(compiled.grasp(step.candidate))
        gain = trial.log - volume.log
        idle = idle + 1 if max(gain, 0.0) < LEAST_GAIN else 0
        if gain > 0.0:
            candidate, volume, weakest = step.candidate, trial, weakest_there
        radius = min(EXPANSION * radius, LARGEST_RADIUS) if gain > FAIR * predicted else CONTRACTION * radius
    return candidate
