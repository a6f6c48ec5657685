"""A look over all placements before the starts: how good any can be, and which are worth a start."""

from __future__ import annotations

import json
import time
from collections import OrderedDict
from dataclasses import replace

import numpy as np

from nlpgrasp.best.incumbent import ROUGH, Met
from nlpgrasp.best.pool.tree import PoolTree
from nlpgrasp.best.scope.scope import scope_of
from nlpgrasp.best.search import Search
from nlpgrasp.bodies import Box, Mesh, Prism, Superquadric
from nlpgrasp.budgets import L2Budget
from nlpgrasp.common.stopping.stop import Stop
from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.errors import InputError
from nlpgrasp.problem.problem import GraspProblem
from nlpgrasp.solution.measures.global_bound import GlobalBound
from nlpgrasp.solve.options import SolveOptions
from nlpgrasp.solve.workbench.placed import Placed
from nlpgrasp.solve.workbench.programs import follows_contacts

NODES, OF_FLAT = 400, 1000  # of the tree: one to four seconds; where faces are flat a node takes less
ONE, ONE_OF_FLAT, EACH = 0.3, 0.65, 0.35  # share of these nodes for one start, and for each other one
OF_MESH = 160  # of a mesh, where starts begin elsewhere
BESIDE_A_HAND = 100  # where starts begin elsewhere
GAP = 0.01  # that the tree aims at where none is asked for
LOOSE = 0.2  # width of a survey's certificates: they find grasps that hold in fewer directions than it seemed
SHARE = 0.7  # of a gap asked for that the tree closes; the rest is the answer's own certificate
APART = 0.05  # of the body's size: grasps nearer than that, contact by contact, are the same
AS_CLOSE = 0.1  # relative: how far the bound of a whole mesh may be above that of its parts
AS_GOOD = 0.01  # relative: by how much the values of a grasp and its image may differ
TIME = 0.2  # of what is left until a deadline: a look takes no more of it
KEPT = 8  # problems whose outlook is remembered


class Outlook:
    """The search of all placements of a problem.

    Parameters
    ----------
    problem : GraspProblem
    gap : float
        Relative, at which to stop.
    surveys : bool
        Whether a look is a short one, for starts to begin from: in large steps, with loose certificates.

    Raises
    ------
    InputError
        On a problem that the bound does not cover.
    """

    def __init__(self, problem: GraspProblem, gap: float, surveys: bool = False) -> None:
        self._search = Search(scope_of(problem), gap, LOOSE if surveys else ROUGH)
        self._surveys = surveys
        self._size = problem.body.size
        self._placements: dict[int, Placed] = {}
        self._certified: tuple[int, float, Json] | None = None
        self._at_first: tuple[float, Json] | None = None  # what a look at a mesh begins with

    def look(self, nodes: int, stop: Stop) -> None:
        """Search until the tree has some nodes more, its gap is closed, or a stop."""
        tree = self._search.tree
        last = tree.nodes + nodes
        if self._surveys:
            self._search.survey(last, stop.requested)
        else:
            self._search.run(lambda: tree.nodes >= last or stop.requested())

    def glance(self, nodes: int = 0) -> None:
        """Bound all placements once, and closer until the tree has some nodes, and look for no grasps."""
        if isinstance(self._search.tree, PoolTree):
            self._search.begin()
            self._at_first = self._search.certificate()
        self._search.tighten(nodes)

    def expect(self, mu: float) -> None:
        """Compare bounds with a grasp found elsewhere, of this certified quality, where it is better."""
        self._search.best.expect(mu)

    @property
    def upper(self) -> float:
        """The bound on mu over all placements, so far."""
        return self._search.upper

    @property
    def complete(self) -> bool:
        """Whether it looks at the whole problem: nothing was left out but a mesh's margin, which starts keep."""
        return self._search.scope.complete

    @property
    def searched(self) -> bool:
        """Whether there is nothing left to look at."""
        return self._search.searched

    def placements(self, count: int, least: float = 0.0) -> list[Placed]:
        """Return up to ``count`` grasps that the search met, best first and apart from each other.

        Those that seem to be images of better ones, or these with contacts changed about, come after all others.

        Parameters
        ----------
        count : int
        least : float
            What their mu has to exceed, as far as it seems.
        """
        met, apart = self._search.best.met, APART * self._size
        new: list[int] = []
        again: list[int] = []
        for i in sorted(range(len(met)), key=lambda j: -met[j].value):
            near = (np.max(np.linalg.norm(met[i].points - met[j].points, axis=1)) for j in new + again)
            if met[i].value > least and min(near, default=np.inf) >= apart:
                (again if any(_alike(met[i], met[j], apart) for j in new) else new).append(i)
        chosen = (new + again)[:count]
        return [self._placements.setdefault(i, Placed(met[i].faces, met[i].points)) for i in chosen]

    def bound(self) -> GlobalBound:
        """Return what holds of all placements so far, with its certificate.

        The certificate of a mesh whose cells were cut holds the order of all its triangles: where that brings the bound
        hardly any closer, it is the one of the whole mesh.
        """
        nodes = self._search.tree.nodes
        if self._certified is None or self._certified[0] != nodes:
            self._certified = nodes, *self._search.certificate()
        _, upper, proof = self._certified
        if self._at_first is not None and self._at_first[0] <= upper * (1.0 + AS_CLOSE):
            upper, proof = self._at_first
            return GlobalBound(upper, 1, self._search.scope.dropped, {"asked": self._search.gap, **proof})
        certificate = {"asked": self._search.gap, **proof}
        return GlobalBound(max(upper, self.upper), nodes, self._search.scope.dropped, certificate)


def _alike(one: Met, other: Met, apart: float) -> bool:
    """Return whether two grasps are as good and their contacts as far from each other."""
    as_good = abs(one.value - other.value) <= AS_GOOD * max(one.value, other.value)
    return as_good and bool(np.all(np.abs(_distances(one.points) - _distances(other.points)) <= apart))


def _distances(points: FloatArray) -> FloatArray:
    """Return the distances between each two of the points, sorted."""
    return np.asarray(np.sort(np.linalg.norm(points[:, None] - points[None], axis=2), axis=None))


_remembered: OrderedDict[str, Outlook] = OrderedDict()


def outlook(problem: GraspProblem, options: SolveOptions, stop: Stop, starts: int) -> Outlook | None:
    """Return a short look over all placements of a problem, None where the bound does not cover it or is not wanted.

    Of a mesh and beside a hand with a pose, whose starts begin elsewhere, that is the bound alone, unless a gap is
    asked for. It depends on the problem alone. The latest few are remembered, as an experiment solves a problem with
    many seeds; where a gap is asked for the look is a new one, for the search goes on from it.
    """
    if not _wanted(problem, options):
        return None
    flat = isinstance(problem.body, Box | Prism)
    share = min(1.0, (ONE_OF_FLAT if flat else ONE) + EACH * (starts - 1))
    key = _key(problem, share)
    if options.gap is None and key in _remembered:
        _remembered.move_to_end(key)
        return _remembered[key]
    mesh = isinstance(problem.body, Mesh)
    found = unseen(problem, options, options.gap is None)
    if found is None:
        return None
    if options.gap is None and mesh:
        found.glance(int(share * OF_MESH) if follows_contacts(problem) else 0)
    elif options.gap is None and not follows_contacts(problem):
        found.glance(int(share * BESIDE_A_HAND) if flat or isinstance(problem.budget, L2Budget) else 0)
    else:
        found.look(int((OF_FLAT if flat else NODES) * (share if options.gap is None else 1.0)), _share_of(stop))
    if options.gap is None and stop.deadline is None and not stop.requested():
        _remembered[key] = found
        while len(_remembered) > KEPT:
            _remembered.popitem(last=False)
    return found


def _left(stop: Stop) -> float:
    """Return the seconds there are until a deadline."""
    return np.inf if stop.deadline is None else max(0.0, stop.deadline - time.monotonic())


def _share_of(stop: Stop) -> Stop:
    """Return the stop of a look: a part of the time that there is until a deadline."""
    return stop if stop.deadline is None else replace(stop, deadline=time.monotonic() + TIME * _left(stop))


def unseen(problem: GraspProblem, options: SolveOptions, surveys: bool = False) -> Outlook | None:
    """Return an outlook that has not looked yet, None where the bound does not cover the problem or is not wanted.

    It looks closely unless it ``surveys``.
    """
    if not _wanted(problem, options):
        return None
    try:
        gap = GAP if options.gap is None else SHARE * options.gap
        return Outlook(problem, gap, surveys)
    except InputError:
        return None


def why_not_bounded(problem: GraspProblem) -> str:
    """Return in words why there is no bound over all placements of a problem."""
    try:
        scope_of(problem)
    except InputError as error:
        return f"there is no bound over all placements of this problem ({error.field}: {error.given})"
    return "no bound over all placements was looked for"


def _wanted(problem: GraspProblem, options: SolveOptions) -> bool:
    """Return whether to look at all: a superquadric is bounded too, but loosely and in ten seconds."""
    return options.global_bound and not isinstance(problem.body, Superquadric)


def _key(problem: GraspProblem, share: float) -> str:
    """Return what tells a problem, and how long it is looked at, from others."""
    faces = [list(problem.allowed_faces(i)) for i in range(len(problem.models))]
    return json.dumps([problem.to_dict(), problem.origin.tolist(), faces, share], sort_keys=True)
