"""Constraint values and violations of candidates, and forward kinematics of the hand."""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from functools import cached_property

import casadi as ca
import numpy as np

from nlpgrasp.common.evaluation import BatchEvaluator
from nlpgrasp.common.scalar_constraints import ScalarConstraint
from nlpgrasp.common.spatial import pose_data
from nlpgrasp.common.types import Expression, Json
from nlpgrasp.common.validation import BoolArray, FloatArray
from nlpgrasp.constraints import Approach
from nlpgrasp.errors import InputError
from nlpgrasp.hands import Hand, ParallelJaw, URDFHand
from nlpgrasp.hands.base import Values
from nlpgrasp.hands.linked_hand import LinkedHand
from nlpgrasp.motion.distance_fields import Distance, DistanceField, build_distance_fields, distance_to_all
from nlpgrasp.motion.jaw_clearance import JawClearance, JawPose, contact_patches
from nlpgrasp.problem.candidate_constraints import CandidateConstraints, build_candidate_constraints
from nlpgrasp.problem.problem import GraspProblem
from nlpgrasp.solution.obstructions import TOLERANCE, jaws_depth

SOLID_TURNS = 24  # approach directions tried for a gripper with stated sizes
FEW_TURNS = 8  # approach directions tried to decide whether any is free
OPPOSITE = -0.99  # cosine between two approaches below which they are opposite
NARROW = 1e-2  # width between limits, over a constraint's scale, below which it counts as an equation


class ConstraintValues:
    """Evaluator of the constraints of a problem and its hand.

    Parameters
    ----------
    problem : GraspProblem
    """

    def __init__(self, problem: GraspProblem) -> None:
        self.problem = problem

    @cached_property
    def named(self) -> tuple[ScalarConstraint, ...]:
        """Scalar constraints of the user and of the hand, in the order of the program."""
        return self._rows[0].named

    @property
    def sources(self) -> tuple[tuple[int, ...], ...]:
        """Indices of the scalar constraints by source: each user constraint, then the hand."""
        return self._rows[0].sources

    def values(self, points: FloatArray, normals: FloatArray, hand: Values) -> FloatArray:
        """Return the constraint values of placements (b, k, space), (b, rows), in the constraints' units."""
        if not self.named:
            return np.zeros((len(points), 0))
        return self._evaluator(points, normals, *hand.values())[0]

    def violations(self, points: FloatArray, normals: FloatArray, hand: Values) -> FloatArray:
        """Return the largest constraint violation of each placement, relative to the constraints' scales, (b,).

        The extents of faces are not among these constraints.
        """
        return self.largest_violations(self.values(points, normals, hand))

    def largest_violations(self, values: FloatArray) -> FloatArray:
        """Return each placement's largest violation, from constraint values (b, m), relative to the scales, (b,)."""
        return np.asarray(np.max(self.each_violation(values), axis=1, initial=0.0))

    def each_violation(self, values: FloatArray, band: float = 0.0) -> FloatArray:
        """Return the violation of each constraint value (b, m), relative to the constraint's scale, (b, m).

        Constraints with nearly equal limits may be violated by a ``band``, relative to their scales.
        """
        lower, upper, scale = (np.array([getattr(r, key) for r in self.named]) for key in ("lower", "upper", "scale"))
        excess = np.maximum(lower - values, values - upper) / scale - band * (upper - lower <= NARROW * scale)
        return np.where(np.isfinite(values), np.maximum(excess, 0.0), np.inf)

    @cached_property
    def dependence_mask(self) -> BoolArray:
        """Mask of the contacts that each constraint depends on, (rows, k + 1); the last column stands for the hand."""
        k, space = len(self.problem.models), self.problem.body.space
        result = np.zeros((len(self.named), k + 1), dtype=bool)
        for i in range(self._row_function.n_in() if self.named else 0):
            rows, columns = self._row_function.jac_sparsity(0, i).get_triplet()
            result[rows, np.array(columns, dtype=int) // space if i < 2 else k] = True
        return result

    @cached_property
    def _rows(self) -> tuple[CandidateConstraints, list[ca.SX]]:
        """Symbolic constraints with their free symbols."""
        space, k, problem = self.problem.body.space, len(self.problem.models), self.problem
        p, n = ca.SX.sym("p", space * k), ca.SX.sym("n", space * k)
        split = list(range(0, space * k + 1, space))
        symbols = {} if problem.hand is None else problem.hand.symbols(problem.body.bounds)
        constraints = build_candidate_constraints(
            problem.body, problem.constraints, problem.hand, ca.vertsplit(p, split), ca.vertsplit(n, split), symbols
        )
        return constraints, [p, n, *symbols.values()]

    @cached_property
    def _evaluator(self) -> BatchEvaluator:
        """Batched evaluator of the constraint values."""
        return BatchEvaluator(self._row_function)

    @cached_property
    def _row_function(self) -> ca.Function:
        """CasADi function of contacts, normals and hand variables that returns the constraint values."""
        inputs, values = self._expressions(range(len(self.named)))
        return ca.Function("rows", inputs, [values])

    def linearised(self, indices: Sequence[int]) -> BatchEvaluator:
        """Return an evaluator of some constraint values (b, r) and their derivatives (b, r, n) by all inputs.

        Inputs are contacts, normals and the hand's variables, side by side.
        """
        inputs, values = self._expressions(indices)
        slopes = ca.horzcat(*[ca.jacobian(values, symbols) for symbols in inputs])
        outputs = [ca.densify(values), ca.densify(slopes)]
        return BatchEvaluator(ca.Function("rows", inputs, outputs, {"cse": True}))

    def _expressions(self, indices: Sequence[int]) -> tuple[list[Expression], Expression]:
        """Return the free symbols, and the column of the constraint values with some indices."""
        constraints, inputs = self._rows
        count = len(constraints.rows)
        values = ca.vertcat(ca.SX(0, 1), *[constraints.rows[i].expression for i in indices if i < count])
        clearances = [constraints.clearances[i - count] for i in indices if i >= count]
        if not clearances:
            return inputs, values
        points = ca.horzcat(ca.SX(self.problem.body.space, 0), *[c.point for c in clearances])
        # distances to a mesh exist only as MX: the SX function of everything else is called inside an MX function
        without_distances = ca.Function("rows", inputs, [values, points])
        symbols = [ca.MX.sym(f"x{i}", s.shape[0]) for i, s in enumerate(inputs)]
        rows, clearance_points = without_distances(*symbols)
        distances = [c.distance(clearance_points[:, i]) for i, c in enumerate(clearances)]
        return symbols, ca.vertcat(rows, *distances)


class HandFunctions:
    """Functions of a problem's hand: initial values, tip and link positions, clearances, jaw approach.

    Parameters
    ----------
    problem : GraspProblem
    """

    def __init__(self, problem: GraspProblem) -> None:
        self._problem = problem

    @property
    def hand(self) -> Hand:
        """The problem's hand; raises an ``InputError`` if there is none."""
        if self._problem.hand is None:
            raise InputError("GraspProblem.hand", None, "a hand")
        return self._problem.hand

    @property
    def posed_hand(self) -> LinkedHand:
        """The problem's hand; raises an ``InputError`` unless it has a pose of its own."""
        if not isinstance(self.hand, LinkedHand):
            raise InputError("GraspProblem.hand", self.hand, "a hand with a pose of its own, such as ng.URDFHand")
        return self.hand

    @property
    def linked_hand(self) -> URDFHand:
        """The problem's hand; raises an ``InputError`` unless it has links."""
        if not isinstance(self.hand, URDFHand):
            raise InputError("GraspProblem.hand", self.hand, "a hand with links, such as ng.URDFHand")
        return self.hand

    @property
    def has_flat_tips(self) -> bool:
        """Whether the hand has a pose of its own and a flat fingertip."""
        hand = self._problem.hand
        return isinstance(hand, LinkedHand) and any(tip.normal is not None for _, tip in hand.tree.tips)

    def of_limits(self, problem: GraspProblem) -> HandFunctions:
        """Return the same functions for a problem whose hand has other joint limits."""
        result = copy(self)
        result._problem = problem
        return result

    def start(self, points: FloatArray, normals: FloatArray) -> Values:
        """Return initial values of the hand's variables for placements (b, k, space), (b, m) each, by name.

        Empty without a hand, and for a hand without variables.
        """
        hand = self._problem.hand
        if hand is None or not hand.variables(self._problem.body.bounds):
            return {}
        return hand.start(points - np.asarray(hand.tip_radii)[:, None] * normals)

    def at_contacts(self, points: FloatArray) -> Json:
        """Return the pose and approach of a hand that is determined by its contacts (k, 3), as JSON data."""
        clearance = self._jaw_clearance
        if clearance is not None:
            directions = clearance.directions(points, self._problem.models)
            return _jaw_record(clearance, points, clearance.poses(points, SOLID_TURNS, directions=directions)[0])
        data = self.hand.at_contacts(
            points, self._problem.body.size, lambda points: self._distance(points), self._approach_cones
        )
        return self._with_shares(points, data)

    def along_approach(self, points: FloatArray, direction: FloatArray, flip: bool = False) -> Json:
        """Return the pose and obstacles of parallel jaws at contacts (2, 3) for an approach direction, as JSON data.

        With ``flip`` the jaws are exchanged. Empty for other hands.
        """
        hand, clearance = self.hand, self._jaw_clearance
        if not isinstance(hand, ParallelJaw):
            return {}
        if clearance is not None:
            data = _jaw_record(clearance, points, clearance.pose(points, direction))
        else:
            data = hand.along_approach(points, direction, self._problem.body.size, self._distance)
            data = self._with_shares(points, self.name_obstacles(points, data))
        return hand.flip_record(data) if flip else data

    def _with_shares(self, points: FloatArray, data: Json) -> Json:
        """Return the data of parallel jaws without stated sizes with the fraction of each contact on its face added."""
        if self._unsized_jaws is None:
            return data
        direction = np.asarray(data["approach"]["direction"])
        shares = self._unsized_jaws.pad_shares(points, direction[None])[0].tolist()
        return {**data, "pads": shares}

    @property
    def _approach_cones(self) -> list[tuple[FloatArray, float]]:
        """Cones that must contain the approach direction: axes (space,) and angles, radians."""
        return [(np.asarray(c.direction), c.angle) for c in self._problem.constraints if isinstance(c, Approach)]

    def name_obstacles(self, points: FloatArray, data: Json) -> Json:
        """Return the data of ``at_contacts`` with the depth of parallel jaws in each obstacle added."""
        hand = self.hand
        if not isinstance(hand, ParallelJaw) or not jaws_depth(data) or self._jaw_clearance is not None:
            return data
        approach, size = data["approach"], self._problem.body.size
        direction = np.asarray(approach["direction"])
        depths = dict[str, float]()
        for field in self._fields:
            depth = hand.approach_depth(points, direction, size, field.distance)
            if depth > max(TOLERANCE, depths.get(field.solid, 0.0)):
                depths[field.solid] = depth
        return {**data, "approach": {**approach, "blocked_by": depths}}

    def has_free_approach(self, points: FloatArray) -> bool:
        """Return whether parallel jaws have a collision-free straight approach to contacts (2, 3)."""
        if self.is_blocked(points):
            return False
        return self._jaw_clearance is not None or jaws_depth(self.at_contacts(points)) == 0.0

    @cached_property
    def _jaw_clearance(self) -> JawClearance | None:
        """Exact clearance of a gripper with given pad or finger sizes; None for other hands and in the plane."""
        problem, hand = self._problem, self._problem.hand
        if not isinstance(hand, ParallelJaw) or not hand.is_solid or problem.body.space != 3:
            return None
        return JawClearance(hand, problem.body, problem.constraints, problem.models)

    @cached_property
    def _unsized_jaws(self) -> JawClearance | None:
        """The surface under plane and line contacts of parallel jaws without stated sizes; None for all others."""
        problem, hand = self._problem, self._problem.hand
        if not isinstance(hand, ParallelJaw) or hand.is_solid or problem.body.space != 3:
            return None
        if not contact_patches(hand, problem.models):
            return None
        return JawClearance(hand, problem.body, problem.constraints, problem.models)

    def is_blocked(self, points: FloatArray) -> bool:
        """Return whether all tested straight approaches of parallel jaws to contacts (2, 3) are blocked.

        For a gripper with stated sizes, a few approaches are tried by exact geometry; its pads have to be on their
        faces. Other jaws are sampled along all approaches: an obstacle can be missed.
        """
        hand, size, clearance = self.hand, self._problem.body.size, self._jaw_clearance
        if clearance is None:
            return isinstance(hand, ParallelJaw) and hand.is_blocked(
                points, size, self._distance, self._approach_cones, TOLERANCE
            )
        directions = clearance.directions(points, self._problem.models)
        if directions is None:
            directions = clearance.gripper.approaches(points, clearance.cones, FEW_TURNS)
        return next(clearance.usable_approaches(points, directions), None) is None

    def usable_turns(self, points: FloatArray) -> list[FloatArray]:
        """Return an approach (3,) for each turn of the pads at contacts (2, 3): on their faces, with a free way in.

        The pads are turned about the closing line from the direction that the problem states; see
        ``JawClearance.turned_approaches``. Of two opposite approaches, which have the same pads, one is returned.
        """
        clearance, chosen = self._jaw_clearance, list[FloatArray]()
        if clearance is None:
            return chosen
        for direction in clearance.usable_approaches(points, clearance.turned_approaches(points, self._problem.models)):
            if all(direction @ other > OPPOSITE for other in chosen):
                chosen.append(direction)
        return chosen

    @cached_property
    def _fields(self) -> list[DistanceField]:
        """Distance fields of the body and of the surroundings that constraints keep a hand away from."""
        problem = self._problem
        return build_distance_fields(problem.body, problem.constraints, len(problem.models))

    @cached_property
    def _distance(self) -> Distance:
        """Function that returns the distance to the body and its surroundings."""
        return distance_to_all(self._fields)

    def tip_centres(self, values: Values, otherwise: FloatArray) -> FloatArray:
        """Return the centres of the fingertips, (k, 3), with ``otherwise`` for fingertips that are not round."""
        centres = self._function(*values.values()).full().T
        return np.where(np.isnan(centres), otherwise, centres)

    @cached_property
    def tip_jacobian_function(self) -> ca.Function:
        """CasADi function of the hand's m variables that returns fingertip positions (3, k) and Jacobian (3 k, m)."""
        symbols = self.hand.symbols(self._problem.body.bounds)
        positions = ca.horzcat(*self.posed_hand.tip_places(symbols))
        jacobian = ca.densify(ca.jacobian(ca.vec(positions), ca.vertcat(*symbols.values())))
        return ca.Function("tips", list(symbols.values()), [positions, jacobian], {"cse": True})

    @cached_property
    def _function(self) -> ca.Function:
        """CasADi function of the hand's variables that returns the centres of the fingertips, NaN if not round."""
        symbols = self.hand.symbols(self._problem.body.bounds)
        tips = [ca.SX.nan(3) if c is None else c for c in self.hand.tip_centres(symbols)]
        return ca.Function("hand", list(symbols.values()), [ca.horzcat(*tips)], {"cse": True})


def _jaw_record(clearance: JawClearance, points: FloatArray, pose: JawPose) -> Json:
    """Return a gripper's pose as JSON data, with exact clearance and the fraction of each pad on its face."""
    approach = {
        "direction": pose.direction.tolist(),
        "depth": max(pose.blocked_by.values(), default=0.0),
        "clearance": pose.clearance,
        "opened": pose.opened,
        **({"blocked_by": dict(pose.blocked_by)} if pose.blocked_by else {}),
    }
    shares = clearance.pad_shares(points, pose.direction[None])[0].tolist()
    return {
        "palm_pose": pose_data(pose.rotation, pose.position),
        "opening": pose.opening,
        "approach": approach,
        **({"pads": shares} if shares else {}),
    }
