"""How good any placement could be, as a solution states it."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import number
from nlpgrasp.errors import InputError
from nlpgrasp.solution.schema.types import GlobalBoundData


@dataclass(frozen=True)
class GlobalBound:
    """A bound on mu over all placements of a problem's contacts (docs/how_close.md).

    Parameters
    ----------
    upper : float
        No placement has a larger mu.
    nodes : int
        Of the tree that was searched for it.
    dropped : tuple of str
        Parts of the problem that it leaves out: they only lower mu.
    certificate : dict
        What it takes to compute the bound again, or where that is; empty where it was not kept.
    """

    upper: float
    nodes: int
    dropped: tuple[str, ...] = ()
    certificate: Json = field(default_factory=dict, repr=False, compare=False)

    def gap(self, mu: float) -> float:
        """Return ``upper / mu - 1`` for a grasp of this certified quality: how far it is from the best, at most."""
        return max(0.0, self.upper / mu - 1.0) if mu > 0.0 else math.inf

    def to_dict(self, mu: float) -> GlobalBoundData:
        """Return the bound as JSON data beside the grasp's certified quality; a gap that is infinite as null."""
        gap = self.gap(mu)
        data: GlobalBoundData = {
            "upper": self.upper,
            "gap": gap if math.isfinite(gap) else None,
            "nodes": self.nodes,
            "dropped": list(self.dropped),
        }
        return {**data, "certificate": self.certificate} if self.certificate else data

    @classmethod
    def from_dict(cls, data: GlobalBoundData, mu: float, name: str) -> GlobalBound:
        """Return the bound that ``to_dict`` wrote.

        Raises
        ------
        InputError
            When it is below the grasp's certified quality, or its gap is not that of both.
        """
        upper = number(f"{name}.upper", data["upper"], at_least=0.0)
        if upper < mu:
            raise InputError(f"{name}.upper", upper, f"at least the grasp's certified mu, {mu:g}")
        found = cls(upper, int(data.get("nodes", 0)), tuple(data.get("dropped", ())), data.get("certificate", {}))
        stated, gap = data.get("gap"), found.gap(mu)
        if (math.inf if stated is None else stated) != gap and not math.isclose(stated or 0.0, gap, rel_tol=1e-9):
            raise InputError(f"{name}.gap", stated, f"upper over the grasp's certified mu, less 1: {gap:g}")
        return found

    def line(self, mu: float) -> str:
        """Return in words how far a grasp of this certified quality is from the best that any placement allows."""
        without = f" (without {', '.join(self.dropped)})" if self.dropped else ""
        if mu <= 0.0:
            return f"no placement is above {self.upper:.4g}{without}"
        return f"at most {self.gap(mu):.2%} below the best possible: no placement is above {self.upper:.4g}{without}"
