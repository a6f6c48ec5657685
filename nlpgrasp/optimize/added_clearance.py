"""Constraints on a hand's links beside the problem's own, where shapes penetrate that spheres do not cover."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.spatial.distance import cdist

from nlpgrasp.common.validation import FloatArray
from nlpgrasp.hands import URDFHand
from nlpgrasp.hands.base import Values
from nlpgrasp.hands.self_collision import LinkPair
from nlpgrasp.hands.urdf_hand import LinkConstraints
from nlpgrasp.optimize.candidate import GraspCandidate
from nlpgrasp.optimize.compiled_problem import CompiledProblem
from nlpgrasp.solution.obstructions import LinkPenetration

DEEP = 1e-4  # metres: penetration of a link in body or surroundings above which constraints are added
DEEP_TIP = 2.5e-4  # metres: that of a fingertip's own link, which touches the body
DEEP_IN_LINK = 5e-4  # metres: that of links in each other
BEYOND = 2e-4  # metres beyond the depth of a link in another


class AddedClearance:
    """Constraints that are added where a grasp's links penetrate something.

    Points of a link's surface, about where it is deepest, are kept outside the body and its surroundings; the spheres
    of two links that penetrate each other are kept farther apart. Against body and surroundings a shape counts as its
    convex hull, as it does in MuJoCo.

    Parameters
    ----------
    compiled : CompiledProblem
    constraints : LinkConstraints
        Constraints to begin with.

    Attributes
    ----------
    finer : CompiledProblem
        The problem compiled with all added constraints so far.
    """

    def __init__(self, compiled: CompiledProblem, constraints: LinkConstraints) -> None:
        self.compiled, self.finer = compiled, compiled.with_link_constraints(constraints)
        self._constraints = constraints

    def depth(self, candidate: GraspCandidate) -> float:
        """Return the depth of the deepest link of a candidate, metres; 0 where no constraint would be added."""
        return max((penetration.depth for penetration in self._penetrations(candidate)), default=0.0)

    def extend(self, candidate: GraspCandidate) -> bool:
        """Add constraints wherever a candidate's links penetrate; return whether any were added."""
        hulls, before = self.compiled.hull_depths, self._constraints
        for penetration in self._penetrations(candidate):
            if penetration.other_link:
                self._keep_apart(candidate.hand, penetration)
            elif hulls is not None:
                self._keep_outside(str(penetration.link), hulls.points_inside(candidate.hand, penetration))
        self.finer = self.compiled.with_link_constraints(self._constraints)
        return self._constraints is not before

    def _keep_outside(self, link: str, added: FloatArray) -> None:
        """Add points (m, 3) of a link's surface, link frame, metres."""
        if len(added):
            points = self._constraints.points
            points = {**points, link: np.concatenate([points.get(link, added[:0]), added])}
            self._constraints = replace(self._constraints, points=points)

    def _keep_apart(self, values: Values, penetration: LinkPenetration) -> None:
        """Require so much more distance between the spheres of two links as these penetrate each other.

        No two spheres may then be nearer than the nearest ones are now and that distance. Links without spheres stay.
        """
        hand, names = self.compiled.problem.hand, (str(penetration.link), penetration.other_link)
        if not isinstance(hand, URDFHand) or not all(
            name in hand.fits and len(hand.fits[name].radii) for name in names
        ):
            return
        poses = hand.tree.body_poses(values)
        centres = [hand.fits[name].centres @ poses[name][:3, :3].T + poses[name][:3, 3] for name in names]
        gaps = cdist(centres[0], centres[1]) - hand.fits[names[0]].radii[:, None] - hand.fits[names[1]].radii
        overlap = -float(np.min(gaps)) - penetration.depth - BEYOND
        near = {(int(i), int(j)) for i, j in np.argwhere(gaps < -overlap)}
        known = [pair for pair in self._constraints.pairs if pair.links == names]
        pairs = tuple(sorted(near.union(*(pair.pairs for pair in known))))
        kept = LinkPair(names, min([overlap, *(pair.overlap for pair in known)]), pairs)
        others = tuple(pair for pair in self._constraints.pairs if pair.links != names)
        self._constraints = replace(self._constraints, pairs=(*others, kept))

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
