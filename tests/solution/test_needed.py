"""Finger forces for the task at full size: text, files, limits, and their verification."""

import json

import pytest

import nlpgrasp as ng
from nlpgrasp.common.formatting import format_number
from nlpgrasp.problem.problem import problem_from_dict
from nlpgrasp.report import write_report
from tests.verify.edits import failed, put, together
from tests.verify.stated import edited

NEEDED = ("quality", "forces_needed")
SQUARE = ng.Polygon([[-0.04, -0.02], [0.04, -0.02], [0.04, 0.02], [-0.04, 0.02]])
TASK = ng.TaskEllipsoid([4.0, 4.0, 0.05])
OPTIONS = ng.SolveOptions(workers=1, global_bound=False)


def solve(**fields):
    return ng.solve(ng.GraspProblem(SQUARE, [ng.FrictionContact(0.5)] * 3, TASK, **fields), 1, options=OPTIONS)


@pytest.fixture(scope="module")
def solution():
    return solve(max_force=100.0)


def test_print_says_it_with_units(solution):
    text = str(solution)
    assert f"the task as given needs {solution.needed.budget.lower:.4g} to" in text
    assert "N (L2 norm of all finger forces, certified)" in text
    size = [sum(x * x for x in force) ** 0.5 for force in solution.needed.forces.tolist()]
    root = sum(s * s for s in size) ** 0.5
    each, total, root = (", ".join(map(format_number, part)) for part in (size, [sum(size)], [root]))
    assert f" fingers 0 to 2 exert {each} N (normal " in text
    assert f"), in all {total} N, L2 norm {root} N\n" in text
    assert ", within max_force = 100 N, as certified for every wrench of the task\n" in text


@pytest.mark.parametrize(("share", "words"), [(0.5, ", ABOVE max_force"), (1.01, " N for the wrenches computed: ")])
def test_a_limit_that_is_not_certified(solution, share, words):
    limit = share * solution.needed.summary[0]
    limited = solve(max_force=limit)
    assert words in str(limited)
    assert limited.title.startswith("grasp: Solved, but finger ") is (share < 1.0)
    assert limited.needed.within is (share > 1.0)
    assert limited.to_dict()["quality"]["forces_needed"]["within_max_force"] is (share > 1.0)
    assert ng.verify(limited).passed


def test_without_a_limit_nothing_is_said_of_one():
    unlimited = solve()
    assert "max_force" not in str(unlimited)
    assert unlimited.max_force is None
    data = unlimited.to_dict()
    assert "max_force" not in data["problem"]
    assert "within_max_force" not in data["quality"]["forces_needed"]


def test_the_whole_task_takes_one_over_mu(solution):
    budget = solution.needed.budget
    assert 1.0 / solution.mu.upper == pytest.approx(budget.lower, rel=1e-15)
    assert budget.lower * solution.mu.upper <= 1.0 <= budget.upper * solution.mu.lower


def test_the_file_carries_it(solution, tmp_path):
    path = solution.save(tmp_path / "f.json")
    loaded = ng.GraspSolution.load(path)
    assert loaded.to_dict() == json.loads(path.read_text())
    assert str(loaded) == str(solution)
    assert loaded.max_force == 100.0
    assert problem_from_dict(loaded.problem, loaded.grasp.torque_origin).max_force == 100.0


def test_a_file_without_the_forces_loads_and_is_not_verified(solution):
    data = solution.to_dict()
    del data["quality"]["forces_needed"], data["problem"]["max_force"]
    old = ng.GraspSolution.from_dict(data)
    assert old.needed is None
    assert "as given" not in str(old)
    assert failed(ng.verify(old)) == ["forces needed"]


def test_the_report_says_it(solution, tmp_path):
    tight = solve(max_force=1.0)
    page = write_report({"wide": solution, "tight": tight}, tmp_path / "f.html").read_text()
    assert page.count("Forces for the task as given") == 2
    assert f"<td>{format_number(solution.needed.size[1])} N</td>" in page
    assert ", ABOVE max_force = 1 N." in page


LIES = {
    "another wrench": put((*NEEDED, "wrench", 0), lambda v: v + 0.1),
    "an easier wrench": put((*NEEDED, "wrench"), lambda w: [0.5 * v for v in w]),
    "an easier wrench with its forces": together(
        put((*NEEDED, "wrench"), lambda w: [0.5 * v for v in w]),
        put((*NEEDED, "fingers"), lambda f: [{**e, "force": [0.5 * v for v in e["force"]]} for e in f]),
    ),
    "a harder wrench": put((*NEEDED, "wrench"), lambda w: [2.0 * v for v in w]),
    "a force": put((*NEEDED, "fingers", 0, "force", 0), lambda v: v + 0.1),
    "a normal force": put((*NEEDED, "fingers", 1, "normal"), lambda v: 0.99 * v),
    "the size of a force": put((*NEEDED, "fingers", 1, "size"), lambda v: 0.99 * v),
    "a largest force": put((*NEEDED, "fingers", 1, "largest"), lambda v: 0.99 * v),
    "the largest of all": put((*NEEDED, "largest"), lambda v: 0.99 * v),
    "whose it is": put((*NEEDED, "finger"), lambda i: (i + 1) % 3),
    "the total": put((*NEEDED, "total"), lambda v: 0.99 * v),
    "the budget": put((*NEEDED, "budget", "upper"), lambda v: 1.01 * v),
    "within the limit": put((*NEEDED, "within_max_force"), False),
    "another limit": put(("problem", "max_force"), 1.0),
    "the limit gone": put(("problem", "max_force"), 1e-3),
}


@pytest.mark.parametrize("name", LIES)
def test_verify_finds_lies(solution, name):
    assert failed(ng.verify(ng.GraspSolution.from_dict(solution.to_dict()))) == []
    data = edited(solution.to_dict(), LIES[name])
    assert failed(ng.verify(ng.GraspSolution.from_dict(data))) == ["forces needed"]


def test_more_than_the_least_forces_are_a_lie(solution):
    """Two fingers that squeeze harder still produce the wrench from inside the cones."""
    data, normals = solution.to_dict(), solution.grasp.normals
    opposed = next(
        (i, j) for i in range(3) for j in range(i) if normals[i] @ normals[j] < -0.99 and solution.needed.size[i] > 0.0
    )
    i, j = opposed
    difference = solution.grasp.points[j] - solution.grasp.points[i]
    push = 0.3 * difference / (difference @ difference) ** 0.5
    fingers = data["quality"]["forces_needed"]["fingers"]
    for k, sign in ((i, 1.0), (j, -1.0)):
        force = solution.needed.forces[k] + sign * push
        fingers[k] |= {
            "force": force.tolist(),
            "normal": float(force @ normals[k]),
            "size": float(force @ force) ** 0.5,
        }
        fingers[k]["largest"] = max(fingers[k]["largest"], fingers[k]["size"])
    block = data["quality"]["forces_needed"]
    block["total"] = sum(f["size"] for f in fingers)
    block["largest"] = max(f["largest"] for f in fingers)
    block["finger"] = max(range(3), key=lambda n: fingers[n]["largest"])
    (check,) = [c for c in ng.verify(ng.GraspSolution.from_dict(data)).checks if c.name == "forces needed"]
    assert not check.passed
    assert "is enough" in check.detail


@pytest.mark.parametrize("value", [0.0, -1.0, float("inf"), float("nan"), "10 N", True])
def test_bad_limits(value):
    with pytest.raises(ng.InputError, match=r"GraspProblem\.max_force"):
        ng.GraspProblem(SQUARE, [ng.FrictionContact(0.5)] * 3, TASK, max_force=value)


def test_forces_of_another_number_of_fingers_are_refused(solution):
    data = solution.to_dict()
    del data["quality"]["forces_needed"]["fingers"][-1]
    with pytest.raises(ng.InputError, match=r"quality.forces_needed.fingers.*one force a contact"):
        ng.GraspSolution.from_dict(data, "grasp.json")
