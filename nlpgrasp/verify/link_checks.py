"""Recomputation of a hand's link penetrations, in the grasp and on the approach, and of contacts off their links.

The depth of a link in a solid is the largest sum of a point's depths in both. It is searched from samples of the link's
surface by the simplex method of Nelder and Mead (1965, doi:10.1093/comjnl/7.4.308), with shapes, kinematics and
distances of this package, ``verify``, alone. For convex shapes in convex solids it is the shortest translation that
separates the two, where that is longer.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
from scipy.optimize import minimize

from nlpgrasp.common.meshes.search_tree import SearchTree
from nlpgrasp.common.validation import FloatArray, number
from nlpgrasp.errors import InputError
from nlpgrasp.solution.obstructions import (
    BODY,
    MOST_TOLERANCE,
    TOLERANCE,
    LinkPenetration,
    approach_penetration,
    grasp_penetration,
)
from nlpgrasp.solution.phase_record import APPROACH, GRASP, PREGRASP, Phase
from nlpgrasp.solution.records import Status
from nlpgrasp.solution.solution import GraspSolution
from nlpgrasp.verify.check import NO_BODY, Check, NotCheckedError, is_complete_version
from nlpgrasp.verify.convex_solids import NumericSolid, penetration_depth, solid_body, solids_around
from nlpgrasp.verify.link_shapes import LinkShape
from nlpgrasp.verify.numeric_urdf_hand import URDFNumbers, require_links
from nlpgrasp.verify.stated_placement import HandNumbers, NumericBody, StatedPlacement

SPACING = 2e-3  # metres between samples of a link's surface
MOST_SAMPLES = 4000  # most samples of a link
BEGINNINGS = 3  # deepest samples from which the search starts
ON = 1e-6  # metres: tolerance of a point on a solid's surface
SLACK, SHARE = 3e-4, 0.2  # metres and share: allowed difference of two measurements of one depth
STATION, MOST_STATIONS = 2e-3, 50  # metres of a link between samples of the approach; samples per leg


def link_checks(
    solution: GraspSolution, hand: HandNumbers | None, surface: NumericBody | None, placement: StatedPlacement
) -> list[Check]:
    """Return the checks of link penetrations, in the grasp and on the approach, and of contacts off their links.

    Parameters
    ----------
    solution : GraspSolution
    hand : HandNumbers or None
    surface : NumericBody or None
        The body; None if missing.
    placement : StatedPlacement
        Contacts, and the reader of obstacles.
    """
    if (solution.problem.get("hand") or {}).get("type") not in ("urdf",):
        return []
    try:
        return _checks(solution, _Solids.of(solution, hand, surface, placement), placement.points)
    except NotCheckedError as reason:
        return [Check.not_made("links inside something", str(reason))]


def _checks(solution: GraspSolution, solids: _Solids, points: FloatArray) -> list[Check]:
    """Return the checks for links with known shapes."""
    if not solids.shapes:
        stated = (solution.hand or {}).get("link_depth") is not None
        told = "the hand's links have no collision shapes: what they run into is not known"
        return [Check("links inside something", not stated, f"a depth is stated, and {told}" if stated else told)]
    if solids.states_all and "meshes" not in solids.hand.data:
        return [Check("links inside something", False, "the file states no sha256 of the meshes of the hand's links")]
    wrong, told = solids.in_grasp()
    checks = [Check("links inside something", not wrong, wrong or told)]
    if solution.phases:
        wrong, told = solids.on_approach()
        checks.append(Check("links on the way in", not wrong, wrong or told))
    elif solids.states_all:
        checks.append(Check("links on the way in", False, "the file states no phases of the hand"))
    wrong, told = solids.contacts_off_links(points)
    return [*checks, Check("contacts on their links", not wrong, wrong or told)]


class _Solids:
    """The links' shapes, the solids around them, and the file's statements about both."""

    def __init__(self, solution: GraspSolution, hand: URDFNumbers, things: Sequence[NumericSolid]) -> None:
        self.solution, self.hand, self.things = solution, hand, things
        self.shapes, self.contacts = hand.shapes, solution.require_grasp().points
        rng = np.random.default_rng(2)
        self.samples = {link: _link_samples(shapes, rng) for link, shapes in self.shapes.items()}
        self.trees = {
            link: [SearchTree(shape.vertices, shape.faces) for shape in shapes] for link, shapes in self.shapes.items()
        }
        asked = solution.solver.get("options", {}).get("link_tolerance", TOLERANCE)
        self.tolerance = number("solver.options.link_tolerance", asked, at_least=0.0)
        if self.tolerance > MOST_TOLERANCE:
            raise InputError("solver.options.link_tolerance", asked, f"at most {MOST_TOLERANCE:g} m")
        self.states_all = is_complete_version(solution)

    @classmethod
    def of(
        cls, solution: GraspSolution, hand: HandNumbers | None, surface: NumericBody | None, placement: StatedPlacement
    ) -> _Solids:
        """Return the solids; raise ``NotCheckedError`` where data are missing."""
        known = require_links(hand, "links")
        if surface is None:
            raise NotCheckedError(NO_BODY)
        body = solid_body(BODY, solution.body, surface)
        return cls(solution, known, [body, *solids_around(solution.problem["constraints"], placement)])

    def in_grasp(self) -> tuple[str, str]:
        """Return the error in the stated depth in the grasp, and otherwise what was seen."""
        stated, seen = grasp_penetration(self.solution.hand), self._at(self.hand)
        return self._depth_error(stated, seen, self.solution.status in (Status.SOLVED, Status.OPTIMAL))

    def on_approach(self) -> tuple[str, str]:
        """Return the error in the stated depth on the approach, and otherwise what was seen."""
        phases = {phase.name: phase for phase in self.solution.phases}
        way = [phases[name] for name in (APPROACH, PREGRASP, GRASP) if name in phases]
        seen = max((self._at(hand) for hand in self._stations(way)), key=lambda d: d.depth, default=LinkPenetration())
        stated = approach_penetration(self.solution.hand)
        if stated is None and len(way) < 2:
            return "", "the file states no way in"
        if stated is None:
            told = f"not stated; {seen.words if seen.depth > self.tolerance + SLACK else 'free'}"
            return (told, "") if self.states_all else ("", told)
        wrong = self._differs(stated, seen)
        return wrong, f"{len(way)} keyframes; " + (seen.words if seen.depth > self.tolerance else "free")

    def contacts_off_links(self, points: FloatArray) -> tuple[str, str]:
        """Return the error in the stated distances of contacts from their links, and otherwise what was seen."""
        stated = (self.solution.hand or {}).get("tip_gaps")
        seen = [self._gap(str(tip["link"]), point) for tip, point in zip(self.hand.tips, points, strict=True)]
        off = [
            f"contact {i} is {1e3 * gap:.2g} mm off link {self.hand.tips[i]['link']}"
            for i, gap in enumerate(seen)
            if gap is not None and gap > TOLERANCE
        ]
        unknown = ", ".join(str(i) for i, gap in enumerate(seen) if gap is None)
        off += [f"not known of contact {unknown}, whose links have no collision shapes"] if unknown else []
        told = "; ".join(off) or "all are"
        if stated is None:
            return ("not stated", "") if self.states_all else ("", f"not stated; {told}")
        for i, (known, gap) in enumerate(zip(stated, seen, strict=True)):
            if (known is None) != (gap is None) or (gap is not None and abs(known - gap) > SLACK + SHARE * gap):
                return f"contact {i} is stated to be {known} m off its link, {gap} m found", ""
        return "", told

    def _depth_error(self, stated: LinkPenetration | None, seen: LinkPenetration, called_free: bool) -> tuple[str, str]:
        more = f" ({1e3 * self.tolerance:g} mm allowed)"
        missing = "not stated" if self.states_all else ""
        wrong = missing if stated is None else self._differs(stated, seen)
        if seen.depth > self.tolerance + SLACK:
            word = f", called {self.solution.status.name.lower()}" if called_free else ""
            return f"{seen.words}{more}{word}" + (f"; {wrong}" if wrong else ""), ""
        if called_free and stated is not None and stated.depth > self.tolerance:
            return f"called {self.solution.status.name.lower()}, though {stated.words}{more}", ""
        return wrong, (f"{seen.words}{more}" if seen.depth > 0.0 else f"none is{more}")

    def _differs(self, stated: LinkPenetration, seen: LinkPenetration) -> str:
        """Return how a stated depth differs from the one seen, or a tolerance from the solve's; empty where equal."""
        if stated.tolerance != self.tolerance:
            return f"a tolerance of {stated.tolerance:g} m stated, {self.tolerance:g} m among the options"
        if abs(stated.depth - seen.depth) > SLACK + SHARE * max(stated.depth, seen.depth):
            return f"{1e3 * stated.depth:.2g} mm stated, {1e3 * seen.depth:.2g} mm found"
        return ""

    def _at(self, hand: URDFNumbers) -> LinkPenetration:
        """Return the deepest penetration of a link in a posture."""
        worst = LinkPenetration(tolerance=self.tolerance)
        for link, samples in self.samples.items():
            pose = hand.poses[link]
            there = samples @ pose[:3, :3].T + pose[:3, 3]
            middle = (there.min(axis=0) + there.max(axis=0)) / 2.0
            reach = float(np.max(np.linalg.norm(there - middle, axis=1)))
            for thing in self.things:
                if float(thing.distance(middle[None])[0]) < reach:
                    depth = self._depth(link, pose, there, thing)
                    if depth > worst.depth:
                        worst = LinkPenetration(depth, link, thing.name, self.tolerance)
        return worst

    def _depth(self, link: str, pose: FloatArray, samples: FloatArray, thing: NumericSolid) -> float:
        """Return the depth of a link in one solid, metres; ``samples`` (m, 3) of its surface are in the body's frame.

        Contacts are tried too: they are on the body, which may lie wholly inside a link.
        """
        samples = np.concatenate([samples, self.contacts[[self._distance(link, pose, p) < 0.0 for p in self.contacts]]])
        found = thing.distance(samples)
        order = np.argsort(found, kind="stable")[:BEGINNINGS]

        def outside(point: FloatArray) -> float:
            a, b = float(thing.distance(point[None])[0]), self._distance(link, pose, point)
            return a + b if max(a, b) <= ON else max(a, b)

        depth = max(0.0, -float(found[order[0]]))
        for start in samples[order[found[order] < SPACING]]:
            corners = np.concatenate([start[None], start + 0.5 * SPACING * np.eye(3)])
            found_inside = minimize(
                outside,
                np.asarray(start, dtype=float),
                method="Nelder-Mead",
                options={"initial_simplex": corners, "xatol": 1e-5, "fatol": 1e-6, "maxfev": 150},
            )
            depth = max(depth, -float(found_inside.fun))
        return max(depth, *self._ways_out(link, pose, thing)) if depth > 0.0 else 0.0

    def _ways_out(self, link: str, pose: FloatArray, thing: NumericSolid) -> list[float]:
        """Return the separating translation of each convex shape of a link from a convex solid, metres."""
        if thing.corners is None:
            return [0.0]
        shapes = [shape.corners for shape in self.shapes[link] if shape.corners is not None]
        return [0.0, *(penetration_depth(corners @ pose[:3, :3].T + pose[:3, 3], thing.corners) for corners in shapes)]

    def _distance(self, link: str, pose: FloatArray, point: FloatArray) -> float:
        """Return the signed distance of a point (3,), body frame, from a link, negative inside."""
        local = ((point - pose[:3, 3]) @ pose[:3, :3])[None]
        return min(float(tree.clearance(local)[0]) for tree in self.trees[link])

    def _gap(self, link: str, point: FloatArray) -> float | None:
        """Return the distance of a point from a link and its rigid group, metres; None where they have no shape."""
        rigid = [name for name in self.shapes if self.hand.is_fixed(name, link)]
        gaps = [self._distance(name, self.hand.poses[name], point) for name in rigid]
        return max(0.0, min(gaps)) if gaps else None

    def _stations(self, way: Sequence[Phase]) -> Iterator[URDFNumbers]:
        """Yield the hand along the straight legs between keyframes, without the last of them."""
        for here, there in pairwise(way):
            ends = [replace(self.hand, posture={**self.hand.posture, **phase.to_dict()}) for phase in (here, there)]
            moved = max(
                float(np.linalg.norm(ends[1].poses[link][:3, 3] - ends[0].poses[link][:3, 3])) for link in self.shapes
            )
            count = min(max(int(np.ceil(moved / STATION)), 1), MOST_STATIONS)
            for share in (np.arange(count) / count).tolist():
                yield self._between(here, there, share)

    def _between(self, here: Phase, there: Phase, share: float) -> URDFNumbers:
        joints = {name: (1.0 - share) * here.joints[name] + share * there.joints[name] for name in here.joints}
        position = (1.0 - share) * here.palm_position + share * there.palm_position
        pose = {"position": position.tolist(), "quaternion_wxyz": here.palm_quaternion.tolist()}
        return replace(self.hand, posture={**self.hand.posture, "joint_positions": joints, "palm_pose": pose})


def _link_samples(shapes: Sequence[LinkShape], rng: np.random.Generator) -> FloatArray:
    """Return samples (m, 3) of the surfaces of a link's shapes, with their corners, metres, link frame."""
    found = []
    for shape in shapes:
        corners = shape.vertices[shape.faces]
        areas = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1) / 2.0
        count = min(int(np.ceil(float(areas.sum()) / SPACING**2)), MOST_SAMPLES)
        which = rng.choice(len(areas), count, p=areas / areas.sum())
        shares = rng.dirichlet(np.ones(3), count)
        found += [np.einsum("ij,ijk->ik", shares, corners[which]), shape.vertices[:MOST_SAMPLES]]
    return np.concatenate(found)
