"""Simulation of a solution in MuJoCo: task wrenches to hold, and the hardest one up to the certified limit."""

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
from nlpgrasp.simulation.simulation_input import EARTH, SimulationInput, given
from nlpgrasp.solution.obstructions import warn_of_touching
from nlpgrasp.solution.solution import GraspSolution, require_solution

# conditions
LESS_FRICTION, OFF = 0.1, 2e-3  # loss of friction as a share, displacement in metres
FARTHEST = 4.0  # largest extrapolation of the file's worst displacement, in its offsets
AS_SOLVED, WEIGHTLESS, SLIPPERY = "as solved", "without gravity", f"friction {LESS_FRICTION:.0%} lower"
DISPLACED = f"contacts {1e3 * OFF:g} mm off"
# finger forces
MARGINS = np.arange(0.0, 0.41, 0.05)  # candidate friction margins, as shares
FOR_FRICTION, FOR_GRIP = 0.90, 0.95  # usable shares of the effort; the rest holds the fingertips in place
# trials of task wrenches
RISE, PAUSE, GROW, HOLD = 4.0, 4.0, 12.0, 10.0  # parts of a run, units of time
SNAPSHOTS = 30  # of a run
# growth of the hardest wrench until it is lost
FURTHEST = 1.5  # largest wrench, in certified upper bounds
STEPS = 40  # shares with computed forces, between which forces are interpolated
GRIP_RISE, SOON = 8.0, 20.0  # units of time of gripping, and of the wrench's growth to QUICK
QUICK = 0.9  # share of the wrench that the effort can produce
SLOWLY = 0.002  # growth per unit of time after that, slow enough for failure to show despite damping
GROWTH_SNAPSHOTS = 2000  # of the whole growth
BEGUN = 0.1  # share of the motion that counts as lost, at which failure begins
FAR = 5.0  # largest motion in pictures, in motions that count as lost


def simulate(
    solution: GraspSolution,
    share: float = 0.8,
    mass: float | None = None,
    wrenches: int = 12,
    progress: Callable[[str], None] | None = None,
) -> Simulation:
    """Simulate a solution: task wrenches one after another, then the hardest one until it is lost.

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
    start = given(solution, share, mass, integer("wrenches", wrenches, at_least=1))
    grasp = start.grasp
    heavy = answer_wrenches(grasp, start.labels, share * start.wrenches + start.weight, start.budget, start.effort)
    if mass is not None and np.any(heavy.margins < 0.0):
        raise InputError("mass", mass, "less: the hand cannot hold it beside the task")
    light = answer_wrenches(grasp, start.labels, share * start.wrenches, start.budget, start.effort)
    conditions: list[tuple[str, Grasp, AnsweredWrenches, float]] = [
        (AS_SOLVED, grasp, heavy, EARTH),
        (WEIGHTLESS, grasp, light, 0.0),
        (SLIPPERY, reduce_friction(grasp, LESS_FRICTION), heavy, EARTH),
    ]
    notes: tuple[str, ...] = ()
    off = displace_contacts(solution, OFF)
    if off is None:
        notes = (f"{DISPLACED}: not tried, the file says nothing of the surface beside the contacts",)
    else:
        conditions.append((DISPLACED, off, heavy, EARTH))
    tell = progress or (lambda _: None)
    trials: list[Trial] = []
    for name, there, loads, gravity in conditions:
        tell(f"  {name} ...")
        done = _trials(start, name, there, loads, gravity)
        tell(describe_trials(name, done))
        trials += done
    tell("  the hardest wrench, growing ...")
    lost_at, growing = grow_wrench(start)
    gap = solution.mu.upper / solution.mu.lower
    name, kilograms, tried = solution.name, start.mass.mass, tuple(trials)
    return Simulation(name, share, start.effort, kilograms, tried, gap, lost_at, growing, notes, touching)


def _trials(
    start: SimulationInput, condition: str, there: Grasp, loads: AnsweredWrenches, gravity: float
) -> list[Trial]:
    """Return the trials of all wrenches with the actual contacts."""
    press = start.press(there, gravity)
    unit, weight = press.unit.time, start.weight if gravity else 0.0 * start.weight
    forces = forces_in_actual_frames(start.grasp, there, loads.forces)
    pulls = loads.wrenches - weight  # gravity applies the weight
    rest_pull, rest_forces = pulls.mean(axis=0), forces.mean(axis=0)  # also feasible: cones are convex
    trials = []
    for label, pull, x in zip(loads.labels, pulls, forces, strict=True):

        def course(time: float, pull: FloatArray = pull, x: FloatArray = x) -> tuple[FloatArray, FloatArray]:
            up = min(time / (RISE * unit), 1.0)
            on = min(max(time / unit - RISE - PAUSE, 0.0) / GROW, 1.0)
            return up * ((1.0 - on) * rest_pull + on * pull), up * ((1.0 - on) * rest_forces + on * x)

        snapshots = press.run(course, (RISE + PAUSE + GROW + HOLD) * unit, RISE * unit, SNAPSHOTS, _is_lost)
        trials.append(Trial(condition, label, tuple(snapshots)))
    return trials


def _is_lost(snapshot: Snapshot) -> bool:
    return snapshot.lost


def grow_wrench(given: SimulationInput) -> tuple[float | None, Trial]:
    """Return the share of the certified lower bound at which the hardest wrench was lost, without gravity, and the run.

    The hand uses up to its full effort; any excess of the wrench is not balanced. The share is that at which the body
    began to move, by a tenth of what counts as lost, as the wrench grows on during the rest. None where it was held to
    the end.
    """
    press = given.press(given.grasp, 0.0)
    unit, end = press.unit.time, FURTHEST * given.solution.mu.upper / given.solution.mu.lower
    hardest = given.wrenches[0]
    limit = given.effort / float(given.least.used[0])
    shares = np.append(np.linspace(0.0, min(end, (1.0 - 1e-9) * limit), STEPS), max(end, limit))
    labels = ("",) * len(shares)
    forces = answer_wrenches(given.grasp, labels, shares[:, None] * hardest, given.budget, given.effort).forces
    forces[-1] = forces[-2]

    quick = QUICK * min(limit, 1.0)

    def share_at(time: float) -> float:
        since = max(time / unit - GRIP_RISE, 0.0)
        return quick * min(since / SOON, 1.0) + SLOWLY * max(since - SOON, 0.0)

    def course(time: float) -> tuple[FloatArray, FloatArray]:
        share = share_at(time)
        after = min(int(np.searchsorted(shares, share, side="right")), STEPS)
        part = (share - shares[after - 1]) / max(shares[after] - shares[after - 1], 1e-300)
        answer = forces[after - 1] + min(part, 1.0) * (forces[after] - forces[after - 1])
        return share * hardest, min(2.0 * time / (GRIP_RISE * unit), 1.0) * answer

    seconds = (GRIP_RISE + SOON + (end - quick) / SLOWLY) * unit
    snapshots = press.run(course, seconds, GRIP_RISE * unit, GROWTH_SNAPSHOTS, lambda snapshot: snapshot.beyond(FAR))
    trial = Trial("growing", given.labels[0], tuple(snapshots))
    if not snapshots[-1].lost:
        return None, trial
    return next(share_at(s.time) for s in snapshots if s.beyond(BEGUN)), trial


@dataclass(frozen=True)
class AnsweredWrenches:
    """Wrenches with the finger forces that answer them.

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


def answer_wrenches(
    grasp: Grasp, labels: tuple[str, ...], wrenches: FloatArray, budget: ForceBudget, effort: float
) -> AnsweredWrenches:
    """Return the wrenches with forces of a friction margin within an effort.

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
    for share in MARGINS:
        found = finger_forces(reduce_friction(grasp, float(share)), wrenches, force_budget=budget)
        most = (1.0 if share == 0.0 else FOR_FRICTION) * effort
        good = found.feasible & (found.used <= most)
        forces[good], margins[good] = found.forces[good], share
    grip = grip_forces(grasp, budget)
    for i in np.flatnonzero(margins >= 0.0):
        forces[i] += _most_grip(grasp, forces[i], grip, budget, FOR_GRIP * effort) * grip
    return AnsweredWrenches(labels, wrenches, forces, margins)


def grip_forces(grasp: Grasp, budget: ForceBudget) -> FloatArray:
    """Return internal finger forces (n,) that press: the sum of the forces for opposite wrenches."""
    d, space = grasp.dimension, grasp.space
    ends = np.diag([1.0] * space + [grasp.mean_arm] * (d - space))
    found = finger_forces(grasp, np.concatenate([ends, -ends]), force_budget=budget)
    total = np.where(found.feasible[:, None], found.forces, 0.0)
    both = found.feasible[:d] & found.feasible[d:]
    return np.asarray((total[:d] + total[d:])[both].sum(axis=0))


def _most_grip(grasp: Grasp, x: FloatArray, grip: FloatArray, budget: ForceBudget, most: float) -> float:
    """Return the largest factor of internal forces that fits within an effort, by bisection."""
    allowed = budget.at(grasp.frames, grasp.contacts)
    size = float(allowed.used(grip[None])[0])
    low, high = 0.0, most / size if size > 0.0 else 0.0
    for _ in range(20):
        middle = 0.5 * (low + high)
        used = float(allowed.used((x + middle * grip)[None])[0])
        low, high = (middle, high) if used <= most else (low, middle)
    return low


def reduce_friction(grasp: Grasp, share: float) -> Grasp:
    """Return the grasp with friction reduced by a share."""
    models = [model.with_friction(1.0 - share) for model in grasp.contacts]
    return Grasp(grasp.points, grasp.normals, models, grasp.torque_origin, grasp.tangents)


def displace_contacts(solution: GraspSolution, offset: float) -> Grasp | None:
    """Return the contacts displaced by an offset, metres, towards the file's worst displacement.

    The file states the worst displacement found at another offset; positions and normals are extrapolated linearly.
    None where the file has none, or one too small to extrapolate.
    """
    grasp, robust = solution.grasp, solution.robust
    if grasp is None or robust is None or robust.offset < offset / FARTHEST:
        return None
    factor = offset / robust.offset
    points = grasp.points + factor * (robust.points - grasp.points)
    normals = grasp.normals + factor * (robust.normals - grasp.normals)
    normals = normals / np.linalg.norm(normals, axis=1, keepdims=True)
    flat = grasp.tangents - np.einsum("kts,ks->kt", grasp.tangents, normals)[..., None] * normals[:, None]
    first = flat[:, 0] / np.linalg.norm(flat[:, 0], axis=1, keepdims=True)
    tangents = first[:, None] if grasp.space == 2 else np.stack([first, np.cross(normals, first)], axis=1)
    return Grasp(points, normals, grasp.contacts, grasp.torque_origin, tangents)


def forces_in_actual_frames(known: Grasp, there: Grasp, forces: FloatArray) -> FloatArray:
    """Return finger forces (m, n) in the frames of the actual contacts: the hand exerts the same spatial forces."""
    result = forces.copy()
    for i, (model, part) in enumerate(zip(known.contacts, component_slices(known.contacts, known.space), strict=True)):
        axes = np.array(model.axes(known.space))
        which = part.start + np.flatnonzero(axes < known.space)
        turned = there.frames[i].T @ known.frames[i]
        local = axes[axes < known.space]
        result[:, which] = forces[:, which] @ turned[np.ix_(local, local)].T
    return result
