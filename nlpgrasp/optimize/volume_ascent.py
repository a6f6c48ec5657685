"""Local search: maximisation of the volume nu (3.2-1) by quadratic steps in a trust region.

log nu and its gradient come from rays that are fixed during a search (``RadialVolume``), so that the samples' error
hardly changes from one candidate to the next. A step maximises the linearised log nu inside the trust
region, with the constraints and the restoration of the cutting-plane method. Grasps without force closure are not
entered: their wrench set has the origin on its boundary.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import islice

import numpy as np

from nlpgrasp.common.deadline import Deadline
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.optimize.candidate import GraspCandidate
from nlpgrasp.optimize.compiled_problem import FEASIBLE, CompiledProblem
from nlpgrasp.optimize.coordinate_exchange import draw_contacts, sampled_quality
from nlpgrasp.optimize.support_gradients import support_gradients
from nlpgrasp.optimize.trust_region import Linearisation
from nlpgrasp.quality.grasp import Grasp
from nlpgrasp.quality.ratio_minimisation import random_directions
from nlpgrasp.quality.volume import RadialVolume, whitening
from nlpgrasp.quality.wrench_set import WrenchSet, wrench_rank

RAYS = {3: 256, 6: 768}  # rays of a search, by dimension
FEW_RAYS, MANY_RAYS = 96, 4096  # rays that rank candidates; that compare the results of starts
DRAWN, SCREENED = 600, 30  # random candidates of a start; those of most sampled mu, whose volume is sampled
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
        Number of rays; half of them are opposite to the others.
    """

    def __init__(self, compiled: CompiledProblem, grasp: Grasp, count: int) -> None:
        self._compiled, self._matrix = compiled, whitening(grasp)
        half = random_directions(count // 2, grasp.dimension, np.random.default_rng(0))
        self._rays = np.concatenate([half, -half])

    def at(self, grasp: Grasp) -> RadialVolume:
        """Return the sampled volume of a grasp."""
        return RadialVolume.of(WrenchSet.of(grasp, self._compiled.problem.budget), self._matrix, self._rays)

    def gradient(self, candidate: GraspCandidate, z: FloatArray, volume: RadialVolume) -> FloatArray:
        """Return the gradient (n,) of log nu in the program's variables z at a candidate with this volume."""
        support, slopes = support_gradients(self._compiled, candidate, z, volume.normals)
        return np.asarray(volume.normals.shape[1] * (volume.weights / support) @ slopes)


def sampled_volume(compiled: CompiledProblem, grasp: Grasp, rays: int = MANY_RAYS) -> float:
    """Return log nu of a grasp at a torque scale of 1 m, estimated by rays; minus infinity without force closure."""
    if wrench_rank(grasp.G.T) < grasp.dimension:
        return -np.inf
    return SampledVolume(compiled, grasp, rays).at(grasp).log


def largest_volumes(
    compiled: CompiledProblem, candidates: Sequence[GraspCandidate], rng: np.random.Generator, count: int
) -> list[GraspCandidate]:
    """Return the feasible candidates of largest sampled nu among given and random ones.

    The first given one where none is feasible.
    """
    drawn = draw_contacts(compiled, DRAWN, rng)
    scored = [(sampled_volume(compiled, compiled.grasp(candidate), FEW_RAYS), candidate) for candidate in candidates]
    closed = np.argsort(-sampled_quality(compiled, drawn.points, drawn.normals), kind="stable")[:SCREENED]
    for faces, points, normals in zip(drawn.faces[closed], drawn.points[closed], drawn.normals[closed], strict=True):
        hand = compiled.hand_functions.start(points[None], normals[None])
        candidate = GraspCandidate(tuple(faces), points, {name: value[0] for name, value in hand.items()})
        scored.append((sampled_volume(compiled, compiled.grasp_at(points, normals), FEW_RAYS), candidate))
    scored.sort(key=lambda pair: -pair[0])
    feasible = (candidate for _, candidate in scored if compiled.violation(candidate) <= FEASIBLE)
    return list(islice(feasible, count)) or [candidates[0]]


def maximise_volume(compiled: CompiledProblem, candidate: GraspCandidate, deadline: Deadline) -> GraspCandidate:
    """Return a candidate improved in log nu by trust-region steps; unchanged without force closure."""
    grasp = compiled.grasp(candidate)
    if wrench_rank(grasp.G.T) < grasp.dimension:
        return candidate
    sampled = SampledVolume(compiled, grasp, RAYS[grasp.dimension])
    volume, radius, idle = sampled.at(grasp), RADIUS, 0
    no_cuts = np.zeros((0, grasp.dimension))
    for _ in range(ROUNDS):
        if not np.isfinite(volume.log) or radius < LEAST_RADIUS or idle == IDLE or deadline.should_stop():
            break
        linear = Linearisation(compiled, candidate, no_cuts)
        gradient = sampled.gradient(candidate, linear.z, volume)
        first = linear.quadratic_step(radius, cost=-gradient)
        if first is None:
            break
        step, predicted = linear.step(first, radius), float(gradient @ first.d)
        if step is None or compiled.violation(step.candidate) > FEASIBLE:
            radius *= CONTRACTION
            continue
        trial = sampled.at(compiled.grasp(step.candidate))
        gain = trial.log - volume.log
        idle = idle + 1 if max(gain, 0.0) < LEAST_GAIN else 0
        if gain > 0.0:
            candidate, volume = step.candidate, trial
        radius = min(EXPANSION * radius, LARGEST_RADIUS) if gain > FAIR * predicted else CONTRACTION * radius
    return candidate
