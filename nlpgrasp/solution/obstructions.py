"""Link penetrations and obstructions of a hand in its grasp and on the straight approach."""

from __future__ import annotations

from dataclasses import dataclass

from nlpgrasp.common.formatting import format_number
from nlpgrasp.common.types import Json
from nlpgrasp.common.user_warnings import warn
from nlpgrasp.common.validation import number
from nlpgrasp.errors import InputError

TOLERANCE = 1e-3  # metres: default penetration up to which links count as free
MOST_TOLERANCE = 0.01  # metres: largest tolerance that may be chosen
BODY = "the body"  # name of the held body among the things that links penetrate


@dataclass(frozen=True)
class LinkPenetration:
    """Deepest penetration of a hand's links, by their collision shapes.

    Parameters
    ----------
    depth : float
        Metres, at least zero.
    link : str or None
        The deepest link.
    thing : str
        What it penetrates: the body, the table, or an obstacle by its name.
    tolerance : float
        Penetration up to which the links count as free, metres.
    postures : int
        Number of postures that were checked.
    """

    depth: float = 0.0
    link: str | None = None
    thing: str = BODY
    tolerance: float = TOLERANCE
    postures: int = 1

    @property
    def is_free(self) -> bool:
        """Whether no link is deeper than the tolerance."""
        return self.depth <= self.tolerance

    @property
    def words(self) -> str:
        """The penetration as text."""
        return f"link {self.link} is {format_number(1e3 * self.depth, 2)} mm inside {self.thing}"

    def to_dict(self) -> Json:
        """Return the penetration as JSON data."""
        return {
            "depth": self.depth,
            "link": self.link,
            "thing": self.thing,
            "tolerance": self.tolerance,
            "samples": self.postures,
        }

    @classmethod
    def from_dict(cls, data: Json, name: str) -> LinkPenetration:
        """Return the record that ``to_dict`` wrote; older files lack thing and tolerance.

        Raises
        ------
        InputError
            On invalid or negative numbers; ``name`` is shown in the message.
        """
        if not isinstance(data, dict) or not {"depth", "samples"} <= data.keys():
            raise InputError(name, data, "a mapping with depth, link and samples")
        lengths = [number(f"{name}.{key}", data.get(key, TOLERANCE), at_least=0.0) for key in ("depth", "tolerance")]
        link = data.get("link")
        thing, postures = str(data.get("thing", BODY)), int(data["samples"])
        return cls(lengths[0], None if link is None else str(link), thing, lengths[1], postures)


def grasp_penetration(hand: Json | None) -> LinkPenetration | None:
    """Return the links' penetration in the grasp; None without links, or where unknown."""
    return _stated_depth(hand, "link_depth")


def approach_penetration(hand: Json | None) -> LinkPenetration | None:
    """Return the links' penetration on the approach path; None where no path is known."""
    return _stated_depth(hand, "way_in")


def tip_deviations(hand: Json | None) -> dict[int, float]:
    """Return the distances of contacts from their fingertips' links, metres, by finger, from a millimetre on."""
    gaps = (hand or {}).get("tip_gaps") or ()
    return {i: float(gap) for i, gap in enumerate(gaps) if gap is not None and gap > TOLERANCE}


def jaws_depth(hand: Json | None) -> float:
    """Return the penetration depth of parallel jaws on their straight approach, metres; 0 where it is free."""
    depth = float(((hand or {}).get("approach") or {}).get("depth", 0.0))
    return depth if depth > TOLERANCE else 0.0


def passes_through(hand: Json | None) -> bool:
    """Return whether parallel jaws pass through something thin on their straight approach."""
    return bool(((hand or {}).get("approach") or {}).get("passes_through", False))


def missing_approach_reason(hand: Json | None) -> str:
    """Return the reason for having no straight approach, as text; empty where there is one, or none is known."""
    reason = ((hand or {}).get("approach") or {}).get("reason")
    return f"no free straight way of the palm to the grasp: {reason}" if reason else ""


def grasp_obstructions(hand: Json | None) -> list[str]:
    """Return the obstructions in the grasp itself as text: links that penetrate something, contacts off their links."""
    depth, links = grasp_penetration(hand), (hand or {}).get("fingertips") or ()
    said = []
    if depth is not None and depth.depth > min(depth.tolerance, TOLERANCE):
        allowed = f" ({format_number(1e3 * depth.tolerance)} mm allowed)" if depth.is_free else ""
        said.append(f"{depth.words}{allowed}")
    for i, gap in tip_deviations(hand).items():
        link = f" {links[i]}" if i < len(links) else ""
        said.append(
            f"contact {i} is {format_number(1e3 * gap, 2)} mm off its fingertip's link{link}, by that link's shape"
        )
    return said


def warn_of_touching(name: str, hand: Json | None) -> str:
    """Warn of obstructions in the grasp itself, and return them as text; empty without any.

    Parameters
    ----------
    name : str
        The solution's.
    hand : mapping or None
        The hand's JSON data.
    """
    said, depth = "; and ".join(grasp_obstructions(hand)), grasp_penetration(hand)
    if said:
        said = said if depth is None or depth.is_free else f"Touches: {said}"
        warn(f"{name}: {said}")
    return said


def unknown_links(hand: Json | None) -> str:
    """Return as text the contacts whose links lack shapes where other links have some; empty without any."""
    gaps = (hand or {}).get("tip_gaps") or ()
    bare = [str(i) for i, gap in enumerate(gaps) if gap is None]
    if not bare or grasp_penetration(hand) is None:
        return ""
    which = f"contact{'s' * (len(bare) > 1)} {', '.join(bare)}"
    return f"the links of {which} have no collision shapes, and may be inside anything"


def approach_obstructions(hand: Json | None) -> list[str]:
    """Return the obstructions on the straight approach, as text."""
    said, jaws, way, depth = [], jaws_depth(hand), approach_penetration(hand), grasp_penetration(hand)
    if jaws:
        said.append(f"the gripper's way in leads {format_number(1e3 * jaws, 2)} mm into what is beside it")
    elif passes_through(hand):
        said.append("the gripper's way in passes through something thin")
    if way is not None and not way.is_free and (depth is None or depth.is_free):
        said.append(f"on the way in {way.words}")
    return said + list(filter(None, [missing_approach_reason(hand)]))


def _stated_depth(hand: Json | None, key: str) -> LinkPenetration | None:
    stated = (hand or {}).get(key)
    return None if stated is None else LinkPenetration.from_dict(stated, f"hand.{key}")
