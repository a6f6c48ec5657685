"""Warm starts between variations: exchanged grasps, kept results, independence of the order."""

import json
import shutil
from dataclasses import replace

import numpy as np
import pytest

import nlpgrasp as ng
from nlpgrasp.experiments.output_folder import EXCHANGE_STATE, OWN_RESULTS
from nlpgrasp.experiments.solve_job import improve_solution
from nlpgrasp.experiments.solve_record import body_digest
from nlpgrasp.optimize.compiled_problem import CompiledProblem
from nlpgrasp.solution.quality_record import GlobalBound
from tests.experiments.small import QUICK, base, experiment
from tests.hands.urdf import four_finger_hand

BLIND = {"time_limit": 1e-6}  # finds nothing by itself
VARIATIONS = {
    "smooth": {},
    "rough": {"friction": 0.8, "options": BLIND},
    "three": {"fingers": 3, "options": BLIND},
    "shared": {"force_budget": "shared", "options": BLIND},
    "walls": {"constraints": [ng.Forbid(["edge0"])], "options": BLIND},
}
OPTIONS = {"options": ng.SolveOptions(**{**QUICK.to_dict(), "global_bound": False})}


def run(variations, folder, **settings):
    how = {name: settings.pop(name) for name in ("resume", "workers") if name in settings}
    plan = experiment(variations, **{"seeds": [0], **OPTIONS, **settings})
    return ng.run_experiment(plan, folder, **{"workers": 1, **how})


def candidate(result):
    return {s.variation: (result.solution(s.variation, s.seed).faces, s.mu.lower) for s in result.solves if s.success}


@pytest.fixture(scope="module")
def handed(tmp_path_factory):
    return run(VARIATIONS, tmp_path_factory.mktemp("handed") / "out")


def test_what_asks_for_less_is_never_worse(handed):
    smooth = handed["smooth"].mu
    for name in ("rough", "three"):
        assert handed[name].mu.upper >= smooth.lower
        assert handed[name].mu.lower >= smooth.lower / 1.05, name
        assert handed[name].best.origin  # found nothing like it itself


def test_what_is_taken_says_from_where_and_is_verified(handed):
    solution = handed.solution("rough")
    taken_starts = [s for s in solution.starts if s.message.startswith("from variation smooth, seed 0")]
    assert solution.best_start in [s.index for s in taken_starts]
    assert len({s.index for s in solution.starts}) == len(solution.starts)
    for file in (handed.folder / "solves").iterdir():
        written = ng.GraspSolution.load(file)
        assert not written.success or ng.verify(file, rtol=0.1), file.name
    assert "rough: the grasp is that of smooth, seed 0" in str(handed)
    assert [row["origin"] for row in handed.rows() if row["variation"] == "smooth"] == [""]


def test_starts_of_others_do_not_count_as_its_own(handed):
    assert [v.starts[1] for v in handed.variations] == [1] + [0] * (len(VARIATIONS) - 1)


def test_no_grasp_is_taken_that_breaks_a_constraint(handed):
    walls = handed.solution("walls")
    assert "edge0" not in walls.faces


def test_a_budgets_answer_is_not_beaten_by_that_of_another(handed):
    budget = handed.solution("shared").budget
    for name in ("smooth", "rough"):
        grasp = handed.solution(name).require_grasp()
        if len(grasp) == 2 and np.isclose(grasp.contacts[0].friction, 0.5):
            other = ng.mu(grasp, handed.solution("shared").task, 0.001, force_budget=budget)
            assert other.lower <= handed["shared"].mu.upper * 1.001


@pytest.mark.slow
def test_the_result_does_not_depend_on_the_workers(handed, tmp_path):
    assert candidate(run(VARIATIONS, tmp_path / "out", workers=2)) == candidate(handed)


def test_resuming_changes_no_file(handed, tmp_path):
    folder = tmp_path / "out"
    shutil.copytree(handed.folder, folder)
    before = {p: p.stat().st_mtime_ns for p in folder.rglob("*.json") if p.parent != folder}
    resumed = run(VARIATIONS, folder, resume=True)
    assert {p: p.stat().st_mtime_ns for p in folder.rglob("*.json") if p.parent != folder} == before
    assert resumed.notes == ()
    assert str(resumed) == str(ng.ExperimentResult.load(folder))
    assert candidate(resumed) == candidate(handed)


@pytest.mark.slow
def test_variations_added_later_give_what_all_at_once_give(handed, tmp_path):
    folder = tmp_path / "out"
    some = {name: VARIATIONS[name] for name in ("rough", "three")}
    run(some, folder)
    later = run(VARIATIONS, folder, resume=True)
    assert candidate(later) == candidate(handed)


@pytest.mark.slow
def test_what_a_solve_found_itself_is_kept_and_comes_back(handed, tmp_path):
    folder = tmp_path / "out"
    shutil.copytree(handed.folder, folder)
    own = folder / OWN_RESULTS / "rough--seed0.json"
    assert ng.GraspSolution.load(own).mu.upper < handed["rough"].mu.upper or not ng.GraspSolution.load(own).success
    assert set(json.loads((folder / EXCHANGE_STATE).read_text())["solves"]) == {
        f"{name}, seed 0" for name in VARIATIONS
    }
    (folder / EXCHANGE_STATE).unlink()  # as a run that was ended leaves it
    assert candidate(run(VARIATIONS, folder, resume=True)) == candidate(handed)
    (folder / "solves" / "rough--seed0.json").write_text("{")
    assert candidate(run(VARIATIONS, folder, resume=True)) == candidate(handed)


def test_another_body_gets_nothing(tmp_path):
    other = ng.Polygon([[-1, -1], [1, -1], [1, 1.1], [-1, 1]])
    result = run({"smooth": {}, "other": {"body": other, "options": BLIND}}, tmp_path / "out")
    assert result["other"].best is None or result["other"].best.origin == ""
    assert not (result.folder / OWN_RESULTS).exists()


@pytest.mark.slow
def test_functions_that_make_the_same_body_take_part(tmp_path):
    def late():
        square = ng.Polygon([[-1, -1], [1, -1], [1, 1], [-1, 1]])
        problem = base()
        return ng.GraspProblem(square, [ng.FrictionContact(0.9)] * 2, problem.task, name="late")

    result = run({"smooth": {}, "late": late}, tmp_path / "out", options=OPTIONS["options"])
    assert result["late"].mu.upper >= result["smooth"].mu.lower


def test_the_gap_is_that_of_the_grasp_taken(handed):
    """A file states a gap of its own: none of a solve that found no grasp."""
    case = experiment(VARIATIONS, seeds=[0], **OPTIONS).case("rough")
    own = ng.GraspSolution.load(handed.folder / OWN_RESULTS / "rough--seed0.json")
    own = replace(own, bound=GlobalBound(5.0, 1, stated_gap=np.inf))
    smooth = handed.solution("smooth")
    offers = {"from variation smooth, seed 0": smooth.grasps[0]}
    improved = improve_solution(CompiledProblem(case.problem, case.options), 1, own, 0, offers, improve=False)
    assert improved.to_dict()["quality"]["best_possible"]["gap"] == pytest.approx(5.0 / improved.mu.lower - 1.0)
    assert improved.mu.upper >= smooth.mu.lower


def test_bodies_are_told_apart_by_what_they_state():
    square, same = (ng.Polygon([[-1, -1], [1, -1], [1, 1], [-1, 1]]) for _ in range(2))
    assert body_digest(square.to_dict()) == body_digest(same.to_dict()) != body_digest(ng.Box([1, 1, 1]).to_dict())
    hidden = ng.PlanarImplicit(lambda p: p[0] ** 2 + p[1] ** 2 - 1, [[-2, -2], [2, 2]])
    assert body_digest(hidden.to_dict()) == ""


@pytest.mark.slow
def test_with_a_posed_hand_its_joints_travel_too(tmp_path):
    """The rougher sphere takes the grasp with palm and joints, which verify checks against the hand's own limits.

    Contacts stay within a micrometre; joints follow links that are off their clearance by as little.
    """
    contacts = [ng.FrictionContact(0.5)] * 4
    task = ng.TaskEllipsoid([1.0, 1.0, 1.0, 0.03, 0.03, 0.03])
    ball = ng.GraspProblem(ng.Sphere(0.03), contacts, task, hand=four_finger_hand(), name="ball")
    variations = {"smooth": {}, "rough": {"friction": 0.8, "options": {**BLIND, "pregrasp_clearance": 0.01}}}
    plan = ng.Experiment(ball, variations, starts=1, options=ng.SolveOptions())
    result = ng.run_experiment(plan, tmp_path / "out", workers=1)
    assert result.notes == ()
    smooth, rough = result.solution("smooth"), result.solution("rough")
    assert result["rough"].best.origin == "smooth, seed 0"
    assert np.max(np.abs(rough.grasp.points - smooth.grasp.points)) < 1e-6
    assert rough.hand["joint_positions"] == pytest.approx(smooth.hand["joint_positions"], abs=1e-3)
    assert rough.mu.upper >= smooth.mu.lower
    assert ng.verify(result.folder / "solves" / "rough--seed0.json")


def test_a_grasp_that_is_taken_has_the_analyses_asked_for(handed):
    case = experiment(VARIATIONS, seeds=[0], **OPTIONS).case("rough")
    own = ng.GraspSolution.load(handed.folder / OWN_RESULTS / "rough--seed0.json")
    smooth = handed.solution("smooth")
    offers = {"from variation smooth, seed 0": smooth.grasps[0]}
    compiled = CompiledProblem(case.problem, replace(case.options, analyses=("delta",), time_limit=None))
    improved = improve_solution(compiled, 1, replace(own, bound=None), 0, offers, improve=False)
    assert improved.delta.lower > 0.0
    assert improved.nu is None
