"""Penetration of a hand's links into the body and its surroundings."""

from __future__ import annotations

from dataclasses import dataclass

from nlpgrasp.common.shown.numbers import rounded
from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import number
from nlpgrasp.errors import InputError

TOLERANCE = 1e-3  # metres: default penetration up to which links count as free
MOST_TOLERANCE = 0.01  # metres: largest tolerance that may be chosen
BODY = "the body"


@dataclass(frozen=True)
class LinkDepth:
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
