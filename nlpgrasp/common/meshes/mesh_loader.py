"""Reading of mesh files by trimesh, within limits of size."""

from __future__ import annotations

import zipfile
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from nlpgrasp.common.files import KINDS

if TYPE_CHECKING:
    import trimesh

ENDINGS = (*KINDS["a mesh"], *KINDS["a CAD file"])
LARGEST = 512 * 1024 * 1024  # bytes of a mesh file
UNPACKED, RATIO = 16 * 1024 * 1024, 30  # bytes that any archive may unpack to; otherwise how many times its own size


def load_scene(path: Path, process: bool = False) -> trimesh.Scene:
    """Return the scene in a mesh file, by default unprocessed: processing drops NaN vertices unseen.

    Raises
    ------
    ValueError
        When the file is no mesh file, is too large, or has triangles of vertices that it does not have; trimesh's
        readers also raise others.
    ImportError
        When a package that reads the format is missing.
    """
    import trimesh

    if path.suffix.lower() not in ENDINGS:
        raise ValueError(f"a mesh file ends in one of {', '.join(ENDINGS)}")
    size = path.stat().st_size
    if size > LARGEST:
        raise ValueError(f"{size / 2**20:.0f} MiB, of at most {LARGEST // 2**20}")
    if zipfile.is_zipfile(path):
        with zipfile.ZipFile(path) as archive:
            unpacked = sum(member.file_size for member in archive.infolist())
        if unpacked > max(UNPACKED, RATIO * size):
            raise ValueError(f"an archive of {size} bytes that unpacks to {unpacked}")
    scene = trimesh.load(path, force="scene", process=process)
    for geometry in scene.geometry.values():
        if isinstance(geometry, trimesh.Trimesh) and (defect := triangle_defect(geometry)):
            raise ValueError(defect)
    return scene


def triangle_defect(mesh: trimesh.Trimesh) -> str:
    """Return why the arrays of a mesh are no triangles of points in space; empty if they are."""
    vertices, faces = np.shape(mesh.vertices), np.asarray(mesh.faces)
    if len(vertices) != 2 or vertices[1] != 3 or faces.ndim != 2 or faces.shape[1] != 3:
        return f"vertices of shape {vertices} and triangles of shape {faces.shape}"
    if len(faces) and not 0 <= faces.min() <= faces.max() < len(mesh.vertices):
        return f"a triangle of vertices {faces.min()} to {faces.max()}, of {len(mesh.vertices)} vertices"
    return ""
