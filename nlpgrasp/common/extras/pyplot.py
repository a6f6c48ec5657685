"""matplotlib (extra ``viz``), for pictures in files."""

from __future__ import annotations

import os
from io import BytesIO
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING

from nlpgrasp.common.files import write_bytes
from nlpgrasp.errors import InputError, MissingExtraError

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def pyplot(what: str) -> ModuleType:
    """Return matplotlib's pyplot, drawing to files alone.

    Raises
    ------
    MissingExtraError
        When matplotlib is not installed; ``what`` is what needs it.
    """
    try:
        import matplotlib as mpl

        mpl.use("Agg")
        from matplotlib import pyplot as plt
    except ImportError:
        raise MissingExtraError(what, "viz") from None
    except ValueError as error:
        raise InputError("MPLBACKEND", os.environ.get("MPLBACKEND"), f"a backend of matplotlib ({error})") from None
    return plt


def write_figure(plt: ModuleType, figure: Figure, path: str | Path, dpi: int = 130) -> Path:
    """Write a figure as PNG, whole or not at all, and close it; return the path.

    Raises
    ------
    InputError
        When the file cannot be written.
    """
    image = BytesIO()
    figure.savefig(image, dpi=dpi)
    plt.close(figure)
    return write_bytes(path, image.getvalue())
