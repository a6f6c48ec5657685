"""Upper bound on the quality over all placements of the contacts."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

from nlpgrasp.common.files import write_text
from nlpgrasp.common.shown.numbers import at_most
from nlpgrasp.common.shown.words import headroom_words
from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import number
from nlpgrasp.errors import InputError
from nlpgrasp.solution.schema.types import GlobalBoundData

SCHEMA = "nlpgrasp-bound/1"
SMALL = 200_000  # bytes: largest certificate stored inside another file
LOOSE = 0.5  # gap above which a bound of a relaxed problem counts as loose


def is_small(certificate: Json) -> bool:
    """Return whether a certificate is small enough to be stored inside another file."""
    return len(json.dumps(certificate, separators=(",", ":"))) <= SMALL


def write_bound(data: Json, path: str | Path) -> Path:
    """Write the data of a bound file atomically, and return the path.

    Raises
    ------
    InputError
        When the folder does not exist or cannot be written.
    """
    return write_text(path, json.dumps(data, allow_nan=False, separators=(",", ":")) + "\n")


def reference(path: str | Path) -> Json:
    """Return the name and SHA-256 of a bound file, for reference from files beside it.

    Raises
    ------
    InputError
        When it cannot be read.
    """
    file = Path(path)
    try:
        return {"file": file.name, "sha256": hashlib.sha256(file.read_bytes()).hexdigest()}
    except OSError as error:
        raise InputError("file", f"{path}: {error.strerror}", "a saved bound") from None


@dataclass(frozen=True)
class GlobalBound:
    """A bound on mu over all placements of a problem's contacts (docs/how_close.md).

    Parameters
    ----------
    upper : float
        Upper bound on mu.
    nodes : int
        Nodes of the search tree.
    dropped : tuple of str
        Relaxed parts of the problem: they only lower mu.
    certificate : dict
        Data from which the bound can be recomputed, or the name and digest of the bound file that holds them; empty if
        they were not kept.
    stated_gap : float or None
        Gap as stated in a file, inf for null; None for a bound from a search.
    """

    upper: float
    nodes: int
    dropped: tuple[str, ...] = ()
    certificate: Json = field(default_factory=dict, repr=False, compare=False)
    stated_gap: float | None = field(default=None, repr=False, compare=False)

    def gap(self, mu: float) -> float:
        """Return the relative optimality gap ``upper / mu - 1`` of a grasp of this certified quality."""
        return max(0.0, self.upper / mu - 1.0) if mu > 0.0 else math.inf

    def to_dict(self, mu: float) -> GlobalBoundData:
        """Return the bound as JSON data, with the gap of a grasp of this quality; an infinite gap is null."""
        gap = self.gap(mu) if self.stated_gap is None else self.stated_gap
        data: GlobalBoundData = {
            "upper": self.upper,
            "gap": gap if math.isfinite(gap) else None,
            "nodes": self.nodes,
            "dropped": list(self.dropped),
        }
        return {**data, "certificate": self.certificate} if self.certificate and is_small(self.certificate) else data

    def saved_beside(self, problem: Mapping[str, object], path: Path) -> GlobalBound:
        """Write a certificate that is too large for a solution file to a bound file; return a bound that names it.

        Parameters
        ----------
        problem : mapping
            As JSON data.
        path : Path
            Of the solution file; ``F.json`` has its bound in ``F.bound.json``.

        Raises
        ------
        InputError
            When the file cannot be written.
        """
        if not self.certificate or is_small(self.certificate):
            return self
        data = {
            "schema": SCHEMA,
            "upper": self.upper,
            "gap": None,
            "closed": False,
            "nodes": self.nodes,
            "seconds": 0.0,
            "dropped": list(self.dropped),
            "problem": dict(problem),
            "grasp": None,
            "certificate": self.certificate,
        }
        return replace(self, certificate=reference(write_bound(data, path.with_suffix(".bound.json"))))

    @classmethod
    def from_dict(cls, data: GlobalBoundData, name: str) -> GlobalBound:
        """Return the bound that ``to_dict`` wrote; the stated gap is checked by ``verify``."""
        upper, gap = number(f"{name}.upper", data["upper"], at_least=0.0), data.get("gap")
        dropped, certificate = tuple(data.get("dropped", ())), data.get("certificate", {})
        return cls(upper, int(data.get("nodes", 0)), dropped, certificate, math.inf if gap is None else gap)

    def line(self, mu: float, label: str = "mu") -> str:
        """Return the optimality gap of a grasp of this certified quality, as text.

        Parameters
        ----------
        mu : float
            Certified quality of the grasp.
        label : str
            The measure's name.
        """
        told, gap = f"{label} is at most {at_most(self.upper, 4)} anywhere", self.gap(mu)
        if not math.isfinite(gap):
            return f"{told}{self.ignored()}"
        if self.is_loose(gap):
            return f"a loose bound on the best possible: {told}{self.ignored()}"
        return f"{headroom_words(gap)}{self.ignored()}: {told}"

    def is_loose(self, gap: float) -> bool:
        """Return whether the bound relaxes parts of the problem and its gap is too wide to rate a grasp."""
        return bool(self.dropped) and LOOSE < gap < math.inf

    def ignored(self) -> str:
        """Return the relaxed parts of the problem as text; empty without any."""
        *first, last = self.dropped or ("",)
        parts = " and ".join(filter(None, (", ".join(first), last)))
        return f", even ignoring {parts}" if parts else ""
