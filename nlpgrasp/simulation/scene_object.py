"""Object of a simulated scene: collision geoms by convex decomposition, mass."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from importlib import import_module
from xml.etree.ElementTree import Element, SubElement

import numpy as np

from nlpgrasp.common.drawing import Triangles, drawing_size
from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.errors import MissingExtraError
from nlpgrasp.simulation.fingertip_scene import DENSITY, format_numbers, solid_mass
from nlpgrasp.solution.solution import GraspSolution
from nlpgrasp.tasks import Task, TaskEllipsoid
from nlpgrasp.tasks.base import parts_of
from nlpgrasp.tasks.tools import WEIGHT

CONVEX_VOLUME = 0.999  # share of its hull's volume above which a body counts as convex
CONCAVITY, PIECES, SEED = 0.02, 64, 0  # coacd: relative concavity threshold, largest number of pieces, seed
APPEARANCE = {"rgba": "0.56 0.64 0.71 1"}

DECOMPOSING = "decomposing the body into convex pieces ..."
MAX_LATERAL = 0.1  # largest lateral force of a weight, as a share of the upward force
PUSH_START = 0.01  # share of the upward force below which the least force is that of a tool's push, no weight
ISOTROPY = 1e-6  # relative tolerance of isotropic forces at one point
CENTRE_DISTANCE = 0.5  # largest distance of a weight from the centre of mass, as a share of half the body's diagonal
STATED, UPRIGHT = "as stated", "the weight that the task carries"
ANY_WAY, OF_WATER = "the weight that the task carries in any orientation", "as if of water"


_last: dict[bytes, list[FloatArray]] = {}  # cache of the last body's pieces, which a simulation needs twice

Progress = Callable[[str], None]
Size = Callable[[Json], Iterable[float]]
PRIMITIVES: dict[str, tuple[str, Size]] = {
    "box": ("box", lambda body: np.asarray(body["extents"], float) / 2.0),
    "sphere": ("sphere", lambda body: [body["radius"]]),
    "ellipsoid": ("ellipsoid", lambda body: body["semi_axes"]),
    "cylinder": ("cylinder", lambda body: [body["radius"], body["height"] / 2.0]),
}


def add_object_geoms(
    asset: Element,
    body: Element,
    shape_data: Json,
    drawn: Triangles,
    surface: dict[str, str],
    progress: Progress | None = None,
) -> int:
    """Add the collision geoms to the object's MJCF body, and return how many there are.

    Boxes, spheres, ellipsoids and cylinders are MuJoCo primitives; a convex body is its hull; any other is decomposed
    into convex pieces (Wei et al. 2022, doi:10.1145/3528223.3530103).

    Parameters
    ----------
    asset, body : Element
    shape_data : mapping
        The body as JSON data.
    drawn : Triangles
        Its surface.
    surface : mapping
        Attributes of each geom: its friction.
    progress : callable, optional
        As for ``convex_pieces``.

    Raises
    ------
    MissingExtraError
        When a body has to be decomposed and coacd (extra ``sim``) is not installed.
    """
    primitive = PRIMITIVES.get(str(shape_data.get("type")))
    if primitive is not None:
        kind, size = primitive
        SubElement(
            body,
            "geom",
            {"name": "object", "type": kind, "size": format_numbers(size(shape_data)), **APPEARANCE, **surface},
        )
        return 1
    pieces = convex_pieces(drawn, progress)
    for i, vertices in enumerate(pieces):
        name = f"object_{i}"
        SubElement(asset, "mesh", name=name, vertex=format_numbers(vertices.ravel()))
        SubElement(body, "geom", {"name": name, "type": "mesh", "mesh": name, **APPEARANCE, **surface})
    return len(pieces)


def convex_pieces(shape: Triangles, progress: Progress | None = None) -> list[FloatArray]:
    """Return the vertices (m, 3), metres, of each piece of a convex decomposition of a triangulated body.

    Parameters
    ----------
    shape : Triangles
    progress : callable, optional
        Called with a message before coacd runs; not for a convex or cached body.

    Raises
    ------
    MissingExtraError
        When more than one piece is needed and coacd is not installed.
    """
    import trimesh

    mesh = trimesh.Trimesh(shape.vertices, shape.faces)
    hull = mesh.convex_hull
    if mesh.is_watertight and mesh.volume > CONVEX_VOLUME * hull.volume:
        return [np.asarray(hull.vertices)]
    try:
        coacd = import_module("coacd")
    except ImportError:
        raise MissingExtraError("convex pieces of a body that is not convex (coacd)", "sim") from None
    vertices, faces = np.asarray(shape.vertices), np.asarray(shape.faces)
    key = vertices.tobytes() + faces.tobytes()
    pieces = _last.get(key)
    if pieces is None:
        if progress is not None:
            progress(DECOMPOSING)
        coacd.set_log_level("error")
        mesh_input = coacd.Mesh(vertices, faces)
        parts = coacd.run_coacd(mesh_input, threshold=CONCAVITY, max_convex_hull=PIECES, seed=SEED)
        pieces = [np.asarray(corners, dtype=float) for corners, _ in parts]
        _last.clear()
        _last[key] = pieces
    return list(pieces)


@dataclass(frozen=True)
class ObjectMass:
    """Mass of an object, and where the value comes from.

    Parameters
    ----------
    kilograms : float
    source : str
        Text such as ``the weight that the task carries``.
    """

    kilograms: float
    source: str


def object_mass(solution: GraspSolution, mass: float | None, otherwise: ObjectMass | None = None) -> ObjectMass:
    """Return the mass of a solution's object: as given, else from the weight in the task, else a default.

    A task carries a weight if the centre of one of its parts is a force along the last axis of the body frame, as in
    ``ng.lift``. A part of isotropic forces at one point near the centre of mass is a weight in any orientation, as in
    ``ng.gravity``; it counts if there is no other.

    Parameters
    ----------
    solution : GraspSolution
        One with a grasp and a drawing.
    mass : float or None
        Kilograms.
    otherwise : ObjectMass, optional
        If the task carries no weight; by default the mass for the density of water.

    Raises
    ------
    InputError
        Without a grasp or a drawing, or if the density of water is used and the drawing has no volume.
    """
    if mass is not None:
        return ObjectMass(mass, STATED)
    parts = parts_of(solution.task) if solution.task.dimension == 6 else ()
    carried = sum(_carried_weight(part) for part in parts)
    if carried > 0.0:
        return ObjectMass(carried / WEIGHT, UPRIGHT)
    isotropic = max((_isotropic_force(part, solution) for part in parts), default=0.0)
    if isotropic > 0.0:
        return ObjectMass(isotropic / WEIGHT, ANY_WAY)
    return otherwise or ObjectMass(solid_mass(solution.require_drawing().body, DENSITY).mass, OF_WATER)


def _carried_weight(part: Task) -> float:
    """Return the weight, newtons, that a part of a task carries; 0 if it carries none.

    The weight is the upward force at the part's centre. A part that pushes from zero carries none.
    """
    axes = np.eye(3, 6)
    largest, smallest = part.support(axes)[0], -part.support(-axes)[0]
    centre = 0.5 * (largest + smallest)
    weight = float(centre[2])
    if weight <= 0.0 or np.hypot(*centre[:2]) > MAX_LATERAL * weight or abs(smallest[2]) <= PUSH_START * weight:
        return 0.0
    return weight


def _isotropic_force(part: Task, solution: GraspSolution) -> float:
    """Return the force, newtons, of a part of a task that is equal in all directions near the centre of mass.

    0 for other parts.
    """
    if not isinstance(part, TaskEllipsoid) or not part.is_centred:
        return 0.0
    forces, moments = part.axes[:, :3], part.axes[:, 3:]
    squares = forces.T @ forces
    square, drawing = float(np.trace(squares)) / 3.0, solution.require_drawing()
    if square == 0.0 or np.max(np.abs(squares - square * np.eye(3))) > ISOTROPY * square:
        return 0.0
    point, diagonal = _skew_vector(moments.T @ forces / square), drawing_size(drawing, None)
    if np.max(np.abs(moments - np.cross(point, forces))) > ISOTROPY * np.sqrt(square) * diagonal:
        return 0.0
    center = solid_mass(drawing.body, DENSITY).center - solution.require_grasp().torque_origin
    return float(np.sqrt(square)) if np.linalg.norm(point - center) <= CENTRE_DISTANCE * diagonal else 0.0


def _skew_vector(turning: FloatArray) -> FloatArray:
    """Return the vector (3,) whose cross-product matrix is nearest to a given matrix (3, 3)."""
    skew = 0.5 * (turning - turning.T)
    return np.array([skew[2, 1], skew[0, 2], skew[1, 0]])
