"""Search over tuples of samples of fingers in the plane, by mu itself.

In the plane mu is nearly known for thousands of grasps at once (``screen``), and exactly whether it is 0, so that
candidates are judged by what they hold. Two fingers are two numbers: all pairs of some samples are compared. More
fingers are placed one at a time. Where few placements hold the task at all, that finds them: directions shared by all
tuples, as of coordinate exchange, promise much at those that do not.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from nlpgrasp.common.validation import FloatArray, IntArray
from nlpgrasp.optimize.surface_samples import SampleTables, best_of_trials
from nlpgrasp.problem.problem import GraspProblem
from nlpgrasp.quality.screening import fixed_force_set, planar_ratios


class PlanarSearch:
    """Search for tuples of samples (b, k) with the largest mu.

    Parameters
    ----------
    problem : GraspProblem
        Planar.
    tables : SampleTables
    merit : callable
        Returns the merits of tuples with some quality: less than -1 where constraints on several contacts are broken.
    distinct : callable
        Returns the indices of placements (b, k, 2) that are not like an earlier one.
    rng : numpy.random.Generator
    pairs : int
        Pairs of samples of two fingers that are compared.
    """

    def __init__(
        self,
        problem: GraspProblem,
        tables: SampleTables,
        merit: Callable[[FloatArray, IntArray], FloatArray],
        distinct: Callable[[FloatArray], list[int]],
        rng: np.random.Generator,
        pairs: int = 6400,
    ) -> None:
        self._problem, self._tables, self._merit, self._distinct, self._rng = problem, tables, merit, distinct, rng
        self._sizes = [len(tables.samples(i).points) for i in range(len(problem.models))]
        spread = [np.linspace(0, size - 1, min(size, int(np.sqrt(pairs)))).astype(int) for size in self._sizes]
        # samples of a contact in the order of the faces, some of all
        self._spread = [np.lexsort(tables.samples(i).points.T)[some] for i, some in enumerate(spread)]

    def values(self, tuples: IntArray, promising: float = 0.0) -> FloatArray:
        """Return about mu of tuples (b, k), (b,), less than 0 where they cannot exert the task.

        There the value is minus the share of the task that is out of reach; up to a ``promising`` share it is what mu
        would be with it. It is less than -1 where constraints on several contacts are broken.
        """
        stack = self._tables.grasps(tuples)
        mu, lack = planar_ratios(stack, self._problem.task, fixed_force_set(stack, self._tables.budget))
        return self._merit(np.where(lack > promising, -np.minimum(lack, 0.99), mu), tuples)

    def share_that_holds(self, drawn: int = 400) -> float:
        """Return the share of random tuples that exert the task."""
        tuples = self._tables.random(drawn, np.random.default_rng(0))
        return float(np.mean(self.values(tuples) > 0.0))

    def best(
        self,
        known: IntArray,
        kept: int = 24,
        drawn: int = 3000,
        widths: Sequence[int] = (400, 150, 60, 25, 10),
        trials: int = 60,
    ) -> IntArray:
        """Return the best tuples found, best first, those they were improved from and known ones (m, k) among them.

        Parameters
        ----------
        known : (m, k) int array
        kept : int
            Tuples that are improved, and as many that nearly exert the task.
        drawn : int
            Random tuples of three fingers or more.
        widths : sequence of int
            Numbers of samples around a contact among which it moves, the others with it, from one round to the next.
        trials : int
            Moves of each tuple in a round.
        """
        k = len(self._sizes)
        if k == 2:
            first = np.stack(np.meshgrid(*self._spread, indexing="ij"), axis=2).reshape(-1, 2)
        else:
            first = self._tables.random(drawn, self._rng)
        first = np.concatenate([known, first])
        tuples = begun = np.concatenate([self._ranked(first, kept, promising) for promising in (0.0, 0.1)])
        if k > 2:
            for i, spread in enumerate(self._spread):
                placed = np.repeat(tuples[:, None], len(spread), axis=1)
                placed[:, :, i] = spread
                tuples = best_of_trials(tuples, placed, self.values)
        for width in widths:
            tuples = best_of_trials(tuples, self._tables.around(tuples, width, trials, self._rng), self.values)
        return self._sorted(np.concatenate([tuples, begun, known]))

    def _ranked(self, tuples: IntArray, kept: int, promising: float, looked_at: int = 500) -> IntArray:
        """Return the best of tuples (b, k) by ``values`` that are not alike, best first."""
        tuples = self._sorted(tuples, promising)[:looked_at]
        return tuples[self._distinct(self._tables.contacts_of(tuples)[0])[:kept]]

    def _sorted(self, tuples: IntArray, promising: float = 0.0) -> IntArray:
        """Return tuples (b, k) by ``values``, each once, best first."""
        tuples = np.unique(tuples, axis=0)
        return np.asarray(tuples[np.argsort(-self.values(tuples, promising), kind="stable")])
