"""Reading of mesh files by trimesh, within limits of size."""

from __future__ import annotations

import zipfile
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from nlpgrasp.common.files import KINDS
from nlpgrasp.errors import InputError

if TYPE_CHECKING:
    import trimesh

ENDINGS = (*KINDS["a mesh"], *KINDS["a CAD file"])
LARGEST = 512 * 1024 * 1024  # bytes of a mesh file
UNPACKED, RATIO = 16 * 1024 * 1024, 30  # bytes that any archive may unpack to; otherwise how many times its own size


def load_scene(path: Path, process: bool = False) -> trimesh.Scene:
    """Return the scene in a mesh file, by default unprocessed: processing drops NaN vertices unseen.

    Raises
    ------
    InputError
        When the file has another ending, is too large, or has triangles of vertices that it does not have.
    ImportError
        When a package that reads the format is missing.
    Exception
        What trimesh's readers raise on damaged files.
    """
    import trimesh

    if path.suffix.lower() not in ENDINGS:
        raise InputError("Mesh.path", path.name, f"a mesh file: {', '.join(ENDINGS)}")
    size = path.stat().st_size
    if size > LARGEST:
        raise InputError("Mesh.path", f"{path.name} of {size / 2**20:.0f} MiB", f"at most {LARGEST // 2**20} MiB")
    if zipfile.is_zipfile(path):
        with zipfile.ZipFile(path) as archive:
            unpacked = sum(member.file_size for member in archive.infolist())
        if unpacked > max(UNPACKED, RATIO * size):
            given = f"{path.name}, an archive of {size} bytes that unpacks to {unpacked}"
            raise InputError("Mesh.path", given, f"at most {UNPACKED // 2**20} MiB, or {RATIO} times its own size")
    scene = trimesh.load(path, force="scene", process=process)
    for geometry in scene.geometry.values():
        if isinstance(geometry, trimesh.Trimesh) and (defect := triangle_defect(geometry)):
            raise InputError("Mesh.path", f"{path.name} with {defect}", "triangles (f, 3) of vertices (v, 3)")
    return scene


def triangle_defect(mesh: trimesh.Trimesh) -> str:
    """Return why the arrays of a mesh are no triangles of points in space; empty if they are."""
    vertices, faces = np.shape(mesh.vertices), np.asarray(mesh.faces)
    if len(vertices) != 2 or vertices[1] != 3 or faces.ndim != 2 or faces.shape[1] != 3:
        return f"vertices of shape {vertices} and triangles of shape {faces.shape}"
    if len(faces) and not 0 <= faces.min() <= faces.max() < len(mesh.vertices):
        return f"a triangle of vertices {faces.min()} to {faces.max()}, of {len(mesh.vertices)} vertices"
    return ""
