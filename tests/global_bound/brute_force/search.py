"""Brute-force search over placements: random draws, coordinate exchange and small random steps."""

from dataclasses import dataclass

import numpy as np

import nlpgrasp as ng
from tests.global_bound.brute_force.places import faces_of

POOL = 300  # allowed points of each contact
STARTS, SWEEPS, DIRECTIONS = 32, 3, 300  # numbers of the coordinate exchange
CHILDREN, ELSEWHERE = 14, 0.15  # children of a placement per round, and the fraction with a new random contact
WIDEST, NARROWEST = 0.12, 2e-3  # steps of the first and the last round, relative to the body's size
HALVED = 3  # trials of a step, each half as long


@dataclass
class Placements:
    """Placements: points and inward normals (b, k, space), and face numbers (b, k)."""

    points: np.ndarray
    normals: np.ndarray
    faces: np.ndarray

    def __getitem__(self, where):
        return Placements(self.points[where], self.normals[where], self.faces[where])

    def concatenate(self, others):
        pairs = zip(vars(self).values(), vars(others).values(), strict=True)
        return Placements(*(np.concatenate(pair) for pair in pairs))


class BruteForce:
    """Brute-force search over placements of a ``Case``.

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
    def is_possible(self):
        """Whether each contact has an allowed point."""
        return all(len(pool.points) for pool in self.pools)

    def _pool(self, contact):
        """Return allowed points of a contact, equally many on each face."""
        faces = [j for j, (name, _) in enumerate(self.faces) if name in self.case.usable(contact)]
        count = -(-2 * POOL // max(1, len(faces)))
        points = [self.faces[j][1].draw(count, self.rng) for j in faces]
        normals = [self.faces[j][1].inward(p) for j, p in zip(faces, points, strict=True)]
        numbers = np.repeat(faces, count).astype(int)
        space = self.problem.body.space
        placements = Placements(
            np.concatenate([np.zeros((0, space)), *points]), np.concatenate([np.zeros((0, space)), *normals]), numbers
        )
        allowed = np.flatnonzero(self.case.allowed(contact, placements.points))
        return placements[self.rng.permutation(allowed)[:POOL]]

    def draw(self, count):
        """Return random placements."""
        contacts = [pool[self.rng.integers(len(pool.points), size=count)] for pool in self.pools]
        return Placements(
            *(np.stack([getattr(c, n) for c in contacts], axis=1) for n in ("points", "normals", "faces"))
        )

    def values(self, placements):
        """Return estimates of mu of placements by screening."""
        stack = ng.GraspStack(placements.points, placements.normals, self.problem.models, self.problem.origin)
        return ng.screen(stack, self.problem.task, force_budget=self.problem.budget)

    def perturb(self, placements, width):
        """Return placements after random steps of all contacts or one along the faces, some with a new contact."""
        new = Placements(*(v.copy() for v in vars(placements).values()))
        b = len(new.points)
        moves_one = self.rng.random(b) < 0.5
        contact = self.rng.integers(self.count, size=b)
        jumps = self.rng.random(b) < ELSEWHERE
        for i in range(self.count):
            is_moved = ~moves_one | (contact == i)
            step = width * self.problem.body.size * self.rng.standard_normal(placements.points[:, i].shape)
            jumps_here = jumps & (contact == i)
            if self.problem.body.kind == "mesh":
                self._along_mesh(new, i, is_moved & ~jumps_here, step)
            else:
                self._along_faces(new, i, is_moved & ~jumps_here, step)
            indices = self.rng.integers(len(self.pools[i].points), size=int(np.sum(jumps_here)))
            for name in ("points", "normals", "faces"):
                getattr(new, name)[jumps_here, i] = getattr(self.pools[i], name)[indices]
        return new

    def _along_faces(self, new, i, is_moved, step):
        for number in np.unique(new.faces[is_moved, i]):
            indices = np.flatnonzero(is_moved & (new.faces[:, i] == number))
            face, old = self.faces[number][1], new.points[indices, i]
            result, unfinished = old.copy(), np.ones(len(indices), dtype=bool)
            for halving in range(HALVED):
                candidates = face.nearest(old + step[indices] * 0.5**halving)
                accepted = unfinished & self.case.allowed(i, candidates)
                result[accepted], unfinished = candidates[accepted], unfinished & ~accepted
            new.points[indices, i], new.normals[indices, i] = result, face.inward(result)

    def _along_mesh(self, new, i, is_moved, step):
        """Move contacts to points of the pool near the ends of their steps."""
        indices, pool = np.flatnonzero(is_moved), self.pools[i]
        if not len(indices):
            return
        distances = np.linalg.norm(pool.points[None] - (new.points[indices, i] + step[indices])[:, None], axis=2)
        distances *= self.rng.uniform(0.5, 1.0, distances.shape)
        nearest = np.argmin(distances, axis=1)
        for name in ("points", "normals", "faces"):
            getattr(new, name)[indices, i] = getattr(pool, name)[nearest]

    def exchange(self):
        """Return random placements after coordinate exchange: each contact in turn to the best of its points.

        The criterion is the least support along random directions, combined by the force budget.
        """
        twists = self._directions()
        tables = [self._supports(i, twists) for i in range(self.count)]
        combine, zero = (np.maximum, 0.0) if self.problem.budget.kind == "shared" else (np.add, 0.0)
        chosen = np.stack([self.rng.integers(len(t), size=STARTS) for t in tables], axis=1)
        for i in [*range(self.count)] * SWEEPS:
            rest = np.full((STARTS, twists.shape[0]), zero)
            for j in range(self.count):
                rest = rest if j == i else combine(rest, tables[j][chosen[:, j]])
            chosen[:, i] = [np.argmax(np.min(combine(tables[i], row), axis=1)) for row in rest]
        contacts = [pool[chosen[:, i]] for i, pool in enumerate(self.pools)]
        return Placements(
            *(np.stack([getattr(c, n) for c in contacts], axis=1) for n in ("points", "normals", "faces"))
        )

    def _directions(self):
        """Return random directions of unit work of the task."""
        task, space = self.problem.task, self.problem.body.space
        d = task.dimension
        moment = task.second_moment()
        unit_moment = np.diag([1.0] * space + [self.problem.body.size**2] * (d - space))
        moment = moment + 0.05 * np.mean(np.diag(moment) / np.diag(unit_moment)) * unit_moment
        y = self.rng.standard_normal((2 * DIRECTIONS, d)) @ np.linalg.inv(np.linalg.cholesky(moment))
        reach = task.support(y)[0]
        usable = np.flatnonzero(reach > 1e-9 * np.max(reach))[:DIRECTIONS]
        return y[usable] / reach[usable, None]

    def _supports(self, contact, twists):
        """Return the support of a contact at each of its points, squared under the L2 budget, (points, m)."""
        pool, model, budget = self.pools[contact], self.problem.models[contact], self.problem.budget.kind
        stack = ng.GraspStack(pool.points[:, None], pool.normals[:, None], [model], self.problem.origin)
        z = twists @ stack.G
        if budget in ("l2", "per_finger_size"):
            size = np.linalg.norm(model.project(z.reshape(-1, z.shape[2])), axis=1).reshape(z.shape[:2])
            return size**2 if budget == "l2" else size
        return np.maximum(model.extreme(z)[0], 0.0)

    def best(self, count=6, rounds=9):
        """Return the best placements found and their estimates of mu, best first."""
        placements = self.exchange().concatenate(self.draw(100))
        values = self.values(placements)
        order_best = np.argsort(-values, kind="stable")[:count]
        placements, values = placements[order_best], values[order_best]
        for i in range(rounds):
            parents = np.repeat(np.arange(len(values)), CHILDREN)
            new = self.perturb(placements[parents], WIDEST * (NARROWEST / WIDEST) ** (i / max(1, rounds - 1)))
            new_values = self.values(new)
            for parent in range(len(values)):
                children = np.flatnonzero(parents == parent)
                child = children[np.argmax(new_values[children])]
                if new_values[child] > values[parent]:
                    values[parent] = new_values[child]
                    for name in ("points", "normals", "faces"):
                        getattr(placements, name)[parent] = getattr(new, name)[child]
            if i == 1:
                best_half = np.argsort(-values, kind="stable")[: max(2, count // 2)]
                placements, values = placements[best_half], values[best_half]
        order = np.argsort(-values, kind="stable")
        return placements[order], values[order]

    def certified(self, checked=2, rtol=0.005, **effort):
        """Return the largest certified lower bound on mu of the best placements, and its grasp or None."""
        placements, values = self.best(**effort)
        best, grasp = 0.0, None
        for i in range(min(checked, len(values))):
            if values[i] > best:
                candidate = ng.Grasp(
                    placements.points[i], placements.normals[i], self.problem.models, self.problem.origin
                )
                lower = ng.mu(candidate, self.problem.task, rtol, force_budget=self.problem.budget).lower
                best, grasp = (lower, candidate) if lower > best else (best, grasp)
        return best, grasp
