"""Object of a simulated scene: collision geoms by convex decomposition, mass."""

from __future__ import annotations

import hashlib
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
from nlpgrasp.tasks import Task, TaskEllipsoid, TaskPolytope
from nlpgrasp.tasks.base import parts_of
from nlpgrasp.tasks.tools import WEIGHT

CONVEX_VOLUME = 0.999  # share of its hull's volume above which a body counts as convex
CONCAVITY, PIECES, SEED = 0.02, 64, 0  # coacd: relative concavity threshold, largest number of pieces, seed
APPEARANCE = {"rgba": "0.56 0.64 0.71 1"}

DECOMPOSING = "decomposing a shape into convex pieces ..."
MAX_LATERAL = 0.1  # largest lateral force of a weight, as a share of the upward force
PUSH_START = 0.01  # share of the upward force below which the least force is that of a tool's push, no weight
ISOTROPY = 1e-6  # relative tolerance of isotropic forces at one point
CENTRE_DISTANCE = 0.5  # largest distance of a weight from the centre of mass, as a share of half the body's diagonal
UP = (0.0, 0.0, 1.0)  # first upward direction, body frame
MIN_TILTS, MOST_CORNER = 4, 1.05  # corners of a tilt's part: at least; their largest force over the weight
UPRIGHT_COSINE, STEP_COSINE = 0.995, 0.9  # of a tilt's first direction from upright, and between neighbours
STATED, UPRIGHT = "as stated", "the weight that the task carries"
ANY_WAY, OF_WATER = "the weight that the task carries in any orientation", "as if of water"


_pieces: dict[bytes, list[FloatArray]] = {}  # of the last meshes: a simulation needs them twice, a set more often
MOST_CACHED = 64  # meshes

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
    key = hashlib.sha256(vertices.tobytes() + faces.tobytes()).digest()
    pieces = _pieces.get(key)
    if pieces is None:
        if progress is not None:
            progress(DECOMPOSING)
        coacd.set_log_level("error")
        mesh_input = coacd.Mesh(vertices, faces)
        parts = coacd.run_coacd(mesh_input, threshold=CONCAVITY, max_convex_hull=PIECES, seed=SEED)
        pieces = [np.asarray(corners, dtype=float) for corners, _ in parts]
        if len(_pieces) >= MOST_CACHED:
            _pieces.clear()
        _pieces[key] = pieces
    return list(pieces)


@dataclass(frozen=True)
class ObjectMass:
    """Mass of an object, and where the value comes from.

    Parameters
    ----------
    kilograms : float
    source : str
        Text such as ``the weight that the task carries``.
    ups : tuple of (3,) tuples
        Upward directions in the body frame that the task goes through in turn, unit: one, or those of a tilt.
    is_default : bool
        Whether neither the task nor the user states a weight.
    """

    kilograms: float
    source: str
    ups: tuple[tuple[float, float, float], ...] = (UP,)
    is_default: bool = False

    @property
    def tilt(self) -> float:
        """Largest angle from the first upward direction, radians."""
        return float(np.max(np.arccos(np.clip(np.array(self.ups) @ self.ups[0], -1.0, 1.0))))


def object_mass(solution: GraspSolution, mass: float | None, otherwise: ObjectMass | None = None) -> ObjectMass:
    """Return the mass of a solution's object: as given, else from the weight in the task, else a default.

    A task carries a weight if the centre of one of its parts is a force along the last axis of the body frame, as in
    ``ng.lift``, or if a part's corners are a weight at one point that turns away from that axis, as in ``ng.pour``. A
    part of isotropic forces at one point near the centre of mass is a weight in any orientation, as in ``ng.gravity``;
    it counts if there is no other.

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
    parts = parts_of(solution.task) if solution.task.dimension == 6 else ()
    turning = [found for part in parts if (found := _turning_weight(part)) is not None]
    ups = tuple((float(x), float(y), float(z)) for x, y, z in turning[0][1]) if turning else (UP,)
    if mass is not None:
        return ObjectMass(mass, STATED, ups)
    carried = sum(_carried_weight(part) for part in parts if _turning_weight(part) is None)
    carried += sum(weight for weight, _ in turning)
    if carried > 0.0:
        return ObjectMass(carried / WEIGHT, UPRIGHT, ups)
    isotropic = max((_isotropic_force(part, solution) for part in parts), default=0.0)
    if isotropic > 0.0:
        return ObjectMass(isotropic / WEIGHT, ANY_WAY)
    return otherwise or ObjectMass(solid_mass(solution.require_drawing().body, DENSITY).mass, OF_WATER, is_default=True)


def _turning_weight(part: Task) -> tuple[float, FloatArray] | None:
    """Return the weight, newtons, of a part that turns a body from upright, and the upward directions (m, 3) in turn.

    The part's corners are forces at one point, in small steps of direction, and the least of them is the weight: those
    between contain the arc. None for other parts.
    """
    if not isinstance(part, TaskPolytope) or len(part.wrenches) < MIN_TILTS:
        return None
    forces, moments = part.wrenches[:, :3], part.wrenches[:, 3:]
    sizes = np.linalg.norm(forces, axis=1)
    weight = float(np.min(sizes))
    if weight <= 0.0 or np.max(sizes) > MOST_CORNER * weight:
        return None
    directions = forces / sizes[:, None]
    directions = directions[np.argsort(-directions[:, 2], kind="stable")]
    steps = np.sum(directions[1:] * directions[:-1], axis=1)
    rows = -np.concatenate([np.cross(np.eye(3), force).T for force in forces])  # f x p
    point = np.linalg.lstsq(rows, -moments.ravel(), rcond=None)[0]
    errors = np.cross(point, forces) - moments
    if directions[0, 2] < UPRIGHT_COSINE or np.min(steps) < STEP_COSINE or np.max(np.abs(errors)) > ISOTROPY * weight:
        return None
    return weight, directions


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
