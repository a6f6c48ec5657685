"""Hand-related results of a solution: squeeze, joint efforts and the approach."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from nlpgrasp.common.shown.numbers import rounded, vector
from nlpgrasp.common.types import Json
from nlpgrasp.errors import InputError
from nlpgrasp.grasp.grasp import Grasp
from nlpgrasp.solution.asked import Asked
from nlpgrasp.solution.link_depth import LinkDepth
from nlpgrasp.solution.measures.needed import ForcesNeeded
from nlpgrasp.solution.obstructions import jaws_depth, link_depth_of, no_approach, of_the_way, way_in_of
from nlpgrasp.solution.phases.phase import Phase, phases_from
from nlpgrasp.solution.squeezed.joints import JointSqueeze
from nlpgrasp.solution.squeezed.squeeze import Squeeze, finger_wrenches

MORE = "a task that pushes from more sides, such as + ng.disturbance(force, torque, point), gives contacts that can"
ROUNDING = 1e-6  # relative
FINE = 5e-5  # metres: smaller lengths are not reported


class ByHand(Asked):
    """Base class with the results that depend on the hand."""

    grasp: Grasp | None
    hand: Json | None
    needed: ForcesNeeded | None

    @cached_property
    def squeeze(self) -> Squeeze | None:
        """The squeeze that ``hand`` states; None without one."""
        if self.grasp is None or self.hand is None or "squeeze" not in self.hand:
            return None
        return Squeeze.from_dict(self.hand, self.problem.get("hand"), self.grasp, "hand.squeeze")

    @property
    def link_depth(self) -> LinkDepth | None:
        """Penetration of the hand's links into body and surroundings; None where unknown or without links."""
        return link_depth_of(self.hand)

    @property
    def way_in(self) -> LinkDepth | None:
        """Penetration of the hand's links along the approach path; None where no path is known."""
        return way_in_of(self.hand)

    @property
    def touches(self) -> bool:
        """Whether a link penetrates anything by more than its tolerance; false where unknown."""
        return self.link_depth is not None and not self.link_depth.is_free

    @property
    def has_free_way(self) -> bool:
        """Whether no known obstruction blocks the straight approach path."""
        return not of_the_way(self.hand)

    def approach_line(self) -> str:
        """Return the reason for having no straight approach, as text; empty where there is one, or none is known."""
        return no_approach(self.hand)

    def lines_by_hand(self) -> list[str]:
        """Return the results on joints, squeeze and approach as text lines."""
        return list(filter(None, (self.effort_line(), self.squeeze_line(), self.links_line(), self.gripper_line())))

    def links_line(self) -> str:
        """Return the links' penetration in the grasp and on the approach as text; empty where unknown."""
        depth, way = self.link_depth, self.way_in
        if depth is None:
            known = "tip_gaps" in (self.hand or {})
            return "the hand's links have no collision shapes: what they run into is not known" if known else ""
        allowed = f"{rounded(1e3 * depth.tolerance)} mm allowed"
        there = depth.words if depth.depth > FINE else "the links are outside the body and its surroundings"
        if way is None:
            return f"{there} ({allowed})"
        free = f"at most {rounded(1e3 * way.depth, 2)} mm inside anything" if way.depth > FINE else "outside as well"
        return f"{there} ({allowed}); on the way in, looked at in {way.postures} postures, {free}"

    @property
    def way_blocked(self) -> float:
        """Penetration depth of parallel jaws on their straight approach, metres; 0 where it is free."""
        return jaws_depth(self.hand)

    def gripper_line(self) -> str:
        """Return the approach of parallel jaws as text; empty for other hands."""
        hand = self.hand or {}
        if "opening" not in hand or "direction" not in (hand.get("approach") or {}):
            return ""
        direction = np.asarray(hand["approach"]["direction"], dtype=float)
        down = float(np.degrees(np.arccos(np.clip(-direction[-1], -1.0, 1.0))))
        along = f"[{vector(direction)}], {rounded(down, 2, 0.5)} degrees off straight down"
        told = f"the jaws are {rounded(1e3 * hand['opening'])} mm apart and come in along {along}"
        deep = f"that way leads {rounded(1e3 * self.way_blocked, 2)} mm deep into the body, a table or an obstacle"
        return f"{told}; {deep}, clearances included" if self.way_blocked else told

    def squeeze_line(self) -> str:
        """Return forces and friction of the squeeze, or why there is none, as text; empty where neither is known."""
        if self.squeeze is not None:
            line, most = self.squeeze.line(), self.max_force
            if most is None or self.squeeze.largest <= (1.0 + ROUNDING) * most:
                return line
            return f"{line}; ABOVE max_force = {rounded(most)} N"
        why = self._why_no_squeeze
        return f"the hand cannot squeeze the body: {why}; {MORE}" if why else ""

    def require_squeeze(self) -> Squeeze:
        """Return the squeeze that ``hand`` states.

        Raises
        ------
        InputError
            Where it states none, with the reason if known.
        """
        if self.squeeze is not None:
            return self.squeeze
        why = self._why_no_squeeze
        given = f"a grasp without a squeeze: {why}" if why else "a grasp without a squeeze"
        raise InputError(
            "solution",
            given,
            "one whose contacts press against each other: " + (MORE if why else "ng.squeeze says why"),
        )

    @cached_property
    def phases(self) -> tuple[Phase, ...]:
        """The keyframes of the hand, from approach to lift; empty without a hand with links, or in older files."""
        return phases_from((self.hand or {}).get("phases", ()), "hand.phases")

    def effort_line(self) -> str:
        """Return the joint efforts for the hardest wrench of the task as text; empty where unknown.

        By virtual work from the stated finger forces: other forces for the same wrench may need smaller efforts.
        """
        effort = self._effort
        return "" if effort is None else f"these forces take {effort.words()}"

    @property
    def beyond_effort(self) -> str:
        """The joints whose effort limit the task exceeds, as text; empty without such joints, or where unknown.

        Other finger forces for the same wrench may need less.
        """
        effort = self._effort
        return "" if effort is None or not effort.exceeded else f"the task takes {effort.words()}"

    @property
    def _effort(self) -> JointSqueeze | None:
        """Joint efforts for the hardest wrench of the task; None where it, or a limit, is unknown."""
        joints, needed = None if self.squeeze is None else self.squeeze.joints, self.needed
        if needed is None or joints is None or joints.worst is None or self.budget.absolute:
            return None
        return joints.under(finger_wrenches(needed.forces, needed.moments))

    @property
    def _why_no_squeeze(self) -> str | None:
        """Reason stated in ``hand`` for having no squeeze; None where there is none."""
        return ((self.hand or {}).get("no_squeeze") or {}).get("reason")
