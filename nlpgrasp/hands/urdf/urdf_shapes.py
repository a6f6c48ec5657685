"""Collision shapes of a URDF's links."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from nlpgrasp.common.meshes.robot_meshes import find_mesh
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.errors import InputError, MissingExtraError
from nlpgrasp.hands.spheres.shapes import MeshFile, Shape
from nlpgrasp.hands.urdf.urdf_values import numbers


def read_shapes(
    source: Path, links: Mapping[str, ET.Element], names: Sequence[str]
) -> tuple[dict[str, tuple[Shape, ...]], tuple[str, ...]]:
    """Return the collision shapes of the named links, and the mesh files that are missing or unreadable.

    Raises
    ------
    InputError
        On shapes that cannot be made, and where meshes are missing and no link has any other shape.
    MissingExtraError
        On meshes in COLLADA (.dae) without pycollada.
    """
    shapes: dict[str, tuple[Shape, ...]] = {}
    missing: list[str] = []
    for name in names:
        found = []
        for element in links[name].findall("collision"):
            shape = _shape(source, name, element, missing)
            if shape is not None:
                found.append(shape)
        if found:
            shapes[name] = tuple(found)
    if missing and not shapes:
        raise InputError(f"URDFHand.path: {source.name}", "missing " + "; ".join(missing), "mesh files that exist")
    return shapes, tuple(missing)


def _shape(source: Path, link: str, element: ET.Element, missing: list[str]) -> Shape | None:
    label = f"collision of link {link}"
    origin, geometry = element.find("origin"), element.find("geometry")
    pose = np.eye(4)
    if origin is not None:
        pose[:3, 3] = numbers(source, f"{label}, xyz", origin.get("xyz"), np.zeros(3))
        rpy = numbers(source, f"{label}, rpy", origin.get("rpy"), np.zeros(3))
        pose[:3, :3] = Rotation.from_euler("xyz", rpy).as_matrix()
    kind = None if geometry is None or not len(geometry) else geometry[0]
    tag = "" if kind is None else kind.tag
    if kind is None or tag not in ("sphere", "cylinder", "capsule", "box", "mesh"):
        allowed = "a sphere, cylinder, capsule, box or mesh"
        raise InputError(f"URDFHand.path: {source.name}", f"{label} with <{tag or 'nothing'}>", allowed)
    if tag == "mesh":
        return _mesh(source, link, kind, pose, missing)
    keys = {"sphere": ["radius"], "cylinder": ["radius", "length"], "capsule": ["radius", "length"], "box": ["size"]}
    values = [
        numbers(source, f"{label}, {key}", kind.get(key) or "missing", np.ones(3 if key == "size" else 1))
        for key in keys[tag]
    ]
    sizes = np.concatenate(values)
    if np.any(sizes <= 0.0):
        raise InputError(f"URDFHand.path: {source.name}", f"{label}, sizes {sizes.tolist()}", "sizes above zero")
    if tag == "sphere":
        return Shape.sphere(float(sizes[0]), pose)
    if tag == "cylinder":
        return Shape.cylinder(float(sizes[0]), float(sizes[1]), pose)
    if tag == "capsule":
        return Shape.capsule(float(sizes[0]), float(sizes[1]), pose)
    return Shape.box(sizes, pose)


def _mesh(source: Path, link: str, element: ET.Element, pose: FloatArray, missing: list[str]) -> Shape | None:
    import trimesh

    name = element.get("filename", "")
    path = find_mesh(source, name)
    if path is None:
        missing.append(f"{name or 'a mesh without filename'} (link {link})")
        return None
    scale = numbers(source, f"collision of link {link}, scale", element.get("scale"), np.ones(3))
    if np.any(scale == 0.0):
        given = f"collision of link {link}, scale {scale.tolist()}"
        raise InputError(f"URDFHand.path: {source.name}", given, "a scale that is not zero")
    try:
        mesh = trimesh.load(path, force="mesh")
    except ImportError as error:
        if path.suffix.lower() == ".dae":
            raise MissingExtraError(f"{source.name}: reading {path.name} (link {link}, pycollada)", "hands") from None
        missing.append(f"{name} (link {link}: {error})")
        return None
    except Exception as error:  # trimesh's readers raise what their formats raise
        missing.append(f"{name} (link {link}: {type(error).__name__})")
        return None
    if not isinstance(mesh, trimesh.Trimesh) or not len(mesh.faces):
        missing.append(f"{name} (link {link}: no triangles)")
        return None
    if path.suffix.lower() == ".dae":  # the only format here that states its unit
        mesh.apply_scale(trimesh.units.unit_conversion(mesh.units or "meters", "meters"))
    mesh.apply_scale(scale)
    mesh.apply_transform(pose)
    return Shape("mesh", mesh, file=MeshFile.of(name, path))
