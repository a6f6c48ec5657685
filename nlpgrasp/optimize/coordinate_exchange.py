"""Initial candidates by coordinate exchange over surface samples.

A candidate is a tuple of samples, one for each contact. Its quality is the least of ``phi_G(y_j) / phi_A(y_j)`` over
directions ``y_j``; the support ``phi_G`` of the grasp combines the supports ``s_i`` of its contacts,
``phi_G^p = sum_i s_i^p``, or is their largest under a shared budget. With the ``s_i^p`` of all samples in a table the
best exchange of one contact takes one addition and one minimum per sample and direction (as in exchange algorithms for
optimal designs: Meyer and Nachtsheim 1995, "The coordinate-exchange algorithm for constructing exact optimal
experimental designs", doi:10.1080/00401706.1995.10485889). Directions are well spread at first; the weakest directions
of candidates are added.

On a mesh, whose triangles have steps between their normals, the best candidates are exchanged again over dense samples
near their contacts (``exchange_nearby``).
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from nlpgrasp.bodies import Mesh
from nlpgrasp.common.unit_directions import directions
from nlpgrasp.common.validation import FloatArray, IntArray
from nlpgrasp.hands import ParallelJaw
from nlpgrasp.optimize.candidate import GraspCandidate
from nlpgrasp.optimize.compiled_problem import FEASIBLE, CompiledProblem
from nlpgrasp.optimize.planar_search import PlanarSearch
from nlpgrasp.optimize.projection import TOUCHING, fix_to_triangles, project_onto_constraints
from nlpgrasp.optimize.surface_samples import BAND, SampleCloud, SampleTables, best_of_trials
from nlpgrasp.quality.grasp import GraspStack
from nlpgrasp.quality.sandwich import ResumableCertificate
from nlpgrasp.quality.screening import minimise_locally, sampled_ratios, screening_score
from nlpgrasp.quality.weakest_directions import weakest_in_polytope

POPULATION = 8  # candidates kept between rounds of exchanges, and perturbed in each; twice as many at first
SWEEPS = 4  # sweeps of exchanges over all contacts, at most
WEAK = 24  # directions in which all samples are compared: the weakest of the remaining contacts
SHORTLISTED = 16  # samples of a shortlist, compared in all directions
CHECKED = 64, 512  # best samples whose coupled constraints are checked; where few satisfy them
MOVES = 8  # perturbations tried where coupled constraints are broken
GAIN = 1e-3  # least relative gain of an exchange
TIE, LAST_TIE = 0.2, 0.01  # weight of the mean over weak directions against the least support; in the last exchange
DESCENTS, STEPS, LEARNED = 3, 8, 2  # per candidate: descents, steps of each, directions added
JUDGED = 4  # descents of a tuple that is judged by what it holds
CERTIFIED, LAST_CERTIFIED = 2, 8  # certificates per round, at most; in the last round
LOOSE = 0.2  # relative width of these certificates
FROM_CERTIFICATE = 8  # directions added from a certificate, at most
PROPOSED = 4  # candidates per start
PER_CANDIDATE = 2  # tuples repaired and ranked per requested candidate
MOST_COMPARED = 200  # tuples compared after the exchange, at most
JAW_PAIRS = 12  # best pairs for jaws whose approach is checked; as many of the rest
REPAIRABLE = 1e-3  # largest violation of coupled constraints, relative to their scales, that is repaired by projection
NEIGHBOURHOOD = 0.05  # over the body's size: radius of a contact's neighbourhood on a mesh
DENSE_SAMPLES = 12000  # samples of a contact near known contacts, at most
MISLED = 0.9  # share of promising tuples that hold less than half of it, above which a second population is searched
THIN = 0.1  # share of random placements in the plane that hold the task below which mu itself is searched
CONGRUENT = 0.05  # over the body's size: difference of distances between contacts below which placements are congruent


def exchanged_candidates(
    compiled: CompiledProblem, rng: np.random.Generator, known: Sequence[FloatArray] = (), count: int = PROPOSED
) -> list[GraspCandidate]:
    """Return the best candidates found by coordinate exchange from random samples, best first.

    Parameters
    ----------
    compiled : CompiledProblem
        Problem whose hand, if any, follows its contacts.
    rng : numpy.random.Generator
    known : sequence of (k, space) array
        Contacts of known grasps: exchanges begin from their nearest samples as well.
    count : int
        Number of candidates, at most.
    """
    tables = compiled.sample_tables
    search = CoordinateExchange(compiled, tables, rng, max(POPULATION, count // 2))
    has_jaws, rounds = isinstance(compiled.problem.hand, ParallelJaw), 2 + count // 3
    if search.planar is not None and search.planar.share_that_holds() < THIN:
        visited = search.planar.best(tables.nearest(known))
    else:
        tuples = search.search(rounds, tables.nearest(known))
        if search.misled > MISLED:
            tuples = np.concatenate([tuples, search.search(rounds)])
        visited = search.sorted_by_judgement(search.best(np.concatenate([tuples, *search.history]), MOST_COMPARED))
    if has_jaws:
        tuples = np.concatenate([visited[:JAW_PAIRS], visited[JAW_PAIRS :: max(1, len(visited) // JAW_PAIRS)]])
    else:
        tuples = search.unlike(visited)[: PER_CANDIDATE * count]
    if isinstance(compiled.problem.body, Mesh):
        search, tuples = exchange_nearby(compiled, tables.contacts_of(tuples)[0], search.directions, rng)
    if search.knows_mu:
        tuples = search.moved(tuples)
    candidates = [search.candidate(samples) for samples in tuples]
    if tables.coupled:
        repairs = (_repair(compiled, candidate) for candidate in candidates)
        repaired = [repair for repair in repairs if repair is not None]
        candidates = search.rank(repaired) if repaired else candidates
    if has_jaws:
        candidates = _free_approaches_first(compiled, candidates, count)
    return drop_congruent(compiled, candidates, count)


def _free_approaches_first(
    compiled: CompiledProblem, candidates: Sequence[GraspCandidate], count: int
) -> list[GraspCandidate]:
    """Return candidates of parallel jaws, those with a free approach first.

    Approaches are checked until ``count`` free ones that are not congruent are known.
    """
    free, others = list[GraspCandidate](), list[GraspCandidate]()
    for candidate in candidates:
        is_enough = len(free) >= count and len(drop_congruent(compiled, free, count)) == count
        is_free = not is_enough and compiled.hand_functions.has_free_approach(candidate.points)
        (free if is_free else others).append(candidate)
    return free + others


class CoordinateExchange:
    """Local search over tuples of surface samples that replaces one contact at a time.

    Parameters
    ----------
    compiled : CompiledProblem
    tables : SampleTables
        Tables of the samples that contacts may be at.
    rng : numpy.random.Generator
    population : int
        Number of candidates kept between rounds.

    Attributes
    ----------
    compiled, tables, rng
        As given.
    directions : (j, d) array
        Directions known so far, each with ``phi_A = 1``.
    powers : list of (j, m) array
        ``s^p`` of each sample table along these.
    history : list of (b, k) arrays
        Tuples compared so far.
    misled : float
        Share of the random tuples that promise most along the known directions which hold less than half of it.
    knows_mu : bool
        Whether tuples are judged by mu, which is then that of the samples' contacts alone.
    planar : PlanarSearch or None
        Search over the same samples by mu, in the plane.
    """

    def __init__(
        self, compiled: CompiledProblem, tables: SampleTables, rng: np.random.Generator, population: int = POPULATION
    ) -> None:
        self.compiled, self.rng, self.tables, self._population = compiled, rng, tables, population
        self.directions, self.powers = self.tables.directions, list(self.tables.powers)
        self.history: list[IntArray] = []
        self.misled = 0.0
        problem, distinct = compiled.problem, partial(select_incongruent, compiled)
        self.knows_mu = not (isinstance(problem.hand, ParallelJaw) or problem.budget.depends_on_frames)
        in_plane = self.knows_mu and problem.dimension == 3
        self.planar = PlanarSearch(problem, tables, self.merit, distinct, rng) if in_plane else None
        self._certified: set[tuple[tuple[int, int], ...]] = set()  # tuples whose certificate had no weaker direction

    def search(self, perturbations: int, known: IntArray | None = None) -> IntArray:
        """Return the best tuples of samples (b, k) found from random and known tuples (m, k), best first.

        Half of the random ones are the best of many. Exchanges by the mean along weak directions move far, but past
        good tuples: every other round compares by the least support alone, and tuples before exchanges are kept.
        """
        initial = self.draw() if known is None else np.concatenate([self.draw(), known])
        best = self.update_population(initial, self.exchange(initial), self.exchange(initial, LAST_TIE))
        best = self.update_population(best, self.exchange(best))
        for number in range(perturbations):
            best = self.update_population(best, self.exchange(self.perturb(best), LAST_TIE if number % 2 else TIE))
        return self.update_population(best, self.exchange(best, LAST_TIE), certified=LAST_CERTIFIED)

    def draw(self, drawn: int = 8192, judged: int = 400) -> IntArray:
        """Return initial tuples (b, k): the best of many random ones that are not alike, and some at random.

        Those of the ``drawn`` ones that hold most along the known directions are ``judged``. The best of each
        combination of faces come first, since exchanges of one contact do not lead from one to another.
        """
        tuples = self.tables.random(drawn, self.rng)
        promising = self.best(tuples, judged)
        held, promised = self.judged(promising), self.values(promising)
        self.misled = float(np.mean(held < 0.5 * promised))
        ordered = promising[np.argsort(-held, kind="stable")]
        best = self.unlike(ordered[self._by_faces_in_turn(ordered)])[: self._population]
        return np.concatenate([best, tuples[: 2 * self._population - len(best)]])

    def _by_faces_in_turn(self, tuples: IntArray) -> IntArray:
        """Return an order of tuples (b, k): the first one on each combination of faces, then the second ones."""
        faces = np.stack([self.tables.samples(i).faces[samples] for i, samples in enumerate(tuples.T)], axis=1)
        seen, turns = Counter[tuple[str, ...]](), np.zeros(len(tuples), int)
        for number, combination in enumerate(map(tuple, np.sort(faces.astype(str), axis=1).tolist())):
            turns[number] = seen[combination]
            seen[combination] += 1
        return np.argsort(turns, kind="stable")

    def judged(self, tuples: IntArray) -> FloatArray:
        """Return about mu of tuples (b, k), (b,): in space by descents from their weakest known directions.

        Where mu is not known they are their ``values``. For a violation that is not repairable it is minus one minus
        the violation.
        """
        if not self.knows_mu:
            return self.values(tuples)
        if self.planar is not None:
            return self.planar.values(tuples)
        return self.merit(np.min(self._weakest(tuples, JUDGED)[1], axis=1), tuples)

    def sorted_by_judgement(self, tuples: IntArray) -> IntArray:
        """Return tuples (b, k) by ``judged``, best first."""
        return np.asarray(tuples[np.argsort(-self.judged(tuples), kind="stable")])

    def unlike(self, tuples: IntArray) -> IntArray:
        """Return the tuples (b, k) that are not congruent to an earlier one."""
        return np.asarray(tuples[select_incongruent(self.compiled, self.tables.contacts_of(tuples)[0])])

    def moved(self, tuples: IntArray, widths: Sequence[int] = (300, 100, 40, 15), trials: int = 40) -> IntArray:
        """Return tuples (b, k), moved by a race in which each moves to the best of trials around it, best first.

        Trials are compared by what they hold; the field halves after the first two rounds. What a tuple is chosen for
        may be a narrow minimum that descents have missed: from round to round all directions that are known at first
        are descended from, and the weakest are added.

        Parameters
        ----------
        tuples : (b, k) int array
        widths : sequence of int
            Numbers of samples around a contact among which it moves, the others with it, from one round to the next.
        trials : int
            In each round.
        """
        task, spread, left = self.compiled.problem.task, self.tables.directions, list[IntArray]()
        for number, width in enumerate(widths):
            trials_around = self.tables.around(tuples, width, trials, self.rng)
            tuples = best_of_trials(tuples, trials_around, self.judged)
            if self.planar is None:  # which has no minimum that is missed
                all_directions = np.broadcast_to(spread, (len(tuples), *spread.shape))
                self._learn(*minimise_locally(self.tables.grasps(tuples), task, all_directions, self.tables.budget))
            tuples, kept = self.sorted_by_judgement(tuples), len(tuples) if number > 1 else (len(tuples) + 1) // 2
            tuples, left = tuples[:kept], [tuples[kept:], *left]
        return np.concatenate([tuples, *left])

    def perturb(self, tuples: IntArray) -> IntArray:
        """Return tuples (b, k) with one or two contacts moved to random samples.

        The given tuples are repeated to fill the population. Where a move breaks coupled constraints, other moves are
        tried a few times.
        """
        original = np.resize(tuples, (self._population, tuples.shape[1]))
        result = self._move_some(original)
        for _ in range(MOVES):
            broken = np.flatnonzero(self.violations(result) > REPAIRABLE)
            if not len(broken):
                break
            result[broken] = self._move_some(original[broken])
        return result

    def _move_some(self, tuples: IntArray) -> IntArray:
        """Return tuples (b, k) with one contact moved to a random sample, in every second tuple two contacts."""
        result = tuples.copy()
        for number, (samples, drawn) in enumerate(zip(result, self.tables.random(len(tuples), self.rng), strict=True)):
            moved = self.rng.permutation(len(samples))[: 1 + number % 2]
            samples[moved] = drawn[moved]
        return result

    def update_population(self, *tuples: IntArray, certified: int = CERTIFIED) -> IntArray:
        """Add the weakest directions of several sets of tuples, and return the best tuples (b, k), best first.

        At most ``certified`` certificates show directions that descents miss.
        """
        self.history += tuples
        best = self.best(np.concatenate(tuples), 4 * self._population)
        self._learn(*self._weakest(best[: 2 * self._population], DESCENTS))
        best = self.best(best, len(best))
        incongruent = select_incongruent(self.compiled, self.tables.contacts_of(best)[0])
        congruent = [b for b in range(len(best)) if b not in incongruent]
        return self.exchange_by_certificates(best[sorted((incongruent + congruent)[: self._population])], certified)

    def values(self, tuples: IntArray) -> FloatArray:
        """Return the least support ratio ``phi_G / phi_A`` of tuples (b, k) over the known directions, (b,).

        For a violation that is not repairable it is minus one minus the violation.
        """
        least = np.min(self.tables.combine.reduce(self._powers_of(tuples), axis=2), axis=0).astype(float)
        return self.merit(least ** (1.0 / self.tables.power), tuples)

    def merit(self, quality: FloatArray, tuples: IntArray) -> FloatArray:
        """Return the merits (b,) of tuples (b, k) with some quality, less than -1 for violations beyond repair."""
        return _merit(quality, self.violations(tuples))

    def violations(self, tuples: IntArray) -> FloatArray:
        """Return the largest violation of coupled constraints at tuples (b, k), relative to their scales, (b,)."""
        if not self.tables.coupled:
            return np.zeros(len(tuples))
        rows, (points, normals) = self.compiled.rows, self.tables.contacts_of(tuples)
        values = rows.values(points, normals, self.compiled.hand_functions.start(points, normals))
        return np.asarray(np.max(rows.each_violation(values, BAND), axis=1))

    def best(self, tuples: IntArray, count: int) -> IntArray:
        """Return the best ``count`` of tuples (b, k), best first and without duplicates."""
        order = np.argsort(-self.values(tuples), kind="stable")
        return np.array(list({self._key(t): t for t in tuples[order[::-1]]}.values())[::-1][:count])

    def exchange(self, tuples: IntArray, tie: float = TIE, within: Sequence[Sequence[IntArray]] = ()) -> IntArray:
        """Return tuples (b, k) after coordinate exchange: one contact at a time moves to its best sample.

        ``within[b][i]`` are the samples that contact i of tuple b may be at, by default all.
        """
        tuples, k = tuples.copy(), tuples.shape[1]
        powers, violation = self._powers_of(tuples), self.violations(tuples)
        since = np.zeros(len(tuples), dtype=int)  # contacts tried since the last exchange
        for turn in range(SWEEPS * k):
            i, active = turn % k, np.flatnonzero(since < k)
            if not len(active):
                break
            for b in active.tolist():
                samples, score, excess = self._promising_samples(
                    tuples[b], float(violation[b]), powers[:, b], i, tie, within[b][i] if within else None
                )
                merit = _merit(score, excess)
                chosen = int(np.argmax(merit))
                since[b] += 1
                if merit[chosen] > merit[-1] + GAIN * abs(merit[-1]):
                    tuples[b, i], violation[b], since[b] = samples[chosen], excess[chosen], 1
                    powers[:, b, i] = self.powers[self.tables.of_contact[i]][:, samples[chosen]]
        return tuples

    def _weakest(self, tuples: IntArray, descents: int) -> tuple[FloatArray, FloatArray]:
        """Return directions (b, m, d) and support ratios (b, m) of descents from tuples' weakest known directions."""
        ratios = self.tables.combine.reduce(self._powers_of(tuples), axis=2)
        count = min(descents, len(ratios) - 1)
        initial = self.directions[np.argpartition(ratios, count, axis=0)[:count].T]
        grasps, task = self.tables.grasps(tuples), self.compiled.problem.task
        return minimise_locally(grasps, task, initial, self.tables.budget, STEPS)

    def _learn(self, minimisers: FloatArray, values: FloatArray) -> None:
        """Add the weakest of directions (b, m, d) of tuples with support ratios (b, m)."""
        weakest = np.argsort(values, axis=1, kind="stable")[:, :LEARNED]
        self.add_directions(
            np.take_along_axis(minimisers, weakest[:, :, None], axis=1).reshape(-1, minimisers.shape[2])
        )

    def exchange_by_certificates(self, tuples: IntArray, most: int) -> IntArray:
        """Return tuples (b, k), best first, after exchanges with weak directions added by certificates.

        Descents miss narrow minima of the support ratio, which a loose certificate of the best tuple shows. There are
        at most ``most`` certificates, each followed by exchanges of all tuples.
        """
        for _ in range(most):
            if self._key(tuples[0]) in self._certified:
                break
            value = float(self.values(tuples[:1])[0])
            grasp = self.compiled.grasp_at(*(part[0] for part in self.tables.contacts_of(tuples[:1])))
            certificate = (
                ResumableCertificate.of(grasp, self.compiled.problem.task, self.tables.budget, LOOSE)
                if value > 0.0
                else None
            )
            weaker = None if certificate is None else weakest_in_polytope(certificate, value)
            if weaker is None:
                self._certified.add(self._key(tuples[0]))
                break
            self.add_directions(weaker.directions[:FROM_CERTIFICATE])
            tuples = self.best(np.concatenate([tuples, self.exchange(tuples, LAST_TIE)]), self._population)
        return tuples

    def add_directions(self, y: FloatArray) -> None:
        """Add directions (j, d) after scaling them to ``phi_A = 1``."""
        reach = self.compiled.problem.task.support(y)[0]
        y = y[reach > 0.0] / reach[reach > 0.0, None]
        self.directions = np.concatenate([self.directions, y])
        self.powers = [
            np.concatenate([old, table.powers(y)]) for old, table in zip(self.powers, self.tables.distinct, strict=True)
        ]

    def candidate(self, samples: IntArray) -> GraspCandidate:
        """Return the candidate at a tuple (k,) of samples, with its hand."""
        points, normals = self.tables.contacts_of(samples[None])
        hand = self.compiled.hand_functions.start(points, normals)
        faces = tuple(str(self.tables.samples(i).faces[sample]) for i, sample in enumerate(samples))
        return GraspCandidate(faces, points[0], {name: value[0] for name, value in hand.items()})

    def rank(self, candidates: Sequence[tuple[GraspCandidate, FloatArray]]) -> list[GraspCandidate]:
        """Return candidates by decreasing least ratio over the known directions.

        Each is paired with its inward normals (k, space).
        """
        points, normals = (np.stack(parts) for parts in zip(*((c.points, n) for c, n in candidates), strict=True))
        stack = GraspStack(points, normals, self.compiled.problem.models, self.compiled.problem.origin)
        ratios = sampled_ratios(stack, self.compiled.problem.task, self.directions, self.tables.budget)
        return [candidates[b][0] for b in np.argsort(-np.min(ratios, axis=1), kind="stable").tolist()]

    def _key(self, samples: IntArray) -> tuple[tuple[int, int], ...]:
        """Return a key shared by tuples (k,) that differ only in the order of identical contacts."""
        return tuple(sorted(zip(self.tables.of_contact, samples.tolist(), strict=True)))

    def _powers_of(self, tuples: IntArray) -> FloatArray:
        """Return the power ``s^p`` of each contact's support s in tuples (b, k) along all directions, (j, b, k)."""
        contacts = zip(self.tables.of_contact, tuples.T, strict=True)
        return np.stack([self.powers[table][:, samples] for table, samples in contacts], axis=2)

    def _promising_samples(
        self,
        samples: IntArray,
        violation: float,
        tuple_powers: FloatArray,
        i: int,
        tie: float,
        within: IntArray | None = None,
    ) -> tuple[IntArray, FloatArray, FloatArray]:
        """Return a shortlist of samples for contact i of a tuple, with the score and violation of each.

        The current sample is the last. Violations are those of coupled constraints. Samples that violate none, if there
        are any, fill the shortlist.

        Parameters
        ----------
        samples : (k,) array of int
            The tuple.
        violation : float
            Its own.
        tuple_powers : (j, k) array
            Powers of the supports of the tuple's samples.
        i : int
            Contact.
        tie : float
            Weight of the mean along weak directions.
        within : array of int, optional
            Samples that the contact may be at; by default all.
        """
        powers = self.powers[self.tables.of_contact[i]]
        others = self.tables.combine.reduce(np.delete(tuple_powers, i, axis=1), axis=1, initial=0.0)
        weak = np.argpartition(others, WEAK)[:WEAK] if len(others) > WEAK else np.arange(len(others))
        trial_powers = powers[weak] if within is None else powers[np.ix_(weak, within)]
        supports = self.tables.combine(others[weak, None], trial_powers)
        score = np.min(supports, axis=0) + np.full(len(weak), tie / len(weak), dtype=np.float32) @ supports
        if self.tables.coupled:
            shortlist, excess = self._feasible_shortlist(samples, i, score, within)
        else:
            shortlist, excess = _largest(score, SHORTLISTED), np.zeros(min(SHORTLISTED, len(score)))
        shortlist = np.append(shortlist if within is None else within[shortlist], samples[i])
        supports = self.tables.combine(others[:, None], powers[:, shortlist])
        return shortlist, np.min(supports, axis=0) + tie * np.mean(supports[weak], axis=0), np.append(excess, violation)

    def _feasible_shortlist(
        self, samples: IntArray, i: int, score: FloatArray, within: IntArray | None
    ) -> tuple[IntArray, FloatArray]:
        """Return a shortlist of samples for contact i of a tuple (k,) under coupled constraints, with violations.

        Its samples are the best, by their score (m,), that violate no constraint; otherwise those that violate least.
        """
        for checked in CHECKED:
            shortlist = np.concatenate([_largest(score, checked), self.rng.integers(len(score), size=SHORTLISTED)])
            trials = np.repeat(samples[None], len(shortlist), axis=0)
            trials[:, i] = shortlist if within is None else within[shortlist]
            excess = self.violations(trials)
            if np.sum(excess <= REPAIRABLE) >= SHORTLISTED:
                break
        kept = _largest(_merit(score[shortlist], excess), SHORTLISTED)
        return shortlist[kept], excess[kept]


def _merit(quality: FloatArray, violation: FloatArray) -> FloatArray:
    """Return the merits (m,) that rank candidates: their quality, or ``-1 - violation`` if not repairable."""
    return np.where(violation <= REPAIRABLE, quality, -1.0 - violation)


def _largest(values: FloatArray, count: int) -> IntArray:
    """Return the indices of the ``count`` largest values, unsorted; of all values if there are fewer."""
    if len(values) <= count:
        return np.arange(len(values))
    return np.asarray(np.argpartition(values, -count)[-count:])


def exchange_nearby(
    compiled: CompiledProblem, contacts: FloatArray, directions: FloatArray, rng: np.random.Generator
) -> tuple[CoordinateExchange, IntArray]:
    """Return a coordinate exchange over dense mesh samples near given contacts, and its best tuples (b, k).

    Parameters
    ----------
    compiled : CompiledProblem
        Problem with a mesh, whose hand, if any, follows its contacts.
    contacts : (b, k, 3) array
        Metres, on the mesh.
    directions : (m, d) array
        Directions along which tuples are compared at first, each with ``phi_A = 1``.
    rng : numpy.random.Generator
    """
    dense, of_contact = compiled.surface.mesh_cloud, np.array(compiled.sample_tables.of_contact)
    clouds = {
        table: _nearby_samples(compiled, dense, contacts[:, of_contact == table].reshape(-1, 3))
        for table in set(of_contact.tolist())
    }
    tables = SampleTables(
        compiled.problem,
        [clouds[table] for table in of_contact.tolist()],
        compiled.rows,
        compiled.hand_functions,
        directions,
        DENSE_SAMPLES,
    )
    search = CoordinateExchange(compiled, tables, rng, len(contacts))
    initial = tables.nearest(list(contacts))
    best = search.update_population(initial, search.exchange(initial, LAST_TIE))
    return search, search.update_population(best, search.exchange(best, LAST_TIE), certified=LAST_CERTIFIED)


def _nearby_samples(compiled: CompiledProblem, dense: SampleCloud, contacts: FloatArray) -> SampleCloud:
    """Return contacts (n, 3) on a mesh together with the dense samples of the mesh near them."""
    points, outward, _ = compiled.surface.mesh.closest(contacts)
    neighbours = dense.tree.query_ball_point(contacts, NEIGHBOURHOOD * compiled.scaling.length)
    nearby = np.unique(np.concatenate([*neighbours, []]).astype(np.intp))
    points = np.concatenate([points, dense.points[nearby]])
    normals = np.concatenate([-outward, dense.normals[nearby]])
    return SampleCloud(np.full(len(points), dense.faces[0], dtype=object), points, normals, cKDTree(points))


def drop_congruent(
    compiled: CompiledProblem, candidates: Sequence[GraspCandidate], count: int = PROPOSED
) -> list[GraspCandidate]:
    """Return the first ``count`` candidates that are not congruent to an earlier one.

    They are compared by the distances between contacts, and from the torque origin.
    """
    chosen = select_incongruent(compiled, np.stack([candidate.points for candidate in candidates]))
    return [candidates[b] for b in chosen[:count]]


def select_incongruent(compiled: CompiledProblem, points: FloatArray) -> list[int]:
    """Return the indices of placements (b, k, space) that are not congruent to an earlier one."""
    points = points - compiled.problem.origin
    across = np.linalg.norm(points[:, :, None] - points[:, None], axis=3).reshape(len(points), -1)
    shapes = np.concatenate([np.sort(across, axis=1), np.sort(np.linalg.norm(points, axis=2), axis=1)], axis=1)
    chosen: list[int] = []
    for b, shape in enumerate(shapes):
        differences = np.max(np.abs(shapes[chosen] - shape), axis=1, initial=0.0)
        if not np.any(differences < CONGRUENT * compiled.scaling.length):
            chosen.append(b)
    return chosen


def sampled_quality(compiled: CompiledProblem, points: FloatArray, normals: FloatArray) -> FloatArray:
    """Return a quality score of placements (b, k, space) over evenly spread directions, (b,), solver units."""
    stack = GraspStack(points, normals, compiled.problem.models, compiled.problem.origin)
    ratios = sampled_ratios(stack, compiled.problem.task, screening_directions(compiled), compiled.screening_budget)
    return screening_score(ratios) * compiled.scaling.beta


def screening_directions(compiled: CompiledProblem) -> FloatArray:
    """Return directions spread evenly over wrench space in the solver's units, (m, d)."""
    return directions(compiled.problem.dimension, 2) * compiled.scaling.wrench


@dataclass(frozen=True)
class ContactPlacements:
    """Batch of placements: positions, normals and faces of all contacts.

    Parameters
    ----------
    points, normals : (b, k, space) array
        Metres; inward unit normals.
    faces : (b, k) array of str
    """

    points: FloatArray
    normals: FloatArray
    faces: NDArray[np.object_]


def draw_contacts(compiled: CompiledProblem, count: int, rng: np.random.Generator) -> ContactPlacements:
    """Return ``count`` random placements, with each contact at a surface sample that it may use."""
    clouds = [compiled.surface.cloud(i) for i in range(len(compiled.problem.models))]
    drawn = [(cloud, rng.integers(len(cloud.points), size=count)) for cloud in clouds]
    return ContactPlacements(
        np.stack([cloud.points[indices] for cloud, indices in drawn], axis=1),
        np.stack([cloud.normals[indices] for cloud, indices in drawn], axis=1),
        np.stack([cloud.faces[indices] for cloud, indices in drawn], axis=1),
    )


def _repair(compiled: CompiledProblem, candidate: GraspCandidate) -> tuple[GraspCandidate, FloatArray] | None:
    """Return a candidate projected onto constraints that it violates slightly, and its inward normals (k, space).

    None where the projection is not feasible.
    """
    on_faces, repaired = fix_to_triangles(compiled, candidate)
    if on_faces.violation(repaired) > FEASIBLE:
        moved, residual = project_onto_constraints(on_faces, repaired)
        repaired = on_faces.projected_onto_faces(moved)
        if residual > TOUCHING or on_faces.violation(repaired) > FEASIBLE:
            return None
    return GraspCandidate(candidate.faces, repaired.points, repaired.hand), on_faces.inward_normals(repaired)
