"""Conversion of tasks, recordings and wrenches to ellipsoids that can be updated."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from nlpgrasp.common.spatial import move_torque_origin, space_dimension
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.errors import InputError
from nlpgrasp.tasks.base import Task
from nlpgrasp.tasks.ellipsoid import TaskEllipsoid
from nlpgrasp.tasks.learnt.enclosing import GAP, enclose, wrench_rows
from nlpgrasp.tasks.learnt.growing.base import Learnt
from nlpgrasp.tasks.learnt.growing.least_volume import LeastVolume
from nlpgrasp.tasks.learnt.growing.moments import Moments
from nlpgrasp.tasks.learnt.growing.normal import Normal
from nlpgrasp.tasks.learnt.recording import WrenchRecording
from nlpgrasp.tasks.library.entry import point_words
from nlpgrasp.tasks.polytope import TaskPolytope

Wrenches = WrenchRecording | TaskPolytope | ArrayLike


@dataclass(frozen=True)
class Given:
    """Input wrenches with their reference point and source.

    Parameters
    ----------
    rows : (n, d) array
    about : (space,) array or None
        Reference point of moments; ``None`` if not stated, which means the entry's.
    source : str
        Provenance.
    """

    rows: FloatArray
    about: FloatArray | None
    source: str

    @classmethod
    def of(cls, value: WrenchRecording | Task | ArrayLike, outliers: float) -> Given:
        """Return the wrenches of a recording, polytope or array, without a share of outliers.

        Raises
        ------
        InputError
            On other types or invalid wrenches.
        """
        if isinstance(value, WrenchRecording):
            found = cls(value.wrenches, np.zeros(3), value.source)
        elif isinstance(value, TaskPolytope):
            found = cls(value.wrenches, value.about, "the corners of a TaskPolytope")
        elif isinstance(value, Task):
            allowed = "a recording, a TaskPolytope or wrenches (m, d); of other tasks a TaskEllipsoid can be added"
            raise InputError("wrenches", f"a {type(value).__name__}", allowed)
        else:
            found = cls(wrench_rows(value), None, "")
        rows = wrench_rows(found.rows)
        if outliers:
            rows = rows[enclose(rows, outliers, None, None, GAP).inside]
        return cls(rows, found.about, found.source)

    def learnt(self, probability: float | None) -> Learnt:
        """Return the minimum-volume ellipsoid of the wrenches, or the covariance ellipsoid of a probability."""
        return LeastVolume.of(self.rows) if probability is None else Normal.of(Moments.of(self.rows), probability)

    def at(self, about: FloatArray | None, dimension: int) -> FloatArray:
        """Return the wrenches with moments about an entry's reference point.

        Raises
        ------
        InputError
            When they have another dimension, or only the entry's point is unknown.
        """
        if self.rows.shape[1] != dimension:
            raise InputError("wrenches", f"dimension {self.rows.shape[1]}", f"dimension {dimension}, that of the entry")
        if self.about is None or (about is not None and np.array_equal(about, self.about)):
            return self.rows
        if about is None:
            given = f"moments about {point_words(self.about)}"
            raise InputError("wrenches", given, f"moments about {point_words(None)}, as the entry's are")
        return np.asarray(self.rows @ move_torque_origin(about - self.about).T)


def learnt_from(
    what: TaskEllipsoid | Wrenches, outliers: float, probability: float | None
) -> tuple[Learnt, FloatArray | None, str]:
    """Return the ellipsoid of a task or wrenches, its reference point of moments and its source."""
    if isinstance(what, TaskEllipsoid):
        if outliers:
            raise InputError("outliers", outliers, "wrenches with it: a TaskEllipsoid is taken as it is")
        if probability is not None:
            raise InputError("probability", probability, "wrenches with it: a TaskEllipsoid is taken as it is")
        return LeastVolume.of_task(what), what.about, ""
    if outliers and probability is not None:
        raise InputError("probability", probability, "a share between 0 and 1, without outliers")
    given = Given.of(what, outliers)
    stated = isinstance(what, WrenchRecording | TaskPolytope)
    about = given.about if stated else np.zeros(space_dimension(given.rows.shape[1]))
    return given.learnt(probability), about, given.source
