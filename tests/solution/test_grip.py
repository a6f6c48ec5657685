"""Grip force of parallel jaws in print, report, kept grasps and files, and its verification."""

import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import nlpgrasp as ng
from nlpgrasp.common.formatting import format_lower, format_upper
from nlpgrasp.quality.bounds import Bounds
from nlpgrasp.report import write_report
from nlpgrasp.solution.grip_record import GripForce
from nlpgrasp.verify import grip_checks
from tests.verify.edits import put
from tests.verify.stated import edited

TASK = ng.TaskEllipsoid([4.0, 4.0, 4.0, 0.08, 0.08, 0.08])
OPTIONS = ng.SolveOptions(workers=1, rounds=0, global_bound=False, final_rtol=0.05)
LIMIT = 120.0


@pytest.fixture(scope="module")
def solution():
    hand = ng.ParallelJaw(0.06, 0.002, finger_length=0.06, max_force=LIMIT)
    problem = ng.GraspProblem(ng.Box([0.08, 0.04, 0.06]), ng.SoftContact(0.6, 0.005), TASK, hand=hand)
    return ng.solve(problem, 1, options=OPTIONS, keep=3)


def limited(solution, **limits):
    hand = {**solution.problem["hand"], **{name: limits[name] for name in limits.keys() & {"max_force"}}}
    return replace(solution, problem={**solution.problem, "hand": hand, "max_force": limits.get("of_problem")})


def test_print_begins_with_the_force_its_margin_and_its_limit(solution):
    force, safe = (format_upper(b.upper, 3) for b in (solution.grip.force, solution.grip.with_margin))
    needed = f"the task needs {force} N, {safe} N with a safety factor of 1.2 and friction 10 % lower"
    line = f"  set the gripper to {safe} N (normal force of each jaw; {needed}); the limit is 120 N"
    assert str(solution).splitlines()[2] == line
    assert solution.grip_force == solution.grip.force.upper
    assert "max_force" not in "".join(solution.caveats)
    assert solution.needed.within is None  # forces with their tangential parts have no limit


def test_the_stated_force_is_the_least_normal_force_of_both_jaws(solution):
    """Least sums of normal forces for the extreme wrenches, by conic programs, are at most twice the force."""
    used = ng.finger_forces(solution.grasp, TASK.ends(), force_budget="shared").used
    assert 0.0 < used.max() <= 2.0 * solution.grip_force
    assert solution.grip.force.lower == pytest.approx(solution.grip_force, rel=0.02)
    double = ng.grip_force(solution, safety_factor=2.4)
    assert double.with_margin.upper == pytest.approx(2.0 * solution.grip.with_margin.upper)


def test_every_kept_grasp_has_its_own_force(solution):
    forces = [grasp.grip_force for grasp in solution.grasps]
    assert len(forces) == 3
    assert [solution.with_answer(grasp).grip_force for grasp in solution.grasps] == forces
    table = str(solution).splitlines()[-3:]
    assert all(f" {format_upper(f, 3)} N " in line for f, line in zip(forces, table, strict=True))


def test_the_friction_needed_is_that_of_the_gripper_at_its_limit(solution):
    least = solution.friction.least
    pattern = (
        r"above friction ([\d.]+) and is lost below ([\d.]+), with at most 120 N a jaw \(certified\); it needs (\S+) N"
    )
    (held, lost, force), *_ = re.findall(pattern, solution.friction_line())
    assert (held, lost) == (format_upper(least.upper, 3), format_lower(least.lower, 3))
    assert force == format_upper(solution.grip_force, 3)
    assert f"  {solution.friction_line()}" in str(solution).splitlines()
    frictions = [0.999 * least.lower, 1.001 * least.upper]
    lower, upper = ng.force_curve(solution.grasp, solution.task, frictions, total=True)
    assert upper.lower <= 2.0 * LIMIT <= lower.upper
    assert ng.GraspSolution.from_dict(solution.to_dict()).friction == solution.friction
    assert "critical friction" in {check.name for check in ng.verify(solution).checks if check.passed}


def test_limits_of_gripper_and_problem_are_of_the_normal_force(solution):
    force, safe = solution.grip.force.upper, solution.grip.with_margin.upper
    for limits in ({"max_force": 0.9 * force}, {"of_problem": 0.9 * force}):
        weak = limited(solution, **limits)
        assert weak.is_too_weak
        (words,) = (words for words in weak.caveats if "each jaw needs" in words)
        assert "N above max_force = " in words
        assert "it holds 90 % of the task; more friction" in words
    near = limited(solution, max_force=0.5 * (force + safe))
    assert not near.is_too_weak
    assert any("leaves too little margin" in words for words in near.caveats)


def test_grips_without_a_margin_are_warned_of_with_any_limit():
    grip = GripForce(1.5, 0.3, Bounds(20.0, 20.1))
    for limit in (None, 40.0):
        assert grip.warning(limit) == "the jaws have no margin: with friction 30 % lower no force holds the task"
    assert "each jaw needs 20.1 N for the task" in grip.warning(15.0)


def test_the_report_shows_the_force_first(solution, tmp_path):
    """Also before the caveats of a grasp whose force is above the limit."""
    weak = limited(solution, max_force=0.9 * solution.grip_force)
    text = write_report({"grip": weak}, tmp_path / "weak.html").read_text(encoding="utf-8")
    assert re.search(r'<aside class="panel"><div class="fact bad broad"><h3>Set the gripper to</h3>', text)
    page = write_report({"grip": solution}, tmp_path / "grip.html").read_text(encoding="utf-8")
    first = re.search(r'<aside class="panel"><div class="fact[^"]*"><h3>(.*?)</h3><p class="value">(.*?)</p>', page)
    force = format_upper(solution.grip.with_margin.upper, 3)
    assert first.groups() == ("Set the gripper to", f"{force}\N{NO-BREAK SPACE}N")
    assert "root of the sum of squares" not in page


def test_files_keep_it_and_verify_recomputes_it(solution, tmp_path):
    path = solution.save(tmp_path / "grip.json")
    loaded = ng.GraspSolution.load(path)
    assert loaded.grip == solution.grip
    verification = ng.verify(loaded)
    assert verification.passed, verification
    assert "grip force" in {check.name for check in verification.checks}


@pytest.mark.parametrize(
    ("path", "share"), [(("force", "upper"), 0.9), (("force", "lower"), 0.5), (("with_margin", "upper"), 0.9)]
)
def test_a_force_that_is_not_the_least_fails(solution, path, share):
    value = getattr(getattr(solution.grip, path[0]), path[1])
    lie = {"upper": share * value, "lower": share * value} if path[1] == "upper" else {"lower": share * value}
    data = edited(solution.to_dict(), lambda d: d["hand"]["grip"][path[0]].update(lie))
    assert "grip force" in {check.name for check in ng.verify(ng.GraspSolution.from_dict(data)).checks if check.failed}


def test_another_safety_factor_fails(solution):
    data = edited(solution.to_dict(), put(("hand", "grip", "safety_factor"), 1.5))
    assert "grip force" in {check.name for check in ng.verify(ng.GraspSolution.from_dict(data)).checks if check.failed}


@pytest.mark.parametrize(("field", "value"), [("safety_factor", 0.9), ("friction_loss", 1.0), ("friction_loss", -0.1)])
def test_numbers_out_of_range_are_refused(solution, field, value):
    with pytest.raises(ng.InputError, match=field):
        ng.grip_force(solution, **{field: value})


@pytest.mark.parametrize(("field", "value"), [("max_force", 0.0), ("safety_factor", 0.5)])
def test_grippers_with_impossible_forces_are_refused(field, value):
    with pytest.raises(ng.InputError, match=rf"ParallelJaw\.{field}"):
        ng.ParallelJaw(0.08, **{field: value})


def test_a_force_that_no_conic_program_confirms_is_not_verified(solution, monkeypatch):
    unsolved = SimpleNamespace(solve=lambda wrenches: [np.full((len(wrenches), 6), np.nan)])
    monkeypatch.setattr(grip_checks, "LeastForces", lambda _: unsolved)
    check = next(check for check in ng.verify(solution).checks if check.name == "grip force")
    assert not check.made
    assert check.detail == "not made: the solver finished no conic program of the task's wrenches"
