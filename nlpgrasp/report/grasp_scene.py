"""3D scene of a grasp for the viewer: surfaces, contacts, force arrows, jaws and camera."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from nlpgrasp.bodies import Box, body_from_dict
from nlpgrasp.bodies.mesh.display_triangles import triangles
from nlpgrasp.common.drawing import CONE, FORCE, NORMAL, Drawing, Triangles, drawing_size
from nlpgrasp.common.spatial import in_space
from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.errors import InputError
from nlpgrasp.hands import Fingertips, ParallelJaw
from nlpgrasp.quality.grasp import Grasp
from nlpgrasp.report.scene_parts import (
    TABLE_HALF_WIDTH,
    DrawnSurroundings,
    drawn_surroundings,
    first_view,
    outermost_points,
    slab,
    surface,
)
from nlpgrasp.report.task_wrenches import ChosenWrench
from nlpgrasp.solution.solution import GraspSolution

FINGER_THICKNESS = 0.1  # default thickness of fingers, as a share of the opening
FINGER_OVERHANG = 0.06  # reach of fingers beyond the contacts, as a share of their length
JAW_NAMES = ("jaw 0", "jaw 1", "palm")
DISC_RADIUS, SHAFT_RADIUS = 0.055, 0.022  # radii of contact discs and arrow shafts, as shares of the body's size
MOST_MARK_SIZE = 3.5  # largest size for discs and shafts, in shortest extents of the body
PAD_RADIUS = 0.16  # radius of a drawn jaw pad, as a share of the body's size


def jaw_shapes(solution: GraspSolution) -> list[tuple[str, Triangles]]:
    """Return name and triangles (body frame) of each finger and the palm of a parallel gripper in its pose.

    Empty for planar grippers, without a ``finger_length``, and for files without a pose. Fingers whose width is not
    stated are drawn as broad as thick; a palm whose size is not stated reaches from finger to finger.
    """
    hand, configuration = solution.problem.get("hand"), solution.hand or {}
    if not isinstance(hand, Mapping) or hand.get("type") != ParallelJaw.kind or "palm_pose" not in configuration:
        return []
    gripper, opening = ParallelJaw.from_dict(hand), float(configuration["opening"])
    length, axes = gripper.finger_length, gripper.axes
    if length <= 0.0:
        return []
    thickness = gripper.finger_thickness or FINGER_THICKNESS * opening
    offset, reach = 0.5 * (opening + thickness), (1.0 + FINGER_OVERHANG) * length
    if gripper.pad is not None:
        reach = length + 0.5 * gripper.pad[0]
    pose = configuration["palm_pose"]
    turn = Rotation.from_quat(pose["quaternion_wxyz"], scalar_first=True).as_matrix()
    palm_middle = gripper.tool_centre_point - length * axes[:, 2]  # gripper's frame
    rotation, position = turn @ axes, np.asarray(pose["position"], dtype=float) + turn @ palm_middle

    def jaw_box(extents: list[float], middle: list[float]) -> Triangles:
        """Return a box with its middle about that of the palm: x from jaw to jaw, z along the approach."""
        vertices, faces = triangles(Box(extents))
        return Triangles(_transform_points(vertices + middle, rotation, position), faces)

    finger = [thickness, gripper.finger_width if gripper.is_solid else thickness, reach]
    parts = [jaw_box(finger, [side * offset, 0.0, 0.5 * reach]) for side in (-1.0, 1.0)]
    sides = gripper.palm_size or (opening + 2.0 * thickness, 1.5 * thickness, 1.5 * thickness)
    palm = jaw_box(list(sides), [0.0, 0.0, -0.5 * sides[2]])
    return list(zip(JAW_NAMES, [*parts, palm], strict=True))


def _transform_points(points: FloatArray, rotation: FloatArray, position: FloatArray) -> FloatArray:
    """Return points (m, 3) transformed by a rotation and a translation."""
    return np.asarray(points @ rotation.T + position)


def solution_scene(solution: GraspSolution, chosen: Sequence[ChosenWrench]) -> Json | None:
    """Return the viewer's scene of a solution, metres, body frame, or ``None`` with neither body nor contacts.

    Returns
    -------
    dict
        ``size``: of the body, the reference of drawn lengths. ``flat``: whether the problem is planar. ``parts``:
        surfaces with name and group (body, link, tip, obstacle, table). ``tables``: middle and half width of each
        table's top; in the plane a table is one of the parts instead. ``unseen``: names of obstacles without a surface.
        ``contacts``: position, inward normal, radius of a free fingertip or 0, slope of the friction cone or null, and
        face. ``palm``: the palm point of free fingertips, or null. ``arrows``: for each chosen wrench a tail and a head
        per finger. ``lengths``: drawn sizes of marks. ``frame``: points that the camera has to have in view; ``view``:
        azimuth and elevation, degrees.
    """
    grasp = solution.grasp
    contacts = np.zeros((0, 3)) if grasp is None else in_space(grasp.points)
    body = body_surface(solution)
    size = drawing_size(None if body is None else Drawing(body), None if grasp is None else grasp.points)
    body_points = contacts if body is None else body.vertices
    if not len(body_points):
        return None
    middle = (body_points.min(axis=0) + body_points.max(axis=0)) / 2.0
    surroundings, flat = drawn_surroundings(solution), _is_flat(solution)
    arrows, palm = _force_arrows(contacts, chosen, size), _palm_point(solution)
    drawn_shapes = scene_shapes(solution, body, surroundings)
    drawn_points = [body_points, *(shape.vertices for _, _, shape in drawn_shapes), _tip_extremes(solution)]
    frame = [contacts, *([] if palm is None else [palm[None]]), *(arrow.reshape(-1, 3) for arrow in arrows)]
    frame.append(outermost_points(np.concatenate(drawn_points), middle, size))
    tables = [{"at": _nested_lists([*middle[:2], h]), "half": TABLE_HALF_WIDTH * size} for h in surroundings.heights]
    if flat:
        tables = []
        drawn_shapes += [("table", "table", slab(h, body_points, size)) for h in surroundings.heights]
    return {
        "size": size,
        "flat": flat,
        "parts": [{"group": group, "name": name, **surface(shape).to_dict()} for group, name, shape in drawn_shapes],
        "tables": tables,
        "unseen": list(surroundings.unseen),
        "contacts": [] if grasp is None else _contact_data(grasp, solution.faces, _tip_radius(solution)),
        "palm": None if palm is None else _nested_lists(palm),
        "arrows": [_nested_lists(arrow) for arrow in arrows],
        "lengths": _mark_lengths(solution, body_points, size),
        "frame": _nested_lists(np.concatenate(frame)),
        "view": first_view(solution, flat),
    }


def _force_arrows(contacts: FloatArray, chosen: Sequence[ChosenWrench], size: float) -> list[FloatArray]:
    """Return tails and heads (k, 2, 3) of the force arrows of each chosen wrench, all to one scale.

    Parameters
    ----------
    contacts : (k, 3) array
        Heads of the arrows, metres.
    chosen : sequence of ChosenWrench
        Wrenches with finger forces.
    size : float
        Of the body, metres.
    """
    largest = max((float(np.max(np.linalg.norm(c.forces, axis=1))) for c in chosen), default=1.0) or 1.0
    return [_arrows(contacts, in_space(c.forces) * (FORCE * size / largest)) for c in chosen]


def _tip_extremes(solution: GraspSolution) -> FloatArray:
    """Return the extreme points (6 k, 3) of free round fingertips along the axes; none for other hands."""
    radius = _tip_radius(solution)
    if radius == 0.0:
        return np.zeros((0, 3))
    extremes = radius * np.concatenate([np.eye(3), -np.eye(3)])
    return (grasp_tips(solution)[:, None] + extremes).reshape(-1, 3)


def _mark_lengths(solution: GraspSolution, body: FloatArray, size: float) -> Json:
    """Return the drawn sizes of normals, friction cones, contact discs, arrow shafts and pads, metres."""
    least_extent = float(np.min(np.ptp(body[:, :2] if _is_flat(solution) else body, axis=0)))
    mark_size = min(size, max(MOST_MARK_SIZE * least_extent, 0.3 * size))
    return {
        "normal": NORMAL * size,
        "cone": CONE * size,
        "disc": DISC_RADIUS * mark_size,
        "shaft": SHAFT_RADIUS * mark_size,
        "pad": _pad_radius(solution) * size,
    }


def _contact_data(grasp: Grasp, faces: Sequence[str], radius: float) -> list[Json]:
    """Return the viewer's data of each contact: point, normal, friction, face and fingertip radius."""
    entries = zip(in_space(grasp.points), in_space(grasp.normals), grasp.contacts, faces, strict=True)
    return [
        {
            "at": _nested_lists(point),
            "inward": _nested_lists(normal),
            "tip": radius,
            "slope": model.coefficients.get("friction"),
            "face": face,
        }
        for point, normal, model, face in entries
    ]


def grasp_tips(solution: GraspSolution) -> FloatArray:
    """Return the centres of free fingertips, (k, 3), metres.

    Without free round fingertips these are the contacts.
    """
    if solution.grasp is None:
        return np.zeros((0, 3))
    return in_space(solution.grasp.points) - _tip_radius(solution) * in_space(solution.grasp.normals)


def body_surface(solution: GraspSolution) -> Triangles | None:
    """Return the body's triangles from the drawing, the solved problem or the body's data; ``None`` without these."""
    if solution.drawing is not None:
        return solution.drawing.body
    try:
        body = body_from_dict(solution.problem["body"]) if solution.source is None else solution.source.body
        return Triangles(*triangles(body))
    except InputError:
        return None


def scene_shapes(
    solution: GraspSolution, body: Triangles | None, surroundings: DrawnSurroundings
) -> list[tuple[str, str, Triangles]]:
    """Return group, name and triangles of each drawn shape: body, hand links, jaws and obstacles."""
    tips = () if solution.hand is None else solution.hand.get("fingertips", ())
    links = () if solution.drawing is None else solution.drawing.links
    hand = [("tip" if name in tips else "link", name, shape) for name, shape in links if len(shape.faces)]
    hand += [("link", name, shape) for name, shape in jaw_shapes(solution)]
    obstacles = [("obstacle", name, shape) for name, shape in surroundings.obstacles]
    return [*([] if body is None else [("body", "body", body)]), *hand, *obstacles]


def _arrows(points: FloatArray, forces: FloatArray) -> FloatArray:
    """Return tails and heads, (k, 2, 3), of arrows that end at the contacts and show their forces."""
    return np.stack([points - forces, points], axis=1)


def _is_flat(solution: GraspSolution) -> bool:
    """Return whether the problem is planar."""
    return solution.task.dimension == 3


def _tip_radius(solution: GraspSolution) -> float:
    """Return the radius of free fingertips, metres; 0 for other hands."""
    hand = solution.problem.get("hand") or {}
    return float(hand.get("radius", 0.0)) if hand.get("type") == Fingertips.kind else 0.0


def _palm_point(solution: GraspSolution) -> FloatArray | None:
    """Return the palm point (3,) of free fingertips, metres, or ``None`` if the hand has none."""
    point = None if solution.hand is None else solution.hand.get("palm")
    return None if point is None else in_space(np.atleast_2d(np.asarray(point, dtype=float)))[0]


def _pad_radius(solution: GraspSolution) -> float:
    """Return the drawn radius of the pads of parallel jaws, in body sizes; 0 for other hands."""
    return PAD_RADIUS if (solution.problem.get("hand") or {}).get("type") == ParallelJaw.kind else 0.0


def _nested_lists(values: FloatArray | Sequence[float]) -> object:
    """Return numbers as nested lists, rounded for display."""
    return np.round(np.asarray(values, dtype=float), 7).tolist()
