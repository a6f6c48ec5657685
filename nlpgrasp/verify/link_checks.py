"""Checks of a hand's links: their penetration depths, and their distances from the contacts.

The depth of a link in the body, a table or an obstacle is the largest sum of a point's depths in both. It is searched
from samples of the link's surface by the simplex method of Nelder and Mead (1965, doi:10.1093/comjnl/7.4.308), with
shapes, kinematics and distances of this package, ``verify``, alone. For convex shapes in convex solids it is the
shortest translation that separates the two, where that is longer.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy as np
from scipy.optimize import minimize

from nlpgrasp.common.meshes.search_tree import SearchTree
from nlpgrasp.common.validation import FloatArray, number
from nlpgrasp.errors import InputError
from nlpgrasp.solution.obstructions import (
    MOST_TOLERANCE,
    TOLERANCE,
    LinkPenetration,
    approach_penetration,
    grasp_penetration,
    link_name,
)
from nlpgrasp.solution.phase_record import APPROACH, GRASP, PREGRASP, Phase
from nlpgrasp.solution.records import Status
from nlpgrasp.solution.solution import GraspSolution
from nlpgrasp.verify.check import Check, NotCheckedError, states_all_hand_fields
from nlpgrasp.verify.convex_solids import NumericSolid, held_and_around, penetration_depth
from nlpgrasp.verify.link_shapes import LinkShape
from nlpgrasp.verify.numeric_urdf_hand import NumericLinkedHand, require_links
from nlpgrasp.verify.self_penetration import NumericSelfPenetration
from nlpgrasp.verify.stated_placement import NumericBody, NumericHand, StatedPlacement

SAMPLE_SPACING = 2e-3  # metres between samples of a link's surface
MOST_SAMPLES = 4000  # most samples of a link
MOST_STARTS = 3  # most samples from which a depth is searched
SURFACE_TOLERANCE = 1e-6  # metres: tolerance of a point on a solid's surface
SLACK = 3e-4  # metres: allowed difference of two measurements of one depth or distance
SHARE = 0.2  # the same, as a further share of the depth
STATION_SPACING = 2e-3  # metres that a link moves between stations of the approach
MOST_STATIONS = 50  # most stations of a leg


def link_checks(
    solution: GraspSolution, hand: NumericHand | None, surface: NumericBody | None, placement: StatedPlacement
) -> list[Check]:
    """Return the checks of link penetration in the grasp and on the approach, and of contacts on their links.

    Parameters
    ----------
    solution : GraspSolution
    hand : NumericHand or None
    surface : NumericBody or None
        The body; None if missing.
    placement : StatedPlacement
        Contacts, and the reader of obstacles.
    """
    if (solution.problem.get("hand") or {}).get("type") not in ("urdf",):
        return []
    try:
        return _comparison_checks(solution, _LinkComparison.of(solution, hand, surface, placement), placement.points)
    except NotCheckedError as reason:
        return [Check.not_made("links inside something", str(reason))]


def _comparison_checks(solution: GraspSolution, solids: _LinkComparison, points: FloatArray) -> list[Check]:
    """Return the checks of links whose collision shapes are known."""
    if not solids.shapes:
        stated = (solution.hand or {}).get("link_depth") is not None
        message = "the hand's links have no collision shapes: what they run into is not known"
        return [Check("links inside something", not stated, f"a depth is stated, and {message}" if stated else message)]
    if solids.states_all and "meshes" not in solids.hand.data:
        return [Check("links inside something", False, "the file states no sha256 of the meshes of the hand's links")]
    error, message = solids.in_grasp()
    checks = [Check.of_errors("links inside something", [error], message)]
    if "pregrasp" in (solution.hand or {}):
        error, message = solids.in_pregrasp()
        checks.append(Check.of_errors("links in the pregrasp", [error], message))
    if solution.phases:
        error, message = solids.on_approach()
        checks.append(Check.of_errors("links on the way in", [error], message))
    elif solids.states_all:
        checks.append(Check("links on the way in", False, "the file states no phases of the hand"))
    error, message = solids.contacts_off_links(points)
    return [*checks, Check.of_errors("contacts on their links", [error], message)]


class _LinkComparison:
    """Comparison of recomputed link penetrations with those in the file.

    Its checks return an error text, empty if the file agrees, and a summary of what was recomputed.
    """

    def __init__(self, solution: GraspSolution, hand: NumericLinkedHand, solids: Sequence[NumericSolid]) -> None:
        self.solution, self.hand, self.solids = solution, hand, solids
        self.shapes, self.contacts = hand.shapes, solution.require_grasp().points
        rng = np.random.default_rng(2)
        self.samples = {link: link_samples(shapes, rng) for link, shapes in self.shapes.items()}
        self.trees = {
            link: [SearchTree(shape.vertices, shape.faces) for shape in shapes] for link, shapes in self.shapes.items()
        }
        tolerance = solution.solver.get("options", {}).get("link_tolerance", TOLERANCE)
        self.tolerance = number("solver.options.link_tolerance", tolerance, at_least=0.0)
        if self.tolerance > MOST_TOLERANCE:
            raise InputError("solver.options.link_tolerance", tolerance, f"at most {MOST_TOLERANCE:g} m")
        self.states_all = states_all_hand_fields(solution)
        avoids_itself = hand.data.get("self_collision") is True
        self.self_penetration = NumericSelfPenetration(hand, self.samples) if avoids_itself else None

    @classmethod
    def of(
        cls, solution: GraspSolution, hand: NumericHand | None, surface: NumericBody | None, placement: StatedPlacement
    ) -> _LinkComparison:
        """Return the comparison for a solution; raise ``NotCheckedError`` if data are missing."""
        linked_hand = require_links(hand, "links")
        held, around = held_and_around(solution, surface, placement)
        return cls(solution, linked_hand, [held, *around])

    def in_grasp(self) -> tuple[str, str]:
        """Check the stored penetration depth in the grasp; return an error text and a summary."""
        stated, recomputed = grasp_penetration(self.solution.hand), self._penetration(self.hand)
        return self._depth_error(stated, recomputed, self._is_called_free)

    def in_pregrasp(self) -> tuple[str, str]:
        """Check that no link is deeper in the pregrasp than in the grasp, or than allowed; return error and summary."""
        recomputed = self._penetration(self.hand.with_posture((self.solution.hand or {})["pregrasp"]))
        stated = grasp_penetration(self.solution.hand)
        allowed = max(self.tolerance, 0.0 if stated is None else stated.depth)
        message = f"{recomputed.words} ({1e3 * allowed:g} mm allowed)" if recomputed.depth > 0.0 else "none is"
        return (message, "") if recomputed.depth > allowed + SLACK else ("", message)

    @property
    def _is_called_free(self) -> bool:
        """Whether the solution's status says that no link penetrates anything."""
        return self.solution.status in (Status.SOLVED, Status.OPTIMAL)

    def on_approach(self) -> tuple[str, str]:
        """Check the stored penetration depth on the approach; return an error text and a summary."""
        phases = {phase.name: phase for phase in self.solution.phases}
        keyframes = [phases[name] for name in (APPROACH, PREGRASP, GRASP) if name in phases]
        penetrations = (self._penetration(hand) for hand in self._postures(keyframes))
        recomputed = max(penetrations, key=lambda penetration: penetration.depth, default=LinkPenetration())
        stated = approach_penetration(self.solution.hand)
        if stated is None and len(keyframes) < 2:
            return "", "the file states no way in"
        if not self.states_all:
            summary = recomputed.words if recomputed.depth > self.tolerance + SLACK else "free"
            message = "not stated; " if stated is None else f"{len(keyframes)} keyframes; "
            return "" if stated is None else self._difference(stated, recomputed), message + summary
        error, summary = self._depth_error(stated, recomputed, self._is_called_free)
        return error, f"{len(keyframes)} keyframes; {summary}"

    def contacts_off_links(self, points: FloatArray) -> tuple[str, str]:
        """Check the stored distances of contacts from their links; return an error text and a summary."""
        stated = (self.solution.hand or {}).get("tip_gaps")
        gaps = [self._gap(str(tip["link"]), point) for tip, point in zip(self.hand.tips, points, strict=True)]
        messages = [
            f"contact {i} is {1e3 * gap:.2g} mm off link {self.hand.tips[i]['link']}"
            for i, gap in enumerate(gaps)
            if gap is not None and gap > TOLERANCE
        ]
        unknown = ", ".join(str(i) for i, gap in enumerate(gaps) if gap is None)
        messages += [f"not known of contact {unknown}, whose links have no collision shapes"] if unknown else []
        summary = "; ".join(messages) or "all are"
        if stated is None:
            return ("not stated", "") if self.states_all else ("", f"not stated; {summary}")
        for i, (stated_gap, gap) in enumerate(zip(stated, gaps, strict=True)):
            if (stated_gap is None) != (gap is None) or (
                gap is not None and abs(stated_gap - gap) > SLACK + SHARE * gap
            ):
                return f"contact {i} is stated to be {stated_gap} m off its link, {gap} m found", ""
        return "", summary

    def _depth_error(
        self, stated: LinkPenetration | None, recomputed: LinkPenetration, called_free: bool
    ) -> tuple[str, str]:
        """Check a stored depth and the status that follows from it; return an error text and a summary."""
        allowance = f" ({1e3 * self.tolerance:g} mm allowed)"
        missing_message = "not stated" if self.states_all else ""
        error = missing_message if stated is None else self._difference(stated, recomputed)
        if recomputed.depth > self.tolerance + SLACK:
            status = f", called {self.solution.status.name.lower()}" if called_free else ""
            return f"{recomputed.words}{allowance}{status}" + (f"; {error}" if error else ""), ""
        if called_free and stated is not None and stated.depth > self.tolerance:
            return f"called {self.solution.status.name.lower()}, though {stated.words}{allowance}", ""
        return error, (f"{recomputed.words}{allowance}" if recomputed.depth > 0.0 else f"none is{allowance}")

    def _difference(self, stated: LinkPenetration, recomputed: LinkPenetration) -> str:
        """Return a message if stored depth or tolerance differ from the recomputed ones, else an empty text."""
        if stated.tolerance != self.tolerance:
            return f"a tolerance of {stated.tolerance:g} m stated, {self.tolerance:g} m among the options"
        things = {*(solid.name for solid in self.solids), *map(link_name, self.shapes)}
        if stated.thing not in things or (stated.link is not None and stated.link not in self.shapes):
            return f"{stated.words} stated, which the file does not have"
        if abs(stated.depth - recomputed.depth) > SLACK + SHARE * max(stated.depth, recomputed.depth):
            return f"{1e3 * stated.depth:.2g} mm stated, {1e3 * recomputed.depth:.2g} mm found"
        return ""

    def _penetration(self, hand: NumericLinkedHand) -> LinkPenetration:
        """Return the deepest penetration of any link into a solid or another link, in the given hand's posture."""
        deepest = LinkPenetration(tolerance=self.tolerance)
        for link, samples in self.samples.items():
            pose = hand.poses[link]
            points = samples @ pose[:3, :3].T + pose[:3, 3]
            centre = (points.min(axis=0) + points.max(axis=0)) / 2.0
            radius = float(np.max(np.linalg.norm(points - centre, axis=1)))
            for solid in self.solids:
                if float(solid.distance(centre[None])[0]) < radius:  # else the bounding ball is outside the solid
                    depth = self._depth(link, pose, points, solid)
                    if depth > deepest.depth:
                        deepest = LinkPenetration(depth, link, solid.name, self.tolerance)
        if self.self_penetration is None:
            return deepest
        among_links = self.self_penetration.in_posture(hand, self.tolerance)
        return max(deepest, among_links, key=lambda penetration: penetration.depth)

    def _depth(self, link: str, pose: FloatArray, samples: FloatArray, solid: NumericSolid) -> float:
        """Return the penetration depth of a link in one solid, metres, found by search.

        ``samples`` (m, 3) are points of the link's surface in the body's frame.

        Contacts are tried too: they are on the body, which may lie wholly inside a link.
        """
        samples = np.concatenate([samples, self.contacts[[self._distance(link, pose, p) < 0.0 for p in self.contacts]]])
        distances = solid.distance(samples)
        order = np.argsort(distances, kind="stable")[:MOST_STARTS]

        def outside(point: FloatArray) -> float:
            a, b = float(solid.distance(point[None])[0]), self._distance(link, pose, point)
            return a + b if max(a, b) <= SURFACE_TOLERANCE else max(a, b)

        depth = max(0.0, -float(distances[order[0]]))
        for start in samples[order[distances[order] < SAMPLE_SPACING]]:
            corners = np.concatenate([start[None], start + 0.5 * SAMPLE_SPACING * np.eye(3)])
            minimum = minimize(
                outside,
                np.asarray(start, dtype=float),
                method="Nelder-Mead",
                options={"initial_simplex": corners, "xatol": 1e-5, "fatol": 1e-6, "maxfev": 150},
            )
            depth = max(depth, -float(minimum.fun))
        return max(depth, *self._separations(link, pose, solid)) if depth > 0.0 else 0.0

    def _separations(self, link: str, pose: FloatArray, solid: NumericSolid) -> list[float]:
        """Return the lengths of the shortest translations that separate a link's convex shapes from a solid, metres."""
        if solid.corners is None:
            return [0.0]
        shapes = [shape.corners for shape in self.shapes[link] if shape.corners is not None]
        return [0.0, *(penetration_depth(corners @ pose[:3, :3].T + pose[:3, 3], solid.corners) for corners in shapes)]

    def _distance(self, link: str, pose: FloatArray, point: FloatArray) -> float:
        """Return the signed distance of a point (3,), body frame, from a link, negative inside."""
        local = ((point - pose[:3, 3]) @ pose[:3, :3])[None]
        return min(float(tree.exact_signed_distance(local)[0]) for tree in self.trees[link])

    def _gap(self, link: str, point: FloatArray) -> float | None:
        """Return the distance of a point from a link and the links fixed to it, metres; None if they have no shape."""
        rigid_links = [name for name in self.shapes if self.hand.is_fixed(name, link)]
        gaps = [self._distance(name, self.hand.poses[name], point) for name in rigid_links]
        return max(0.0, min(gaps)) if gaps else None

    def _postures(self, keyframes: Sequence[Phase]) -> Iterator[NumericLinkedHand]:
        """Yield the hand in sampled postures of the straight motion through keyframes, without the last keyframe."""
        for start, end in pairwise(keyframes):
            hands = [self.hand.with_posture(phase.to_dict()) for phase in (start, end)]
            distance = max(
                float(np.linalg.norm(hands[1].poses[link][:3, 3] - hands[0].poses[link][:3, 3])) for link in self.shapes
            )
            count = min(max(int(np.ceil(distance / STATION_SPACING)), 1), MOST_STATIONS)
            for fraction in (np.arange(count) / count).tolist():
                yield self._between(start, end, fraction)

    def _between(self, start: Phase, end: Phase, fraction: float) -> NumericLinkedHand:
        """Return the hand at a fraction of the straight motion between two phases."""
        joints = {name: (1.0 - fraction) * start.joints[name] + fraction * end.joints[name] for name in start.joints}
        position = (1.0 - fraction) * start.palm_position + fraction * end.palm_position
        pose = {"position": position.tolist(), "quaternion_wxyz": start.palm_quaternion.tolist()}
        return self.hand.with_posture({"joint_positions": joints, "palm_pose": pose})


def link_samples(shapes: Sequence[LinkShape], rng: np.random.Generator) -> FloatArray:
    """Return sample points (m, 3) on the surfaces of a link's shapes, including corners, metres, link frame."""
    samples = []
    for shape in shapes:
        corners = shape.vertices[shape.faces]
        areas = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1) / 2.0
        count = min(int(np.ceil(float(areas.sum()) / SAMPLE_SPACING**2)), MOST_SAMPLES)
        chosen = rng.choice(len(areas), count, p=areas / areas.sum())
        barycentric = rng.dirichlet(np.ones(3), count)
        samples += [np.einsum("ij,ijk->ik", barycentric, corners[chosen]), shape.vertices[:MOST_SAMPLES]]
    return np.concatenate(samples)
