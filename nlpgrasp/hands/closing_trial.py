"""Trial closures of the fingertips on cylinders and boxes of several widths, with a force balance test.

Contacts, fingertips and links are those of the nonlinear program; efforts, quality and collisions between links are
left out. Constraints are solved by damped least squares from several postures side by side.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import casadi as ca
import numpy as np
from scipy.spatial.transform import Rotation

from nlpgrasp.common.least_squares import nonnegative_least_squares
from nlpgrasp.common.spatial import tangents
from nlpgrasp.common.types import Expression
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.hands.collision_shapes import CollisionShape
from nlpgrasp.hands.fitted_tips import supporting_points
from nlpgrasp.hands.kinematics import LinkTree
from nlpgrasp.hands.opposition import mean_alignment
from nlpgrasp.hands.tips import HullTip, SymbolicTouch, Tip, dome

WIDTHS = (0.01, 0.02, 0.03, 0.04, 0.06, 0.08, 0.1)  # metres, of the bodies that are tried
HALF_LENGTH, HALF_DEPTH = 0.05, 0.02  # metres: half lengths of the bodies along z, and of the box along y
STARTS, POSTURES = 16, 400  # starts of a body, and random postures that they are chosen from
SPLITS = 2  # ways to put the fingertips on two sides that are tried
MOST_TIPS = 8  # fingertips of which all ways are compared
STEPS = 20  # of the Levenberg-Marquardt method
FIRST_DAMPING, LEAST_DAMPING = 1e-2, 1e-6  # added to the diagonal of its matrices: at first, and at least
LESS_DAMPING, MORE_DAMPING = 0.3, 5.0  # factors on the damping after a better and after a worse step
LENGTH = 0.01  # metres: unit of lengths in the residuals
CORNERS, ROUNDING, SIDES = 12, 3e-4, 24  # of a hull in the trial: corners at most, metres, sides of the sampled patch
TOLERANCE = 0.05  # largest residual of a body that is closed on: 0.5 mm, and 0.05 of numbers
SPACING = 0.015  # metres, at least, of the inscribed balls of a shape
OUTER_DIRECTIONS = np.array([d for d in product((-1.0, 0.0, 1.0), repeat=3) if np.count_nonzero(d) in (1, 3)])
SOFT = 0.02  # weight of the contacts' distances along the faces from their mean
FRICTION, EDGES = 0.7, 8  # of the contacts, and edges of their friction cones
BALANCED = 0.02  # largest remainder of balanced forces, as a share of their normal forces (torques about 50 mm)


@dataclass(frozen=True)
class ClosingWidths:
    """Widths of cylinders and boxes, among those tried, on which all fingertips of a hand close.

    Parameters
    ----------
    cylinder, box : tuple of float
        Diameters of cylinders and widths of boxes, metres, ascending.
    """

    cylinder: tuple[float, ...]
    box: tuple[float, ...]

    def __len__(self) -> int:
        """Return the number of bodies."""
        return len(self.cylinder) + len(self.box)

    def __str__(self) -> str:
        """Return the widths as text, in millimetres."""
        if not self:
            return f"none of the cylinders and boxes of {_format_runs(WIDTHS)} that were tried"
        if self.cylinder == self.box:
            return f"cylinders and boxes of {_format_runs(self.box)}"
        parts = {"cylinders": self.cylinder, "boxes": self.box}
        return " and ".join(f"{kind} of {_format_runs(widths)}" for kind, widths in parts.items() if widths)


def closing_widths(tree: LinkTree) -> ClosingWidths:
    """Return the widths of cylinders and boxes that all fingertips can touch without the links penetrating.

    Parameters
    ----------
    tree : LinkTree
        With two to ``MOST_TIPS`` fingertips; no width is found for other numbers. Links fixed to a fingertip's are not
        tested.
    """
    if not 2 <= len(tree.tips) <= MOST_TIPS:
        return ClosingWidths((), ())
    joints = tree.random_joints(POSTURES, np.random.default_rng(0))
    tips, splits = tree.palm_tips(joints), _side_assignments(tree, joints)
    tree = LinkTree(tree.robot, [(link, _coarsened(tip)) for link, tip in tree.tips], tree.approach)
    postures = _Postures(joints, tips, splits)
    cylinder, box = (_Trial(tree, kind).closing_widths(postures) for kind in ("cylinder", "box"))
    return ClosingWidths(cylinder, box)


@dataclass(frozen=True)
class _Postures:
    """Random postures from which the starts of the trials are chosen.

    Parameters
    ----------
    joints : (b, m) array
        Positions of the free joints.
    tips : (b, k, 3) array
        Centres of the fingertips, palm frame, metres.
    splits : (s, k) array
        Ways to put the fingertips on two sides, 1 or -1.
    """

    joints: FloatArray
    tips: FloatArray
    splits: FloatArray


class _Trial:
    """Least-squares trial of a hand on a body: compiled residuals of its contacts and links.

    Parameters
    ----------
    tree : LinkTree
    kind : {"cylinder", "box"}
    """

    def __init__(self, tree: LinkTree, kind: str) -> None:
        self.tree, self.kind = tree, kind
        count = len(tree.tips)
        lower, upper = tree.joint_limits
        slides = [tip.initial_slide for _, tip in tree.tips if tip.slides]
        self.sizes = [3, 4, len(lower), len(slides), 2 * count]
        self.slides = np.array(slides)
        free = np.full(7, np.inf)
        self.lower = np.concatenate([-free, lower, np.zeros(len(slides)), np.full(2 * count, -np.inf)])
        self.upper = np.concatenate([free, upper, np.ones(len(slides)), np.full(2 * count, np.inf)])
        self.scale = np.concatenate([np.full(3, LENGTH), np.ones(4 + len(lower) + len(slides)), np.ones(2 * count)])
        x, width, sides = ca.SX.sym("x", sum(self.sizes)), ca.SX.sym("width"), ca.SX.sym("sides", count)
        residuals = self._residuals(x, width, sides)
        self.hard = residuals.shape[0] - 2 * count
        outputs = [residuals, ca.jacobian(residuals, x)]
        self.function = ca.Function("trial", [x, width, sides], outputs).map(STARTS)

    def closing_widths(self, postures: _Postures) -> tuple[float, ...]:
        """Return the body widths for which some start ends with all contacts on the body and no link in it.

        The first start of a width is where that of the width before ended, from narrow to wide and then back.
        """
        closed: dict[float, tuple[FloatArray, FloatArray]] = {}
        last = None
        for width in (*WIDTHS, *reversed(WIDTHS)):
            if width not in closed:
                sides = postures.splits[np.arange(STARTS) % len(postures.splits)]
                x = np.array([self._start(width, postures, side, i) for i, side in enumerate(sides)])
                if last is not None:
                    x[0], sides[0] = last
                index = self._solve(width, x, sides)
                if index is not None:
                    closed[width] = x[index], sides[index]
            last = closed.get(width, last)
        return tuple(sorted(closed))

    def _solve(self, width: float, x: FloatArray, sides: FloatArray) -> int | None:
        """Improve the starts ``x`` in place; return the index of the first that closes on the body, None if none does.

        The Levenberg-Marquardt method runs for all starts side by side, with limits on the variables.

        Parameters
        ----------
        width : float
            Metres.
        x : (b, m) array
            Values of the variables.
        sides : (b, k) array
            Sides of the fingertips, 1 or -1.
        """
        damping = np.full(STARTS, FIRST_DAMPING)
        residuals, jacobians = self._evaluate(x, width, sides)
        costs = np.sum(residuals**2, axis=1)
        for _ in range(STEPS):
            if (index := self._closed_start(x, width, sides, residuals)) is not None:
                return index
            gradients = np.einsum("bri,br->bi", jacobians, residuals)
            # variables at a limit, beyond which the cost would fall, stay there
            is_fixed = ((x <= self.lower) & (gradients > 0.0)) | ((x >= self.upper) & (gradients < 0.0))
            scaled_jacobians = jacobians * (self.scale * ~is_fixed)[:, None]
            matrices = scaled_jacobians.transpose(0, 2, 1) @ scaled_jacobians
            matrices[:, np.arange(x.shape[1]), np.arange(x.shape[1])] += damping[:, None]
            scaled_gradients = np.einsum("bri,br->bi", scaled_jacobians, residuals)
            steps = np.linalg.solve(matrices, -scaled_gradients[..., None])[..., 0]
            trial = np.clip(x + self.scale * steps, self.lower, self.upper)
            new_residuals, new_jacobians = self._evaluate(trial, width, sides)
            is_better = np.sum(new_residuals**2, axis=1) < costs
            x[is_better], residuals[is_better], jacobians[is_better] = (
                trial[is_better],
                new_residuals[is_better],
                new_jacobians[is_better],
            )
            costs = np.sum(residuals**2, axis=1)
            damping *= np.where(is_better, LESS_DAMPING, MORE_DAMPING)
            damping = np.maximum(damping, LEAST_DAMPING)
        return self._closed_start(x, width, sides, residuals)

    def _evaluate(self, x: FloatArray, width: float, sides: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return residuals (b, r) and their derivatives (b, r, m) at variables (b, m)."""
        residuals, jacobians = self.function(x.T, np.full((1, STARTS), width), sides.T)
        count, size = residuals.shape[0], x.shape[1]
        return residuals.full().T, jacobians.full().reshape(count, STARTS, size).transpose(1, 0, 2)

    def _closed_start(self, x: FloatArray, width: float, sides: FloatArray, residuals: FloatArray) -> int | None:
        """Return the index of the first start with small residuals and balanced contact forces; None without one."""
        for index in np.flatnonzero(np.max(np.abs(residuals[:, : self.hard]), axis=1) <= TOLERANCE):
            places = x[index, -2 * len(self.tree.tips) :].reshape(-1, 2)
            if self.kind == "cylinder":
                normals = -np.column_stack([np.cos(places[:, 0]), np.sin(places[:, 0]), np.zeros(len(places))])
                points = np.column_stack([-0.5 * width * normals[:, :2], places[:, 1]])
            else:
                normals = np.column_stack([-sides[index], np.zeros((len(places), 2))])
                points = np.column_stack([0.5 * width * sides[index], places])
            if _is_balanced(points, normals):
                return int(index)
        return None

    def _start(self, width: float, postures: _Postures, side: FloatArray, index: int) -> FloatArray:
        """Return the initial variables (m,) of a start, with the body between the two sides of the fingertips.

        Its posture is one of those whose sides are nearest to a body's width apart. The body's x axis points from one
        side to the other; its z axis lies across the palm's direction, or along it.
        """
        tips, index = postures.tips, index // len(postures.splits)
        ends = np.array([tips[:, side == sign].mean(axis=1) for sign in (-1.0, 1.0)])
        order = np.argsort(np.abs(np.linalg.norm(ends[1] - ends[0], axis=1) - width))
        posture = int(order[index % len(order)])
        middle, x_axis = ends[:, posture].mean(axis=0), ends[1, posture] - ends[0, posture]
        distance = float(np.linalg.norm(x_axis))
        x_axis = x_axis / distance if distance > 1e-6 else tangents(self.tree.approach[None])[0, 0]
        transverse = np.cross(x_axis, self.tree.approach + 1e-3 * np.array([1.0, 2.0, 3.0]))
        z_axis = transverse / np.linalg.norm(transverse)
        body = np.column_stack([x_axis, np.cross(z_axis, x_axis), z_axis])
        if index % 3 == 2:
            body = body @ Rotation.from_euler("x", 0.5 * np.pi).as_matrix()
        quaternion = Rotation.from_matrix(body.T).as_quat(scalar_first=True)
        local = (tips[posture] - middle) @ body
        places = local[:, 1:].copy()
        if self.kind == "cylinder":
            places[:, 0] = np.where(side > 0.0, 0.0, np.pi)
        return np.concatenate([-body.T @ middle, quaternion, postures.joints[posture], self.slides, places.ravel()])

    def _residuals(self, x: Expression, width: Expression, sides: Expression) -> Expression:
        """Return the residuals: contacts on the fingertips and within the faces, links outside the body.

        The last two for each contact, of little weight, draw the contacts towards each other's heights.
        """
        names = ("palm_position", "palm_quaternion", "joints", "slides", "places")
        variables = dict(zip(names, ca.vertsplit(x, np.cumsum([0, *self.sizes]).tolist()), strict=True))
        norm = ca.norm_2(variables["palm_quaternion"])
        variables["palm_quaternion"] = variables["palm_quaternion"] / norm
        poses, places = self.tree.poses(variables, self.tree.used_links), ca.reshape(variables.pop("places"), 2, -1)
        residuals = [norm - 1.0]
        for i, (link, tip, slide) in enumerate(self.tree.tips_with_slides(variables)):
            p, n, beyond = self._contact(places[:, i], width, sides[i])
            residuals += [ca.fmax(value, 0.0) / LENGTH for value in beyond]
            for row in tip.rows(SymbolicTouch(link, i, poses[link], p, n, slide, LENGTH)):
                below = row.lower - row.expression if np.isfinite(row.lower) else 0.0
                above = row.expression - row.upper if np.isfinite(row.upper) else 0.0
                excess = below if row.lower == row.upper else ca.fmax(0.0, ca.fmax(below, above))
                residuals.append(excess / row.scale)
        if self.tree.robot.has_linkages:
            residuals += [row.expression / LENGTH for row in self.tree.linkages.rows(variables["joints"])]
        groups = self.tree.robot.rigid_groups
        touching = {groups[link] for link, _ in self.tree.tips}
        for link, shapes in self.tree.robot.shapes.items():
            for shape in shapes if groups[link] not in touching else ():
                deepest = ca.SX(0)
                for point, radius in zip(*_inscribed_balls(shape), strict=True):
                    position = poses[link][:3, 3] + ca.mtimes(poses[link][:3, :3], ca.DM(point))
                    deepest = ca.fmax(deepest, float(radius) - self._distance(position, width))
                residuals.append(deepest / LENGTH)
        heights = places[1, :] if self.kind == "cylinder" else places
        offsets = ca.reshape(heights - ca.sum2(heights) / places.shape[1], -1, 1) * (SOFT / LENGTH)
        return ca.vertcat(*residuals, offsets, ca.SX(2 * places.shape[1] - offsets.shape[0], 1))

    def _contact(
        self, place: Expression, width: Expression, side: Expression
    ) -> tuple[Expression, Expression, list[Expression]]:
        """Return point, inward normal and excess beyond the face's edges of a contact, from two face coordinates."""
        excess = [ca.fabs(place[1]) - HALF_LENGTH]
        if self.kind == "cylinder":
            direction = ca.vertcat(ca.cos(place[0]), ca.sin(place[0]), 0.0)
            return 0.5 * width * direction + ca.vertcat(0.0, 0.0, place[1]), -direction, excess
        point = ca.vertcat(0.5 * width * side, place)
        return point, ca.vertcat(-side, 0.0, 0.0), [*excess, ca.fabs(place[0]) - HALF_DEPTH]

    def _distance(self, point: Expression, width: Expression) -> Expression:
        """Return a lower bound on the signed distance of a point (3,) from the body, metres, negative inside."""
        lateral = ca.norm_2(point[:2] + 1e-9) if self.kind == "cylinder" else ca.fabs(point[0])
        distance = ca.fmax(lateral - 0.5 * width, ca.fabs(point[2]) - HALF_LENGTH)
        return distance if self.kind == "cylinder" else ca.fmax(distance, ca.fabs(point[1]) - HALF_DEPTH)


def _is_balanced(points: FloatArray, normals: FloatArray) -> bool:
    """Return whether contact forces in the friction cones, not all zero, can have zero resultant force and torque.

    Parameters
    ----------
    points, normals : (k, 3) array
        Contact points, metres, and inward unit normals.
    """
    turns = 2.0 * np.pi * np.arange(EDGES) / EDGES
    frames = tangents(normals)  # (k, 2, 3)
    tangential = np.cos(turns)[:, None, None] * frames[:, 0] + np.sin(turns)[:, None, None] * frames[:, 1]
    forces = normals + FRICTION * tangential  # (edges, k, 3)
    torques = np.cross(points - points.mean(axis=0), forces) / HALF_LENGTH
    wrenches = np.concatenate([forces, torques], axis=2).reshape(-1, 6).T
    matrix = np.vstack([wrenches, np.ones(wrenches.shape[1])])  # the normal forces add up to one
    return bool(nonnegative_least_squares(matrix, np.array([*np.zeros(6), 1.0]))[1] <= BALANCED)


def _inscribed_balls(shape: CollisionShape) -> tuple[FloatArray, FloatArray]:
    """Return points (m, 3) of a shape, metres, link frame, and their depths (m,): outermost ones, and a grid inside.

    The cells of the grid are as long as the shape is thin, but at least ``SPACING``.
    """
    if shape.centre is not None:
        return shape.centre[None], np.array([shape.radius])
    vertices, pose = np.asarray(shape.mesh.vertices, dtype=float), np.eye(4) if shape.pose is None else shape.pose
    outermost = supporting_points(vertices, OUTER_DIRECTIONS @ pose[:3, :3].T, len(OUTER_DIRECTIONS))
    low, high = (end(vertices @ pose[:3, :3], axis=0) for end in (np.min, np.max))
    counts = np.ceil((high - low) / max(float(np.min(high - low)), SPACING) - 1e-9).astype(int)
    axes = [low[i] + (np.arange(count) + 0.5) * (high - low)[i] / count for i, count in enumerate(counts)]
    inner = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3) @ pose[:3, :3].T
    depths = shape.depth(inner)
    points = np.concatenate([outermost, inner[depths > 0.0]])
    return points, np.concatenate([np.zeros(len(outermost)), depths[depths > 0.0]])


def _coarsened(tip: Tip) -> Tip:
    """Return a fingertip with fewer corners if it is a convex hull."""
    if not isinstance(tip, HullTip):
        return tip
    normals = dome(np.asarray(tip.facing), tip.angle, SIDES).vertices
    return HullTip(supporting_points(np.asarray(tip.points), normals, CORNERS), tip.facing, tip.angle, ROUNDING)


def _side_assignments(tree: LinkTree, joints: FloatArray) -> FloatArray:
    """Return the best divisions of the fingertips into two sides, (s, k), 1 or -1.

    The two sides press most against each other, on average over postures.
    """
    alignment, count = mean_alignment(tree, joints), len(tree.tips)
    sides = np.array([(1.0, *others) for others in product((1.0, -1.0), repeat=count - 1) if -1.0 in others])
    scores = np.einsum("si,ij,sj->s", sides, alignment, sides)
    fewest = np.minimum(np.sum(sides > 0.0, axis=1), np.sum(sides < 0.0, axis=1))
    return sides[np.lexsort((fewest, -np.round(scores, 6)))[:SPLITS]]


def _format_runs(widths: tuple[float, ...]) -> str:
    """Return widths as text, in millimetres, with runs of consecutive trial widths as ranges."""
    runs: list[list[float]] = []
    for width in widths:
        index = WIDTHS.index(width)
        if runs and WIDTHS.index(runs[-1][-1]) == index - 1:
            runs[-1].append(width)
        else:
            runs.append([width])
    texts = [f"{1e3 * run[0]:g} to {1e3 * run[-1]:g}" if len(run) > 1 else f"{1e3 * run[0]:g}" for run in runs]
    return f"{' and '.join(texts)} mm"
