"""Optional packages that are imported on demand: MuJoCo, viser, Matplotlib with drawing functions."""

from __future__ import annotations

import os
from collections.abc import Sequence
from importlib import import_module
from io import BytesIO
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING
from xml.etree import ElementTree

import numpy as np

from nlpgrasp.common.drawing import Triangles
from nlpgrasp.common.files import write_bytes
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.errors import InputError, MissingExtraError

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from mpl_toolkits.mplot3d import Axes3D
    from mujoco import MjSpec


LIGHT = np.array([0.4, 0.3, 0.85])  # direction to the light of pictures
SEAM = 0.8  # points: width of lines over the seams between triangles
ZOOM = 1.4  # matplotlib leaves wide margins


def import_mujoco(feature: str, extra: str = "sim") -> ModuleType:
    """Return the package ``mujoco``, imported on demand.

    Raises
    ------
    MissingExtraError
        When it is not installed; ``feature`` names the feature that needs it, and ``extra`` what installs it.
    """
    try:
        return import_module("mujoco")
    except ImportError:
        raise MissingExtraError(feature, extra) from None


def mjcf_spec(path: Path) -> MjSpec:
    """Return MuJoCo's specification of an MJCF file, whatever its ending: MuJoCo itself goes by ``.xml``.

    Raises
    ------
    ValueError
        When MuJoCo cannot read it.
    """
    mujoco = import_mujoco(f"{path.name}: reading MJCF")
    if path.suffix == ".xml":
        return mujoco.MjSpec.from_file(str(path))
    spec = mujoco.MjSpec.from_string(path.read_text("utf-8"), include=_included_files(path, path.parent))
    spec.modelfiledir = str(path.parent)
    return spec


def _included_files(path: Path, folder: Path) -> dict[str, bytes]:
    """Return the files that an MJCF includes, and those that they include, by name."""
    result: dict[str, bytes] = {}
    waiting = [path]
    for file in waiting:
        for element in ElementTree.fromstring(file.read_bytes()).iter("include"):  # noqa: S314  (the user's own file)
            name = element.get("file", "")
            if name and name not in result and (folder / name).is_file():
                result[name] = (folder / name).read_bytes()
                waiting.append(folder / name)
    return result


def import_viser(feature: str) -> ModuleType:
    """Return the package ``viser``, imported on demand.

    Raises
    ------
    MissingExtraError
        When it is not installed; ``feature`` names the feature that needs it.
    """
    try:
        return import_module("viser")
    except ImportError:
        raise MissingExtraError(feature, "view") from None


def pyplot(feature: str) -> ModuleType:
    """Return matplotlib's pyplot with a backend that only writes files, imported on demand.

    Raises
    ------
    MissingExtraError
        When matplotlib is not installed; ``feature`` names the feature that needs it.
    InputError
        When the environment names an unknown backend.
    """
    try:
        import_module("matplotlib").use("Agg")
        return import_module("matplotlib.pyplot")
    except ImportError:
        raise MissingExtraError(feature, "viz") from None
    except ValueError as error:
        raise InputError("MPLBACKEND", os.environ.get("MPLBACKEND"), f"a backend of matplotlib ({error})") from None


def write_figure(figure: Figure, path: str | Path, dpi: int = 130) -> Path:
    """Write a figure to a PNG file atomically, close the figure, and return the file's path.

    Raises
    ------
    InputError
        When the file cannot be written.
    """
    image = BytesIO()
    figure.savefig(image, dpi=dpi)
    pyplot("a picture").close(figure)
    return write_bytes(path, image.getvalue())


def draw_triangles(ax: Axes3D, shape: Triangles, colour: str, opacity: float) -> None:
    """Draw a triangulated surface with directional shading.

    Parameters
    ----------
    ax : Axes3D
    shape : Triangles
    colour : str
        As ``#rrggbb``.
    opacity : float
        From 0 to 1.
    """
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    corners = shape.vertices[shape.faces]  # (m, 3, 3)
    faces = Poly3DCollection(corners, facecolors=_shade(corners, colour), alpha=opacity, linewidths=0.0)
    faces.set_antialiased(False)  # seams between triangles look like edges
    ax.add_collection3d(faces)


def draw_solids(ax: Axes3D, solids: Sequence[tuple[FloatArray, str]]) -> None:
    """Draw opaque triangulated surfaces that hide each other correctly, with directional shading.

    Parameters
    ----------
    ax : Axes3D
    solids : sequence of ((m, 3, 3) array, str)
        Small triangles, which are sorted by their distance, and the colour as ``#rrggbb``.
    """
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    corners = np.concatenate([triangles for triangles, _ in solids])
    colours = np.concatenate([_shade(triangles, colour) for triangles, colour in solids])
    # edges of a face's own colour cover the seams between triangles
    ax.add_collection3d(Poly3DCollection(corners, facecolors=colours, edgecolors=colours, linewidths=SEAM))


def show_at_one_scale(ax: Axes3D, points: FloatArray) -> None:
    """Set equal scales on all axes so that points (n, 3) are visible, and hide the axes."""
    low, high = points.min(axis=0), points.max(axis=0)
    half = 0.5 * float(np.max(high - low)) or 1.0
    for setter, middle in zip((ax.set_xlim, ax.set_ylim, ax.set_zlim), 0.5 * (low + high), strict=True):
        setter(middle - half, middle + half)
    ax.set_box_aspect((1, 1, 1), zoom=ZOOM)
    ax.set_axis_off()


def _shade(corners: FloatArray, colour: str) -> FloatArray:
    """Return the shaded colour (m, 3) of each triangle."""
    base = np.array([int(colour[i : i + 2], 16) for i in (1, 3, 5)]) / 255.0
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals = normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)
    light = 0.65 + 0.35 * normals @ (LIGHT / np.linalg.norm(LIGHT))
    return np.asarray(np.clip(base * light[:, None], 0.0, 1.0))
