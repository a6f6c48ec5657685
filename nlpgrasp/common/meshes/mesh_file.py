"""Reading, scaling, validation and repair of meshes.

Both bodies and the independent verification read meshes here; the digest shows whether both have the same triangles.
"""

from __future__ import annotations

import hashlib
import re
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from nlpgrasp.common.files import file_kind
from nlpgrasp.common.meshes.mesh_loader import load_scene, triangle_defect
from nlpgrasp.common.meshes.outer_surface import outer_surface
from nlpgrasp.common.meshes.search_tree import OPEN_SHARE, local_origin, relative_to, unclear_fraction
from nlpgrasp.common.meshes.topology import count_open_edges, drop_duplicates, is_plain, merge_mesh_vertices
from nlpgrasp.common.user_warnings import warn_once
from nlpgrasp.common.validation import LENGTHS, LONGEST_BODY, UNITS, FloatArray, IntArray, check_body_size, metres_per
from nlpgrasp.errors import InputError

if TYPE_CHECKING:
    import trimesh


COARSE = 1e-4  # of the longest side: rounding step above which a warning is due
LOST = 0.02  # of the longest side: rounding step above which the shape is lost
DOUBLE = 4.0 * np.finfo(float).eps  # relative error of a scaled coordinate
DIGITS = 9  # significant decimal digits up to which a coordinate counts as decimal
SMALLEST = 1e-300  # against division by zero
LARGE = 3.0  # m, length above which another unit is suspected
STEP = (".step", ".stp")
IN_METRES = (".glb", ".gltf", *STEP)  # glTF by its specification, STEP as its reader converts it
WITH_UNIT = (".3mf", ".dae", ".zae", ".3dxml")  # formats that state a unit, or have one by default
HEAD, STL_HEADER = 8192, 80  # bytes in which comments are looked at
# a comment of an OBJ or PLY file that is nothing but a unit; the header of an STL file as Materialise writes it
UNIT_COMMENT = re.compile(
    rb"^(?:#|comment|obj_info)[ \t]*(?:(?:file|length)[ \t]+)?units?(?:[ \t]*[:=][ \t]*|[ \t]+)"
    rb"([a-z]+)(?:[ \t]*\([a-z]+\))?\.?[ \t\r]*$",
    re.I | re.M,
)
STL_UNIT = re.compile(rb"\bUNITS=[ \t]*([a-z]+)", re.I)


def coarse_rounding_warning(vertices: FloatArray) -> str | None:
    """Return a warning if vertices (v, 3), metres, were rounded to coarse single precision, else None.

    The file's unit is unknown here, since vertices are already scaled to metres; all known units are tried.

    Raises
    ------
    InputError
        When the steps are so coarse that the shape is lost.
    """
    longest, farthest = float(np.max(np.ptp(vertices, axis=0))), float(np.max(np.abs(vertices)))
    if float(np.spacing(np.float32(farthest))) <= COARSE * longest / 2.0:  # scaling moves it by less than 2
        return None
    for factor in UNITS.values():
        coordinates = vertices / factor
        step = factor * float(np.spacing(np.float32(np.max(np.abs(coordinates)))))
        if step > COARSE * longest and _is_single(coordinates) and not _is_decimal(coordinates):
            text = f"coordinates of single precision, in steps of {1e3 * step:.2g} mm this far from the origin"
            description = f"{text} ({farthest:.4g} m), which is coarse for a part of {1e3 * longest:.3g} mm"
            if step > LOST * longest:
                raise InputError("Mesh.vertices", description, "a part exported near the origin")
            return f"the mesh has {description}: export it near the origin"
    return None


def _is_single(coordinates: FloatArray) -> bool:
    """Return whether coordinates (v, 3) are single-precision numbers, up to scaling errors."""
    return bool(np.all(np.abs(coordinates - coordinates.astype(np.float32)) <= DOUBLE * np.abs(coordinates)))


def _is_decimal(coordinates: FloatArray) -> bool:
    """Return whether coordinates (v, 3) are decimal numbers with few digits."""
    largest = np.maximum(np.abs(coordinates), SMALLEST)
    scale = 10.0 ** (DIGITS - 1 - np.floor(np.log10(largest)))
    return bool(np.all(np.abs(coordinates * scale - np.round(coordinates * scale)) <= DOUBLE * scale * largest))


def read_mesh(path: str | Path, unit: str | None = None, scale: float = 1.0) -> tuple[trimesh.Trimesh, str]:
    """Return the mesh in a file, scaled to metres, and the unit of its coordinates.

    The coordinates are multiplied by ``scale``. Without a ``unit`` it is the one that the file states, else metres.

    Raises
    ------
    InputError
        When the file does not exist, trimesh cannot read it, it has no triangles, or the unit is unknown or another one
        than the file states.
    """
    import trimesh

    file = Path(path)
    if unit is not None:
        metres_per("Mesh.unit", unit)
    if not file.is_file():
        raise InputError("Mesh.path", str(path), "a mesh file that exists")
    try:
        scene = load_scene(file)
        loaded = _one_mesh(scene)
    except InputError:
        raise
    except ImportError:
        if file_kind(file) == "a CAD file":
            cure = "a mesh: export an STL from the CAD system; STEP files alone are read with pip install cascadio"
            raise InputError("Mesh.path", f"{path}, a CAD file", cure) from None
        allowed = "a mesh file trimesh can read (STL, OBJ, PLY, OFF, GLB, ...)"
        raise InputError("Mesh.path", f"{path}, which is not of the format its name says", allowed) from None
    except Exception as error:
        reason = f"{path} ({type(error).__name__}: {error})"
        raise InputError("Mesh.path", reason, "a mesh file trimesh can read (STL, OBJ, PLY, OFF, GLB, ...)") from None
    if not isinstance(loaded, trimesh.Trimesh) or not len(loaded.faces):
        raise InputError("Mesh.path", f"{path} without triangles", "a triangle mesh")
    stated = stated_unit(file, scene)
    if stated is not None and unit not in (None, stated):
        factor = metres_per("Mesh.unit", unit) / metres_per("Mesh.unit", stated)
        allowed = f"none: {file.name} states {stated}; scale={factor:g} makes up for a file that states a wrong one"
        if file.suffix.lower() in STEP:
            allowed = f"none: {file.name} states its unit, from which it is converted to metres when it is read"
        raise InputError("Mesh.unit", unit, allowed)
    used = stated or unit or "m"
    factor = scale * metres_per("Mesh.unit", used)
    longest = factor * _longest_side(loaded)
    if stated is not None and longest > LONGEST_BODY:
        cure = "scale=0.001 makes up for numbers that are millimetres" if stated == "m" else "scale= makes up for it"
        allowed = f"at most {LONGEST_BODY:g} m: where a file states a wrong unit, {cure}"
        raise InputError("Mesh.path", f"{file.name}, which states {stated} and is {longest:.3g} m long", allowed)
    if used == "m" and stated is None and LARGE < longest <= LONGEST_BODY:
        warn_once(f'{file.name}: {longest:.3g} m long; unit="mm" says that its numbers are millimetres')
    return scale_mesh(loaded, factor), used


def stated_unit(file: Path, geometry: trimesh.Scene | trimesh.Trimesh) -> str | None:
    """Return the unit that a mesh file states, by its format or in a comment; None if it states none.

    It is a name of ``UNITS``, or metres as ``"0.9144 m"``.

    Raises
    ------
    InputError
        On a unit that is no length, and on parts in different units.
    """
    factor = metres_of_format(file, geometry) or _metres_in_comment(file)
    if factor is None:
        return None
    return next((name for name, metres in UNITS.items() if np.isclose(factor, metres, 1e-9, 0.0)), f"{factor!r} m")


def states_unit(file: Path) -> bool:
    """Return whether a mesh file states its unit, by its format or in a comment."""
    return file.suffix.lower() in (*IN_METRES, *WITH_UNIT) or _metres_in_comment(file) is not None


def _metres_in_comment(file: Path) -> float | None:
    """Return the length in metres of the one unit that a file's comments state; None without one, or with two."""
    pattern = {".obj": UNIT_COMMENT, ".ply": UNIT_COMMENT, ".stl": STL_UNIT}.get(file.suffix.lower())
    if pattern is None:
        return None
    with file.open("rb") as stream:
        head = stream.read(HEAD if pattern is UNIT_COMMENT else STL_HEADER)
    lengths = {_metres_of_name(name.decode()) for name in pattern.findall(head.partition(b"end_header")[0])} - {None}
    if len(lengths) > 1:
        warn_once(f"{file.name}: its comments state {len(lengths)} units: unit= says which one is meant")
    return lengths.pop() if len(lengths) == 1 else None


def metres_of_format(file: Path, geometry: trimesh.Scene | trimesh.Trimesh) -> float | None:
    """Return the length of a file's unit in metres, where its format states one; None for other formats.

    Raises
    ------
    InputError
        On a unit that is no length, and on parts in different units.
    """
    if file.suffix.lower() in IN_METRES:
        return 1.0
    if file.suffix.lower() not in WITH_UNIT:
        return None
    names = {part.units for part in getattr(geometry, "geometry", {"": geometry}).values()}
    lengths = {_metres_of_name(str(name)) for name in names}
    factor = lengths.pop() if len(lengths) == 1 else None
    if factor is None:
        raise InputError("Mesh.path", f"{file.name} in units of {', '.join(map(repr, names))}", "one unit of length")
    return factor


def _metres_of_name(name: str) -> float | None:
    """Return the length of a unit in metres, by a name of ``LENGTHS`` or trimesh; None for any other."""
    from trimesh.units import unit_conversion

    if name.lower() in LENGTHS:
        return UNITS[LENGTHS[name.lower()]]
    try:
        factor = float(unit_conversion(name, "meters"))
    except ValueError:
        return None
    return factor if np.isfinite(factor) and factor > 0.0 else None


def _one_mesh(scene: trimesh.Scene) -> object:
    """Return all triangles of a scene as one mesh, without textures."""
    import trimesh

    for geometry in scene.geometry.values():
        if isinstance(geometry, trimesh.Trimesh):
            geometry.visual = trimesh.visual.ColorVisuals()
    return scene.to_mesh()


def scale_mesh(mesh: trimesh.Trimesh, factor: float) -> trimesh.Trimesh:
    """Return a scaled copy of a mesh; an object of another type is returned unchanged."""
    import trimesh

    if not isinstance(mesh, trimesh.Trimesh):
        return mesh
    result = mesh.copy()
    result.apply_scale(factor)
    return result


def repaired_mesh(mesh: object) -> tuple[trimesh.Trimesh, tuple[str, ...]]:
    """Return the outer surface of a mesh after repairs, and a list of these repairs.

    Raise ``InputError`` if the mesh has no clear inside.

    Small holes are filled, inverted parts reversed, and overlapping parts united; all repairs are listed. A mesh that
    stays open is accepted only if its winding number distinguishes inside and outside almost everywhere (scans with a
    few bad triangles). A mesh without defects keeps its vertices and triangles. Vertices at the same position are
    merged, whatever their texture coordinates and normals. A mesh far from the origin is processed in local
    coordinates.
    """
    import trimesh

    triangles = _check_size(mesh)
    vertices, faces = np.asarray(triangles.vertices, dtype=float), np.asarray(triangles.faces)
    origin, rounding = local_origin(vertices), coarse_rounding_warning(vertices)
    try:
        result, notes = _repair_surface(relative_to(vertices, origin), faces)
    except InputError as error:
        if rounding is None:
            raise
        raise InputError(error.field, f"{error.given}; {rounding}", error.allowed) from None
    if np.any(origin):
        result = trimesh.Trimesh(np.asarray(result.vertices) + origin, result.faces, process=False)
    if rounding is not None:
        warn_once(rounding)
        notes.append(rounding)
    return result, tuple(notes)


def _repair_surface(vertices: FloatArray, faces: IntArray) -> tuple[trimesh.Trimesh, list[str]]:
    """Return the outer surface of vertices (v, 3), metres, and triangles (f, 3), and a list of repairs."""
    import trimesh

    longest = float(np.max(np.ptp(vertices, axis=0)))
    result, notes = _fill_holes(vertices, faces)
    vertices, faces, surface_notes = outer_surface(np.asarray(result.vertices, dtype=float), np.asarray(result.faces))
    if surface_notes:
        result = trimesh.Trimesh(vertices, faces, process=False)
    volume, box = _signed_volume(result), float(np.prod(np.ptp(result.vertices, axis=0)))
    if abs(volume) <= 1e-6 * max(box, 1e-3 * longest**3):
        raise InputError("Mesh.mesh", f"volume {abs(volume):.3g} m^3", "a mesh with volume: a sheet has two sides")
    notes.extend(surface_notes)
    if not is_plain(result) and (count := count_open_edges(result)):
        notes.append(f"not watertight ({count} open edges); the winding number decides what is inside")
    return result, notes


def _check_size(mesh: object) -> trimesh.Trimesh:
    """Return the mesh, after checks of its triangles, its coordinates and its size."""
    import trimesh

    if not isinstance(mesh, trimesh.Trimesh) or not len(mesh.faces):
        raise InputError("Mesh.mesh", type(mesh).__name__, "a trimesh.Trimesh with triangles")
    if defect := triangle_defect(mesh):
        raise InputError("Mesh.mesh", defect, "triangles (f, 3) of vertices (v, 3)")
    if not np.all(np.isfinite(mesh.vertices)):
        raise InputError("Mesh.vertices", "NaN or infinite coordinates", "finite coordinates")
    longest = _longest_side(mesh)
    if longest <= 0.0:
        raise InputError("Mesh.mesh", "a mesh of zero size", "a mesh with volume")
    check_body_size("Mesh.unit", "a longest side", longest, "its unit is probably {} than the one stated")
    return mesh


def _longest_side(mesh: trimesh.Trimesh) -> float:
    """Return the longest side of a mesh's bounding box, metres."""
    return float(np.max(np.ptp(mesh.vertices, axis=0)))


def _fill_holes(vertices: FloatArray, faces: IntArray) -> tuple[trimesh.Trimesh, list[str]]:
    """Return the mesh with holes filled as far as possible, and a list of repairs.

    Raise ``InputError`` if the inside is then ambiguous.
    """
    result = merge_mesh_vertices(vertices, faces)
    if not len(result.faces):
        raise InputError("Mesh.mesh", "triangles without area", "a mesh with volume")
    notes = [] if is_plain(result) else _repair_mesh(result)
    if not is_plain(result) and (count := count_open_edges(result)):
        fraction = unclear_fraction(np.asarray(result.vertices), np.asarray(result.faces))
        if fraction > OPEN_SHARE:
            raise InputError(
                "Mesh.mesh",
                f"an open surface ({count} open edges, inside unclear for {fraction:.0%} of its box)",
                "a closed mesh, or one with small holes only",
            )
    return result, notes


def _repair_mesh(mesh: trimesh.Trimesh) -> list[str]:
    """Repair duplicate triangles, holes and winding of a mesh in place, and return a list of the repairs."""
    import trimesh

    notes: list[str] = []
    is_needed, copies, walls = drop_duplicates(np.asarray(mesh.vertices), np.asarray(mesh.faces))
    if not np.all(is_needed):
        if copies and not count_open_edges(mesh):  # parts of which one is inside out share a wall
            needed = mesh.copy()
            needed.update_faces(is_needed)
            if count_open_edges(needed):
                return notes
        mesh.update_faces(is_needed)
    if copies:
        notes.append(f"triangles left out that were there more than once: {copies}")
    if walls:
        notes.append(f"triangles left out that lay back to back and bound nothing: {walls}")
    open_edges, count, windings = count_open_edges(mesh), len(mesh.faces), np.array(mesh.faces)
    if open_edges:
        mesh.fill_holes()
        trimesh.repair.fix_normals(mesh)
        turned = int(np.sum(np.any(np.asarray(mesh.faces)[:count] != windings, axis=1)))
        still_open, filled = count_open_edges(mesh), len(mesh.faces) > count
        if filled:
            notes.append(f"filled holes: {open_edges} open edges before, {still_open} after")
        if turned:
            notes.append(f"triangles turned round to face as those beside them do: {turned}")
    return notes


def mesh_digest(mesh: trimesh.Trimesh) -> str:
    """Return the SHA-256 of a mesh's vertices (float64, metres) and faces (int64), as hexadecimal digits."""
    digest = hashlib.sha256(np.ascontiguousarray(mesh.vertices, dtype=float).tobytes())
    digest.update(np.ascontiguousarray(mesh.faces, dtype=np.int64).tobytes())
    return digest.hexdigest()


def _signed_volume(mesh: trimesh.Trimesh) -> float:
    """Return the signed volume of a mesh, m^3."""
    a, b, c = (np.asarray(mesh.triangles)[:, i] - np.mean(mesh.vertices, axis=0) for i in range(3))
    return float(np.sum(np.einsum("ij,ij->i", a, np.cross(b, c)))) / 6.0
