"""Penetration of a hand's links into the body and its surroundings, as files state it."""

from __future__ import annotations

from dataclasses import dataclass

from nlpgrasp.common.shown.numbers import rounded
from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import number
from nlpgrasp.errors import InputError

TOLERANCE = 1e-3  # metres: a link that is deeper in anything is not free
MOST_TOLERANCE = 0.01  # metres: no more may be allowed
BODY = "the body"


@dataclass(frozen=True)
class LinkDepth:
    """The deepest penetration of a hand's links, by their own collision shapes.

    Parameters
    ----------
    depth : float
        Metres, at least zero.
    link : str or None
        The link that is so deep.
    thing : str
        What it is in: the body, the table, or an obstacle by its name.
    tolerance : float
        Metres up to which the links count as free.
    postures : int
        How many postures of the hand were looked at.
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
        """The penetration in words."""
        return f"link {self.link} is {rounded(1e3 * self.depth, 2)} mm inside {self.thing}"

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
    def from_dict(cls, data: Json, name: str) -> LinkDepth:
        """Return what ``to_dict`` wrote; files of earlier versions state no thing and no tolerance.

        Raises
        ------
        InputError
            On numbers that are none, or below zero; ``name`` is shown in the message.
        """
        if not isinstance(data, dict) or not {"depth", "samples"} <= data.keys():
            raise InputError(name, data, "a mapping with depth, link and samples")
        lengths = [number(f"{name}.{key}", data.get(key, TOLERANCE), at_least=0.0) for key in ("depth", "tolerance")]
        link = data.get("link")
        thing, postures = str(data.get("thing", BODY)), int(data["samples"])
        return cls(lengths[0], None if link is None else str(link), thing, lengths[1], postures)
