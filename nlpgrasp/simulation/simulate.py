"""Simulation of a solution with free fingertips: task wrenches, and the hardest one beyond the certified bound."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from nlpgrasp.budgets import ForceBudget
from nlpgrasp.common.optional_packages import import_mujoco
from nlpgrasp.common.validation import FloatArray, integer, number
from nlpgrasp.contacts.product import component_slices
from nlpgrasp.errors import InputError
from nlpgrasp.quality import finger_forces
from nlpgrasp.quality.grasp import Grasp
from nlpgrasp.simulation.fingertip_model import Snapshot
from nlpgrasp.simulation.fingertip_outcome import Simulation, Trial, describe_trials
from nlpgrasp.simulation.simulation_input import EARTH, SimulationInput, build_simulation_input
from nlpgrasp.solution.obstructions import warn_of_touching
from nlpgrasp.solution.solution import GraspSolution, require_solution

# conditions
LESS_FRICTION, DISPLACEMENT = 0.1, 2e-3  # loss of friction as a share, displacement in metres
MAX_EXTRAPOLATION = 4.0  # largest extrapolation of the file's worst displacement, as a multiple of its offset
AS_SOLVED, WEIGHTLESS, SLIPPERY = "as solved", "without gravity", f"friction {LESS_FRICTION:.0%} lower"
DISPLACED = f"contacts {1e3 * DISPLACEMENT:g} mm off"
# finger forces
MARGINS = np.arange(0.0, 0.41, 0.05)  # candidate friction margins, as shares
FRICTION_EFFORT, GRIP_EFFORT = 0.97, 0.99  # usable shares of the effort; the rest holds the fingertips in place
# trials of task wrenches
RISE, PAUSE, GROWTH, HOLD = 4.0, 4.0, 12.0, 10.0  # parts of a run, units of time
SNAPSHOTS = 30  # snapshots of a run
# growth of the hardest wrench until it is lost
LARGEST_WRENCH = 1.5  # largest wrench, in certified upper bounds
STEPS = 40  # shares with computed forces, between which forces are interpolated
GRIP_RISE, QUICK_TIME = 8.0, 20.0  # units of time of gripping, and of the wrench's growth to QUICK
QUICK = 0.9  # share of the wrench that the effort can produce
SLOW_RATE = 0.002  # growth per unit of time after that, slow enough for failure to show despite damping
GROWTH_SNAPSHOTS = 2000  # snapshots of the growth
FAILURE_SHARE = 0.1  # share of the motion that counts as lost, at which failure begins
LAST_MOTION = 5.0  # largest motion in pictures, in motions that count as lost


def simulate(
    solution: GraspSolution,
    share: float = 0.8,
    mass: float | None = None,
    wrenches: int = 12,
    progress: Callable[[str], None] | None = None,
) -> Simulation:
    """Simulate a solution in MuJoCo: first the task wrenches, then the hardest one, growing until it is lost.

    The hand's effort is that of the task at full size, ``1 / mu`` units of the force budget (one for torque budgets).
    Its fingertips press with forces that produce each wrench within that effort; springs hold them in place, and motors
    and springs together never exceed it. Under every condition the hand only knows the grasp as solved.

    Parameters
    ----------
    solution : GraspSolution
        One with a grasp.
    share : float
        Scale of the task wrenches, as a share of certified mu, above 0 and below 1.
    mass : float, optional
        Of the object, kilograms. By default that of water, or that which takes a quarter of the effort left by the
        wrenches, whichever is less. Gravity acts along -z of the body (-y in the plane).
    wrenches : int
        Number of ends of the task's semi-axes to simulate beside the hardest wrench.
    progress : callable, optional
        Called with messages on the beginning and end of each condition.

    Raises
    ------
    InputError
        Without a grasp, with bilateral contacts, or with more mass than the hand can carry.
    MissingExtraError
        Without MuJoCo (extra ``sim``).

    Warns
    -----
    UserWarning
        On a link inside something, and on contacts that are off their fingertips' links.
    """
    solution = require_solution(solution)
    import_mujoco("a simulation")
    touching = warn_of_touching(solution.name, solution.hand)
    share = number("share", share, above=0.0)
    if share >= 1.0:
        raise InputError("share", share, "less than 1: beyond it nothing is certified")
    data = build_simulation_input(solution, share, mass, integer("wrenches", wrenches, at_least=1))
    conditions = _conditions(data, share)
    if mass is not None and np.any(conditions[0].loads.margins < 0.0):
        raise InputError("mass", mass, "less: the hand cannot hold it beside the task")
    notes: tuple[str, ...] = ()
    if DISPLACED not in (condition.name for condition in conditions):
        notes = (f"{DISPLACED}: not tried, the file says nothing of the surface beside the contacts",)
    report = progress or (lambda _: None)
    trials: list[Trial] = []
    for condition in conditions:
        report(f"  {condition.name} ...")
        outcomes = _run_trials(data, condition)
        report(describe_trials(condition.name, outcomes))
        trials += outcomes
    report("  the hardest wrench, growing ...")
    lost_at, growing = grow_wrench(data)
    return Simulation(
        name=solution.name,
        share=share,
        effort=data.effort,
        mass=data.mass.mass,
        trials=tuple(trials),
        gap=solution.mu.upper / solution.mu.lower,
        lost_at=lost_at,
        growing=growing,
        notes=notes,
        touching=touching,
    )


@dataclass(frozen=True)
class _Condition:
    """Condition of a simulation: actual contacts, wrenches with finger forces, gravity (m / s^2)."""

    name: str
    contacts: Grasp
    loads: WrenchForces
    gravity: float


def _conditions(data: SimulationInput, share: float) -> list[_Condition]:
    """Return the conditions of a simulation.

    The one with displaced contacts is left out if the solution states no displacement.
    """
    grasp, scaled_wrenches = data.grasp, share * data.wrenches
    with_weight = forces_for_wrenches(grasp, data.labels, scaled_wrenches + data.weight, data.budget, data.effort)
    without_weight = forces_for_wrenches(grasp, data.labels, scaled_wrenches, data.budget, data.effort)
    result = [
        _Condition(AS_SOLVED, grasp, with_weight, EARTH),
        _Condition(WEIGHTLESS, grasp, without_weight, 0.0),
        _Condition(SLIPPERY, reduce_friction(grasp, LESS_FRICTION), with_weight, EARTH),
    ]
    displaced = displace_contacts(data.solution, DISPLACEMENT)
    if displaced is not None:
        result.append(_Condition(DISPLACED, displaced, with_weight, EARTH))
    return result


def _run_trials(data: SimulationInput, condition: _Condition) -> list[Trial]:
    """Return one trial per wrench under a condition."""
    model, loads = data.fingertip_model(condition.contacts, condition.gravity), condition.loads
    unit, weight = model.unit.time, data.weight if condition.gravity else 0.0 * data.weight
    forces = forces_in_actual_frames(data.grasp, condition.contacts, loads.forces)
    pulls = loads.wrenches - weight  # gravity applies the weight
    mean_pull, mean_forces = pulls.mean(axis=0), forces.mean(axis=0)  # also feasible: cones are convex
    trials = []
    for label, pull, x in zip(loads.labels, pulls, forces, strict=True):

        def course(time: float, pull: FloatArray = pull, x: FloatArray = x) -> tuple[FloatArray, FloatArray]:
            rise = min(time / (RISE * unit), 1.0)
            growth = min(max(time / unit - RISE - PAUSE, 0.0) / GROWTH, 1.0)
            return rise * ((1.0 - growth) * mean_pull + growth * pull), rise * (
                (1.0 - growth) * mean_forces + growth * x
            )

        snapshots = model.run(course, (RISE + PAUSE + GROWTH + HOLD) * unit, RISE * unit, SNAPSHOTS, _is_lost)
        trials.append(Trial(condition.name, label, tuple(snapshots)))
    return trials


def _is_lost(snapshot: Snapshot) -> bool:
    """Return whether the grasp is lost in a snapshot."""
    return snapshot.lost


def grow_wrench(data: SimulationInput) -> tuple[float | None, Trial]:
    """Return the scale of the hardest wrench at which the body begins to move, or None if it is held, and the trial.

    The wrench grows slowly. The hand uses up to its full effort; any excess of the wrench is not balanced. The scale is
    relative to the certified lower bound. Motion begins at a tenth of what counts as lost, as the wrench grows on until
    the body is lost.
    """
    model = data.fingertip_model(data.grasp, 0.0)
    unit, end = model.unit.time, LARGEST_WRENCH * data.solution.mu.upper / data.solution.mu.lower
    hardest = data.wrenches[0]
    limit = data.effort / float(data.least.used[0])
    scales = np.append(np.linspace(0.0, min(end, (1.0 - 1e-9) * limit), STEPS), max(end, limit))
    labels = ("",) * len(scales)
    forces = forces_for_wrenches(data.grasp, labels, scales[:, None] * hardest, data.budget, data.effort).forces
    forces[-1] = forces[-2]

    quick = QUICK * min(limit, 1.0)

    def scale_at(time: float) -> float:
        elapsed = max(time / unit - GRIP_RISE, 0.0)
        return quick * min(elapsed / QUICK_TIME, 1.0) + SLOW_RATE * max(elapsed - QUICK_TIME, 0.0)

    def course(time: float) -> tuple[FloatArray, FloatArray]:
        scale = scale_at(time)
        index = min(int(np.searchsorted(scales, scale, side="right")), STEPS)
        fraction = (scale - scales[index - 1]) / max(scales[index] - scales[index - 1], 1e-300)
        finger_force_values = forces[index - 1] + min(fraction, 1.0) * (forces[index] - forces[index - 1])
        return scale * hardest, min(2.0 * time / (GRIP_RISE * unit), 1.0) * finger_force_values

    seconds = (GRIP_RISE + QUICK_TIME + (end - quick) / SLOW_RATE) * unit
    snapshots = model.run(
        course, seconds, GRIP_RISE * unit, GROWTH_SNAPSHOTS, lambda snapshot: snapshot.beyond(LAST_MOTION)
    )
    trial = Trial("growing", data.labels[0], tuple(snapshots))
    if not snapshots[-1].lost:
        return None, trial
    return next(scale_at(s.time) for s in snapshots if s.beyond(FAILURE_SHARE)), trial


@dataclass(frozen=True)
class WrenchForces:
    """Wrenches and finger forces that produce them.

    Parameters
    ----------
    labels : tuple of m str
    wrenches : (m, d) array
        Wrenches to produce.
    forces : (m, n) array
        Contact by contact, as in G: they produce the wrenches.
    margins : (m,) array
        Unused share of friction; -1 where a wrench needs more than the effort.
    """

    labels: tuple[str, ...]
    wrenches: FloatArray
    forces: FloatArray
    margins: FloatArray


def forces_for_wrenches(
    grasp: Grasp, labels: tuple[str, ...], wrenches: FloatArray, budget: ForceBudget, effort: float
) -> WrenchForces:
    """Return finger forces that produce wrenches with the largest friction margin within an effort.

    The least forces lie on the boundary of the friction cones, where any disturbance makes fingers slip. For all but
    the hardest wrenches the hand has spare effort, and uses it for forces that need less friction, and for gripping.

    Parameters
    ----------
    grasp : Grasp
    labels : tuple of m str
    wrenches : (m, d) array
    budget : ForceBudget
    effort : float
        Units of the budget.
    """
    forces = np.zeros((len(wrenches), grasp.G.shape[1]))
    margins = np.full(len(wrenches), -1.0)
    for margin in MARGINS:
        result = finger_forces(reduce_friction(grasp, float(margin)), wrenches, force_budget=budget)
        available = (1.0 if margin == 0.0 else FRICTION_EFFORT) * effort
        is_feasible = result.feasible & (result.used <= available)
        forces[is_feasible], margins[is_feasible] = result.forces[is_feasible], margin
    grip = grip_forces(grasp, budget)
    for i in np.flatnonzero(margins >= 0.0):
        forces[i] += _largest_grip(grasp, forces[i], grip, budget, GRIP_EFFORT * effort) * grip
    return WrenchForces(labels, wrenches, forces, margins)


def grip_forces(grasp: Grasp, budget: ForceBudget) -> FloatArray:
    """Return internal finger forces (n,), summed over axes: the forces for a wrench and for its opposite."""
    d, space = grasp.dimension, grasp.space
    ends = np.diag([1.0] * space + [grasp.mean_arm] * (d - space))
    result = finger_forces(grasp, np.concatenate([ends, -ends]), force_budget=budget)
    total = np.where(result.feasible[:, None], result.forces, 0.0)
    is_pair = result.feasible[:d] & result.feasible[d:]
    return np.asarray((total[:d] + total[d:])[is_pair].sum(axis=0))


def _largest_grip(grasp: Grasp, x: FloatArray, grip: FloatArray, budget: ForceBudget, limit: float) -> float:
    """Return the largest factor of internal forces that keeps all forces within an effort, by bisection."""
    allowed = budget.at(grasp.frames, grasp.contacts)
    grip_effort = float(allowed.gauge(grip[None])[0])
    low, high = 0.0, limit / grip_effort if grip_effort > 0.0 else 0.0
    for _ in range(20):
        middle = 0.5 * (low + high)
        used = float(allowed.gauge((x + middle * grip)[None])[0])
        low, high = (middle, high) if used <= limit else (low, middle)
    return low


def reduce_friction(grasp: Grasp, fraction: float) -> Grasp:
    """Return the grasp with friction reduced by a fraction."""
    models = [model.with_friction(1.0 - fraction) for model in grasp.contacts]
    return Grasp(grasp.points, grasp.normals, models, grasp.torque_origin, grasp.tangents)


def displace_contacts(solution: GraspSolution, offset: float) -> Grasp | None:
    """Return the grasp with contacts displaced by an offset, metres, towards the solution's worst displacement.

    The file states the worst displacement found at another offset; positions and normals are extrapolated linearly.
    None where the file has none, or one too small to extrapolate.
    """
    grasp, robust = solution.grasp, solution.robust
    if grasp is None or robust is None or robust.offset < offset / MAX_EXTRAPOLATION:
        return None
    factor = offset / robust.offset
    points = grasp.points + factor * (robust.points - grasp.points)
    normals = grasp.normals + factor * (robust.normals - grasp.normals)
    normals = normals / np.linalg.norm(normals, axis=1, keepdims=True)
    projected = grasp.tangents - np.einsum("kts,ks->kt", grasp.tangents, normals)[..., None] * normals[:, None]
    first = projected[:, 0] / np.linalg.norm(projected[:, 0], axis=1, keepdims=True)
    tangents = first[:, None] if grasp.space == 2 else np.stack([first, np.cross(normals, first)], axis=1)
    return Grasp(points, normals, grasp.contacts, grasp.torque_origin, tangents)


def forces_in_actual_frames(solved: Grasp, actual: Grasp, forces: FloatArray) -> FloatArray:
    """Return finger forces (m, n) in the frames of the displaced contacts, unchanged as vectors in space."""
    result = forces.copy()
    for i, (model, part) in enumerate(
        zip(solved.contacts, component_slices(solved.contacts, solved.space), strict=True)
    ):
        axes = np.array(model.axes(solved.space))
        indices = part.start + np.flatnonzero(axes < solved.space)
        rotation = actual.frames[i].T @ solved.frames[i]
        local = axes[axes < solved.space]
        result[:, indices] = forces[:, indices] @ rotation[np.ix_(local, local)].T
    return result
