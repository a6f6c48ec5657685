"""Why there is no grasp: which constraints contradict each other, or which wrench nothing resists.

Elastic relaxation: every group of rows (a constraint, the fingertips, the links' clearance) may be broken at a
price, and the sum of the groups' largest violations is minimised from several starts, by quadratic programs in a
trust region. What is left is a least violated set: locally, so the status is locally infeasible, never more.
"""

from __future__ import annotations

from dataclasses import dataclass

import clarabel
import numpy as np
from scipy import sparse

from nlpgrasp.common.conic import quiet_settings
from nlpgrasp.common.shown.words import direction_words
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.grasp.grasp import Grasp
from nlpgrasp.quality import mu
from nlpgrasp.solution.findings import WhyNot
from nlpgrasp.solve.after.wording import conflict_of
from nlpgrasp.solve.ascent.nonlinear import fill_start, no_cuts
from nlpgrasp.solve.ascent.quadratic import step_bounds
from nlpgrasp.solve.start.result import StartResult
from nlpgrasp.solve.start.screen import Candidate, draw_start
from nlpgrasp.solve.workbench.workbench import Workbench
from nlpgrasp.solve.workers.stop import Stop

STARTS, STEPS = 6, 40
FIRST_RADIUS, LAST_RADIUS = 0.3, 1e-3  # solver units
DAMPING = 1e-3
FINGERTIPS = "fingertips on the body"
HARD = "the body's surface"  # group of the rows that are never given up
HARD_WEIGHT = 100.0
KEPT = 1e-4  # relative to a row's scale: a violation this small is none
FACTORS = (1.1, 1.25, 1.5, 2.0, 3.0)


@dataclass(frozen=True)
class Relaxed:
    """A least violated placement.

    Parameters
    ----------
    total : float
        Sum of the groups' largest violations, relative to the rows' scales.
    worst : dict
        Group to its largest violation and the index and value of that row among the constraint rows.
    """

    total: float
    worst: dict[str, tuple[float, int, float]]


def why_not(bench: Workbench, results: list[StartResult], seed: int, stop: Stop) -> WhyNot:
    """Return the diagnosis of a problem whose starts found no grasp."""
    best: Relaxed | None = None
    for index in range(STARTS):
        if stop.requested():
            break
        candidate = draw_start(bench, np.random.default_rng([seed, index, 1]))[0]
        found = relaxed(bench, candidate)
        if best is None or found.total < best.total:
            best = found
        if best.total <= KEPT:
            break
    if best is None:
        return WhyNot(reasons=("Stopped before a reason was found.",))
    if best.total > KEPT:
        return _contradiction(bench, best)
    return _unreachable(bench, results)


def relaxed(bench: Workbench, candidate: Candidate) -> Relaxed:
    """Return the least violated placement near a candidate."""
    faces = candidate.faces
    compiled = bench.cut_program(faces)
    program = compiled.program
    theta = no_cuts(bench, faces, candidate.points)
    z = fill_start(bench, compiled, faces, candidate.points, candidate.hand)
    rows = slice(program.contained, None)
    low, high = (limits[rows] for limits in program.limits)
    groups = _groups(bench, len(low), program.placement.start - program.contained)
    names = sorted(set(groups))
    member = np.array([names.index(g) for g in groups])
    weights = np.array([HARD_WEIGHT if name == HARD else 1.0 for name in names])
    radius = FIRST_RADIUS
    g, J = compiled.linearise(z, theta)
    g, J = g[rows], J[rows]
    for _ in range(STEPS):
        violated = np.maximum(np.maximum(low - g, g - high), 0.0)
        merit = float(weights @ _largest(violated, member, len(names)))
        if merit <= 0.1 * KEPT or radius < LAST_RADIUS:
            break
        d = _elastic(g, J, low, high, *step_bounds(z, program.bounds, radius), member, weights)
        if d is None:
            radius *= 0.3
            continue
        there, J_there = compiled.linearise(z + d, theta)
        broken = np.maximum(np.maximum(low - there[rows], there[rows] - high), 0.0)
        if float(weights @ _largest(broken, member, len(names))) < merit * (1.0 - 1e-4):
            z, g, J = z + d, there[rows], J_there[rows]
            radius = min(1.5 * radius, FIRST_RADIUS)
        else:
            radius *= 0.4
    violated = np.maximum(np.maximum(low - g, g - high), 0.0)
    worst = {}
    offset = program.placement.start - program.contained
    scales = np.array([row.scale for row in bench.constraint_rows])
    for i, name in enumerate(names):
        own = np.flatnonzero(member == i)
        row = int(own[np.argmax(violated[own])])
        if violated[row] > KEPT and name != HARD:
            index = row - offset
            worst[name] = (float(violated[row]), index, float(g[row] * scales[index]))
    return Relaxed(float(np.sum(_largest(violated, member, len(names)))), worst)


def group_names(bench: Workbench) -> list[str]:
    """Return the group of each constraint row: its constraint, or the kind of a hand's row.

    Several constraints of one kind are numbered in the order of ``GraspProblem.constraints``.
    """
    rows, sources = bench.constraint_rows, bench.row_sources
    count = len(bench.problem.constraints)
    own = [rows[source[0]].name.split(",")[0] if source else "" for source in sources[:count]]
    names = [""] * len(rows)
    for i, source in enumerate(sources):
        for row in source:
            kind = rows[row].name.split(",")[0]
            if i >= count:
                names[row] = FINGERTIPS if kind.startswith("on fingertip") else kind
            else:
                number = own[: i + 1].count(own[i])
                names[row] = own[i] if own.count(own[i]) == 1 else f"{own[i]} ({number})"
    return [HARD if name.startswith("palm quaternion of") else name for name in names]


def _groups(bench: Workbench, count: int, offset: int) -> list[str]:
    """Return the group of each row: face rows and the quaternion's length are hard."""
    names = group_names(bench)
    return [HARD] * offset + names + [HARD] * (count - offset - len(names))


def _largest(values: FloatArray, member: FloatArray, count: int) -> FloatArray:
    result = np.zeros(count)
    np.maximum.at(result, member.astype(int), values)
    return result


def _elastic(
    g: FloatArray,
    J: sparse.csr_matrix,
    low: FloatArray,
    high: FloatArray,
    least: FloatArray,
    most: FloatArray,
    member: FloatArray,
    weights: FloatArray,
) -> FloatArray | None:
    """Return the step of least weighted group violations, one slack a group."""
    reach = np.asarray(abs(J) @ np.maximum(-least, most)).ravel()
    below, above = np.isfinite(low) & (g - reach < low), np.isfinite(high) & (g + reach > high)
    n, m = J.shape[1], len(weights)

    def slack(used: FloatArray) -> sparse.csr_matrix:
        chosen = member[used]
        return sparse.csr_matrix((-np.ones(len(chosen)), (np.arange(len(chosen)), chosen)), (len(chosen), m))

    identity, own = sparse.identity(n), sparse.identity(m)
    A = sparse.bmat(
        [[-J[below], slack(below)], [J[above], slack(above)], [identity, None], [-identity, None], [None, -own]],
        format="csc",
    )
    b = np.concatenate([(g - low)[below], (high - g)[above], most, -least, np.zeros(m)])
    P = sparse.diags(np.concatenate([np.full(n, DAMPING), np.full(m, 1e-8)]), format="csc")
    cost = np.concatenate([np.zeros(n), weights])
    found = clarabel.DefaultSolver(P, cost, A, b, [clarabel.NonnegativeConeT(len(b))], quiet_settings(1e-8)).solve()
    return np.array(found.x)[:n] if "Solved" in str(found.status) else None


def _contradiction(bench: Workbench, best: Relaxed) -> WhyNot:
    conflicts = [
        conflict_of(name, bench.constraint_rows[index], value) for name, (_, index, value) in best.worst.items()
    ]
    conflicts.sort(key=lambda c: -c.excess)
    everything = sorted(set(group_names(bench)) - {HARD})
    names = ", ".join(c.name for c in conflicts)
    reasons = [
        f"From no start could all of these be kept at once: {', '.join(everything)}.",
        f"The nearest miss breaks: {names}." if conflicts else "The contacts do not stay on their faces.",
        *(str(c) for c in conflicts),
    ]
    fixed = {FINGERTIPS, "self-collision", "clearance from the body"}
    advice = [f"Relax {c.name} by at least {c.amount}." for c in conflicts if c.name not in fixed]
    if any(c.name in fixed for c in conflicts):
        advice.append("Try a hand of another size, fewer contacts, or less in its way.")
    return WhyNot(tuple(conflicts), None, tuple(reasons), tuple(advice), locally_infeasible=True)


def _unreachable(bench: Workbench, results: list[StartResult]) -> WhyNot:
    """Explain why placements that keep all constraints do not resist the task."""
    grasps = [r.grasp for r in results if r.grasp is not None]
    if not grasps:
        return WhyNot(reasons=("The constraints can be kept, but every start ended with an error.",))
    task, budget = bench.problem.task, bench.closure_budget
    bounds = [mu(g, task, 0.1, force_budget=budget) for g in grasps]
    best = int(np.argmax([b.upper for b in bounds]))
    grasp, found = grasps[best], bounds[best]
    if found.lower > 0.0:
        text = "The constraints can be kept and the task can be resisted, but no start did both at once."
        return WhyNot(reasons=(text,), advice=("Try more starts.",))
    direction = found.worst_direction
    reasons = ["The constraints can be kept, but in the best grasp found no finger force works against one wrench."]
    if direction is not None:
        reasons.append(f"That wrench is {direction_words(-direction, bench.scaling.length)}.")
    advice = _with_friction(bench, grasp)
    advice.append("Try more starts, more fingers, other faces, or soft contacts where a torque is what is missing.")
    return WhyNot((), direction, tuple(reasons), tuple(advice))


def _with_friction(bench: Workbench, grasp: Grasp) -> list[str]:
    """Return how much more friction would make the best grasp found resist the task."""
    for factor in FACTORS:
        if not all("friction" in model.coefficients for model in grasp.contacts):
            break
        models = [m.with_coefficients(friction=factor * m.coefficients["friction"]) for m in grasp.contacts]
        rougher = Grasp(grasp.points, grasp.normals, models, grasp.torque_origin)
        if mu(rougher, bench.problem.task, 0.5, force_budget=bench.closure_budget).lower > 0.0:
            return [f"With friction {factor:g} times as large the best grasp found would resist the task."]
    return []
