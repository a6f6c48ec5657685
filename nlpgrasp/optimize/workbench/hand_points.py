"""Forward kinematics of a problem's hand: fingertips and link spheres, with link clearances from a mesh."""

from __future__ import annotations

from copy import copy
from functools import cached_property

import casadi as ca
import numpy as np

from nlpgrasp.bodies import Mesh
from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.constraints import Approach
from nlpgrasp.errors import InputError
from nlpgrasp.hands import Hand, URDFHand
from nlpgrasp.hands.base import Values
from nlpgrasp.hands.urdf.linked_hand import LinkedHand
from nlpgrasp.problem.fields import Distance, distance_to_all, fields_of
from nlpgrasp.problem.problem import GraspProblem
from nlpgrasp.solution.obstructions import jaws_depth


class HandPoints:
    """Fingertip and link positions of a problem's hand.

    Parameters
    ----------
    problem : GraspProblem
    """

    def __init__(self, problem: GraspProblem) -> None:
        self._problem = problem

    @property
    def hand(self) -> Hand:
        """The hand, of a problem that has one."""
        if self._problem.hand is None:
            raise InputError("GraspProblem.hand", None, "a hand")
        return self._problem.hand

    @property
    def posed_hand(self) -> LinkedHand:
        """The hand, of a problem with one that has a pose of its own."""
        if not isinstance(self.hand, LinkedHand):
            raise InputError("GraspProblem.hand", self.hand, "a hand with a pose of its own, such as ng.URDFHand")
        return self.hand

    @property
    def linked_hand(self) -> URDFHand:
        """The hand, of a problem with one that has links."""
        if not isinstance(self.hand, URDFHand):
            raise InputError("GraspProblem.hand", self.hand, "a hand with links, such as ng.URDFHand")
        return self.hand

    @property
    def has_flat_tips(self) -> bool:
        """Whether a hand with a pose has flat fingertips."""
        hand = self._problem.hand
        return isinstance(hand, LinkedHand) and any(tip.normal is not None for _, tip in hand.tree.tips)

    def of_limits(self, problem: GraspProblem) -> HandPoints:
        """Return the same functions for a problem whose hand differs in its joint limits alone."""
        result = copy(self)
        result._problem = problem
        return result

    def start(self, points: FloatArray, normals: FloatArray) -> Values:
        """Return the hand's starting variables for placements (b, k, space), name -> (b, m); none without a hand."""
        hand = self._problem.hand
        if hand is None or not hand.variables(self._problem.body.bounds):
            return {}
        tips = points - np.asarray(hand.tip_radii)[:, None] * normals
        starts = [hand.start(t) for t in tips]
        return {name: np.stack([s[name] for s in starts]) for name in starts[0]}

    def at_contacts(self, points: FloatArray) -> Json:
        """Return the pose and approach of a hand that follows contacts (k, 3), as JSON data."""
        problem = self._problem
        cones = [(np.asarray(c.direction), c.angle) for c in problem.constraints if isinstance(c, Approach)]
        return self.hand.at_contacts(points, problem.body.size, lambda places: self._distance(places), cones)

    def has_free_way(self, points: FloatArray) -> bool:
        """Return whether the straight approach of parallel jaws to contacts (2, 3) is collision-free."""
        return jaws_depth(self.at_contacts(points)) == 0.0

    @cached_property
    def _distance(self) -> Distance:
        """Distance to the body and to the surroundings that constraints keep a hand away from."""
        problem = self._problem
        return distance_to_all(fields_of(problem.body, problem.constraints, len(problem.models)))

    def tip_centres(self, values: Values, otherwise: FloatArray) -> FloatArray:
        """Return the centres of round fingertips (k, 3), and the given points for the others."""
        centres = self._function(*values.values())[0].full().T
        return np.where(np.isnan(centres), otherwise, centres)

    def mesh_clearances(self, body: Mesh, values: Values) -> FloatArray:
        """Return the links' signed distances to the mesh itself, (m,), one per clearance constraint, metres."""
        return body.clearance(np.asarray(self._function(*values.values())[1].full()).T)

    def link_places(self, values: Values) -> FloatArray:
        """Return the centres of the spheres around links, (b, s, 3), for values (b, m) of the hand's variables."""
        count = len(next(iter(values.values())))
        found = self._function.map(count)(*[v.T for v in values.values()])[1]
        return np.asarray(found.full()).reshape(3, count, -1).transpose(1, 2, 0)

    @cached_property
    def tip_motion(self) -> ca.Function:
        """Function of the hand's variables: fingertip positions (3, k) and their Jacobian (3 k, variables)."""
        symbols = self.hand.symbols(self._problem.body.bounds)
        places = ca.horzcat(*self.posed_hand.tip_places(symbols))
        slopes = ca.densify(ca.jacobian(ca.vec(places), ca.vertcat(*symbols.values())))
        return ca.Function("tips", list(symbols.values()), [places, slopes], {"cse": True})

    @cached_property
    def _function(self) -> ca.Function:
        """Function of the hand's variables: centres of round fingertips (NaN for others) and of the link spheres."""
        symbols = self.hand.symbols(self._problem.body.bounds)
        tips = [ca.SX.nan(3) if c is None else c for c in self.hand.tip_centres(symbols)]
        spheres = [s.centre for s in self.hand.spheres(symbols)]
        outputs = [ca.horzcat(*tips), ca.horzcat(ca.SX(3, 0), *spheres)]
        return ca.Function("hand", list(symbols.values()), outputs, {"cse": True})
