"""Least friction and force curve: closed forms, and conic programs beyond either end."""

from dataclasses import dataclass

import clarabel
import numpy as np
import pytest
from scipy import sparse

import nlpgrasp as ng

SIDES = np.array([[-0.04, 0.016, -0.002], [0.04, 0.016, -0.002], [-0.04, -0.016, -0.002], [0.04, -0.016, -0.002]])
INWARD = np.array([[1.0, 0, 0], [-1, 0, 0], [1, 0, 0], [-1, 0, 0]])
WEIGHT = ng.TaskPolytope([[0, 0, 2.0, 0, 0, 0]])


def pinch(friction: float = 0.6) -> ng.Grasp:
    return ng.Grasp(SIDES, INWARD, ng.FrictionContact(friction))


def test_a_weight_between_four_fingers_needs_its_share() -> None:
    # 2 N on four contacts that press with 2 N each: 0.5 N of friction a contact
    for limits in ({"finger_force": 2.0}, {"total": 8.0}):
        friction = ng.critical_friction(pinch(), WEIGHT, **limits)
        assert friction.lower <= 0.25 <= friction.upper <= 1.02 * friction.lower
    assert ng.critical_friction(pinch(), WEIGHT).lower == 0.0  # with forces of any size


def test_the_force_curve_is_the_weight_over_friction() -> None:
    for friction, force in zip((0.1, 0.5, 2.0), ng.force_curve(pinch(), WEIGHT, (0.1, 0.5, 2.0)), strict=True):
        assert force.lower <= 0.5 / friction <= force.upper <= 1.01 * force.lower


@dataclass(frozen=True)
class Case:
    """Random grasp and task, and the force limit in newtons as ``critical_friction`` takes it."""

    grasp: ng.Grasp
    task: ng.TaskPolytope | ng.TaskEllipsoid
    limits: dict[str, float]

    @classmethod
    def random(cls, seed: int) -> "Case":
        """Return the case of a seed: its remainders give contacts, contact model, task and limit."""
        rng = np.random.default_rng(seed)
        k = 3 + seed % 4
        outward = rng.normal(size=(k, 3))
        outward /= np.linalg.norm(outward, axis=1, keepdims=True)
        normals = -outward + 0.2 * rng.normal(size=(k, 3))
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        friction, direction = float(rng.uniform(0.3, 0.9)), rng.normal(size=3)
        model = (
            ng.FrictionContact(friction),
            ng.SoftContact(friction, float(rng.uniform(0.002, 0.008))),
            ng.SoftContact(friction, 0.004, model="elliptic"),
            ng.LineContact(0.02, friction, direction=direction),
            ng.PlaneContact(extents=(0.02, 0.012), friction=friction, direction=direction),
        )[seed // 4 % 5]
        size = np.array([1.0, 1.0, 1.0, 0.02, 0.02, 0.02])
        task = (
            lambda: ng.TaskPolytope(size * rng.normal(size=(5, 6))),
            lambda: ng.TaskEllipsoid(size * rng.uniform(0.3, 1.0, 6), center=size * rng.normal(size=6)),
            lambda: ng.TaskEllipsoid(size * rng.uniform(0.5, 1.5, 6)),
        )[seed // 20 % 3]()
        limits = (
            {},
            {"finger_force": float(rng.uniform(3.0, 30.0))},
            {"total": float(rng.uniform(10.0, 80.0))},
        )[seed // 60 % 3]
        return cls(ng.Grasp(0.03 * outward, normals, model, np.zeros(3)), task, limits)

    def wrenches(self, friction: float, rng: np.random.Generator) -> np.ndarray:
        """Return wrenches of the task: its vertices, or ends of an ellipsoid, the hardest for this friction first."""
        if isinstance(self.task, ng.TaskPolytope):
            return self.task.wrenches
        budget = "shared" if "total" in self.limits else "per_finger"
        directions = rng.normal(size=(8, 6)) / np.linalg.norm(self.task.axes, axis=0)
        hardest = ng.mu(self.at(friction), self.task, force_budget=budget).worst_direction
        directions = directions if hardest is None else np.vstack([hardest, directions])
        along = directions @ self.task.axes.T
        return self.task.center + along @ self.task.axes / np.linalg.norm(along, axis=1, keepdims=True)

    def at(self, friction: float) -> ng.Grasp:
        """Return the grasp with another friction, torsional friction in proportion."""
        models = [c.with_friction(friction / c.friction) for c in self.grasp.contacts]
        return ng.Grasp(self.grasp.points, self.grasp.normals, models, np.zeros(3))

    def holds(self, friction: float, wrench: np.ndarray) -> bool:
        """Return whether forces exert a wrench: a conic program in forces at points and torsions, by Clarabel.

        It minimises t, the largest normal force of a finger or their sum, and shares no code with the package.
        """
        columns, cones, presses = list[np.ndarray](), list[tuple[np.ndarray, list[int]]](), list[list[int]]()
        for p, n, contact in zip(self.grasp.points, self.grasp.normals, self.grasp.contacts, strict=True):
            first = np.cross(n, [0.3, -0.5, 0.8])
            if isinstance(contact, ng.LineContact | ng.PlaneContact):
                first = np.array(contact.direction) - (np.array(contact.direction) @ n) * n
            first /= np.linalg.norm(first)
            second = np.cross(n, first)
            a, b = contact.extents if isinstance(contact, ng.PlaneContact) else (getattr(contact, "length", 0.0), 0.0)
            corners = {(i * a / 2.0, j * b / 2.0) for i in (1, -1) for j in (1, -1)}
            presses.append([])
            for u, v in sorted(corners):
                arm, start = p + u * first + v * second, len(columns)
                columns += [np.concatenate([axis, np.cross(arm, axis)]) for axis in (n, first, second)]
                presses[-1].append(start)
                cone = [friction, 1.0, 1.0]
                if isinstance(contact, ng.SoftContact):
                    columns.append(np.concatenate([np.zeros(3), n]))
                    ratio = contact.friction / contact.torsional_friction  # of a unit torsion to a unit force across
                    if contact.model == "elliptic":
                        cone.append(ratio)
                    else:
                        cones.append((np.array([friction, ratio]), [start, start + 3]))
                cones.append((np.array(cone), list(range(start, start + len(cone)))))
        count = len(columns)
        groups = [[i for group in presses for i in group]] if "total" in self.limits else presses
        scale = np.array([1.0, 1.0, 1.0, 0.02, 0.02, 0.02])
        rows, right = [np.column_stack([np.array(columns).T / scale[:, None], np.zeros(6)])], [wrench / scale]
        kinds = [clarabel.ZeroConeT(6), clarabel.NonnegativeConeT(len(groups))]
        limit = np.zeros((len(groups), count + 1))
        for row, group in zip(limit, groups, strict=True):
            row[group] = 1.0
            row[-1] = -1.0
        rows.append(limit)
        right.append(np.zeros(len(groups)))
        for factors, variables in cones:
            block = np.zeros((len(factors), count + 1))
            block[np.arange(len(factors)), variables] = -factors
            rows.append(block)
            right.append(np.zeros(len(factors)))
            kinds.append(clarabel.SecondOrderConeT(len(factors)))
        cost = np.zeros(count + 1)
        cost[-1] = 1.0
        settings = clarabel.DefaultSettings()
        settings.verbose = False
        flat = sparse.csc_matrix((count + 1, count + 1))
        program = clarabel.DefaultSolver(
            flat, cost, sparse.csc_matrix(np.vstack(rows)), np.concatenate(right), kinds, settings
        )
        solution = program.solve()
        status = str(solution.status)
        assert status in ("Solved", "AlmostSolved", "PrimalInfeasible", "AlmostPrimalInfeasible"), status
        most = next(iter(self.limits.values()), np.inf)
        return status in ("Solved", "AlmostSolved") and solution.x[-1] <= most * (1.0 + 1e-6)


def contradictions(case: Case, friction: ng.Bounds) -> list[str]:
    """Return what conic programs contradict in the bounds on a case's critical friction."""
    rng, found = np.random.default_rng(0), list[str]()
    if np.isfinite(friction.upper):
        for factor in (1.001, 1.5, 4.0):
            trial = factor * friction.upper
            if not all(case.holds(trial, wrench) for wrench in case.wrenches(trial, rng)):
                found.append(f"lost at {trial:g}, said to be held above {friction.upper:g}")
    if friction.lower > 0.0:
        for factor in (0.999, 0.5):
            trial = factor * friction.lower
            if all(case.holds(trial, wrench) for wrench in case.wrenches(trial, rng)):
                found.append(f"held at {trial:g}, said to be lost below {friction.lower:g}")
    if friction.lower > 0.0 and friction.upper < np.inf and friction.upper > 1.02 * friction.lower:
        found.append(f"from {friction.lower:g} to {friction.upper:g}")
    return found


@pytest.mark.slow
@pytest.mark.parametrize("first", range(5))
def test_the_task_is_held_above_and_lost_below(first: int) -> None:
    # each contact model with each task and limit; python -m benchmarks measures:friction has a thousand
    for seed in range(4 * first + first % 4, 180 + 4 * first, 20):
        case = Case.random(seed)
        assert contradictions(case, ng.critical_friction(case.grasp, case.task, **case.limits)) == []


def test_bad_input_is_refused() -> None:
    with pytest.raises(ng.InputError, match="one of finger_force and total"):
        ng.critical_friction(pinch(), WEIGHT, finger_force=1.0, total=2.0)
    mixed = ng.Grasp(SIDES, INWARD, [ng.FrictionContact(0.5)] * 3 + [ng.FrictionContact(0.6)])
    with pytest.raises(ng.InputError, match=r"friction 0\.5 and 0\.6, expected one friction coeff"):
        ng.critical_friction(mixed, WEIGHT)
    with pytest.raises(ng.InputError, match="got contacts without friction, expected contacts with one friction"):
        ng.critical_friction(ng.Grasp(SIDES, INWARD, ng.PointContact()), WEIGHT)
    for name, value, expected in (
        ("rtol", 0.0, "at least 0.001"),
        ("rtol", np.nan, "at least 0.001"),
        ("rtol", "2 %", "at least 0.001"),
        ("largest", 0.0, "greater than 0"),
        ("finger_force", np.inf, "finite"),
        ("total", -1.0, "greater than 0"),
    ):
        with pytest.raises(ng.InputError, match=f"^{name}: got .*{expected}"):
            ng.critical_friction(pinch(), WEIGHT, **{name: value})
    for frictions, expected in (
        ([0.0], "greater than 0"),
        ([-0.5], "greater than 0"),
        ([np.nan], "finite"),
        ("0.5", ""),
    ):
        with pytest.raises(ng.InputError, match=f"^frictions: got .*{expected}"):
            ng.force_curve(pinch(), WEIGHT, frictions)


def test_a_task_that_no_friction_holds_is_refuted_up_to_the_largest() -> None:
    two = ng.Grasp(SIDES[:2], INWARD[:2], ng.FrictionContact(0.6), SIDES[:2].mean(axis=0))
    twist = ng.TaskPolytope([[0, 0, 0, 0.1, 0, 0]])  # about the line between two contacts without torsion
    friction = ng.critical_friction(two, twist)
    assert (friction.lower, friction.upper) == (10.0, np.inf)
    assert ng.force_curve(two, twist, [0.5])[0].upper == np.inf


def test_the_coarsest_interval_and_a_friction_above_the_largest() -> None:
    friction = ng.critical_friction(pinch(), WEIGHT, finger_force=2.0, rtol=3.0)
    assert friction.lower <= 0.25 <= friction.upper <= 4.0 * friction.lower
    friction = ng.critical_friction(pinch(0.6), WEIGHT, finger_force=2.0, largest=0.2)
    assert (friction.lower, friction.upper) == (0.2, np.inf)


def test_loads_that_no_friction_changes_have_a_wide_interval_at_most() -> None:
    # 2 N along the closing line on two contacts of 2 N: held by the normal force alone, to the last digit
    along = ng.TaskPolytope([[2.0, 0, 0, 0, 0, 0]])
    friction = ng.critical_friction(pinch(), along, finger_force=1.0)
    assert friction.lower == 0.0 or friction.upper == np.inf
