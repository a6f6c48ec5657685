"""The best of many random placements after exchanges and small random moves: no bound may be below their mu."""

from dataclasses import dataclass

import numpy as np

import nlpgrasp as ng
from tests.global_bound.brute_force.places import faces_of

POOL = 300  # allowed places of each contact
STARTS, SWEEPS, DIRECTIONS = 32, 3, 300  # of the exchange of contacts between their places
CHILDREN, ELSEWHERE = 14, 0.15  # of each placement in a round; share of them with a contact anywhere else
WIDEST, NARROWEST = 0.12, 2e-3  # moves of the first and the last round, relative to the body's size
HALVED = 3  # times a move that leaves what is allowed is tried shorter


@dataclass
class Placements:
    """Points and inward normals (b, k, space), and the number of each contact's face."""

    points: np.ndarray
    normals: np.ndarray
    faces: np.ndarray

    def __getitem__(self, where):
        return Placements(self.points[where], self.normals[where], self.faces[where])

    def with_(self, others):
        pairs = zip(vars(self).values(), vars(others).values(), strict=True)
        return Placements(*(np.concatenate(pair) for pair in pairs))


class BruteForce:
    """Random placements of a case (``tests.global_bound.brute_force.cases``) and the best of them.

    Parameters
    ----------
    case : Case
    rng : numpy.random.Generator
    """

    def __init__(self, case, rng):
        self.case, self.rng = case, rng
        self.problem, self.count = case.problem, len(case.problem.models)
        self.faces = faces_of(case.problem.body)
        self.pools = [self._pool(i) for i in range(self.count)]

    @property
    def possible(self):
        """Whether each contact has a place."""
        return all(len(pool.points) for pool in self.pools)

    def _pool(self, contact):
        """Return places that a contact may be in, as many on each face."""
        usable = [j for j, (name, _) in enumerate(self.faces) if name in self.case.usable(contact)]
        each = -(-2 * POOL // max(1, len(usable)))
        points = [self.faces[j][1].drawn(each, self.rng) for j in usable]
        normals = [self.faces[j][1].inward(p) for j, p in zip(usable, points, strict=True)]
        numbers = np.repeat(usable, each).astype(int)
        space = self.problem.body.space
        every = Placements(
            np.concatenate([np.zeros((0, space)), *points]), np.concatenate([np.zeros((0, space)), *normals]), numbers
        )
        kept = np.flatnonzero(self.case.allowed(contact, every.points))
        return every[self.rng.permutation(kept)[:POOL]]

    def drawn(self, count):
        """Return random placements."""
        chosen = [pool[self.rng.integers(len(pool.points), size=count)] for pool in self.pools]
        return Placements(*(np.stack([getattr(c, n) for c in chosen], axis=1) for n in ("points", "normals", "faces")))

    def values(self, placements):
        """Return what screening says of placements, about their mu."""
        stack = ng.GraspStack(placements.points, placements.normals, self.problem.models, self.problem.origin)
        return ng.screen(stack, self.problem.task, force_budget=self.problem.budget)

    def moved(self, old, width):
        """Return placements with each contact, or one, a random step away along its face, and some elsewhere."""
        new = Placements(*(v.copy() for v in vars(old).values()))
        b = len(new.points)
        one = self.rng.random(b) < 0.5
        only = self.rng.integers(self.count, size=b)
        jumps = self.rng.random(b) < ELSEWHERE
        for i in range(self.count):
            here = ~one | (only == i)
            step = width * self.problem.body.size * self.rng.standard_normal(old.points[:, i].shape)
            away = jumps & (only == i)
            if self.problem.body.kind == "mesh":
                self._along_mesh(new, i, here & ~away, step)
            else:
                self._along_faces(new, i, here & ~away, step)
            where = self.rng.integers(len(self.pools[i].points), size=int(np.sum(away)))
            for name in ("points", "normals", "faces"):
                getattr(new, name)[away, i] = getattr(self.pools[i], name)[where]
        return new

    def _along_faces(self, new, i, here, step):
        for number in np.unique(new.faces[here, i]):
            own = np.flatnonzero(here & (new.faces[:, i] == number))
            face, old = self.faces[number][1], new.points[own, i]
            result, left = old.copy(), np.ones(len(own), dtype=bool)
            for halved in range(HALVED):
                tried = face.nearest(old + step[own] * 0.5**halved)
                good = left & self.case.allowed(i, tried)
                result[good], left = tried[good], left & ~good
            new.points[own, i], new.normals[own, i] = result, face.inward(result)

    def _along_mesh(self, new, i, here, step):
        """To the place of the pool that is nearest to where the step ends."""
        own, pool = np.flatnonzero(here), self.pools[i]
        if not len(own):
            return
        apart = np.linalg.norm(pool.points[None] - (new.points[own, i] + step[own])[:, None], axis=2)
        apart *= self.rng.uniform(0.5, 1.0, apart.shape)
        where = np.argmin(apart, axis=1)
        for name in ("points", "normals", "faces"):
            getattr(new, name)[own, i] = getattr(pool, name)[where]

    def exchanged(self):
        """Return random placements after exchanges: each contact in turn to the best of all its places.

        The best along random directions: of every pair of contacts' places the supports are added as the budget does.
        """
        twists = self._directions()
        tables = [self._supports(i, twists) for i in range(self.count)]
        add, none = (np.maximum, 0.0) if self.problem.budget.kind == "shared" else (np.add, 0.0)
        chosen = np.stack([self.rng.integers(len(t), size=STARTS) for t in tables], axis=1)
        for i in [*range(self.count)] * SWEEPS:
            rest = np.full((STARTS, twists.shape[0]), none)
            for j in range(self.count):
                rest = rest if j == i else add(rest, tables[j][chosen[:, j]])
            chosen[:, i] = [np.argmax(np.min(add(tables[i], own), axis=1)) for own in rest]
        picked = [pool[chosen[:, i]] for i, pool in enumerate(self.pools)]
        return Placements(*(np.stack([getattr(c, n) for c in picked], axis=1) for n in ("points", "normals", "faces")))

    def _directions(self):
        """Return random directions along which the task does unit work."""
        task, space = self.problem.task, self.problem.body.space
        d = task.dimension
        moment = task.second_moment()
        own = np.diag([1.0] * space + [self.problem.body.size**2] * (d - space))
        moment = moment + 0.05 * np.mean(np.diag(moment) / np.diag(own)) * own
        y = self.rng.standard_normal((2 * DIRECTIONS, d)) @ np.linalg.inv(np.linalg.cholesky(moment))
        reach = task.support(y)[0]
        good = np.flatnonzero(reach > 1e-9 * np.max(reach))[:DIRECTIONS]
        return y[good] / reach[good, None]

    def _supports(self, contact, twists):
        """Return the support of one contact in each of its places, squared under the L2 budget, (places, m)."""
        pool, model, budget = self.pools[contact], self.problem.models[contact], self.problem.budget.kind
        stack = ng.GraspStack(pool.points[:, None], pool.normals[:, None], [model], self.problem.origin)
        z = twists @ stack.G
        if budget in ("l2", "per_finger_size"):
            size = np.linalg.norm(model.project(z.reshape(-1, z.shape[2])), axis=1).reshape(z.shape[:2])
            return size**2 if budget == "l2" else size
        return np.maximum(model.extreme(z)[0], 0.0)

    def best(self, kept=6, rounds=9):
        """Return the best placements met and what screening says of them, best first."""
        every = self.exchanged().with_(self.drawn(100))
        values = self.values(every)
        top = np.argsort(-values, kind="stable")[:kept]
        every, values = every[top], values[top]
        for i in range(rounds):
            parents = np.repeat(np.arange(len(values)), CHILDREN)
            new = self.moved(every[parents], WIDEST * (NARROWEST / WIDEST) ** (i / max(1, rounds - 1)))
            found = self.values(new)
            for parent in range(len(values)):
                own = np.flatnonzero(parents == parent)
                child = own[np.argmax(found[own])]
                if found[child] > values[parent]:
                    values[parent] = found[child]
                    for name in ("points", "normals", "faces"):
                        getattr(every, name)[parent] = getattr(new, name)[child]
            if i == 1:
                few = np.argsort(-values, kind="stable")[: max(2, kept // 2)]
                every, values = every[few], values[few]
        order = np.argsort(-values, kind="stable")
        return every[order], values[order]

    def certified(self, checked=2, rtol=0.005, **effort):
        """Return the best certified lower bound on mu of the best placements, and that grasp or None."""
        every, values = self.best(**effort)
        best, grasp = 0.0, None
        for i in range(min(checked, len(values))):
            if values[i] > best:
                one = ng.Grasp(every.points[i], every.normals[i], self.problem.models, self.problem.origin)
                lower = ng.mu(one, self.problem.task, rtol, force_budget=self.problem.budget).lower
                best, grasp = (lower, one) if lower > best else (best, grasp)
        return best, grasp
