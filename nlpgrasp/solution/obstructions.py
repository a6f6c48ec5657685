"""Obstructions of a hand in its grasp and on its straight approach, read from its JSON data."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from nlpgrasp.common.formatting import format_number, format_percent, vector
from nlpgrasp.common.types import Json
from nlpgrasp.common.user_warnings import warn
from nlpgrasp.contacts import ContactModel
from nlpgrasp.contacts.pad import PadContact
from nlpgrasp.solution.record_fields import LATER, Count, NonNegative, Record

TOLERANCE = 1e-3  # metres: default penetration up to which links count as free
MOST_TOLERANCE = 0.01  # metres: largest tolerance that may be chosen
LEAST_DEPTH = 5e-5  # metres: smaller penetrations are not reported
LEAST_PAD_SHARE = 0.9  # share of a pad on its face below which it counts as overhanging
LINK = "link "  # prefix of a link's name among the things that links penetrate
GRIPPER_POSE = "the pose is that of the gripper's own frame"
TABLE = "the table"  # name of a table, the same
BODY = "the body"  # name of the held body among the things that links penetrate


@dataclass(frozen=True)
class LinkPenetration(Record):
    """Deepest penetration of a hand's links, by their collision shapes.

    Parameters
    ----------
    depth : float
        Metres, at least zero.
    link : str or None
        The deepest link.
    thing : str
        What it penetrates: the body, the table, an obstacle by its name, or another link.
    tolerance : float
        Penetration up to which the links count as free, metres.
    postures : int
        Number of postures that were checked.
    """

    depth: NonNegative = 0.0
    link: str | None = None
    thing: str = field(default=BODY, metadata=LATER)
    tolerance: NonNegative = field(default=TOLERANCE, metadata=LATER)
    postures: Count = field(default=1, metadata={"key": "samples"})

    @property
    def is_free(self) -> bool:
        """Whether the penetration is at most the tolerance."""
        return self.depth <= self.tolerance

    @property
    def other_link(self) -> str:
        """Name of the link that is penetrated; empty if it is the body, a table or an obstacle."""
        return self.thing.removeprefix(LINK) if self.thing.startswith(LINK) else ""

    @property
    def words(self) -> str:
        """The penetration as text: link, depth and penetrated object."""
        return f"link {self.link} is {format_number(1e3 * self.depth, 2)} mm inside {self.thing}"


def link_name(link: str) -> str:
    """Return the name of a link as a penetrated object."""
    return LINK + link


def grasp_penetration(hand: Json | None) -> LinkPenetration | None:
    """Return the links' deepest penetration in the grasp; None if unknown or without links."""
    return _stored_penetration(hand, "link_depth")


def approach_penetration(hand: Json | None) -> LinkPenetration | None:
    """Return the links' deepest penetration on the approach; None if no path is known."""
    return _stored_penetration(hand, "way_in")


def links_are_free(hand: Json | None) -> bool:
    """Return whether no link is known to penetrate anything beyond its tolerance, in the grasp or on the approach."""
    penetrations = grasp_penetration(hand), approach_penetration(hand)
    return all(penetration is None or penetration.is_free for penetration in penetrations)


def tip_deviations(hand: Json | None) -> dict[int, float]:
    """Return the distances of contacts from their fingertips' links, metres, by finger, above a millimetre."""
    gaps = (hand or {}).get("tip_gaps") or ()
    return {i: float(gap) for i, gap in enumerate(gaps) if gap is not None and gap > TOLERANCE}


def jaws_depth(hand: Json | None) -> float:
    """Return the penetration depth of parallel jaws on their straight approach, metres; 0 if it is free."""
    approach = (hand or {}).get("approach") or {}
    depth = float(approach.get("depth", 0.0))
    return depth if depth > (0.0 if "clearance" in approach else TOLERANCE) else 0.0


def jaws_way_in(hand: Json | None) -> str:
    """Return a text on what parallel jaws penetrate on their straight approach; empty if it is free."""
    depth = jaws_depth(hand)
    if not depth:
        return ""
    depths = jaws_obstacles(hand) or {"the body, a table or an obstacle": depth}
    text = " and ".join(f"{format_number(1e3 * value, 2)} mm deep into {solid}" for solid, value in depths.items())
    is_surrounded = any(solid != BODY for solid in depths)
    return f"{text} (clearance included; it takes at least that much more room there)" if is_surrounded else text


def jaws_obstacles(hand: Json | None) -> dict[str, float]:
    """Return the penetration depths, metres, of parallel jaws on their approach, by object, deepest first."""
    depths = ((hand or {}).get("approach") or {}).get("blocked_by") or {}
    return dict(sorted(depths.items(), key=lambda entry: -entry[1]))


def jaws_cross_thin_part(hand: Json | None) -> bool:
    """Return whether parallel jaws pass through a thin solid on their straight approach."""
    return bool(((hand or {}).get("approach") or {}).get("passes_through", False))


def pad_share(hand: Json | None) -> float:
    """Return the least fraction of a gripper's pads that is on its face; 1 for other hands."""
    return float(min((hand or {}).get("pads") or (), default=1.0))


def patch_share(hand: Json | None, contacts: Sequence[ContactModel]) -> float:
    """Return the least share of a gripper's plane and line contacts that is on a face; 1 for contacts at points."""
    return pad_share(hand) if any(isinstance(model, PadContact) for model in contacts) else 1.0


def unseen_patches(hand: Json | None, contacts: Sequence[ContactModel]) -> str:
    """Return a text on plane and line contacts whose share on a face is unknown; empty without such."""
    if "pads" in (hand or {}) or not any(isinstance(model, PadContact) for model in contacts):
        return ""
    return "it is not checked that plane and line contacts are whole on their faces, as the quality takes them to be"


def pad_overhang(hand: Json | None) -> str:
    """Return a text on the fraction of a gripper's pad that is on its face; empty if at least 90 %."""
    least = pad_share(hand)
    return "" if least >= LEAST_PAD_SHARE else f"{format_percent(least)} of the pad on the face"


def unusable_reason(hand: Json | None) -> str:
    """Return a text on why no sampled pose of parallel jaws has its pads on faces and a free way in; mostly empty."""
    reason = str(((hand or {}).get("approach") or {}).get("unusable", ""))
    return f"{reason[:1].lower()}{reason[1:].rstrip('.')}"


def missing_approach_reason(hand: Json | None) -> str:
    """Return a text on why there is no straight approach; empty if there is one or the reason is unknown."""
    reason = ((hand or {}).get("approach") or {}).get("reason")
    return f"no free straight way of the palm to the grasp: {reason}" if reason else ""


def grasp_obstructions(hand: Json | None) -> list[str]:
    """Return texts on the obstructions in the grasp: penetrating links and contacts off their links."""
    penetration, links = grasp_penetration(hand), (hand or {}).get("fingertips") or ()
    obstructions = []
    if penetration is not None and penetration.depth > min(penetration.tolerance, TOLERANCE):
        tolerance = f" ({format_number(1e3 * penetration.tolerance)} mm allowed)" if penetration.is_free else ""
        obstructions.append(f"{penetration.words}{tolerance}")
    for i, gap in tip_deviations(hand).items():
        link = f" {links[i]}" if i < len(links) else ""
        obstructions.append(
            f"contact {i} is {format_number(1e3 * gap, 2)} mm off its fingertip's link{link}, by that link's shape"
        )
    return obstructions


def closing_obstructions(hand: Json | None) -> list[str]:
    """Return texts on links that penetrate something on the approach but not in the grasp."""
    grasp, approach = grasp_penetration(hand), approach_penetration(hand)
    if approach is None or approach.is_free or not (grasp is None or grasp.is_free):
        return []
    return [f"on the way in {approach.words}"]


def link_obstructions(hand: Json | None) -> list[str]:
    """Return texts on the obstructions of links in the grasp and on the approach."""
    return [*grasp_obstructions(hand), *closing_obstructions(hand)]


def warn_of_touching(name: str, hand: Json | None) -> str:
    """Warn of penetrating links and contacts off their links; return the warning, or an empty text.

    Parameters
    ----------
    name : str
        The solution's.
    hand : mapping or None
        The hand's JSON data.
    """
    message = "; and ".join(link_obstructions(hand))
    if message:
        message = message if links_are_free(hand) else f"Touches: {message}"
        warn(f"{name}: {message}")
    return message


def format_unshaped_links(hand: Json | None) -> str:
    """Return a text on contacts whose links have no collision shapes; empty if all links or none have shapes."""
    gaps = (hand or {}).get("tip_gaps") or ()
    unshaped = [str(i) for i, gap in enumerate(gaps) if gap is None]
    if not unshaped or grasp_penetration(hand) is None:
        return ""
    subject = f"contact{'s' * (len(unshaped) > 1)} {', '.join(unshaped)}"
    return f"the links of {subject} have no collision shapes, and may be inside anything"


def way_obstructions(hand: Json | None) -> list[str]:
    """Return texts on the obstructions of the straight approach."""
    obstructions, jaws = [], jaws_way_in(hand)
    if jaws:
        obstructions.append(f"the gripper's way in leads {jaws}")
    elif jaws_cross_thin_part(hand):
        obstructions.append("the gripper's way in passes through something thin")
    return [*obstructions, *closing_obstructions(hand), *filter(None, [missing_approach_reason(hand)])]


def approach_obstructions(hand: Json | None) -> list[str]:
    """Return texts on the obstructions of the straight approach, and on overhanging pads."""
    return [*way_obstructions(hand), *filter(None, [pad_overhang(hand)])]


def obstruction_rank(hand: Json | None) -> tuple[bool, bool, float]:
    """Return the sorting key of a grasp's obstructions: free links first, then a free way in, then more of the pads.

    Pads that are on their faces to 90 % rank alike.
    """
    overhang = 1.0 - pad_share(hand) if pad_overhang(hand) else 0.0
    return bool(link_obstructions(hand)), bool(way_obstructions(hand)), overhang


def format_link_penetrations(hand: Json | None) -> str:
    """Return a text on the links' penetration in the grasp and on the approach; empty if unknown."""
    penetration, approach = grasp_penetration(hand), approach_penetration(hand)
    if penetration is None:
        is_posed = "tip_gaps" in (hand or {})
        return "the hand's links have no collision shapes: what they run into is not known" if is_posed else ""
    tolerance = f"{format_number(1e3 * penetration.tolerance)} mm allowed"
    outside = "the links are outside the body and its surroundings"
    in_grasp = penetration.words if penetration.depth > LEAST_DEPTH else outside
    if approach is None:
        return f"{in_grasp} ({tolerance})"
    depth = f"at most {format_number(1e3 * approach.depth, 2)} mm inside anything"
    on_approach = depth if approach.depth > LEAST_DEPTH else "outside as well"
    return f"{in_grasp} ({tolerance}); on the way in, looked at in {approach.postures} postures, {on_approach}"


def format_jaw_approach(hand: Json | None) -> str:
    """Return a text on the approach of parallel jaws; empty for other hands."""
    data = hand or {}
    if "opening" not in data or "direction" not in (data.get("approach") or {}):
        return ""
    direction = np.asarray(data["approach"]["direction"], dtype=float)
    tilt = float(np.degrees(np.arccos(np.clip(-direction[-1], -1.0, 1.0))))
    course = f"[{vector(direction)}], {format_number(tilt, 2, 0.5)} degrees off straight down"
    text = f"the jaws are {format_number(1e3 * data['opening'])} mm apart and come in along {course}"
    pads_text = " and ".join(format_percent(fraction) for fraction in data.get("pads") or ())
    text = f"{text}; {pads_text} of the pads on their faces" if pads_text else text
    jaws = jaws_way_in(hand)
    return f"{text}; that way leads {jaws}" if jaws else text


def format_gripper_frame(hand: Json | None, gripper: Json | None, pose: str = GRIPPER_POSE) -> str:
    """Return a text on a gripper's pose, its axes and tool centre point; empty for other hands and files without it."""
    stated = gripper or {}
    if "palm_pose" not in (hand or {}) or "tcp" not in stated:
        return ""
    closing, approach = (
        axis if isinstance(axis, str) else f"[{vector(np.asarray(axis, dtype=float))}]"
        for axis in (stated["closing_axis"], stated["approach_axis"])
    )
    tcp = ", ".join(f"{1e3 * coordinate + 0.0:.6g}" for coordinate in stated["tcp"])
    axes = f"closing axis {closing}, approach axis {approach}, tool centre point [{tcp}] mm"
    return f"{pose}: {axes}"


def _stored_penetration(hand: Json | None, key: str) -> LinkPenetration | None:
    """Return the penetration under a key of a hand's JSON data, or None if there is none."""
    data = (hand or {}).get(key)
    return None if data is None else LinkPenetration.from_dict(data, f"hand.{key}")
