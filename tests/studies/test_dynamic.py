"""Dynamic grasping against cold solves; the filling cup; invalid input."""

from dataclasses import replace
from itertools import permutations

import numpy as np
import pytest

import nlpgrasp as ng
from nlpgrasp.pipeline import multistart
from nlpgrasp.pipeline.multistart import Multistart
from problems.filling_cup import HEIGHT, center_of_mass, filled, into_rack
from tests.hands.urdf import four_finger_hand
from tests.studies.random_paths import compared, random_path

ONE = ng.SolveOptions(workers=1)
LEVELS = np.linspace(0.2, 1.0, 5)


@pytest.fixture(scope="module")
def cup():
    return ng.follow_task(filled, LEVELS, starts=3, options=ONE, regrasp_gain=0.0)


@pytest.fixture(scope="module")
def calm_cup():
    return ng.follow_task(filled, LEVELS, starts=3, options=ONE)


@pytest.mark.slow
def test_the_fingers_follow_the_rising_water(cup):
    """Section 3.6: as the cup fills the fingers move up, with the centre of mass."""
    heights = cup.paths[:, :, 2].mean(axis=1)
    rising = [center_of_mass(level)[1] for level in LEVELS]
    assert rising[-1] - rising[0] > 0.03
    assert heights[-1] - heights[0] > 0.02
    assert np.all(np.diff(heights) > -2e-3)


@pytest.mark.slow
@pytest.mark.parametrize("index", [2, 4])
def test_no_worse_than_a_cold_solve(cup, calm_cup, index):
    cold = ng.solve(filled(LEVELS[index]), 3, options=ONE)
    assert cup.steps[index].solution.mu.lower >= 0.99 * cold.mu.lower
    assert calm_cup.steps[index].solution.mu.lower >= 0.97 * cold.mu.lower  # 2 % that moving has to gain, and the gaps


@pytest.mark.slow
def test_fingers_that_would_gain_little_move_less_often(cup, calm_cup):
    """And in all no farther: up the side."""

    def moves(found):
        return sum(bool(np.any(step.moved > 0.0)) for step in found.steps)

    def way(found):
        return sum(float(np.sum(step.moved)) for step in found.steps)

    assert moves(calm_cup) < moves(cup)
    assert way(calm_cup) <= 1.01 * way(cup)


@pytest.mark.slow
def test_every_step_is_a_solution_that_verifies(cup, tmp_path):
    path = cup.steps[3].solution.save(tmp_path / "step.json")
    assert ng.verify(path).passed
    assert cup.steps[3].solution.name == "cup filled to 80%"
    for step in cup.steps:
        assert step.solution.mu.gap <= 0.0101


@pytest.mark.slow
def test_each_step_s_file_verifies_on_its_own(tmp_path):
    """With its constraints, seed, options and versions, as a solve's file has them."""
    square = ng.Polygon([[0, 0], [0.1, 0], [0.1, 0.06], [0, 0.06]])
    below = ng.Workspace(ng.BoxRegion([-1, -1], [1, 0.05]))

    def pulling(share):
        task = ng.TaskEllipsoid([1.0, 1.0 - 0.5 * share, 0.03])
        return ng.GraspProblem(square, [ng.FrictionContact(0.5)] * 3, task, constraints=[below])

    for i, step in enumerate(ng.follow_task(pulling, [0.0, 0.5, 1.0], starts=2, seed=4, options=ONE).steps):
        path = step.solution.save(tmp_path / f"{i}.json")
        verified = ng.verify(path)
        assert verified.passed, str(verified)
        solution = ng.GraspSolution.load(path)
        rows = [c for c in solution.constraints if c.kind == "workspace"]
        assert {finger for c in rows for finger in c.fingers} == {0, 1, 2}
        assert solution.solver["seed"] == 4
        stated = solution.solver["options"]
        assert {**stated, "final_rtol": ONE.final_rtol} == ONE.to_dict()
        assert stated["final_rtol"] <= ONE.final_rtol  # the gap that the certificate reached
        assert solution.solver["versions"]["nlpgrasp"] == ng.__version__
        assert solution.solver["seconds"]["total"] > 0.0


@pytest.mark.slow
def test_what_staying_would_give(cup):
    """An upper bound of the contacts of the step before under this step's task, certified anew."""
    before, step = cup.steps[3].solution.grasp, cup.steps[4]
    bounds = ng.mu(before, filled(LEVELS[4]).task)
    assert bounds.lower <= step.stayed <= bounds.upper * 1.05
    after = step.solution.grasp.points
    orders = permutations(range(len(after))) if step.regrasp else [range(len(after))]  # any finger to any place then
    went = [np.linalg.norm(after - before.points[list(order)], axis=1) for order in orders]
    np.testing.assert_allclose(sorted(step.moved), sorted(min(went, key=np.sum)))
    for line, each in zip(str(cup).splitlines()[1:], cup.steps, strict=True):
        assert f" in {each.solution.mu}, {each.how}; staying would give at most {each.stayed:.4g}" in line


@pytest.mark.slow
def test_what_the_fingers_do_in_words(cup):
    """Which of them a step is depends on which optimum the ascent is nearest to; the words are those of the step."""
    step = replace(cup.steps[4], regrasp=False, cold=False)
    assert replace(step, moved=np.array([0.0, 0.0012, 0.0004])).how == "slide by at most 1.2 mm"
    assert replace(step, moved=np.zeros(3)).how == "stay"
    assert replace(step, regrasp=True).how == "regrasp"
    assert replace(step, cold=True).how == "found by a cold solve, as none that was followed held"


def turning(share):
    """Return a task that turns from a force along x to one along y: another pair of faces is best."""
    force = 3.0 * np.array([1.0 - share, share])
    axes = [0.2 + force[0], 0.2 + force[1], 0.2, 0.01, 0.01, 0.01]
    return ng.GraspProblem(ng.Box([0.06, 0.06, 0.02]), [ng.FrictionContact(0.3)] * 4, ng.TaskEllipsoid(axes))


@pytest.mark.slow
def test_a_regrasp_where_sliding_does_not_help():
    followed = ng.follow_task(turning, np.linspace(0.0, 1.0, 5), starts=6, options=ONE)
    switched = [step for step in followed.steps if step.regrasp]
    assert switched
    for step in switched:
        assert step.solution.mu.lower > 1.05 * step.stayed
    assert "regrasp" in str(followed)
    cold = ng.solve(turning(1.0), 6, options=ONE)
    assert followed.steps[-1].solution.mu.lower >= 0.99 * cold.mu.lower


SIDES = ng.Polygon([[-1.0, -0.5], [1.0, -0.5], [1.0, 0.5], [-1.0, 0.5]])


def swinging(s, fingers=2):
    """Return a rectangle whose load swings from one side to the other and turns it."""
    task = ng.TaskEllipsoid([1.0, 1.0, 0.5], center=[1.2 * s, 0.5, 0.15 * s])
    return ng.GraspProblem(SIDES, [ng.FrictionContact(0.5)] * fingers, task, torque_origin=[0.0, 0.0])


def best_of_a_grid(task, count=7):
    """Return the best quality of two fingers on a grid of places on opposite sides."""
    best = 0.0
    for axis, half in ((0, 1.0), (1, 0.5)):
        along, across = np.eye(2)[axis], np.eye(2)[1 - axis]
        places = np.linspace(-0.95 * half, 0.95 * half, count)
        other = 1.5 - half
        for a in places:
            for b in places:
                points = [a * along - other * across, b * along + other * across]
                grasp = ng.Grasp(points, [across, -across], ng.FrictionContact(0.5), torque_origin=[0.0, 0.0])
                best = max(best, ng.mu(grasp, task, rtol=0.1).lower)
    return best


@pytest.mark.slow
def test_no_step_is_lost_where_a_task_turns():
    followed = ng.follow_task(swinging, np.linspace(-1.0, 1.0, 9), starts=8, options=ONE)
    for step in followed.steps:
        assert step.solution.status is ng.Status.SOLVED
        assert step.solution.mu.lower >= 0.97 * best_of_a_grid(swinging(step.parameter).task)


@pytest.mark.slow
@pytest.mark.parametrize("number", [6, 13, 28])
def test_random_paths_against_cold_solves(number):
    """The hard ones: another basin is best, descents flatter, or hardly any start finds a grasp."""
    one = compared(number, (0, 3, 7))
    assert one.ratio >= 0.97
    assert one.lost == 0


@pytest.mark.slow
def test_a_basin_in_the_middle_of_a_path_is_found():
    """A cold solve's best there is on other sides than those of both ends."""
    path, shares = random_path(4), [0.0, 3.0 / 7.0, 1.0]
    steps = ng.follow_task(path.at, shares, starts=2, options=ONE).steps
    cold = ng.solve(path.at(shares[1]), 2, options=ONE)
    assert cold.mu.lower > 0.0
    assert steps[1].solution.mu.lower >= 0.97 * cold.mu.lower
    middle, *ends = (sorted(steps[i].solution.faces) for i in (1, 0, 2))
    assert middle not in ends


TRIANGLE = ng.Polygon([[-1.0, -0.6], [1.1, -0.6], [0.2, 1.0]])
TURNS = {  # degrees: middle and torque, semi-axes, friction of both fingers
    -72: ([-1.1524, 0.2426], -0.2208, [0.9926, 0.7599, 0.7861], [0.5144, 0.8465]),
    -100: ([0.4061, 0.9201], -0.0861, [0.7399, 0.5912, 0.8903], [0.5358, 0.7206]),
}


@pytest.mark.slow
@pytest.mark.parametrize("degrees", TURNS)
def test_a_middle_that_turns_about_a_triangle_with_unlike_fingers(degrees):
    """One start a step followed the wrong basin: a longer search of all placements shows that it is wrong."""
    middle, torque, axes, frictions = TURNS[degrees]

    def at(share):
        c, s = np.cos(np.radians(degrees) * share), np.sin(np.radians(degrees) * share)
        task = ng.TaskEllipsoid(axes, center=[c * middle[0] - s * middle[1], s * middle[0] + c * middle[1], torque])
        return ng.GraspProblem(TRIANGLE, [ng.FrictionContact(f) for f in frictions], task)

    for step in ng.follow_task(at, np.linspace(0.0, 1.0, 8), starts=6, options=ONE).steps[3::4]:
        cold = ng.solve(at(step.parameter), 6, options=ONE)
        assert step.solution.mu.lower >= 0.98 * cold.mu.lower
        assert step.gap <= 0.1


def rising(limit):
    """Return a rectangle of which only the part above a limit may be touched."""
    above = ng.Workspace(ng.BoxRegion([-2.0, limit], [2.0, 2.0]))
    task = ng.TaskEllipsoid([1.0, 1.0, 0.5])
    return ng.GraspProblem(SIDES, [ng.FrictionContact(0.7)] * 2, task, constraints=[above])


def test_fingers_move_out_of_the_way_of_surroundings_that_change():
    limits = [-0.4, 0.1, 0.2]
    followed = ng.follow_task([rising(limit) for limit in limits], limits, starts=2, options=ONE)
    for step in followed.steps:
        assert step.solution.status is ng.Status.SOLVED
        assert np.all(step.solution.grasp.points[:, 1] >= step.parameter - 1e-6)
        assert ng.verify(step.solution, rtol=0.05).passed
    assert [step.stayed > 0.0 for step in followed.steps] == [True, False, False]  # in the way
    cold = ng.solve(rising(limits[-1]), 2, options=ONE)
    assert followed.steps[-1].solution.mu.lower >= 0.98 * cold.mu.lower
    assert str(followed).count("no placement is more than") == 3


def gripped(share):
    """Return a rectangle with four fingers whose load turns."""
    task = ng.TaskEllipsoid([0.3, 0.3, 0.2], center=[np.sin(share), np.cos(share), 0.0])
    return ng.GraspProblem(SIDES, [ng.FrictionContact(0.6)] * 4, task, constraints=[ng.Spread(max=2.0)])


WEIGHT = ng.TaskEllipsoid([0.1, 0.1, 0.05], center=[0.0, 0.5, 0.0])


def test_moves_between_steps_are_certified_on_their_whole_way():
    """While a finger is lifted the others hold the weight alone; one that slides goes on holding. By certificates."""
    followed = ng.follow_task(gripped, [0.0, 0.2], starts=1, options=ONE, regrasp_gain=0.0, hold=WEIGHT)
    first, second = followed.steps
    assert first.held is None
    assert len({move.finger for move in second.moves}) == np.count_nonzero(second.moved)
    points, normals = first.solution.grasp.points.copy(), first.solution.grasp.normals.copy()
    for move in second.moves:
        holding = [i for i in range(4) if move.slides or i != move.finger]
        for station in move.path if move.slides else move.path[:1]:
            points[move.finger] = station
            grasp = ng.Grasp(points[holding], normals[holding], ng.FrictionContact(0.6), np.zeros(2))
            assert ng.mu(grasp, WEIGHT, 0.01).upper >= second.held.lower
        target = int(np.argmin(np.linalg.norm(second.solution.grasp.points - move.path[-1], axis=1)))
        points[move.finger] = second.solution.grasp.points[target]
        normals[move.finger] = second.solution.grasp.normals[target]
    assert second.held.lower == min(move.held.lower for move in second.moves) > 1.0
    assert f"held with {second.held} everywhere on the way" in str(followed)


def test_a_body_that_is_dropped_between_two_steps_is_said_to_be():
    """Each of two fingers alone holds nothing."""
    followed = ng.follow_task(rising, [0.1, 0.2], starts=1, options=ONE, hold=ng.TaskEllipsoid([0.1] * 3))
    assert followed.steps[1].held.upper == 0.0
    assert "not held while the fingers move" in str(followed)


def test_expressions_that_look_alike_are_compiled_for_each_step():
    """Their files say only the name: a step may not keep the limit of another one."""

    def below(limit):
        row = ng.Constraint("height", lambda p, n: p[0][1] + p[1][1] - limit, upper=0.0)
        return replace(rising(-1.0), constraints=[row])

    followed = ng.follow_task(below, [0.4, -0.4], starts=1, options=ONE)
    for step in followed.steps:
        assert np.sum(step.solution.grasp.points[:, 1]) <= step.parameter + 1e-5


@pytest.mark.slow
def test_a_cup_that_is_set_into_a_rack():
    """Section 3.6, compliant motion: the rim rises, pushes more, and the fingers stay above it."""
    depths = [0.01, 0.06, 0.1]
    followed = ng.follow_task(into_rack, depths, starts=3, options=ONE)
    for step in followed.steps:
        assert step.solution.status is ng.Status.SOLVED
        assert np.all(step.solution.grasp.points[:, 2] >= step.parameter - 0.5 * HEIGHT + 0.005 - 1e-6)
    cold = ng.solve(into_rack(depths[-1]), 3, options=ONE)
    assert followed.steps[-1].solution.mu.lower >= 0.98 * cold.mu.lower
    assert followed.steps[-1].stayed == 0.0


def swelling(size):
    return ng.GraspProblem(SIDES, [ng.FrictionContact(0.5)] * 2, ng.TaskEllipsoid([1.0, 1.0 + 0.01 * size, 0.5]))


def test_fingers_stay_where_sliding_gains_next_to_nothing():
    followed = ng.follow_task(swelling, [0.0, 0.5, 1.0], starts=2, options=ONE)
    assert "stay" in str(followed)
    for step in followed.steps[1:]:
        np.testing.assert_array_equal(step.moved, 0.0)
        np.testing.assert_array_equal(step.solution.grasp.points, followed.steps[0].solution.grasp.points)
        assert not step.regrasp
        assert step.solution.mu.lower <= step.stayed


@pytest.mark.slow
def test_each_step_says_how_far_it_is_from_the_best():
    """The bound against grasps on a grid, the grasp against the bound."""
    for step in ng.follow_task(swinging, np.linspace(-0.5, 0.5, 3), starts=2, options=ONE).steps:
        assert step.solution.bound.upper >= best_of_a_grid(swinging(step.parameter).task, 5)
        assert step.solution.mu.lower >= 0.96 * step.solution.bound.upper  # the search's gap, 2 % to move, certificates


def test_no_start_is_run_where_the_warm_start_is_proved_to_be_near_the_best(monkeypatch):
    run, starts = multistart.run_start, []
    monkeypatch.setattr(multistart, "run_start", lambda *of: starts.append(of) or run(*of))
    followed = ng.follow_task(swelling, [0.0, 0.5, 1.0], starts=2, options=ONE)
    assert len(starts) == 1  # of the first step
    assert all(step.solution.gap <= 0.03 for step in followed.steps)  # a percent, and 2 % that moving has to gain


@pytest.mark.slow
def test_a_hand_with_a_pose_is_followed_with_its_posture():
    """Four fingers on a box whose task grows evenly: the hand stays as it is, and the step verifies."""
    body = ng.Box([0.08, 0.04, 0.04])

    def growing_task(size):
        task = ng.TaskEllipsoid(size * np.array([1.0, 1.0, 1.0, *[body.size] * 3]))
        return ng.GraspProblem(body, ng.FrictionContact(0.7), task, hand=four_finger_hand())

    first, second = ng.follow_task(growing_task, [1.0, 2.0], starts=1, options=ONE).steps
    assert first.solution.mu.lower > 0.5
    assert second.how == "stay"
    assert second.solution.hand["joint_positions"] == first.solution.hand["joint_positions"]
    assert second.solution.mu.lower == pytest.approx(0.5 * first.solution.mu.lower, rel=0.01)
    assert ng.verify(second.solution).passed


@pytest.mark.slow
def test_without_the_search_random_starts_are_followed():
    followed = ng.follow_task(swelling, [0.0, 1.0], starts=2, options=replace(ONE, global_bound=False))
    searched = ng.follow_task(swelling, [0.0, 1.0], starts=2, options=ONE)
    for step, other in zip(followed.steps, searched.steps, strict=True):
        assert step.solution.bound is None
        assert step.solution.mu.lower <= other.solution.bound.upper
        assert step.solution.mu.lower >= 0.97 * other.solution.mu.lower


def test_a_step_that_no_warm_start_holds_is_solved_cold_and_says_so(monkeypatch):
    monkeypatch.setattr(Multistart, "add_warm_start", lambda self, warm: False)
    followed = ng.follow_task(swelling, [0.0, 1.0], starts=2, options=ONE)
    assert [step.cold for step in followed.steps] == [False, True]
    assert "found by a cold solve" in str(followed)
    assert followed.steps[1].solution.mu.lower >= 0.97 * followed.steps[0].solution.mu.lower


def test_where_no_task_has_a_grasp():
    def frictionless(size):
        return replace(swelling(size), contacts=[ng.PointContact()] * 2)

    with pytest.raises(ng.InputError, match="no grasp found for any of the parameters"):
        ng.follow_task(frictionless, [0.0, 1.0], starts=1, options=ONE)


def vanishing(size):
    corners = size * np.array([[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, -1.0, 0.0]])
    return replace(swelling(size), task=ng.TaskPolytope(corners))


def growing(size):
    return replace(filled(size), body=ng.Cylinder(0.03, 0.1 + 0.1 * size))


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: ng.follow_task(filled, [0.5]), "at least 2"),
        (lambda: ng.follow_task(lambda t: t, [0.5, 1.0]), "a GraspProblem at 0.5"),
        (
            lambda: ng.follow_task(growing, [0.5, 1.0]),
            "another body at 1",
        ),
        (lambda: ng.follow_task(filled, [0.5, np.nan]), "parameters"),
        (lambda: ng.follow_task(filled, [0.5, 1.0], regrasp_gain=-1.0), "regrasp_gain"),
        (lambda: ng.follow_task(vanishing, [0.5, 0.0]), "wrenches that are all zero"),
        (lambda: ng.follow_task(lambda size: vanishing(0.0), [0.5, 1.0]), "wrenches that are all zero"),
        (lambda: ng.follow_task(filled, [0.5, 1.0], starts=0), "starts"),
        (lambda: ng.follow_task(filled, [0.5, 1.0], seed=-1), "seed"),
        (lambda: ng.follow_task(None, [0.5, 1.0]), "a function of the parameter"),
        (lambda: ng.follow_task(filled, [0.5, 1.0], options=3), "a SolveOptions"),
        (lambda: ng.follow_task(filled, 0.5), "parameters"),
        (lambda: ng.follow_task(filled), "the values at which problem_at is a problem"),
        (lambda: ng.follow_task([filled(0.5), filled(1.0)], [0.5, 0.7, 1.0]), "expected 2, one for each problem"),
        (lambda: ng.follow_task([filled(0.5)]), "at least 2"),
        (lambda: ng.follow_task(filled, [0.5, 1.0], hold=ng.TaskEllipsoid([1.0] * 3)), "a task of dimension 6"),
    ],
)
def test_bad_input_is_one_sentence(call, message):
    with pytest.raises(ng.InputError, match=message) as caught:
        call()
    assert "\n" not in str(caught.value)


def test_an_error_of_the_users_function_is_one_sentence_with_its_step():
    def broken(size):
        return filled(size) if size < 1.0 else {}["rack"]

    with pytest.raises(ng.InputError, match=r"problem_at\(2\), step 1: got KeyError: 'rack'") as raised:
        ng.follow_task(broken, [0.5, 2.0])
    assert isinstance(raised.value.__cause__, KeyError)
