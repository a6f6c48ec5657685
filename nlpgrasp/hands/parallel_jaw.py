"""Parallel-jaw gripper: constraints on the jaws, and poses about the closing line.

The closing direction points from contact 0 to contact 1. The approach, in which the gripper moves to the body, is the
clearest direction at right angles to it within the cones of the problem. The pose is that of the gripper's own frame,
in which both directions are axes, x and z unless the hand states others, and the middle between the pads is its tool
centre point.

The approach path is straight: from the grasp back by twice the body's size. Without stated pads or fingers, lines stand
for the gripper (``Jaws``): both fingers, rectangles as thick as stated from the pads outwards, and, where a finger's
length is stated, the palm between their ends. The lines are at most two millimetres apart, the faces of the fingers
included, so an obstacle between two lines is at most one millimetre deep; the fingers' width is ignored. With stated
pads or fingers, boxes stand for fingers and palm (``GripperSolids``; ``motion/jaw_clearance.py``). An arm is ignored.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import InitVar, dataclass, field
from typing import ClassVar, cast

import casadi as ca
import numpy as np
from scipy.spatial.transform import Rotation

from nlpgrasp.common.scalar_constraints import ScalarConstraint, SymbolicCandidate
from nlpgrasp.common.spatial import pose_data
from nlpgrasp.common.types import Expression, Json
from nlpgrasp.common.validation import BoolArray, FloatArray, angle, array, hand_length, number, prefix_errors
from nlpgrasp.errors import InputError
from nlpgrasp.hands.base import Hand, HandVariable

CLOSING_AXIS, APPROACH_AXIS = "x", "z"  # defaults, gripper frame
# unit directions of the axes
AXES = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}
DIGITS = 1e-4  # tolerance on unit length and right angles: directions are written with few digits
TURNS = 36  # approach directions tried about the closing line
LINE_SPACING = 2e-3  # metres: largest distance between two lines, of at most 100 in a row
SAMPLE_SPACING = 1e-2  # metres between positions along an approach that are sampled
PATH_SIZES = 2.0  # length of the approach path, in body sizes
DEPTH_TOLERANCE = 0.02  # share of the body's size: tolerated depth, for example of pads on tilted faces
MIN_ACROSS = 1e-9  # least part across the closing line of a cone's axis that is tried as an approach
COARSE_STEP, FINE_STEP = 2.5e-4, 2e-5  # metres: least steps along pads or inside an obstacle, and elsewhere
STEEP_FALL = 0.5  # fall of the distance over a step, as a share of it, where a line enters an obstacle
MEAN_TOLERANCE = 0.1  # share of the largest mean distance that the steepest approach may lack
ROUNDING = 1e-9  # rounding tolerance of a number of lines
TIE_TOLERANCE = 1e-6  # share of the body's size: clearances this close are ties
MAX_TILT = 0.5 * np.pi * (1.0 - 1e-9)  # radians: largest angle of a contact's normal to the closing line
LARGEST_PART = 2.0  # metres: largest dimension of a gripper's finger
TILT, PAD_TILT = 0.05, 0.002  # radians: default tilt, without and with stated pads
PAD_FRICTION = 0.5  # default Coulomb coefficient of pads
THIN = 1e-3  # metres: width and thickness of a finger that states none
SAFETY_FACTOR = 1.2  # default factor on the grip force at less friction
SAME_POINT = 1e-12  # metres: distance of a stated tool centre point from the default one that counts as none


Distance = Callable[[FloatArray], FloatArray]
Cone = tuple[FloatArray, float]  # a unit direction, and the largest angle to it, radians


@dataclass(frozen=True)
class ParallelJaw(Hand):
    """A parallel-jaw gripper: two flat jaws that face each other, for two contacts (usually soft fingers).

    The line between the contacts is within an angle of both inward normals: jaws close along one line and touch
    flat. The opening is the distance of the contacts along it.

    A solution states the gripper's pose in ``hand``: ``palm_pose`` (of the gripper's own frame: its closing axis from
    contact 0 to contact 1, its approach axis along the approach), ``opening``, and ``approach``: its ``direction``, and
    its penetration ``depth``. The contacts do not determine the rotation about the closing line: of 36 directions the
    clearest of the body, tables and obstacles is taken, within the cones of ``Approach`` (docs/hands.md).

    Parameters
    ----------
    opening : float
        Greatest distance between the jaws, metres; also called ``stroke``.
    closed : float
        Least distance between them, metres.
    tilt : float
        Largest angle between a contact's normal and the closing direction, radians: compliant pads give a little. By
        default 0.05; 0.002 with ``pad``, whose whole length is to lie flat.
    finger_length : float
        From the middle between the pads back to the palm, metres; 0 checks no palm on the approach.
    finger_thickness : float
        Of a finger in the closing direction, outwards from its pad, metres; 0 checks the pads' lines alone.
    closing_axis : str or (3,) sequence of float
        Direction of the closing line in the gripper's own frame, from the jaw at contact 0 to that at contact 1:
        ``"x"``, ``"y"``, ``"z"``, with a sign such as ``"-x"``, or a unit direction. The Franka hand closes along y.
    approach_axis : str or (3,) sequence of float
        Direction in which the gripper moves to the body, in its own frame, at right angles to ``closing_axis``.
    tcp : (3,) sequence of float, optional
        Tool centre point, the middle between the pads, in the gripper's own frame, metres; by default
        ``finger_length`` along ``approach_axis``. The Franka hand's is ``(0, 0, 0.1034)``.
    max_force : float, optional
        Largest normal force of each jaw, newtons: a solution states whether the task's grip force stays within it.
    safety_factor : float
        Of the stated grip force with its margin: a factor on the force at 10 % less friction, at least 1.
    pad : (2,) sequence of float, optional
        Length of each pad along the approach and width across it, metres; the tool centre point is in its middle. On
        a stated finger half of it is at most as long as that.
    finger : (3,) sequence of float, optional
        Length from the middle between the pads back to the palm (``finger_length``), thickness outwards from the pad
        (``finger_thickness``) and width across, metres. A finger ends with its pad; as wide as the pad if not stated.
    palm_size : (3,) sequence of float, optional
        Of the gripper's body behind the fingers: along the closing line, across it, and back along the approach,
        metres; by default a plate between the fingers' outer sides.
    pad_friction : float
        Coulomb coefficient of the pads, for problems whose contacts are the gripper's pads; 0.5 is rubber on metal.
    stroke : float, optional
        Another name of ``opening``, given instead of it.

    Raises
    ------
    InputError
        On lengths that no gripper has, on both ``opening`` and ``stroke``, on a pad that is not on its finger, on axes
        that are no unit directions or not at right angles to each other, and on forces and factors out of range.
    """

    kind: ClassVar[str] = "parallel_jaw"
    opening: float = 0.0
    closed: float = 0.0
    tilt: float | None = None
    finger_length: float = 0.0
    finger_thickness: float = 0.0
    closing_axis: str | Sequence[float] = CLOSING_AXIS
    approach_axis: str | Sequence[float] = APPROACH_AXIS
    tcp: Sequence[float] | None = None
    max_force: float | None = None
    safety_factor: float = SAFETY_FACTOR
    pad: Sequence[float] | None = None
    finger: Sequence[float] | None = None
    palm_size: Sequence[float] | None = None
    pad_friction: float = PAD_FRICTION
    stroke: InitVar[float | None] = None
    count: int = field(default=2, init=False, repr=False)

    def __post_init__(self, stroke: float | None) -> None:
        object.__setattr__(self, "closed", number("ParallelJaw.closed", self.closed, at_least=0.0))
        label = "ParallelJaw.opening" if stroke is None else "ParallelJaw.stroke"
        if stroke is not None and self.opening != 0.0:
            allowed = "one of the two (dataclasses.replace changes opening)"
            raise InputError(label, f"{stroke} beside opening={self.opening}", allowed)
        opening = hand_length(label, number(label, self.opening if stroke is None else stroke, above=0.0))
        if opening <= self.closed:
            raise InputError(label, f"{opening:g} m", f"more than closed, {self.closed:g} m")
        object.__setattr__(self, "opening", opening)
        self._set_solids()
        tilt = (TILT if self.pad is None else PAD_TILT) if self.tilt is None else self.tilt
        object.__setattr__(self, "tilt", angle("ParallelJaw.tilt", tilt, MAX_TILT, "less than a right angle"))
        friction = number("ParallelJaw.pad_friction", self.pad_friction, above=0.0)
        object.__setattr__(self, "pad_friction", friction)
        for name in ("finger_length", "finger_thickness"):
            length = number(f"ParallelJaw.{name}", getattr(self, name), at_least=0.0)
            object.__setattr__(self, name, hand_length(f"ParallelJaw.{name}", length, LARGEST_PART))
        with prefix_errors("ParallelJaw."):
            axes = gripper_rotation(self.closing_axis, self.approach_axis)
        object.__setattr__(self, "closing_axis", axis_name(axes[:, 0]))
        object.__setattr__(self, "approach_axis", axis_name(axes[:, 2]))
        object.__setattr__(self, "tcp", self._stated_tcp(self.finger_length * axes[:, 2]))
        if self.max_force is not None:
            object.__setattr__(self, "max_force", number("ParallelJaw.max_force", self.max_force, above=0.0))
        factor = number("ParallelJaw.safety_factor", self.safety_factor, at_least=1.0)
        object.__setattr__(self, "safety_factor", factor)

    def _set_solids(self) -> None:
        """Validate the sizes of pad, finger and palm, and set length and thickness of the fingers."""
        for name, count in (("pad", 2), ("finger", 3), ("palm_size", 3)):
            if (sizes := getattr(self, name)) is not None:
                label = f"ParallelJaw.{name}"
                lengths = [number(label, v, above=0.0) for v in array(label, sizes, (count,)).tolist()]
                object.__setattr__(self, name, tuple(hand_length(label, v, LARGEST_PART) for v in lengths))
        if self.finger is not None:
            object.__setattr__(self, "finger_length", self.finger[0])
            object.__setattr__(self, "finger_thickness", self.finger[1])
        if self.finger is not None and self.pad is not None:
            length, reach = self.pad[0], self.finger[0]
            if length > 2.0 * reach:
                allowed = f"at most {2.0 * reach:g} m: the finger reaches {reach:g} m from the pad's middle to the palm"
                raise InputError("ParallelJaw.pad", f"{length:g} m long", allowed)

    def _stated_tcp(self, default: FloatArray) -> tuple[float, ...] | None:
        """Return the validated tool centre point; None if it equals the default."""
        if self.tcp is None:
            return None
        point = array("ParallelJaw.tcp", self.tcp, (3,))
        hand_length("ParallelJaw.tcp", float(np.linalg.norm(point)), LARGEST_PART)
        return None if np.linalg.norm(point - default) <= SAME_POINT else tuple(point.tolist())

    @property
    def axes(self) -> FloatArray:
        """Rotation (3, 3) whose columns are the closing, transverse and approach directions in the gripper's frame."""
        return gripper_rotation(self.closing_axis, self.approach_axis)

    @property
    def tool_centre_point(self) -> FloatArray:
        """Tool centre point, the middle between the pads, in the gripper's frame, (3,), metres."""
        return self.finger_length * self.axes[:, 2] if self.tcp is None else np.asarray(self.tcp, dtype=float)

    @property
    def gripper_frame(self) -> dict[str, FloatArray]:
        """Closing axis, approach axis and tool centre point by their names in exports, (3,) each, gripper's frame."""
        closing, _, approach = self.axes.T + 0.0  # no -0.0
        return {"closing_axis": closing, "approach_axis": approach, "tcp": self.tool_centre_point + 0.0}

    @property
    def is_solid(self) -> bool:
        """Whether pad or finger sizes are given, so that clearances are computed with boxes instead of lines."""
        return self.pad is not None or self.finger is not None

    @property
    def finger_width(self) -> float:
        """Width of a finger transverse to closing line and approach, metres.

        At least the pad's width; a millimetre without either.
        """
        widths = [sizes[-1] for sizes in (self.finger, self.pad) if sizes is not None]
        return float(max(widths, default=THIN))

    def solids(self, opening: float, opened: float, path: float) -> GripperSolids:
        """Return the boxes swept by fingers and palm on a straight approach and by the fingers while they close.

        Parameters
        ----------
        opening, opened : float
            Distances between the pads in the grasp and on the approach, metres.
        path : float
            Length of the approach, metres.
        """
        thickness, half_width = max(self.finger_thickness, THIN), 0.5 * self.finger_width
        tip, back = 0.0 if self.pad is None else 0.5 * self.pad[0], -self.finger_length  # ends along the approach
        has_palm = self.finger_length > 0.0
        along, across, depth = self.palm_size or (opened + 2.0 * thickness, 2.0 * half_width, 0.0)
        rear = back - depth - path

        def fingers(inner: float, outer: float, rear: float) -> list[FloatArray]:
            box = np.array([[inner, -half_width, rear], [outer, half_width, tip]])
            return [np.array([[-outer, *box[0, 1:]], [-inner, *box[1, 1:]]]), box]

        palm = np.array([[-0.5 * along, -0.5 * across, rear], [0.5 * along, 0.5 * across, back]])
        return GripperSolids(
            open_fingers=fingers(0.5 * opened, 0.5 * opened + thickness, rear),
            closing_fingers=fingers(0.5 * opening, 0.5 * opened + thickness, back if has_palm else rear),
            closed_fingers=fingers(0.5 * opening, 0.5 * opening + thickness, rear),
            palm=[palm] if has_palm else [],
        )

    @property
    def tip_radii(self) -> tuple[float, ...]:
        """Radii of the two flat pads: zero."""
        return (0.0, 0.0)

    def variables(self, bounds: FloatArray) -> list[HandVariable]:
        """Return an empty list: the contacts determine the jaws."""
        return []

    def rows(self, placement: SymbolicCandidate, variables: dict[str, Expression]) -> list[ScalarConstraint]:
        """Return the constraints on the opening and on the angle between each normal and the closing line."""
        (p, q), (m, n) = placement.positions, placement.normals
        between = q - p
        squared = ca.sumsqr(between)
        length = ca.sqrt(squared + 1e-12 * placement.size**2)
        tilt = cast("float", self.tilt)  # set in __post_init__
        cosine = float(np.cos(tilt))
        return [
            ScalarConstraint(
                "opening of the jaws", squared, self.closed**2, self.opening**2, placement.size**2, unit="m2"
            ),
            ScalarConstraint("opposed jaws", ca.dot(m, n), upper=-float(np.cos(2.0 * tilt))),
            ScalarConstraint("facing", ca.dot(m, between) - cosine * length, 0.0, scale=placement.size, part="jaw 0"),
            ScalarConstraint("facing", -ca.dot(n, between) - cosine * length, 0.0, scale=placement.size, part="jaw 1"),
        ]

    def closing(self, positions: Sequence[Expression]) -> Expression:
        """Return the vector from the first contact to the second, metres."""
        return positions[1] - positions[0]

    def at_contacts(self, points: FloatArray, size: float, distance: Distance, cones: Sequence[Cone] = ()) -> Json:
        """Return pose, opening and approach of the gripper, as JSON data."""
        jaws = Jaws(points, self.finger_length, self.finger_thickness, tuple(cones))
        return jaws.posture(size, distance, self.axes, self.tool_centre_point)

    def along_approach(self, points: FloatArray, direction: FloatArray, size: float, distance: Distance) -> Json:
        """Return pose and opening of the gripper for a given approach, as JSON data.

        Arguments as for ``approach_depth``.
        """
        jaws = Jaws(points, self.finger_length, self.finger_thickness)
        return jaws.posture(size, distance, self.axes, self.tool_centre_point, direction)

    def flip_record(self, data: Json) -> Json:
        """Return the JSON data of a pose with the jaws exchanged, by half a turn about the approach."""
        pose, direction = data["palm_pose"], np.asarray(data["approach"]["direction"], dtype=float)
        turn = Rotation.from_quat(pose["quaternion_wxyz"], scalar_first=True)
        rotation, position = self.flip(turn.as_matrix(), np.asarray(pose["position"], dtype=float), direction)
        return {**data, "palm_pose": pose_data(rotation, position), "approach": {**data["approach"], "flip": True}}

    def flip(self, rotation: FloatArray, position: FloatArray, direction: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return rotation (3, 3) and position (3,), metres, after half a turn about the approach through the TCP."""
        flipped = (2.0 * np.outer(direction, direction) - np.eye(3)) @ rotation
        return flipped, position + (rotation - flipped) @ self.tool_centre_point

    def approaches(self, points: FloatArray, cones: Sequence[Cone] = (), turns: int = TURNS) -> FloatArray:
        """Return unit approach directions perpendicular to the closing line and within cones, (m, space)."""
        return Jaws(points, self.finger_length, self.finger_thickness, tuple(cones)).approaches(turns)

    def pose(self, points: FloatArray, direction: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return rotation (3, 3) and position (3,), metres, of the gripper's frame, given contacts and approach."""
        jaws = Jaws(points, self.finger_length, self.finger_thickness)
        return jaws.pose(direction, self.axes, self.tool_centre_point)

    def approach_depth(self, points: FloatArray, direction: FloatArray, size: float, distance: Distance) -> float:
        """Return the penetration depth of fingers and palm on a given approach, metres.

        Arguments as for ``at_contacts``. ``direction`` is the approach's, unit, (space,), body frame.
        """
        jaws = Jaws(points, self.finger_length, self.finger_thickness)
        return float(jaws.march_outwards(direction[None], size, distance)[0][0])

    def is_blocked(
        self, points: FloatArray, size: float, distance: Distance, cones: Sequence[Cone], depth: float
    ) -> bool:
        """Return whether fingers or palm penetrate something deeper than a limit, metres, on every approach.

        They are sampled at positions along the approaches: a shallow or thin obstacle can be missed.
        """
        jaws = Jaws(points, self.finger_length, self.finger_thickness, tuple(cones))
        return all(jaws.is_deeper(depth, direction, size, distance) for direction in jaws.approaches())

    def to_dict(self) -> Json:
        """Return limits, finger sizes, axes and tool centre point as JSON data."""
        axes = {"closing_axis": self.closing_axis, "approach_axis": self.approach_axis}
        return {
            "type": self.kind,
            "opening": self.opening,
            "closed": self.closed,
            "tilt": self.tilt,
            "finger_length": self.finger_length,
            "finger_thickness": self.finger_thickness,
            **{name: axis if isinstance(axis, str) else list(axis) for name, axis in axes.items()},
            "tcp": self.tool_centre_point.tolist(),
            **({} if self.max_force is None else {"max_force": self.max_force}),
            **{k: list(v) for k in ("pad", "finger", "palm_size") if (v := getattr(self, k)) is not None},
            **({} if self.pad_friction == PAD_FRICTION else {"pad_friction": self.pad_friction}),
            **({} if self.safety_factor == SAFETY_FACTOR else {"safety_factor": self.safety_factor}),
        }


@dataclass(frozen=True)
class GripperSolids:
    """Boxes swept by fingers and palm of a gripper on a straight approach, and by the fingers while they close.

    Coordinates are along closing line, transverse direction and approach, metres, from the middle between the pads.

    Parameters
    ----------
    open_fingers : list of (2, 3) array
        Corners of the two boxes that the open fingers sweep along the approach.
    closing_fingers : list of (2, 3) array
        Those that they sweep while they close.
    closed_fingers : list of (2, 3) array
        Those that the closed fingers sweep along the approach.
    palm : list of (2, 3) array
        The one that the palm sweeps along the approach; empty without a finger's length.
    """

    open_fingers: list[FloatArray]
    closing_fingers: list[FloatArray]
    closed_fingers: list[FloatArray]
    palm: list[FloatArray]


@dataclass(frozen=True)
class Jaws:
    """Two gripper pads at a pair of contacts, with the fingers behind them.

    Parameters
    ----------
    points : (2, space) array
        The contacts, metres, body frame.
    length : float
        From the pads back to the palm, metres; 0 where none is stated.
    thickness : float
        Of a finger in the closing direction, metres.
    cones : tuple of pairs
        Cones that the approach has to be within.
    """

    points: FloatArray
    length: float
    thickness: float
    cones: tuple[Cone, ...] = ()

    @property
    def opening(self) -> float:
        """Distance between the pads, metres."""
        return float(np.linalg.norm(self.points[1] - self.points[0]))

    @property
    def closing(self) -> FloatArray:
        """Unit direction from contact 0 to contact 1, (space,), body frame."""
        return np.asarray((self.points[1] - self.points[0]) / self.opening)

    def approaches(self, turns: int = TURNS) -> FloatArray:
        """Return unit approach directions perpendicular to the closing line, (m, space), steepest downwards first.

        Only those within all cones are returned, or those nearest to them; each cone's axis is tried too.
        """
        directions = self._perpendicular_directions(turns)
        if not self.cones:
            return directions
        projections = [axis - (axis @ self.closing) * self.closing for axis, _ in self.cones]
        lengths = [float(np.linalg.norm(projection)) for projection in projections]
        units = (p[None] / length for p, length in zip(projections, lengths, strict=True) if length > MIN_ACROSS)
        directions = np.concatenate([directions, *units])
        excess = [np.arccos(np.clip(directions @ axis, -1.0, 1.0)) - angle for axis, angle in self.cones]
        violation = np.maximum(np.max(excess, axis=0), 0.0)
        return np.asarray(directions[violation <= float(violation.min()) + 1e-9])

    def _perpendicular_directions(self, turns: int) -> FloatArray:
        """Return unit directions perpendicular to the closing line, (m, space), steepest downwards first."""
        closing, space = self.closing, self.points.shape[1]
        if space == 2:
            normals = np.array([[-closing[1], closing[0]], [closing[1], -closing[0]]])
            return normals[np.argsort(normals[:, 1])]
        down = -np.eye(3)[2] if abs(closing[2]) < 1.0 - 1e-9 else np.eye(3)[0]
        steepest = down - (down @ closing) * closing
        steepest /= np.linalg.norm(steepest)
        angles = np.arange(turns) * 2.0 * np.pi / turns
        return np.asarray(np.outer(np.cos(angles), steepest) + np.outer(np.sin(angles), np.cross(closing, steepest)))

    def clearest(self, size: float, distance: Distance) -> tuple[FloatArray, float, bool]:
        """Return the clearest approach, (space,), its penetration depth, metres, and whether it crosses a solid.

        Among the directions of least depth, to ``DEPTH_TOLERANCE`` of the body's size, it has the largest mean
        distance; of equals it is the steepest down the last axis. The steepest of all is taken where it lacks at most a
        tenth of that mean. Directions that pass through something thin are taken only where all do.
        """
        directions = self.approaches()
        depth, mean, through = self.march_outwards(directions, size, distance)
        is_shallow = depth <= max(float(depth.min()), DEPTH_TOLERANCE * size)
        best = float(mean[is_shallow].max())
        steepest = np.where(is_shallow & (mean >= best - TIE_TOLERANCE * size), -directions[:, -1], -np.inf)
        lowest = int(np.argmin(directions[:, -1]))
        index = int(np.argmax(steepest))
        if is_shallow[lowest] and mean[lowest] >= (1.0 - MEAN_TOLERANCE) * best > 0.0:
            index = lowest
        if through[index] and not np.all(through[is_shallow]):
            index = int(np.argmax(np.where(is_shallow & ~through, mean, -np.inf)))
        return directions[index], float(depth[index]), bool(through[index])

    def is_deeper(self, depth: float, direction: FloatArray, size: float, distance: Distance) -> bool:
        """Return whether something is penetrated deeper than ``depth``, metres, at positions along an approach."""
        (starts, setbacks, _), path_length = self._clearance_lines(), self.length + PATH_SIZES * size
        travelled = (
            setbacks + share * (path_length - setbacks)
            for share in _evenly_spaced(path_length, SAMPLE_SPACING) / path_length
        )
        return any(np.min(distance(starts - t[:, None] * direction)) < -depth for t in travelled)  # the next ones first

    def march_outwards(
        self, directions: FloatArray, size: float, distance: Distance
    ) -> tuple[FloatArray, FloatArray, BoolArray]:
        """Return each approach's penetration depth and mean distance from solids, and whether it enters one, (m,) each.

        Approaches are straight. The lines of fingers and palm are followed from the grasp outwards, by steps that
        depend on the distance.

        Outside, a step exceeds the signed distance by ``FINE_STEP`` alone, so that nothing thicker is between two
        points; inside, it is the least that can get deeper than the deepest point so far. There, and along pads, no
        step is shorter than ``COARSE_STEP``.

        Parameters
        ----------
        directions : (m, space) array
            Unit approaches.
        size : float
            Of the body, metres.
        distance : callable
            Points (n, space) to signed distances from the body and the surroundings, (n,), metres.

        Returns
        -------
        depth : (m,) array
            Largest penetration depth, metres, at least zero.
        mean : (m,) array
            Mean distance along the lines, metres.
        through : (m,) bool array
            Whether a line enters something, however thin: the distance falls to zero steeply. Lines along the pads of
            thick fingers are left out, as they slide along the body.
        """
        starts, setbacks, on_pads = self._clearance_lines()
        line_count, path_length = len(starts), self.length + PATH_SIZES * size
        start, outward = np.tile(starts, (len(directions), 1)), np.repeat(-directions, line_count, axis=0)
        travelled = np.tile(setbacks, len(directions))
        gaps, area = distance(start + travelled[:, None] * outward), np.zeros(len(start))
        least_gap = np.minimum(gaps, distance(start + path_length * outward)).reshape(-1, line_count).min(axis=1)
        least_gap, enters = np.minimum(least_gap, 0.0), np.zeros(len(start), dtype=bool)
        while (active := np.flatnonzero(travelled < path_length)).size:
            gap, position = gaps[active], travelled[active]
            advance = np.where(gap > 0.0, gap + FINE_STEP, gap - least_gap[active // line_count])
            coarse = (gap <= 0.0) | on_pads[active % line_count]
            travelled[active] = np.minimum(
                position + np.where(coarse, np.maximum(advance, COARSE_STEP), advance), path_length
            )
            step = travelled[active] - position
            next_gap = distance(start[active] + travelled[active, None] * outward[active])
            enters[active] |= (gap > 0.0) & (next_gap <= 0.0) & (next_gap - gap < -STEEP_FALL * step)
            np.minimum.at(least_gap, active // line_count, next_gap)
            area[active] += 0.5 * step * (gap + next_gap)
            gaps[active] = next_gap
        lines = (len(directions), line_count)
        mean = (area.reshape(lines) / (path_length - setbacks)).mean(axis=1)
        return 0.0 - least_gap, mean, np.any(enters.reshape(lines) & ~(on_pads & (self.thickness > 0.0)), axis=1)

    def _clearance_lines(self) -> tuple[FloatArray, FloatArray, BoolArray]:
        """Return start points (n, space) of finger and palm lines, distances (n,) to skip, and which lie on pads (n,).

        The lines are parallel to the approach, and go from their start outwards, after their setback; metres.
        Finger lines begin at the pads, palm lines between them, set back by a finger's length. The first line of each
        finger is on its pad.
        """
        (first, second), closing = self.points, self.closing
        offsets = _evenly_spaced(self.thickness, LINE_SPACING)
        palm = _evenly_spaced(self.opening, LINE_SPACING)[1:-1] if self.length > 0.0 else np.zeros(0)
        fingers = [first - offsets[:, None] * closing, second + offsets[:, None] * closing]
        starts = np.concatenate([*fingers, first + palm[:, None] * closing])
        setbacks = np.concatenate([np.zeros(2 * len(offsets)), np.full(len(palm), self.length)])
        on_pads = np.zeros(len(starts), dtype=bool)
        on_pads[[0, len(offsets)]] = True
        return starts, setbacks, on_pads

    def posture(
        self,
        size: float,
        distance: Distance,
        axes: FloatArray,
        tcp: FloatArray,
        direction: FloatArray | None = None,
    ) -> Json:
        """Return opening, approach, penetration depth and, in space, the pose of the gripper's frame, as JSON data.

        Parameters
        ----------
        size, distance
            As for ``march_outwards``.
        axes : (3, 3) array
            Closing, transverse and approach directions in the gripper's frame, its columns.
        tcp : (3,) array
            Tool centre point in the gripper's frame, metres.
        direction : (space,) array, optional
            Of the approach, unit; the clearest one by default.
        """
        if direction is None:
            approach, depth, through = self.clearest(size, distance)
        else:
            depths, _, enters = self.march_outwards(direction[None], size, distance)
            approach, depth, through = direction, float(depths[0]), bool(enters[0])
        approach_data: dict[str, object] = {"direction": approach.tolist(), "depth": depth}
        if through:
            approach_data["passes_through"] = True
        data: dict[str, object] = {"opening": self.opening, "approach": approach_data}
        if len(approach) == 2:
            return data
        rotation, position = self.pose(approach, axes, tcp)
        return {"palm_pose": pose_data(rotation, position), **data}

    def pose(self, approach: FloatArray, axes: FloatArray, tcp: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return rotation (3, 3) and position (3,), metres, of the gripper's frame in the body frame."""
        rotation = np.stack([self.closing, np.cross(approach, self.closing), approach], axis=1) @ axes.T
        return rotation, self.points.mean(axis=0) - rotation @ tcp


def _evenly_spaced(width: float, step: float, most: int = 100) -> FloatArray:
    """Return even offsets over a width, ends included, with steps of at most ``step``, metres, if ``most`` suffice."""
    return np.linspace(0.0, width, 1 + min(most, int(np.ceil(width / step - ROUNDING))))


def gripper_rotation(closing: str | Sequence[float], approach: str | Sequence[float]) -> FloatArray:
    """Return the rotation whose columns are closing, transverse and approach directions in the gripper's frame.

    Raises
    ------
    InputError
        On axes that are no unit directions, or not at right angles to each other.
    """
    x, z = axis_direction("closing_axis", closing), axis_direction("approach_axis", approach)
    if not abs(float(x @ z)) <= DIGITS:
        angle = np.degrees(np.arccos(np.clip(x @ z, -1.0, 1.0)))
        raise InputError("approach_axis", f"{angle:.4g} degrees off closing_axis", "a direction at right angles to it")
    z = z - (x @ z) * x
    z /= np.linalg.norm(z)
    return np.stack([x, np.cross(z, x), z], axis=1) + 0.0  # no -0


def axis_direction(field: str, axis: str | Sequence[float]) -> FloatArray:
    """Return an axis as a unit direction (3,) in the gripper's frame.

    Parameters
    ----------
    field : str
        For messages.
    axis : str or (3,) sequence of float
        ``"x"``, ``"y"``, ``"z"``, with a sign before it where it points the other way, or a unit direction.

    Raises
    ------
    InputError
        On any other letter, and on a direction of another length.
    """
    allowed = '"x", "y", "z", with a sign such as "-x", or a unit direction of three numbers'
    if isinstance(axis, str):
        letter = axis.removeprefix("-").removeprefix("+")
        if letter not in AXES or len(axis) > len(letter) + 1:
            raise InputError(field, axis, allowed)
        return (-1.0 if axis.startswith("-") else 1.0) * np.array(AXES[letter]) + 0.0
    direction = array(field, axis, (3,))
    length = float(np.linalg.norm(direction))
    if not abs(length - 1.0) <= DIGITS:
        raise InputError(field, f"a direction of length {length:.4g}", allowed)
    return np.asarray(direction / length)


def axis_name(direction: FloatArray) -> str | tuple[float, float, float]:
    """Return a unit direction as a signed letter if it is a coordinate axis, else as three numbers."""
    for letter, unit in AXES.items():
        for sign, mark in ((1.0, ""), (-1.0, "-")):
            if np.array_equal(sign * direction, unit):
                return f"{mark}{letter}"
    x, y, z = direction.tolist()
    return x, y, z
