"""What the hand of a solution does: its squeeze, what its joints exert, its way to the grasp."""

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
FINE = 5e-5  # metres: less is not worth a number


class ByHand(Asked):
    """What is known of a grasp by the hand that was asked for."""

    grasp: Grasp | None
    hand: Json | None
    needed: ForcesNeeded | None

    @cached_property
    def squeeze(self) -> Squeeze | None:
        """The squeeze of the hand's joints that ``hand`` states; None where it states none."""
        if self.grasp is None or self.hand is None or "squeeze" not in self.hand:
            return None
        return Squeeze.from_dict(self.hand, self.problem.get("hand"), self.grasp, "hand.squeeze")

    @property
    def link_depth(self) -> LinkDepth | None:
        """How deep the hand's links are in the body and its surroundings; None of hands without links, or unknown."""
        return link_depth_of(self.hand)

    @property
    def way_in(self) -> LinkDepth | None:
        """How deep the links are in anything on the way to the grasp; None where no such way is known."""
        return way_in_of(self.hand)

    @property
    def touches(self) -> bool:
        """Whether a link is deeper in anything than is allowed; false where that is not known."""
        return self.link_depth is not None and not self.link_depth.is_free

    @property
    def has_free_way(self) -> bool:
        """Whether nothing that is known blocks the straight way to the grasp."""
        return not of_the_way(self.hand)

    def approach_line(self) -> str:
        """Return in words why the palm does not come straight to the grasp; empty where it does, or none is known."""
        return no_approach(self.hand)

    def lines_by_hand(self) -> list[str]:
        """Return what is known of the hand's joints, squeeze and way to the grasp, in words."""
        return list(filter(None, (self.effort_line(), self.squeeze_line(), self.links_line(), self.gripper_line())))

    def links_line(self) -> str:
        """Return in words how deep the links are in anything, in the grasp and before; empty where it is not known."""
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
        """How deep the straight way of parallel jaws leads into what is beside it, metres; 0 where it is free."""
        return jaws_depth(self.hand)

    def gripper_line(self) -> str:
        """Return in words how parallel jaws come to the grasp; empty of other hands."""
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
        """Return in words what the squeeze needs, or why there is none; empty where neither is known."""
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
            Where it states none, with the reason where that is known.
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
        """The keyframes of the hand, from afar to the lift; none without a hand with links, or in older files."""
        return phases_from((self.hand or {}).get("phases", ()), "hand.phases")

    def effort_line(self) -> str:
        """Return in words what the joints do for the hardest wrench of the task; empty where that is not known.

        By virtual work, of the finger forces stated: others that hold the same wrench may ask less of the joints.
        """
        effort = self._effort
        return "" if effort is None else f"these forces take {effort.words()}"

    @property
    def beyond_effort(self) -> str:
        """Which joints the task asks more of than they can do, in words; empty where it asks of none, or none is known.

        Other finger forces for the same wrench may ask less.
        """
        effort = self._effort
        return "" if effort is None or not effort.exceeded else f"the task takes {effort.words()}"

    @property
    def _effort(self) -> JointSqueeze | None:
        """What the joints do for the hardest wrench of the task; None where that, or a limit, is not known."""
        joints, needed = None if self.squeeze is None else self.squeeze.joints, self.needed
        if needed is None or joints is None or joints.worst is None or self.budget.absolute:
            return None
        return joints.under(finger_wrenches(needed.forces, needed.moments))

    @property
    def _why_no_squeeze(self) -> str | None:
        """Why the hand cannot squeeze the body, as ``hand`` states it; None where it does not."""
        return ((self.hand or {}).get("no_squeeze") or {}).get("reason")
