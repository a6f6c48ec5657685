"""Input data of a simulation: grasp, effort of the hand, mass of the object, wrenches."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from nlpgrasp.budgets import ForceBudget
from nlpgrasp.common.formatting import format_wrench
from nlpgrasp.common.spatial import in_space
from nlpgrasp.common.validation import FloatArray, number
from nlpgrasp.errors import InputError
from nlpgrasp.quality import FingerForces, finger_forces, mu
from nlpgrasp.quality.grasp import Grasp
from nlpgrasp.simulation.fingertip_model import FingertipModel
from nlpgrasp.simulation.fingertip_scene import DENSITY, Mass, SceneOptions, dynamic_scales, mjcf, solid_mass
from nlpgrasp.solution.solution import GraspSolution
from nlpgrasp.tasks import TaskPolytope

EARTH = 9.81  # m / s^2, gravitational acceleration
LEAST_MASS = 1e-6  # kilograms: least mass
RTOL = 0.05  # relative gap of the certificate that finds the hardest wrench, if the file lacks it
MAX_BOUND_RATIO = 1.5  # largest ratio of upper to lower bound for a conclusive simulation
WEIGHT_EFFORT = 0.25  # share of the remaining effort that the default weight takes at most


@dataclass(frozen=True)
class SimulationInput:
    """Input data of a simulation: grasp, budget, effort, mass and wrenches.

    Parameters
    ----------
    solution : GraspSolution
    grasp : Grasp
    budget : ForceBudget
    effort : float
        Units of the budget available to the hand: those of the task at full size by certified mu.
    mass : Mass
        Mass of the object.
    wrenches : (m, d) array
        Wrenches of the task, at certified mu times the effort; the hardest first.
    labels : tuple of m str
        The wrenches as text, at the simulated share.
    weight : (d,) array
        The wrench that carries the object.
    """

    solution: GraspSolution
    grasp: Grasp
    budget: ForceBudget
    effort: float
    mass: Mass
    wrenches: FloatArray
    labels: tuple[str, ...]
    weight: FloatArray

    @cached_property
    def least(self) -> FingerForces:
        """The least finger forces that produce the hardest wrench."""
        return finger_forces(self.grasp, self.wrenches[:1], force_budget=self.budget)

    def fingertip_model(self, actual: Grasp, gravity: float) -> FingertipModel:
        """Return the MuJoCo model of the grasp at given contacts."""
        unit = dynamic_scales(self.grasp, float(np.linalg.norm(self.least.forces)), self.mass.mass)
        scene = mjcf(self.solution, SceneOptions(actual, self.mass, unit=unit, stiffness=False))
        allowed = self.budget.at(actual.frames, actual.contacts)
        return FingertipModel(scene, actual, allowed, self.effort, unit, gravity)


def build_simulation_input(solution: GraspSolution, share: float, mass: float | None, count: int) -> SimulationInput:
    """Return the input of a simulation; arguments as in ``simulate``."""
    drawing, grasp = solution.require_drawing(), solution.require_grasp()
    if not solution.is_certified or solution.mu.upper > MAX_BOUND_RATIO * solution.mu.lower:
        raise InputError(
            "quality.mu", str(solution.mu), f"bounds within a factor of {MAX_BOUND_RATIO:g}: solve it again"
        )
    budget = solution.budget
    effort = 1.0 if budget.absolute else 1.0 / solution.mu.lower
    wrenches = effort * solution.mu.lower * boundary_wrenches(solution, count)
    water_mass = solid_mass(drawing.body, DENSITY)
    unit_weight = _weight_wrench(grasp, water_mass)
    unit_forces = finger_forces(grasp, unit_weight, force_budget=budget)
    if mass is not None:
        kilograms = number("mass", mass, at_least=LEAST_MASS)
    elif unit_forces.feasible[0]:
        kilograms = min(water_mass.mass, WEIGHT_EFFORT * (1.0 - share) * effort / float(unit_forces.used[0]) / EARTH)
    else:
        raise InputError("solution", "a grasp that cannot carry the body upwards", "one that bears its weight too")
    labels = tuple(format_wrench(share * w) for w in wrenches)
    weight = kilograms * EARTH * unit_weight
    return SimulationInput(solution, grasp, budget, effort, water_mass.scaled(kilograms), wrenches, labels, weight)


def boundary_wrenches(solution: GraspSolution, count: int) -> FloatArray:
    """Return the task's hardest wrench and ``count`` ends, about the grasp's torque origin, (m, d).

    Those of a polytope are spread over its corners: the last of a pour is its tilt.
    """
    grasp, task, hardest = solution.require_grasp(), solution.task, solution.mu.worst_direction
    if hardest is None:
        hardest = mu(grasp, task, RTOL, force_budget=solution.budget).worst_direction
    ends = [] if hardest is None else [task.support(hardest[None, :])[1][0]]
    others = task.ends()
    if isinstance(task, TaskPolytope) and count < len(others):
        others = others[np.linspace(len(others) - 1, 0, count).round().astype(int)[::-1]]
    return np.array([*ends, *others[:count]])


def _weight_wrench(grasp: Grasp, mass: Mass) -> FloatArray:
    """Return the wrench (d,) that balances one newton of weight."""
    up = np.eye(3)[2 if grasp.space == 3 else 1]
    moment = np.cross(mass.center - in_space(grasp.torque_origin[None])[0], up)
    return np.concatenate([up, moment]) if grasp.space == 3 else np.array([*up[:2], moment[2]])
