"""Initial candidates by coordinate exchange over surface samples.

A candidate is a tuple of samples, one a contact. Its quality is the least of ``phi_G(y_j) / phi_A(y_j)`` over
directions ``y_j``; the support ``phi_G`` of the grasp combines the supports ``s_i`` of its contacts,
``phi_G^p = sum_i s_i^p``, or is their largest under a shared budget. With the ``s_i^p`` of all samples in a table the
best exchange of one contact takes one addition and one minimum a sample and direction (as exchange algorithms of
optimal designs do: Meyer and Nachtsheim 1995, "The coordinate-exchange algorithm for constructing exact optimal
experimental designs", doi:10.1080/00401706.1995.10485889). Directions are well-spread ones of the task, and those in
which candidates turn out to be weakest.

On a mesh the same exchange also improves a refined grasp, over dense samples near its contacts (``exchange_nearby``).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from nlpgrasp.common.unit_directions import directions
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.hands import ParallelJaw
from nlpgrasp.optimize.candidate import GraspCandidate
from nlpgrasp.optimize.compiled_problem import FEASIBLE, CompiledProblem
from nlpgrasp.optimize.projection import TOUCHING, fix_to_triangles, project_onto_constraints
from nlpgrasp.optimize.surface_samples import BAND, IntArray, SampleCloud, SampleTables
from nlpgrasp.quality.grasp import Grasp, GraspStack
from nlpgrasp.quality.sandwich import ResumableCertificate
from nlpgrasp.quality.screening import minimise_locally, sampled_ratios, screening_score
from nlpgrasp.quality.weakest_directions import weaker_in_polytope

KEPT = 8  # candidates kept between rounds of exchanges, and perturbed in each; twice as many are begun with
DRAWN = 2048  # random tuples drawn, of which the best are half of those that exchanges begin with
SHAKES = 6  # rounds of random perturbation and exchange for one start; one more for each other
SWEEPS = 4  # sweeps of exchanges over all contacts, at most
WEAK = 24  # directions in which all samples are compared: the weakest of the remaining contacts
LIKELY = 16  # shortlisted samples, compared in all directions
GAIN = 1e-3  # least relative gain of an exchange
TIE, LAST_TIE = 0.2, 0.01  # weight of the mean over weak directions beside the least support; in the last exchange
DESCENTS, STEPS, LEARNED = 3, 8, 2  # per candidate: descents, steps of each, directions added
CERTIFIED, LOOSE = 2, 0.2  # certificates per round, at most; their relative width
SHOWN = 8  # directions added from a certificate, at most
PROPOSED = 4  # candidates per start
MET = 2  # tuples compared per candidate requested
MOST_MET, BEST_MET = 200, 12  # tuples compared; pairs for jaws whose approach is checked: the best, as many of the rest
REPAIRABLE = 1e-3  # largest violation of coupled constraints, relative to their scales, that is repaired afterwards
AROUND, MOST_AROUND = 0.08, 300  # radius over the body's size, and most samples, of a contact's neighbourhood on a mesh
APART = 0.05  # over the body's size: congruent placements differ by less in all distances between contacts


def exchanged_candidates(
    compiled: CompiledProblem, rng: np.random.Generator, known: Sequence[FloatArray] = (), count: int = PROPOSED
) -> list[GraspCandidate]:
    """Return the best few candidates of a coordinate exchange from random tuples of samples, best first.

    Parameters
    ----------
    compiled : CompiledProblem
        Of a problem whose hand, if any, follows its contacts.
    rng : numpy.random.Generator
    known : sequence of (k, space) array
        Contacts, whose nearest samples exchanges begin from as well.
    count : int
        Candidates at most.
    """
    tables = compiled.sample_tables
    search = CoordinateExchange(compiled, tables, rng, max(KEPT, count // 2))
    tuples = search.search(SHAKES + count // PROPOSED - 1, tables.nearest(known))
    met = search.best(np.concatenate([tuples, *search.met]), MOST_MET)
    jaws = isinstance(compiled.problem.hand, ParallelJaw)
    if jaws:
        tuples = np.concatenate([met[:BEST_MET], met[BEST_MET :: max(1, len(met) // BEST_MET)]])
    else:
        tuples = met[select_incongruent(compiled, tables.places(met)[0])[: MET * count]]
    found = [search.candidate(one) for one in tuples]
    if tables.coupled:
        repaired = [one for one in (_repair(compiled, candidate) for candidate in found) if one is not None]
        found = _rank(compiled, repaired) if repaired else found
    if jaws:
        found.sort(key=lambda candidate: not compiled.hand_points.has_free_way(candidate.points))
    return distinct(compiled, found, count)


class CoordinateExchange:
    """Local search over tuples of surface samples that replaces one contact at a time.

    Parameters
    ----------
    compiled : CompiledProblem
    tables : SampleTables
        Of the samples that contacts are at.
    rng : numpy.random.Generator
    kept : int
        Candidates kept between rounds.

    Attributes
    ----------
    directions : (j, d) array
        Known so far, each with ``phi_A = 1``.
    powers : list of (j, m) array
        ``s^p`` of each sample table along these.
    met : list of (b, k) arrays
        Tuples after exchanges.
    """

    def __init__(
        self, compiled: CompiledProblem, tables: SampleTables, rng: np.random.Generator, kept: int = KEPT
    ) -> None:
        self._bench, self._rng, self._tables, self._kept = compiled, rng, tables, kept
        self.directions, self.powers = self._tables.directions, list(self._tables.powers)
        self.met: list[IntArray] = []
        self._certified: set[tuple[tuple[int, int], ...]] = set()  # whose values descents did not flatter

    def search(self, shakes: int, known: IntArray | None = None) -> IntArray:
        """Return the best tuples found from random ones and known ones (m, k), best first, (b, k).

        Half of the random ones are the best of many. Exchanges by the mean along weak directions lead far, but past
        good tuples: every other round they go by the least support alone, and tuples before exchanges stay.
        """
        begun = self.draw() if known is None else np.concatenate([self.draw(), known])
        best = self.select_best(begun, self.exchange(begun), self.exchange(begun, LAST_TIE))
        best = self.select_best(best, self.exchange(best))
        for number in range(shakes):
            best = self.select_best(best, self.exchange(self.perturb(best), LAST_TIE if number % 2 else TIE))
        return self.select_best(best, self.exchange(best, LAST_TIE))

    def draw(self) -> IntArray:
        """Return random tuples, (b, k); half of them are the best of ``DRAWN``."""
        many = self._tables.random(DRAWN, self._rng)
        chosen = self.best(many, self._kept)
        return np.concatenate([chosen, many[: 2 * self._kept - len(chosen)]])

    def perturb(self, tuples: IntArray) -> IntArray:
        """Return tuples with one or two contacts at random samples, as many as are kept, the best tuples most often."""
        result = np.resize(tuples, (self._kept, tuples.shape[1]))
        for number, (row, drawn) in enumerate(zip(result, self._tables.random(self._kept, self._rng), strict=True)):
            moved = self._rng.permutation(len(row))[: 1 + number % 2]
            row[moved] = drawn[moved]
        return result

    def select_best(self, *tuples: IntArray) -> IntArray:
        """Return the best of several sets of tuples (b, k), best first, after adding their weakest directions."""
        self.met += tuples
        best = self.best(np.concatenate(tuples), 4 * self._kept)
        self.add_weakest_directions(best[: 2 * self._kept])
        best = self.best(best, len(best))
        first = select_incongruent(self._bench, self._tables.places(best)[0])
        rest = [b for b in range(len(best)) if b not in first]
        return self.certified(best[sorted((first + rest)[: self._kept])])

    def values(self, tuples: IntArray) -> FloatArray:
        """Return the least ``phi_G / phi_A`` of tuples (b, k) along known directions, (b,); -1 less any violation."""
        least = np.min(self._tables.combine.reduce(self._powers_of(tuples), axis=2), axis=0).astype(float)
        violation = self.violations(tuples)
        return np.where(violation <= REPAIRABLE, least ** (1.0 / self._tables.power), -1.0 - violation)

    def violations(self, tuples: IntArray) -> FloatArray:
        """Return the largest violation of coupled constraints by tuples (b, k), relative to their scales, (b,)."""
        if not self._tables.coupled:
            return np.zeros(len(tuples))
        rows, (points, normals) = self._bench.rows, self._tables.places(tuples)
        values = rows.values(points, normals, self._bench.hand_points.start(points, normals))
        return np.asarray(np.max(rows.each_excess(values, BAND), axis=1))

    def best(self, tuples: IntArray, count: int) -> IntArray:
        """Return the best ``count`` of tuples (b, k), without duplicates."""
        order = np.argsort(-self.values(tuples), kind="stable")
        return np.array(list({self._key(t): t for t in tuples[order[::-1]]}.values())[::-1][:count])

    def exchange(self, tuples: IntArray, tie: float = TIE, within: Sequence[Sequence[IntArray]] = ()) -> IntArray:
        """Return tuples (b, k) after coordinate exchange: one contact at a time moves to its best sample.

        Where it is given, ``within[b][i]`` are the samples that contact i of tuple b may be at.
        """
        tuples, k = tuples.copy(), tuples.shape[1]
        own, violation = self._powers_of(tuples), self.violations(tuples)
        since = np.zeros(len(tuples), dtype=int)  # contacts tried since the last exchange
        for turn in range(SWEEPS * k):
            i, going = turn % k, np.flatnonzero(since < k)
            if not len(going):
                break
            outside = violation > REPAIRABLE
            each = [(b, within[b][i] if within else None) for b in going.tolist()]
            shortlists = [
                self._promising_samples(own[:, b], i, int(tuples[b, i]), bool(outside[b]), tie, some)
                for b, some in each
            ]
            trials = np.repeat(tuples[going], [len(samples) for samples, _ in shortlists], axis=0)
            trials[:, i] = np.concatenate([samples for samples, _ in shortlists])
            broken = self.violations(trials)
            end = 0
            for b, (samples, score) in zip(going, shortlists, strict=True):
                start, end = end, end + len(samples)
                excess = broken[start:end]
                merit = np.where(excess <= REPAIRABLE, score, -1.0 - excess)
                chosen = int(np.argmax(merit))
                since[b] += 1
                if merit[chosen] > merit[-1] + GAIN * abs(merit[-1]):
                    tuples[b, i], violation[b], since[b] = samples[chosen], excess[chosen], 1
                    own[:, b, i] = self.powers[self._tables.of_contact[i]][:, samples[chosen]]
        return tuples

    def add_weakest_directions(self, tuples: IntArray) -> None:
        """Add the directions in which tuples (b, k) are weakest, found by descents."""
        ratios = self._tables.combine.reduce(self._powers_of(tuples), axis=2)
        count = min(DESCENTS, len(ratios) - 1)
        begun = self.directions[np.argpartition(ratios, count, axis=0)[:count].T]
        stack = GraspStack(*self._tables.places(tuples), self._bench.problem.models, self._bench.problem.origin)
        found, values = minimise_locally(stack, self._bench.problem.task, begun, self._tables.budget, STEPS)
        weakest = np.argsort(values, axis=1, kind="stable")[:, :LEARNED]
        self.add_directions(np.take_along_axis(found, weakest[:, :, None], axis=1).reshape(-1, found.shape[2]))

    def certified(self, tuples: IntArray) -> IntArray:
        """Return tuples (b, k), best first, re-ranked with weak directions from loose certificates of the best tuple.

        Descents miss narrow dips. A tuple that turns out to be weaker makes place for the next.
        """
        for _ in range(CERTIFIED):
            if self._key(tuples[0]) in self._certified:
                break
            value = float(self.values(tuples[:1])[0])
            grasp = self._bench.grasp_at(*(part[0] for part in self._tables.places(tuples[:1])))
            begun = (
                ResumableCertificate.of(grasp, self._bench.problem.task, self._tables.budget, LOOSE)
                if value > 0.0
                else None
            )
            weaker = None if begun is None else weaker_in_polytope(begun, value)
            if weaker is None:
                self._certified.add(self._key(tuples[0]))
                break
            self.add_directions(weaker.directions[:SHOWN])
            tuples = self.best(np.concatenate([tuples, self.exchange(tuples, LAST_TIE)]), self._kept)
        return tuples

    def add_directions(self, y: FloatArray) -> None:
        """Add directions (j, d), scaled to ``phi_A = 1``."""
        reach = self._bench.problem.task.support(y)[0]
        y = y[reach > 0.0] / reach[reach > 0.0, None]
        self.directions = np.concatenate([self.directions, y])
        self.powers = [
            np.concatenate([old, table.powers(y)])
            for old, table in zip(self.powers, self._tables.distinct, strict=True)
        ]

    def candidate(self, one: IntArray) -> GraspCandidate:
        """Return a tuple (k,) of samples as a candidate with its hand."""
        points, normals = self._tables.places(one[None])
        hand = self._bench.hand_points.start(points, normals)
        faces = tuple(str(self._tables.samples(i).faces[sample]) for i, sample in enumerate(one))
        return GraspCandidate(faces, points[0], {name: value[0] for name, value in hand.items()})

    def _key(self, one: IntArray) -> tuple[tuple[int, int], ...]:
        """Return a key that is equal for tuples that differ only in the order of identical contacts."""
        return tuple(sorted(zip(self._tables.of_contact, one.tolist(), strict=True)))

    def _powers_of(self, tuples: IntArray) -> FloatArray:
        """Return the powers ``s^p`` of each contact's support in tuples (b, k) along all directions, (j, b, k)."""
        each = zip(self._tables.of_contact, tuples.T, strict=True)
        return np.stack([self.powers[table][:, samples] for table, samples in each], axis=2)

    def _promising_samples(
        self, own: FloatArray, i: int, current: int, outside: bool, tie: float, among: IntArray | None = None
    ) -> tuple[IntArray, FloatArray]:
        """Return promising samples of contact i beside the others of a tuple (j, k), the current one last, and scores.

        They are among all samples, or some by number.
        """
        powers = self.powers[self._tables.of_contact[i]]
        rest = self._tables.combine.reduce(np.delete(own, i, axis=1), axis=1, initial=0.0)
        weak = np.argpartition(rest, WEAK)[:WEAK] if len(rest) > WEAK else np.arange(len(rest))
        some = powers[weak] if among is None else powers[np.ix_(weak, among)]
        supports = self._tables.combine(rest[weak, None], some)
        score = np.min(supports, axis=0) + np.full(len(weak), tie / len(weak), dtype=np.float32) @ supports
        likely = np.argpartition(score, -LIKELY)[-LIKELY:] if len(score) > LIKELY else np.arange(len(score))
        if outside:
            likely = np.concatenate([likely, self._rng.integers(len(score), size=LIKELY)])
        likely = likely if among is None else among[likely]
        likely = np.append(likely, current)
        every = self._tables.combine(rest[:, None], powers[:, likely])
        return likely, np.min(every, axis=0) + tie * np.mean(every[weak], axis=0)


def exchange_nearby(
    compiled: CompiledProblem, candidate: GraspCandidate, grasp: Grasp, cuts: FloatArray
) -> GraspCandidate | None:
    """Return contacts on a mesh improved by coordinate exchange over dense samples nearby; None where none are better.

    Parameters
    ----------
    compiled : CompiledProblem
        Of a problem with a mesh, whose hand, if any, follows its contacts.
    candidate : GraspCandidate
    grasp : Grasp
        Of the same contacts.
    cuts : (m, d) array
        Directions that the grasp is weak in, each with ``phi_A = 1``.
    """
    rng, whole = np.random.default_rng(0), compiled.surface.mesh_cloud
    clouds = []
    for face, point, normal in zip(candidate.faces, grasp.points, grasp.normals, strict=True):
        near = np.array(sorted(whole.tree.query_ball_point(point, AROUND * compiled.scaling.length)), dtype=np.intp)
        if len(near) > MOST_AROUND:
            near = np.sort(rng.choice(near, MOST_AROUND, replace=False))
        points, normals = (
            np.concatenate([own[None], all_[near]]) for own, all_ in ((point, whole.points), (normal, whole.normals))
        )
        faces = np.full(len(points), whole.faces[0], dtype=object)
        faces[0] = face
        clouds.append(SampleCloud(faces, points, normals, cKDTree(points)))
    directions = np.concatenate([cuts, compiled.sample_tables.directions])
    tables = SampleTables(compiled.problem, clouds, compiled.rows, compiled.hand_points, directions)
    search = CoordinateExchange(compiled, tables, rng)
    here = np.zeros((1, len(clouds)), dtype=np.intp)
    if search.values(here)[0] <= 0.0:
        return None
    best = search.select_best(here, search.exchange(here))[0]
    return search.candidate(best) if best.any() else None


def distinct(compiled: CompiledProblem, found: Sequence[GraspCandidate], count: int = PROPOSED) -> list[GraspCandidate]:
    """Return the first few candidates that are not congruent to an earlier one.

    They are compared by the distances between contacts, and from the torque origin.
    """
    chosen = select_incongruent(compiled, np.stack([candidate.points for candidate in found]))
    return [found[b] for b in chosen[:count]]


def select_incongruent(compiled: CompiledProblem, points: FloatArray) -> list[int]:
    """Return the indices of placements (b, k, space) that are not congruent to an earlier one."""
    points = points - compiled.problem.origin
    across = np.linalg.norm(points[:, :, None] - points[:, None], axis=3).reshape(len(points), -1)
    shapes = np.concatenate([np.sort(across, axis=1), np.sort(np.linalg.norm(points, axis=2), axis=1)], axis=1)
    chosen: list[int] = []
    for b, shape in enumerate(shapes):
        near = np.max(np.abs(shapes[chosen] - shape), axis=1, initial=0.0)
        if not np.any(near < APART * compiled.scaling.length):
            chosen.append(b)
    return chosen


def sampled_quality(compiled: CompiledProblem, points: FloatArray, normals: FloatArray) -> FloatArray:
    """Return the sampled quality of placements (b, k, space), (b,)."""
    stack = GraspStack(points, normals, compiled.problem.models, compiled.problem.origin)
    ratios = sampled_ratios(stack, compiled.problem.task, screening_directions(compiled), compiled.screening_budget)
    return screening_score(ratios) * compiled.scaling.beta


def screening_directions(compiled: CompiledProblem) -> FloatArray:
    """Return well-spread directions in wrench space, isotropic in the solver's units, (m, d)."""
    return directions(compiled.problem.dimension, 2) * compiled.scaling.wrench


@dataclass(frozen=True)
class RandomContacts:
    """Random placements of all contacts.

    Parameters
    ----------
    points, normals : (b, k, space) array
        Metres; inward unit normals.
    faces : (b, k) array of str
    """

    points: FloatArray
    normals: FloatArray
    faces: NDArray[np.object_]


def draw_contacts(compiled: CompiledProblem, count: int, rng: np.random.Generator) -> RandomContacts:
    """Return random placements over the samples of the faces that each contact may use."""
    clouds = [compiled.surface.cloud(i) for i in range(len(compiled.problem.models))]
    each = [(cloud, rng.integers(len(cloud.points), size=count)) for cloud in clouds]
    return RandomContacts(
        np.stack([cloud.points[where] for cloud, where in each], axis=1),
        np.stack([cloud.normals[where] for cloud, where in each], axis=1),
        np.stack([cloud.faces[where] for cloud, where in each], axis=1),
    )


def _repair(compiled: CompiledProblem, candidate: GraspCandidate) -> tuple[GraspCandidate, FloatArray] | None:
    """Return a candidate projected onto constraints that it violates slightly, and its inward normals (k, space).

    None where it does not get there.
    """
    own, there = fix_to_triangles(compiled, candidate)
    if own.violation(there) > FEASIBLE:
        moved, left = project_onto_constraints(own, there)
        there = own.snapped(moved)
        if left > TOUCHING or own.violation(there) > FEASIBLE:
            return None
    return GraspCandidate(candidate.faces, there.points, there.hand), own.inward_normals(there)


def _rank(compiled: CompiledProblem, found: Sequence[tuple[GraspCandidate, FloatArray]]) -> list[GraspCandidate]:
    """Return candidates, given with their inward normals, by decreasing sampled quality."""
    points, normals = (
        np.stack([candidate.points for candidate, _ in found]),
        np.stack([normals for _, normals in found]),
    )
    return [found[b][0] for b in np.argsort(-sampled_quality(compiled, points, normals), kind="stable")]
