"""What a global search found: a bound on mu over all placements, and the best grasp met."""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from pathlib import Path

from nlpgrasp.common.files import write_text
from nlpgrasp.common.types import Json
from nlpgrasp.grasp.grasp import Grasp
from nlpgrasp.quality import Bounds


@dataclass(frozen=True)
class BestPossible:
    """A bound on mu over all placements of the contacts, and the best grasp met on the way.

    Parameters
    ----------
    upper : float
        No placement has a larger mu. A proof: it holds however early the search was stopped.
    grasp : Grasp or None
        The best grasp met, of the problem without what was left out; ``None`` where none resists the task.
    mu : Bounds
        Its certified quality; 0 to 0 where there is no grasp.
    faces : tuple of str
        The faces that its contacts are on.
    closed : bool
        Whether the gap is as small as was asked for.
    nodes : int
        Of the tree that was searched.
    seconds : float
        Wall time.
    dropped : tuple of str
        Parts of the problem that were left out because the bound does not cover them, such as a hand or constraints
        between contacts. They only lower mu: the bound holds for the problem with them as well, the grasp may not.
    certificate : dict
        What it takes to compute the bound again (docs/how_close.md).
    """

    upper: float
    grasp: Grasp | None
    mu: Bounds
    faces: tuple[str, ...]
    closed: bool
    nodes: int
    seconds: float
    dropped: tuple[str, ...] = ()
    certificate: Json = field(default_factory=dict, repr=False, compare=False)

    @property
    def gap(self) -> float:
        """``upper / mu.lower - 1``: by how much of its own quality the grasp misses the bound; inf without a grasp."""
        if self.mu.lower > 0.0:
            return self.upper / self.mu.lower - 1.0
        return 0.0 if self.upper == 0.0 else float("inf")

    def gap_of(self, mu: float) -> float:
        """Return the gap of another grasp of this certified quality; inf where it has none."""
        return max(0.0, self.upper / mu - 1.0) if mu > 0.0 else float("inf")

    def save(self, path: str | Path) -> Path:
        """Write bound and certificate as JSON, whole or not at all, and return the path.

        Raises
        ------
        InputError
            When the folder does not exist or cannot be written.
        """
        return write_text(path, json.dumps(self.to_dict(), allow_nan=False) + "\n")

    def to_dict(self) -> Json:
        """Return the bound as JSON data; a gap that is infinite as null."""
        grasp = None
        if self.grasp is not None:
            points, normals = self.grasp.points.tolist(), self.grasp.normals.tolist()
            grasp = {"positions": points, "normals": normals, "faces": list(self.faces), "mu": self.mu.to_dict()}
        return {
            "schema": "nlpgrasp-bound/1",
            "upper": self.upper,
            "gap": self.gap if self.gap < float("inf") else None,
            "closed": self.closed,
            "nodes": self.nodes,
            "seconds": self.seconds,
            "dropped": list(self.dropped),
            "grasp": grasp,
            "certificate": self.certificate,
        }

    def __str__(self) -> str:
        without = f", without {', '.join(self.dropped)}" if self.dropped else ""
        if self.grasp is None:
            return f"mu at most {self.upper:.4g} over all placements{without}; no grasp met ({self.nodes} nodes)"
        found = f"best met {self.mu.lower:.4g}, within {100.0 * self.gap:.2g} %"
        return f"mu at most {self.upper:.4g} over all placements{without}; {found} ({self.nodes} nodes)"
