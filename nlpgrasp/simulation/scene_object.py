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
SAME_POINT = 1e-6  # metres, of a lift's weight from its forces
CENTRE_DISTANCE = 0.5  # largest distance of a weight from the centre of mass, as a share of half the body's diagonal
UP = (0.0, 0.0, 1.0)  # first upward direction, body frame
MIN_TILTS, MOST_CORNER = 4, 1.05  # corners of a tilt's part: at least; their largest force over the weight
UPRIGHT_COSINE, STEP_COSINE = 0.995, 0.9  # of a tilt's first direction from upright, and between neighbours
STATED, UPRIGHT = "as stated", "the weight that the task carries"
ANY_WAY, OF_WATER = "the weight that the task carries in any orientation", "as if of water"


_pieces: dict[bytes, list[FloatArray]] = {}  # of the last meshes: a simulation needs them twice, a set more often
MOST_CACHED = 64  # meshes

Progress = Callable[[str], None]
Vector = tuple[float, float, float]
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
    center : (3,) tuple, optional
        Where the task's weight acts, metres, body frame; by default at the centre of the body's volume.
    """

    kilograms: float
    source: str
    ups: tuple[Vector, ...] = (UP,)
    is_default: bool = False
    center: Vector | None = None

    @property
    def tilt(self) -> float:
        """Largest angle from the first upward direction, radians."""
        return float(np.max(np.arccos(np.clip(np.array(self.ups) @ self.ups[0], -1.0, 1.0))))


def object_mass(solution: GraspSolution, mass: float | None, otherwise: ObjectMass | None = None) -> ObjectMass:
    """Return the mass of a solution's object: as given, else from the weight in the task, else a default.

    A task carries a weight if the centre of one of its parts is a force along the last axis of the body frame, or if a
    part is that of ``ng.lift`` along another axis near the centre of mass, or if a part's corners are a weight at one
    point that turns, as in ``ng.pour``. A part of isotropic forces at one point near the centre of mass is a weight in
    any orientation, as in ``ng.gravity``; it counts if there is no other. The object's centre of mass is where the
    task says that the weight acts; along an upright weight it is that of the body's volume.

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
    weights = [found for part in parts if (found := _part_weight(part, solution)) is not None]
    turning = [weight for weight in weights if len(weight.ups) > 1]
    source = UPRIGHT
    if not weights:
        centred = [part for part in parts if part.is_centred]
        forces = [force for part in centred if (force := _isotropic_force(part, solution)) is not None]
        weights = [_Weight(size, np.array([UP]), point) for size, point in forces]
        weights, source = sorted(weights, key=lambda weight: weight.newtons)[-1:], ANY_WAY
    carried = sum(weight.newtons for weight in weights)
    if carried > 0.0:
        middle = sum(weight.newtons * weight.point for weight in weights) / carried
        center = _vector(middle + solution.require_grasp().torque_origin)
        ups = tuple(map(_vector, (turning or weights)[0].ups))
        return ObjectMass(*((mass, STATED) if mass is not None else (carried / WEIGHT, source)), ups, center=center)
    if mass is not None:
        return ObjectMass(mass, STATED)
    return otherwise or ObjectMass(solid_mass(solution.require_drawing().body, DENSITY).mass, OF_WATER, is_default=True)


@dataclass(frozen=True)
class _Weight:
    """Weight of a part of a task: newtons, upward directions (m, 3) in turn, and its point from the torque origin."""

    newtons: float
    ups: FloatArray
    point: FloatArray


def _vector(values: FloatArray) -> Vector:
    """Return three numbers as a tuple."""
    x, y, z = map(float, values)
    return x, y, z


def _part_weight(part: Task, solution: GraspSolution) -> _Weight | None:
    """Return the weight that a part of a task carries upright, or turns; None if it carries none."""
    turning = _turning_weight(part)
    if turning is not None:
        return turning
    axes = np.eye(6)
    largest, smallest = part.support(axes)[0], -part.support(-axes)[0]
    wrench = 0.5 * (largest + smallest)
    weight = float(np.linalg.norm(wrench[:3]))
    if weight == 0.0 or not (_is_upright(wrench, smallest[2]) or _is_lift(part, wrench, solution)):
        return None
    up = wrench[:3] / weight if not _is_upright(wrench, smallest[2]) else np.array(UP)
    middle = solid_mass(solution.require_drawing().body, DENSITY).center - solution.require_grasp().torque_origin
    offset = np.cross(wrench[:3], wrench[3:] - np.cross(middle, wrench[:3])) / weight**2
    return _Weight(float(wrench[:3] @ up), up[None], middle + offset)


def _is_upright(wrench: FloatArray, least: float) -> bool:
    """Return whether the middle of a part is a weight upright, given its least upward force.

    A part that pushes from zero is a tool's push.
    """
    weight = float(wrench[2])
    return weight > 0.0 and np.hypot(*wrench[:2]) <= MAX_LATERAL * weight and abs(least) > PUSH_START * weight


def _is_lift(part: Task, wrench: FloatArray, solution: GraspSolution) -> bool:
    """Return whether a part with a given middle is that of ``ng.lift``: isotropic forces and a weight at one point."""
    found = _isotropic_force(part, solution)
    return found is not None and bool(
        np.linalg.norm(np.cross(found[1], wrench[:3]) - wrench[3:]) <= SAME_POINT * np.linalg.norm(wrench[:3])
    )


def _turning_weight(part: Task) -> _Weight | None:
    """Return the weight of a part that turns a body from upright.

    The part's corners are forces at one point, in small steps of direction away from the first, and the least of them
    is the weight: those between contain the arc. None for other parts.
    """
    if not isinstance(part, TaskPolytope) or len(part.wrenches) < MIN_TILTS:
        return None
    forces, moments = part.wrenches[:, :3], part.wrenches[:, 3:]
    sizes = np.linalg.norm(forces, axis=1)
    weight = float(np.min(sizes))
    if weight <= 0.0 or np.max(sizes) > MOST_CORNER * weight:
        return None
    directions = forces / sizes[:, None]
    if np.max(directions[:, 2]) >= UPRIGHT_COSINE:
        directions = directions[np.argsort(-directions[:, 2], kind="stable")]
    steps, turned = np.sum(directions[1:] * directions[:-1], axis=1), directions @ directions[0]
    rows = -np.concatenate([np.cross(np.eye(3), force).T for force in forces])  # f x p
    point = np.linalg.lstsq(rows, -moments.ravel(), rcond=None)[0]
    errors = np.cross(point, forces) - moments
    if np.max(np.diff(turned)) > ISOTROPY or np.min(steps) < STEP_COSINE or np.max(np.abs(errors)) > ISOTROPY * weight:
        return None
    return _Weight(weight, directions, point)


def _isotropic_force(part: Task, solution: GraspSolution) -> tuple[float, FloatArray] | None:
    """Return the force, newtons, of a part of a task that is equal in all directions about its middle, and its point.

    The point is near the centre of mass, from the torque origin, metres. None for other parts.
    """
    if not isinstance(part, TaskEllipsoid):
        return None
    forces, moments = part.axes[:, :3], part.axes[:, 3:]
    squares = forces.T @ forces
    square, drawing = float(np.trace(squares)) / 3.0, solution.require_drawing()
    if square == 0.0 or np.max(np.abs(squares - square * np.eye(3))) > ISOTROPY * square:
        return None
    point, diagonal = _skew_vector(moments.T @ forces / square), drawing_size(drawing, None)
    if np.max(np.abs(moments - np.cross(point, forces))) > ISOTROPY * np.sqrt(square) * diagonal:
        return None
    center = solid_mass(drawing.body, DENSITY).center - solution.require_grasp().torque_origin
    return (float(np.sqrt(square)), point) if np.linalg.norm(point - center) <= CENTRE_DISTANCE * diagonal else None


def _skew_vector(turning: FloatArray) -> FloatArray:
    """Return the vector (3,) whose cross-product matrix is nearest to a given matrix (3, 3)."""
    skew = 0.5 * (turning - turning.T)
    return np.array([skew[2, 1], skew[0, 2], skew[1, 0]])
