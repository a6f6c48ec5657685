"""Plot of a fitted task ellipsoid, by matplotlib (extra ``viz``)."""

from __future__ import annotations

from itertools import combinations
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from nlpgrasp.common.extras.pyplot import pyplot
from nlpgrasp.common.shown.palette import COLOURS
from nlpgrasp.common.shown.words import axis_labels
from nlpgrasp.common.validation import FloatArray, array
from nlpgrasp.errors import InputError
from nlpgrasp.tasks.learnt.fit import EllipsoidFit

MOST_POINTS = 5000  # most points of each kind
ROUND = np.linspace(0.0, 2.0 * np.pi, 181)
FORMATS = (".png", ".svg", ".pdf")


def draw_fit(fit: EllipsoidFit, wrenches: ArrayLike, path: str | Path) -> Path:
    """Draw a fitted ellipsoid over its wrenches, projected on each pair of components; return the path.

    Parameters
    ----------
    fit : EllipsoidFit
        Result of ``fit_ellipsoid``.
    wrenches : (m, d) array
        The fitted wrenches, newtons and newton-metres.
    path : str or Path
        Of the picture; its ending says the format (png, svg, pdf).

    Raises
    ------
    MissingExtraError
        When matplotlib is not installed.
    InputError
        On wrenches of another shape, or a path that cannot be written.
    """
    plt = pyplot("draw_fit")
    if not isinstance(fit, EllipsoidFit):
        raise InputError("fit", fit, "what ng.fit_ellipsoid returns")
    if not isinstance(path, str | Path) or Path(path).suffix.lower() not in FORMATS:
        raise InputError("path", path, "a file name that ends in " + ", ".join(FORMATS))
    rows = array("wrenches", wrenches, (len(fit.inside), fit.task.dimension))
    d = fit.task.dimension
    labels = axis_labels(d)
    figure, axes = plt.subplots(d - 1, d - 1, figsize=(2.0 * d, 2.0 * d), layout="constrained", squeeze=False)
    step = max(1, len(rows) // MOST_POINTS)
    shown, inside = rows[::step], fit.inside[::step]
    for i, j in combinations(range(d), 2):
        ax = axes[j - 1, i]
        ax.scatter(*shown[inside][:, [i, j]].T, s=2, color="0.6", linewidths=0, rasterized=True)
        ax.scatter(*shown[~inside][:, [i, j]].T, s=6, color=COLOURS["warning"], linewidths=0, rasterized=True)
        ax.plot(*_shadow(fit, i, j), color=COLOURS["task"], linewidth=1.2)
        if j == d - 1:
            ax.set_xlabel(labels[i])
        if i == 0:
            ax.set_ylabel(labels[j])
        ax.tick_params(labelsize=6)
    for i in range(d - 1):
        for j in range(i):
            axes[j, i].axis("off")
    figure.suptitle(str(fit), fontsize=9)
    target = Path(path)
    try:
        figure.savefig(target, dpi=130)
    except (OSError, ValueError) as error:
        raise InputError("path", f"{target}: {error}", "a file that can be written, such as fit.png") from None
    finally:
        plt.close(figure)
    return target


def _shadow(fit: EllipsoidFit, i: int, j: int) -> FloatArray:
    """Return the outline of the ellipsoid's projection on two components, (2, m)."""
    both = fit.task.axes[:, [i, j]]
    _, s, vt = np.linalg.svd(both, full_matrices=False)
    outline = (np.stack([np.cos(ROUND), np.sin(ROUND)], axis=1)[:, : len(s)] * s) @ vt
    return np.asarray((fit.task.center[[i, j]] + outline).T)
