"""Properties of a solution: task, budget, body, start of the answer, required grasp."""

from dataclasses import replace
from pathlib import Path

import pytest

import nlpgrasp as ng
from nlpgrasp.quality import Bounds
from nlpgrasp.solution import StartRecord

FILES = Path(__file__).parent / "files"


@pytest.fixture(scope="module")
def box():
    return ng.GraspSolution.load(FILES / "box.json")


@pytest.fixture(scope="module")
def infeasible():
    return ng.GraspSolution.load(FILES / "none.json")


def test_what_was_asked(box):
    assert box.task == ng.TaskEllipsoid([1, 1, 1, 0.03, 0.03, 0.03])
    assert box.budget.kind == "l2"
    assert box.body == {"type": "box", "extents": [0.08, 0.04, 0.04]}
    assert box.label == "mu"
    assert replace(box, kind="mu_tilde").label == "mu-tilde"


@pytest.mark.parametrize(
    ("hand", "palm"), [(None, "palm"), ({"type": "urdf", "palm": "base"}, "base"), ({"type": "jaw"}, "palm")]
)
def test_the_palm_is_the_hand_s_root(box, hand, palm):
    assert replace(box, problem={**box.problem, "hand": hand}).palm == palm


def test_a_grasp_is_required(box, infeasible):
    assert box.success
    assert box.require_grasp() is box.grasp
    assert box.require_drawing() is box.drawing
    assert not infeasible.success
    with pytest.raises(ng.InputError, match="solution: got no grasp, expected a solution with a grasp"):
        infeasible.require_grasp()
    with pytest.raises(ng.InputError, match=r"got no grasp \(locally infeasible\), expected"):
        replace(infeasible, status=ng.Status.LOCALLY_INFEASIBLE).require_drawing()
    unknown = {**box.problem, "hand": {"type": "other"}}
    with pytest.raises(ng.InputError, match="got a grasp without a drawing, from a file without its body"):
        replace(box, drawing=None, problem=unknown).require_drawing()


STARTS = (
    StartRecord(0, ng.Status.NO_GRASP, mu=Bounds(0.8, 0.9), violation=0.1),  # broke a constraint
    StartRecord(1, ng.Status.SOLVED, mu=Bounds(0.49, 0.5)),
    StartRecord(3, ng.Status.SOLVED, mu=Bounds(0.44, 0.45)),
    StartRecord(4, ng.Status.FAILED),
)


@pytest.mark.parametrize(("stated", "index"), [(3, 3), (1, 1), (None, 1)])
def test_the_start_of_the_answer_is_the_one_stated_or_for_earlier_files_the_best_solved(box, stated, index):
    assert replace(box, starts=STARTS, best_start=stated).winner.index == index


def test_a_failed_solve_tells_the_error_of_its_first_start(infeasible):
    starts = tuple(StartRecord(i, ng.Status.FAILED, message=f"RuntimeError: {i}") for i in range(2))
    failed = replace(infeasible, status=ng.Status.FAILED, starts=starts)
    assert failed.told.endswith("the starts' messages in the result name it. The first: RuntimeError: 0")


def test_without_a_solved_start_none_won(infeasible):
    assert infeasible.winner is None
    assert infeasible.best_start is None
    assert "best_start" not in infeasible.to_dict()


@pytest.mark.slow
def test_a_solve_by_robustness_records_the_start_it_took():
    task = ng.TaskEllipsoid([1, 1, 0.03])
    rectangle = ng.Polygon([[0, 0], [0.1, 0], [0.1, 0.06], [0, 0.06]])
    problem = ng.GraspProblem(rectangle, [ng.FrictionContact(0.5)] * 3, task)
    solution = ng.solve(problem, starts=3, options=ng.SolveOptions(workers=1, maximise_robust=True))
    assert solution.winner.faces == solution.faces
    assert solution.winner.mu.lower <= solution.mu.upper
    assert solution.mu.lower <= solution.winner.mu.upper
