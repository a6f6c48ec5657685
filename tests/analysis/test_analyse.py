"""Analyses of a solution, on request."""

import re
from dataclasses import replace

import numpy as np
import pytest
import trimesh

import nlpgrasp as ng
from nlpgrasp.cli.problem_script import load_problem
from nlpgrasp.solution.records import Status
from tests.hands.urdf import four_finger_hand

CONTACTS = [ng.FrictionContact(0.6)] * 3
ALL = ("prices", "robustness", "delta", "nu", "friction", "drawing")
MU = ng.SolveOptions(workers=1, rank="mu")  # robustness, too, is left out


def box(**more):
    task = ng.TaskEllipsoid([1.0, 1.0, 1.0, 0.03, 0.03, 0.03])
    return ng.GraspProblem(ng.Box([0.08, 0.05, 0.04]), CONTACTS, task, constraints=[ng.Table(-0.015)], **more)


def plate(**more):
    """A planar problem, solved in a second."""
    body = ng.Polygon([[-0.04, -0.025], [0.04, -0.025], [0.04, 0.025], [-0.04, 0.025]])
    task = ng.TaskEllipsoid([1.0, 1.0, 0.03])
    return ng.GraspProblem(body, **{"contacts": CONTACTS, "task": task, "constraints": [ng.Table(-0.015)], **more})


@pytest.fixture(scope="module")
def solution():
    return ng.solve(plate(), 1, options=MU)


@pytest.fixture(scope="module")
def complete():
    return ng.solve(plate(), 1, options=replace(MU, analyses=ALL))


def test_a_solve_computes_the_answer_alone(solution):
    assert (solution.delta, solution.nu, solution.prices, solution.robust, solution.drawing) == (
        None,
        None,
        (),
        None,
        None,
    )
    assert solution.needed is not None
    assert solution.kkt is not None
    assert solution.friction is None
    assert set(ALL) & set(solution.solver["seconds"]) == set()


def test_analyses_asked_for_are_computed(complete):
    assert None not in (complete.delta, complete.nu, complete.robust, complete.friction, complete.drawing)
    assert complete.prices
    assert set(ALL) <= set(complete.solver["seconds"])
    assert "delta certified in" in str(complete)


def test_analyses_do_not_change_the_answer(solution, complete, tmp_path):
    assert solution.grasp.points.tolist() == complete.grasp.points.tolist()
    assert (solution.mu.lower, solution.best_possible) == (complete.mu.lower, complete.best_possible)
    file = solution.save(tmp_path / "plain.json")
    assert ng.verify(file)
    assert file.stat().st_size < complete.save(tmp_path / "whole.json").stat().st_size


def test_one_analysis_is_added_by_its_name(solution):
    analysed = ng.analyse(solution, "nu")
    assert analysed.nu is not None
    assert (analysed.delta, analysed.robust, analysed.drawing) == (None, None, None)
    assert solution.nu is None
    assert analysed.grasp is solution.grasp


def test_from_the_file_alone_all_is_added_as_a_whole_solve_finds_it(solution, complete, tmp_path):
    path = solution.save(tmp_path / "box.json")
    analysed = ng.analyse(ng.GraspSolution.load(path))
    for name in ("delta", "nu", "robust", "friction"):
        assert str(getattr(analysed, name)) == str(getattr(complete, name)) != "None"
    np.testing.assert_allclose(analysed.drawing.body.vertices, complete.drawing.body.vertices)
    mine, theirs = ({p.name: p.gain for p in s.prices} for s in (analysed, complete))
    assert mine.keys() == theirs.keys() != set()
    assert mine == pytest.approx(theirs, rel=0.05, abs=1e-3)
    assert ng.verify(analysed.save(path))
    loaded = ng.GraspSolution.load(path)
    assert ng.analyse(loaded).to_dict() == loaded.to_dict()


def test_a_drawing_is_made_for_what_needs_one(solution, complete):
    np.testing.assert_allclose(solution.require_drawing().body.vertices, complete.drawing.body.vertices)
    assert solution.drawing is None


@pytest.mark.slow
def test_a_mesh_needs_the_problem_once_it_is_in_a_file(tmp_path):
    trimesh.creation.box(extents=[0.08, 0.05, 0.04]).export(tmp_path / "box.stl")
    body = ng.Mesh.load(tmp_path / "box.stl", unit="m", resolution=16)
    problem = replace(box(), body=body, constraints=[])
    solved = ng.solve(problem, 1, options=MU)
    of_file = ng.GraspSolution.load(solved.save(tmp_path / "found.json"))
    alone, helped = ng.analyse(of_file), ng.analyse(of_file, problem=problem)
    assert alone.delta is not None
    assert alone.nu is not None
    assert (alone.robust, alone.prices) == (None, ())
    assert len(of_file.require_drawing().body.faces) == 12  # which the file holds, as it holds no mesh
    assert (helped.delta, helped.nu) == (alone.delta, alone.nu)
    assert 0.0 <= helped.robust.mu.lower <= helped.mu.upper
    assert len(helped.drawing.body.faces) == 12
    assert len(ng.analyse(solved, "drawing").drawing.body.faces) == 12  # which knows its problem
    with pytest.raises(ng.InputError, match=r"^problem: got None, expected the problem that was .*: prices need"):
        ng.analyse(of_file, "prices", "nu")
    with pytest.raises(ng.InputError, match="got a grasp without a drawing, from a file without its body"):
        replace(of_file, drawing=None).require_drawing()


@pytest.mark.slow
def test_phases_of_a_hand():
    task = ng.TaskEllipsoid([1.0, 1.0, 1.0, 0.03, 0.03, 0.03])
    problem = ng.GraspProblem(ng.Sphere(0.03), ng.FrictionContact(0.7), task, hand=four_finger_hand())
    solved = ng.solve(problem, 1, options=MU)
    names = ("pregrasp", "approach", "way_in", "phases", "lift")
    assert solved.hand.keys() > {*names, "link_depth", "squeeze"}  # never left out
    without = replace(solved, hand={name: value for name, value in solved.hand.items() if name not in names})
    analysed = ng.analyse(without, "phases", "drawing")
    assert analysed.hand["link_depth"] == solved.hand["link_depth"]
    assert [phase["name"] for phase in analysed.hand["phases"]] == [phase["name"] for phase in solved.hand["phases"]]
    assert len(analysed.drawing.links) > 10


@pytest.mark.slow
def test_contacts_along_links_are_found_again(problems_folder):
    """Where along a link each contact is follows from the contacts: files state postures alone."""
    problem = load_problem(problems_folder / "power_grasp.py")
    options = replace(MU, global_bound=False)
    solved = ng.solve(problem, 1, options=options)
    values = problem.hand.values_at(solved.hand, solved.grasp.points)
    poses = problem.hand.tree.body_poses(values)
    slides = iter(values["slides"])
    for (link, tip), point in zip(problem.hand.tips, solved.grasp.points, strict=True):
        if tip.slides:
            centre = np.asarray(tip.ball_centre(poses[link], next(slides))).ravel()
            assert np.linalg.norm(point - centre) == pytest.approx(tip.radius, abs=1e-6)
    assert ng.analyse(solved, "robustness").robust.mu.lower > 0.0
    resolved = ng.solve(problem, 1, options=options, warm_starts=[solved])
    assert resolved.mu.upper >= (1.0 - 1e-3) * solved.mu.lower


@pytest.mark.filterwarnings("ignore:GraspProblem.task. its moments stay")
@pytest.mark.parametrize(
    ("part", "changed"),
    [
        ("body", {"body": ng.Polygon([[-0.04, -0.025], [0.04, -0.025], [0.0, 0.025]])}),
        ("contacts", {"contacts": [ng.FrictionContact(0.5)] * 3}),
        ("task", {"task": ng.TaskEllipsoid([1.0, 2.0, 0.03])}),
        ("constraints", {"constraints": []}),
        ("hand", {"hand": ng.Fingertips(3, radius=0.004)}),
    ],
)
def test_another_problem_is_refused(part, changed, solution):
    with pytest.raises(ng.InputError, match=rf"problem\.{part}: got another than the solution's"):
        ng.analyse(solution, problem=replace(plate(), **changed))


def test_names_of_no_analyses_are_refused(solution):
    allowed = r'"prices", "robustness", "delta", "nu", "friction", "phases", "drawing"'
    with pytest.raises(ng.InputError, match=rf'^analyses: got "?price"?, expected {allowed}'):
        ng.analyse(solution, "nu", "price")
    with pytest.raises(ng.InputError, match=rf"SolveOptions\.analyses: got .*, expected {allowed}"):
        ng.SolveOptions(analyses=("nu", 3))
    with pytest.raises(ng.InputError, match=r"SolveOptions\.analyses: got nu, expected a sequence of names"):
        ng.SolveOptions(analyses="nu")


def test_phases_of_no_hand_are_refused(solution):
    expected = re.escape("got phases, expected no phases without a hand that has links, such as an ng.URDFHand")
    with pytest.raises(ng.InputError, match=rf"^analyses: {expected}"):
        ng.analyse(solution, "phases")
    with pytest.raises(ng.InputError, match=rf"^SolveOptions\.analyses: {expected}"):
        ng.solve(plate(), 1, options=ng.SolveOptions(analyses=["phases"]))


def test_the_friction_needed_is_said_with_the_force_at_two_frictions():
    task = ng.TaskPolytope([[0.0, 2.0, 0.0]])  # 1 N of friction at each of two contacts that press with at most 4 N
    opposed = plate(contacts=[ng.FrictionContact(0.6)] * 2, task=task, force_budget="per_finger", max_force=4.0)
    grasp = ng.Grasp([[-0.04, 0.0], [0.04, 0.0]], [[1.0, 0.0], [-1.0, 0.0]], opposed.models, [0.0, 0.0])
    found = ng.GraspSolution(Status.SOLVED, "pinch", opposed.to_dict(), grasp, ("edge3", "edge1"), ng.mu(grasp, task))
    analysed = ng.analyse(replace(found, mu=ng.mu(grasp, task, force_budget="per_finger")), "friction")
    least = analysed.friction.least  # size of a force: sqrt(1 + 1 / f^2) = 4
    assert least.lower <= 1.0 / np.sqrt(15.0) <= least.upper <= 1.02 * least.lower
    line = analysed.friction_line()
    assert re.match(
        r"the task is held above friction 0\.2\d+ and is lost below 0\.2\d+, with at most 4 N a finger", line
    )
    assert re.search(r"; it needs 1\.6[78] N at 0\.6 and 3\.\d+ N at 0\.3 \(largest normal force\)$", line)
    assert f"  {line}" in str(analysed).splitlines()
    for point in analysed.force_curve():
        assert point.force.lower <= 1.0 / point.friction <= point.force.upper
    assert found.friction_line() == ""


def test_friction_of_contacts_without_one_coefficient_is_refused():
    mixed = plate(contacts=[ng.FrictionContact(0.6), ng.FrictionContact(0.5), ng.FrictionContact(0.6)])
    message = (
        "SolveOptions.analyses: got contacts with friction 0.5 and 0.6, expected one friction coefficient: what is held"
        " with 0.5 at all of them is held with these too"
    )
    with pytest.raises(ng.InputError, match=f"^{re.escape(message)}$"):
        ng.solve(mixed, 1, options=ng.SolveOptions(analyses=["friction"]))
    smooth = ng.Grasp([[-0.04, 0.0], [0.04, 0.0]], [[1.0, 0.0], [-1.0, 0.0]], ng.PointContact(), [0.0, 0.0])
    task = ng.TaskPolytope([[0.0, 2.0, 0.0]])
    problem = plate(contacts=[ng.PointContact()] * 2, task=task).to_dict()
    found = ng.GraspSolution(Status.SOLVED, "smooth", problem, smooth, ("edge3", "edge1"), ng.mu(smooth, task))
    assert ng.analyse(found).friction is None  # among all analyses it is left out
    with pytest.raises(ng.InputError, match=r"^analyses: got contacts without friction, expected contacts"):
        ng.analyse(found, "friction")


def test_all_analyses_are_those_that_there_can_be(solution):
    assert "phases" not in str(ng.analyse(solution).hand)


def test_without_a_grasp_there_is_nothing_to_analyse():
    problem = plate(contacts=[ng.FrictionContact(0.6)])
    solution = ng.solve(problem, 1, options=replace(MU, extras=True))
    assert solution.grasp is None
    with pytest.raises(ng.InputError, match="solution: got no grasp"):
        ng.analyse(solution, "nu")
