"""Infeasibility diagnosis: contradicting constraints, or a wrench that the fingers cannot exert."""

import numpy as np
import pytest

import nlpgrasp as ng

BODY = ng.Ellipsoid([0.06, 0.03, 0.03])
TASK = ng.TaskEllipsoid([1.0, 1.0, 1.0, 0.03, 0.03, 0.03])
OPTIONS = ng.SolveOptions(workers=1, global_bound=False)


def solve(contacts, starts=2, body=BODY, **fields):
    return ng.solve(ng.GraspProblem(body, contacts, TASK, **fields), starts, options=OPTIONS)


@pytest.fixture(scope="module")
def spread():
    """Four points of the ellipsoid are at most 60 mm apart from each other (two of them at the ends, two across)."""
    return solve([ng.FrictionContact(0.6)] * 4, constraints=[ng.Spread(min=0.08)])


@pytest.mark.slow
def test_one_constraint_that_cannot_be_kept(spread):
    assert spread.status is ng.Status.LOCALLY_INFEASIBLE
    diagnosis = spread.why_not
    assert diagnosis.locally_infeasible
    (conflict,) = diagnosis.conflicts
    assert conflict.name == "spread"
    assert conflict.bound == pytest.approx(0.08)
    assert conflict.relation == "at least"
    assert conflict.value == pytest.approx(0.06, abs=0.003)
    assert "mm, wanted at least 80 mm" in str(diagnosis)
    assert "Relax spread by at least" in diagnosis.advice[0]


@pytest.mark.slow
def test_constraints_that_contradict_each_other_are_both_named():
    hand = ng.Fingertips(3, 0.005, reach=0.03)
    solution = solve([ng.FrictionContact(0.6)] * 3, hand=hand, constraints=[ng.Spread(min=0.07)])
    assert solution.status is ng.Status.LOCALLY_INFEASIBLE
    conflicts = {c.name: c for c in solution.why_not.conflicts}
    assert set(conflicts) == {"reach", "spread"}
    assert conflicts["reach"].value > conflicts["reach"].bound == pytest.approx(0.03)
    assert conflicts["spread"].value < conflicts["spread"].bound == pytest.approx(0.07)
    assert "fingertip distance, reach, spread" in solution.why_not.reasons[0]


@pytest.mark.slow
def test_relaxing_by_what_is_advised_gives_a_grasp(spread):
    (conflict,) = spread.why_not.conflicts
    relaxed = ng.Spread(min=0.08 - conflict.excess - 0.004)
    relaxed_solution = solve([ng.FrictionContact(0.6)] * 4, 4, constraints=[relaxed])
    assert relaxed_solution.status is not ng.Status.LOCALLY_INFEASIBLE


@pytest.mark.slow
def test_torque_about_an_axis_of_symmetry_without_friction():
    solution = solve([ng.PointContact()] * 7)
    assert solution.status is ng.Status.NO_GRASP
    assert not solution.why_not.conflicts
    direction = solution.why_not.direction / np.linalg.norm(solution.why_not.direction)
    assert abs(direction[3]) > 0.999
    about = "a torque about x" if direction[3] > 0.0 else "a torque about -x"
    assert about in str(solution.why_not)  # what the fingers cannot exert, not the load that they cannot hold


@pytest.mark.slow
def test_more_friction_is_advised_where_it_helps():
    """Three faces at right angles to each other: not closed with friction 0.6, closed with a quarter more."""
    contact = [ng.FrictionContact(0.6, faces=[f]) for f in ("+x", "+y", "+z")]
    solution = solve(contact, 1, body=ng.Box([0.1, 0.1, 0.1]))
    assert solution.status is ng.Status.NO_GRASP
    assert [start.mu.upper for start in solution.starts] == [0.0]
    assert "the fingers cannot exert one wrench" in solution.why_not.reasons[0]
    assert "With friction 1.25 times as large" in solution.why_not.advice[0]


@pytest.mark.slow
def test_diagnosis_survives_the_file(spread, tmp_path):
    path = spread.save(tmp_path / "none.json")
    loaded = ng.GraspSolution.load(path)
    assert loaded.status is ng.Status.LOCALLY_INFEASIBLE
    assert str(loaded.why_not) == str(spread.why_not)
    assert not ng.verify(path)


@pytest.mark.slow
def test_solved_problems_have_no_diagnosis():
    assert solve([ng.FrictionContact(0.6)] * 4, 1).why_not is None


@pytest.mark.slow
def test_jaws_that_open_too_little():
    """The ellipsoid is 60 mm thick."""
    body = ng.Ellipsoid([0.04, 0.03, 0.035])
    solution = solve(ng.SoftContact(0.6, 0.01), body=body, hand=ng.ParallelJaw(0.05))
    assert solution.status is ng.Status.LOCALLY_INFEASIBLE
    (conflict,) = [c for c in solution.why_not.conflicts if c.name.startswith("opening")]
    assert conflict.value == pytest.approx(0.06, abs=0.004)


@pytest.mark.slow
def test_two_constraints_of_one_kind_are_told_apart():
    constraints = [ng.Spread(max=0.02), ng.Spread(min=0.05)]
    solution = solve([ng.FrictionContact(0.6)] * 3, constraints=constraints)
    assert solution.status is ng.Status.LOCALLY_INFEASIBLE
    conflicts = {c.name: c for c in solution.why_not.conflicts}
    assert set(conflicts) == {"spread (1)", "spread (2)"}
    most, least = (conflicts[f"spread ({i})"] for i in (1, 2))
    assert (most.relation, least.relation) == ("at most", "at least")
    assert 0.02 < most.value < 0.05  # all three equally far apart: the nearest miss of both
    assert least.value == pytest.approx(most.value, abs=1e-6)
    assert "spread (1), spread (2)" in solution.why_not.reasons[0]


def test_rows_are_grouped_by_constraint_and_by_kind():
    from nlpgrasp.analysis.infeasibility import group_names
    from nlpgrasp.optimize.compiled_problem import CompiledProblem

    rules = [ng.Table(-0.1), ng.Table(-0.2), ng.Constraint("near, level", lambda p, n: p[0], -1.0, 1.0)]
    hand = ng.Fingertips(2, 0.005, reach=0.2)
    problem = ng.GraspProblem(BODY, [ng.FrictionContact(0.6)] * 2, TASK, hand=hand, constraints=rules)
    groups = ["table (1)"] * 2 + ["table (2)"] * 2 + ["near, level"] * 3 + ["reach"] * 2 + ["fingertip distance"]
    assert group_names(CompiledProblem(problem, OPTIONS)) == groups


RECTANGLE = [[-0.06, -0.006], [0.06, -0.006], [0.06, 0.006], [-0.06, 0.006]]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("plate", "contact", "obstacle"),
    [
        (ng.Polygon(RECTANGLE), ng.FrictionContact(0.6), ng.Obstacle(ng.Polygon(RECTANGLE), position=[0.2, 0.0])),
        (
            *(ng.Box([0.12, 0.1, 0.012]), ng.SoftContact(0.6, 0.005)),
            ng.Obstacle(ng.Sphere(0.01), position=[0.2, 0.0, 0.0]),
        ),
    ],
    ids=["plane", "space"],
)
def test_a_table_without_which_there_is_a_grasp_is_named_with_the_room_that_it_takes(plate, contact, obstacle):
    """Jaws that are too narrow for a plate's sides take it from above and below, where the table is."""
    from nlpgrasp.analysis.infeasibility import surroundings_in_the_way
    from nlpgrasp.common.deadline import Deadline
    from nlpgrasp.optimize.compiled_problem import CompiledProblem

    surroundings = [ng.Table.under(plate, clearance=0.003), obstacle]
    task = ng.TaskEllipsoid([1.0] * plate.space + [0.01] * (3 if plate.space == 3 else 1))
    problem = ng.GraspProblem(plate, [contact] * 2, task, ng.ParallelJaw(0.08), surroundings)
    compiled = CompiledProblem(problem, OPTIONS)
    sentences = list(surroundings_in_the_way(compiled, (), 0, Deadline()))
    assert sentences == ["Without the table a start finds a grasp, which takes 3 mm more room there."]
    assert list(surroundings_in_the_way(compiled, {"table", "obstacle"}, 0, Deadline())) == []
