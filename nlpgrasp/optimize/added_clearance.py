"""Constraints on a hand's links beside the problem's own, where shapes penetrate that spheres do not cover."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from nlpgrasp.common.validation import FloatArray
from nlpgrasp.optimize.candidate import GraspCandidate
from nlpgrasp.optimize.compiled_problem import CompiledProblem
from nlpgrasp.optimize.grasp_on_body import GraspOnBody
from nlpgrasp.solution.obstructions import LinkPenetration

DEEP = 1e-4  # metres: penetration of a link in body or surroundings above which constraints are added
DEEP_TIP = 2.5e-4  # metres: that of a fingertip's own link, which touches the body
DEEP_IN_LINK = 5e-4  # metres: that of links in each other
BEYOND = 2e-4  # metres beyond the depth of a link in another


class AddedClearance:
    """Constraints that are added where a grasp's links penetrate something.

    Points of a link's surface, about where it is deepest, are kept outside the body and its surroundings; of two links
    that penetrate each other, the nearest two spheres are kept farther apart. Against body and surroundings a shape
    counts as its convex hull, as it does in MuJoCo.

    Parameters
    ----------
    compiled : CompiledProblem
    points : mapping of str to (m, 3) array
        Surface points to begin with, by link, metres, link frame.

    Attributes
    ----------
    finer : CompiledProblem
        The problem compiled with all surface points so far.
    increase : (rows,) array
        Increase of the lower limits of the constraints of ``finer``, metres.
    """

    def __init__(self, compiled: CompiledProblem, points: Mapping[str, FloatArray]) -> None:
        self.compiled, self.finer = compiled, compiled.with_surface_points(points)
        self._points, self.increase = dict(points), np.zeros(len(self.finer.rows.named))

    def depth(self, candidate: GraspCandidate) -> float:
        """Return the depth of the deepest link of a candidate, metres; 0 where no constraint would be added."""
        return max((penetration.depth for penetration in self._penetrations(candidate)), default=0.0)

    def extend(self, on_body: GraspOnBody) -> bool:
        """Add constraints wherever a grasp's links penetrate; return whether any were added, and all links can be free.

        Two links in each other that no spheres keep apart stay so.
        """
        hulls, values, points = self.compiled.hull_depths, on_body.candidate.hand, dict(self._points)
        deep = self._penetrations(on_body.candidate)
        in_links = [penetration for penetration in deep if penetration.other_link]
        is_apart = [self._move_apart(on_body, penetration) for penetration in in_links]
        if any(not penetration.is_free for penetration, moved in zip(in_links, is_apart, strict=True) if not moved):
            return False  # nothing keeps these two links apart
        for penetration in deep:
            if not penetration.other_link and hulls is not None:
                link, added = str(penetration.link), hulls.points_inside(values, penetration)
                points |= {link: np.concatenate([points.get(link, added[:0]), added])} if len(added) else {}
        has_more = sum(map(len, points.values())) > sum(map(len, self._points.values()))
        if has_more:
            increase = self.increase[self.finer.rows.without_surface_points]
            self.finer, self._points = self.compiled.with_surface_points(points), points
            self.increase = np.zeros(len(self.finer.rows.named))
            self.increase[self.finer.rows.without_surface_points] = increase
        return has_more or any(is_apart)

    def _penetrations(self, candidate: GraspCandidate) -> list[LinkPenetration]:
        """Return the deep penetrations of the links' hulls in body and surroundings, and of links in each other."""
        links, hulls = self.compiled.link_depths, self.compiled.hull_depths
        if links is None or hulls is None:
            return []
        groups = hulls.hand.robot.rigid_groups
        with_tip = {groups[link] for link, _ in hulls.hand.tips}

        def is_deep(penetration: LinkPenetration) -> bool:
            if penetration.other_link:
                return penetration.depth > DEEP_IN_LINK
            return penetration.depth > (DEEP_TIP if groups[str(penetration.link)] in with_tip else DEEP)

        penetrations = hulls.in_surroundings(candidate.hand) + links.in_each_other(candidate.hand)
        return [penetration for penetration in penetrations if is_deep(penetration)]

    def _move_apart(self, on_body: GraspOnBody, penetration: LinkPenetration) -> bool:
        """Require more distance between the nearest spheres of two links; return whether a constraint does."""
        slack = self.finer.rows.link_slack(on_body.values, str(penetration.link), penetration.other_link)
        nearest = int(np.argmin(slack))
        if np.isinf(slack[nearest]):
            return False
        self.increase[nearest] = slack[nearest] + penetration.depth + BEYOND
        return True
