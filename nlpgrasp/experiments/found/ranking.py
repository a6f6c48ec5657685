"""Ranking of certified intervals, with overlaps as ties."""

from __future__ import annotations

from collections.abc import Sequence

from nlpgrasp.quality import Bounds


def ranks(bounds: Sequence[Bounds]) -> list[int]:
    """Return for each interval 1 plus the number of intervals wholly above it."""
    return [1 + sum(other.lower > one.upper for other in bounds) for one in bounds]


def ties(bounds: Sequence[Bounds]) -> list[tuple[int, ...]]:
    """Return for each interval the indices of the others that it overlaps."""
    return [
        tuple(j for j, other in enumerate(bounds) if j != i and one.lower <= other.upper and other.lower <= one.upper)
        for i, one in enumerate(bounds)
    ]
