"""Incremental minimum-volume ellipsoid around all recorded wrenches, with bounded memory.

Up to ``MOST`` wrenches are kept individually: as long as there are no more, an update is a fit of all. When there are
more, the innermost are discarded until ``LEAST`` are left. The current ellipsoid, shrunk to the outermost of those
discarded, becomes a cover that represents them, together with their covariance ellipsoid, which stays small if the
former was stretched by outliers that are removed later.

Guarantees:

- Every wrench that was given and not removed is inside, to 1e-9 of the ellipsoid's size (across a flat ellipsoid, to
  1e-7 of the wrenches' extents). By induction each is kept or in a cover: wrenches discarded at one time are in their
  cover, which never changes and is dropped only when it lies in a new one. The updated ellipsoid contains the kept
  wrenches, and the covers by an upper bound of their level (``Cover.farthest``).
- Its volume is at most ``1 + gap`` times the minimum around all of them. The dual weights bound the minimum volume
  around the kept wrenches from below, hence also that around all. Covers that extend beyond that ellipsoid enlarge it
  more than necessary; the gap says by how much.

The gap has no a-priori bound: no summary of bounded size has one in six dimensions, where millions of points are
needed to approximate a ball to 0.2 % of its radius. If wrenches come from one distribution or drift, covers lie deep
inside later ellipsoids, and the gap stays that of the search, 1e-5.
"""

from __future__ import annotations

import base64
import binascii
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray, array
from nlpgrasp.errors import InputError
from nlpgrasp.tasks.ellipsoid import TaskEllipsoid
from nlpgrasp.tasks.learnt.enclosing import NEAR, trimmed
from nlpgrasp.tasks.learnt.growing.around import GAP, Around, least_around
from nlpgrasp.tasks.learnt.growing.base import Learnt, outlier_share
from nlpgrasp.tasks.learnt.growing.cover import Cover, Shape
from nlpgrasp.tasks.learnt.growing.moments import Moments
from nlpgrasp.tasks.learnt.local import ROUNDING, Local
from nlpgrasp.tasks.learnt.min_volume import levels

MOST, LEAST = 8192, 4096  # wrenches kept individually: most, and number after thinning
NUMBERS = np.dtype("<f8")  # number format of kept wrenches in files


@dataclass(frozen=True)
class LeastVolume(Learnt):
    """Incremental minimum-volume ellipsoid around wrenches and given task ellipsoids.

    Parameters
    ----------
    center, axes, moments, forgotten
        See ``Learnt``.
    gap : float or None
        Certified relative excess of its volume over the minimum; ``None`` if unknown.
    kept : (n, d) array
        Wrenches kept individually.
    covers : tuple of Cover
        Covers of the discarded wrenches and given ellipsoids.
    """

    kind: ClassVar[str] = "least volume"
    gap: float | None
    kept: FloatArray
    covers: tuple[Cover, ...]

    @classmethod
    def of(cls, rows: FloatArray) -> LeastVolume:
        """Return the minimum-volume ellipsoid around wrenches (n, d)."""
        nothing = rows[:0]
        around = least_around(rows, (), None)
        return cls._made(around, Moments.of(nothing), 0, nothing, ())._with(rows, (), Moments.of(rows))

    @classmethod
    def of_task(cls, task: TaskEllipsoid) -> LeastVolume:
        """Return a fit that starts from a given task ellipsoid, which updates will enclose too."""
        none = Moments.of(np.zeros((0, task.dimension)))
        cover = Cover((Shape(task.center, task.axes),), given=True)
        return cls(task.center, task.axes, none, 0, 0.0, np.zeros((0, task.dimension)), (cover,))

    @classmethod
    def _made(
        cls, around: Around, moments: Moments, forgotten: int, kept: FloatArray, covers: tuple[Cover, ...]
    ) -> LeastVolume:
        return cls(around.center, around.axes, moments, forgotten, around.gap, kept, covers)

    def words(self) -> str:
        """Return a text on the certified volume."""
        if not self.wrenches:
            return "as given"
        known = "not known" if self.gap is None else f"at most {self.gap:.1g} above the least"
        return f"of least volume around {self.wrenches} wrenches, {known}"

    def updated(self, rows: FloatArray) -> LeastVolume:
        """Return the minimum-volume ellipsoid around all previous and new wrenches."""
        return self._with(rows, (), Moments.of(rows))

    def merged(self, other: Learnt) -> LeastVolume:
        """Return the minimum-volume ellipsoid around all wrenches and given tasks of both."""
        self.check_alike(other)
        if not isinstance(other, LeastVolume):
            raise InputError("fit.kind", other.kind, f"{self.kind!r}, that of the other")
        merged = self._with(other.kept, other.covers, other.moments)
        return self._made(
            Around(merged.center, merged.axes, merged.gap),
            merged.moments,
            self.forgotten + other.forgotten,
            merged.kept,
            merged.covers,
        )

    def _with(self, rows: FloatArray, covers: tuple[Cover, ...], moments: Moments) -> LeastVolume:
        """Return the minimum-volume ellipsoid around its own contents, more wrenches and more covers."""
        kept, all_covers = np.concatenate([self.kept, rows]), self.covers + covers
        around = least_around(kept, all_covers, Around(self.center, self.axes, self.gap))
        kept, all_covers = _thinned(kept, all_covers, around)
        return self._made(around, self.moments.plus(moments), self.forgotten, kept, all_covers)

    def without_outliers(self, share: float) -> tuple[LeastVolume, FloatArray]:
        """Return the minimum-volume ellipsoid without a share of outliers, and the removed wrenches (k, d).

        The farthest wrenches are trimmed iteratively, as by ``fit_ellipsoid``; only wrenches kept individually, which
        include the outermost, can be removed.

        Raises
        ------
        InputError
            On a share of half or more of those, or one that leaves wrenches that do not span.
        """
        many = int(outlier_share(share) * self.wrenches)
        if many == 0:
            return self, self.kept[:0]
        if 2 * many >= len(self.kept):
            most = (len(self.kept) - 1) / 2 / self.wrenches
            raise InputError("share", share, f"at most {most:.3g}: {len(self.kept)} wrenches are kept one by one")
        local = Local.of(self.kept)
        found = trimmed(local.points, (many + 0.5) / len(self.kept), GAP, False)
        inside = levels(local.points, found.center, found.axes) <= 1.0 + NEAR
        left, out = self.kept[inside], self.kept[~inside]
        around = least_around(left, self.covers, None)
        moments = self.moments.minus(Moments.of(out))
        return self._made(around, moments, self.forgotten + len(out), left, self.covers), out

    def to_dict(self) -> Json:
        """Return the fit as JSON data; kept wrenches as little-endian doubles in base64, row by row."""
        text = base64.b64encode(np.ascontiguousarray(self.kept, dtype=NUMBERS).tobytes()).decode("ascii")
        return {
            "kind": self.kind,
            "gap": self.gap,
            "forgotten": self.forgotten,
            "moments": self.moments.to_dict(),
            "covers": [cover.to_dict() for cover in self.covers],
            "kept": text,
        }

    @classmethod
    def from_dict(cls, data: Json, task: TaskEllipsoid) -> LeastVolume:
        """Return the fit from the data of its ``to_dict`` and its ellipsoid."""
        d = task.dimension
        covers = tuple(Cover.from_dict(one, d, f"fit.covers.{i}") for i, one in enumerate(data["covers"]))
        moments = Moments.from_dict(data["moments"], d)
        kept = _kept(data["kept"], d)
        if len(kept) > moments.count or not len(kept) + len(covers):
            raise InputError("fit.kept", f"{len(kept)} wrenches", f"wrenches or covers, at most {moments.count}")
        return cls(task.center, task.axes, moments, data["forgotten"], data["gap"], kept, covers)


def _kept(text: str, dimension: int) -> FloatArray:
    """Decode kept wrenches (n, d) from base64 text."""
    try:
        content = base64.b64decode(text, validate=True)
    except binascii.Error:
        raise InputError("fit.kept", "a text that is not base64", "numbers in base64") from None
    row = dimension * NUMBERS.itemsize
    if len(content) % row:
        raise InputError("fit.kept", f"{len(content)} bytes", f"rows of {row}: {dimension} numbers a wrench")
    return array("fit.kept", np.frombuffer(content, NUMBERS).reshape(-1, dimension), (None, dimension))


def _thinned(kept: FloatArray, covers: Sequence[Cover], around: Around) -> tuple[FloatArray, tuple[Cover, ...]]:
    """Return wrenches and covers, with the innermost wrenches replaced by a cover if there are too many."""
    if len(kept) > MOST:
        kept = np.unique(kept, axis=0)
    if len(kept) <= MOST:
        return kept, tuple(covers)
    local = Local.of(np.concatenate([kept, *(cover.ends() for cover in covers)]))
    ellipsoid = around.within(local)
    if ellipsoid is None:  # rounding at the edge of being flat
        return kept, tuple(covers)
    level = levels(local.inward(kept), ellipsoid.center, ellipsoid.axes)
    order = np.argsort(level, kind="stable")
    inner = kept[order[:-LEAST]]
    rho = float(level[order[-LEAST - 1]])
    made = Cover((Shape(around.center, rho * around.axes), _shaped(inner)))
    shrunk = replace(ellipsoid, axes=rho * ellipsoid.axes)
    others = [c for c in covers if c.given or c.within(local).farthest(shrunk)[0] > 1.0]
    return kept[np.sort(order[-LEAST:])], (*others, made)


def _shaped(rows: FloatArray) -> Shape:
    """Return an enclosing ellipsoid of wrenches (n, d) with the shape of their covariance."""
    local = Local.of(rows)
    values, vectors = np.linalg.eigh(local.points.T @ local.points / len(rows))
    axes = np.sqrt(values)[:, None] * vectors.T
    reach = float(np.max(levels(local.points, np.zeros(len(values)), axes))) * (1.0 + ROUNDING)
    return Shape(local.about, local.outward_axes(reach * axes))
