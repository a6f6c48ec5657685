"""Simulation with free fingertips against the certified bounds, also for a wrong certificate."""

import sys
from dataclasses import replace

import numpy as np
import pytest

import nlpgrasp as ng
from nlpgrasp.bodies.mesh.display_triangles import triangles
from nlpgrasp.cli.problem_script import load_problem
from nlpgrasp.common.drawing import Drawing, Triangles
from nlpgrasp.errors import InputError, MissingExtraError
from nlpgrasp.quality import Bounds
from nlpgrasp.simulation import simulate
from nlpgrasp.simulation.fingertip_model import Snapshot, components
from nlpgrasp.simulation.fingertip_outcome import Simulation, Trial
from nlpgrasp.simulation.picture_strips import write_strip
from nlpgrasp.simulation.simulate import (
    displace_contacts,
    forces_for_wrenches,
    forces_in_actual_frames,
    grip_forces,
    reduce_friction,
)
from nlpgrasp.simulation.simulation_input import build_simulation_input
from tests.images import panels_drawn, size
from tests.once import solve_once
from tests.test_problems import VALUES


def outcome(lost_at, slip=0.0, touching=""):
    """A simulation that slipped so far as solved, and lost the hardest wrench at a share of what is certified."""
    snapshot = Snapshot(1.0, slip, 0.0, 0.5, np.eye(3), np.zeros(3), np.zeros((2, 3)))
    trials = tuple(Trial(condition, "f_x 1 N", (snapshot,)) for condition in ("as solved", "without gravity"))
    return Simulation("box", 0.8, 1.0, 0.1, trials, 1.01, lost_at, trials[0], touching=touching)


@pytest.mark.parametrize(
    ("lost_at", "confirmed", "said"),
    [
        (1.0, True, "confirmed: the grasp as solved holds what is certified, and loses what is more"),
        (1.03, True, "confirmed: the grasp as solved holds what is certified, and loses what is more"),
        (0.9999, True, "confirmed to 0.999 of the certified share: there the grasp as solved loses the hardest wrench"),
        (0.955, True, "confirmed to 0.955 of the certified share: there the grasp as solved loses the hardest wrench"),
        (0.91, False, "NOT confirmed: loses the hardest wrench at 0.910 of the certified share"),
        (1.2, False, "NOT confirmed: held more than the certificate says is possible"),
        (None, False, "NOT confirmed: held more than the certificate says is possible"),
    ],
)
def test_the_verdict_says_up_to_which_share_it_is_confirmed(lost_at, confirmed, said):
    simulation = outcome(lost_at)
    assert simulation.confirmed is confirmed
    creeps = " (simulated friction creeps: 0.92 is enough)" if lost_at and lost_at < 1.0 else ""
    assert simulation.verdict == said + creeps
    assert outcome(lost_at, slip=0.01).verdict == "NOT confirmed: lost a wrench that the certificate says can be held"


def test_what_the_hand_touches_is_the_first_line():
    touching = "Touches: link f1 is 4 mm inside the body"
    assert str(outcome(1.0, touching=touching)).startswith(f"box: {touching}\nbox: wrenches up to 0.8")
    assert str(outcome(1.0)).startswith("box: wrenches up to 0.8")


@pytest.fixture(scope="module")
def square():
    problem = ng.GraspProblem(
        ng.Polygon([[-0.03, -0.03], [0.03, -0.03], [0.03, 0.03], [-0.03, 0.03]]),
        [ng.FrictionContact(0.5)] * 2,
        ng.TaskEllipsoid([1.0, 1.0, 0.03], center=[0.0, 0.5, 0.0]),
        name="square",
    )
    return solve_once(problem, starts=2)


@pytest.fixture(scope="module")
def box():
    problem = ng.GraspProblem(
        ng.Box([0.08, 0.04, 0.04]),
        [ng.SoftContact(0.6, 0.01, model="elliptic"), ng.FrictionContact(0.5), ng.SoftContact(0.6, 0.01)],
        ng.TaskEllipsoid([5, 5, 10, 0.2, 0.2, 0.2]),
        name="box",
    )
    return solve_once(problem, starts=1, options=ng.SolveOptions(workers=1, rounds=0))


@pytest.fixture(scope="module")
def simulated(box):
    return simulate(box, wrenches=2)


@pytest.mark.slow
def test_both_ends_of_the_certificate(simulated):
    assert simulated.confirmed, str(simulated)
    assert 1.0 <= simulated.lost_at <= 1.05 * simulated.gap
    for condition in ("as solved", "without gravity"):
        assert len(simulated.of(condition)) == 3
        for trial in simulated.of(condition):
            assert trial.held
            assert trial.slip < 1e-4
            assert np.degrees(trial.turn) < 0.1
            assert max(m.used for m in trial.snapshots) <= 1.0
    assert simulated.conditions == ("as solved", "without gravity", "friction 10% lower", "contacts 2 mm off")


@pytest.mark.slow
def test_a_planar_grasp(square):
    simulation = simulate(square, wrenches=3)
    assert simulation.confirmed, str(simulation)
    assert simulation.lost_at <= 1.1 * simulation.gap
    assert all(t.held for t in simulation.trials)


SLOW = pytest.mark.slow


@pytest.mark.slow
@pytest.mark.parametrize("factor", [pytest.param(f, marks=[] if f == 1.15 else SLOW) for f in (0.6, 0.87, 1.15, 1.4)])
def test_a_wrong_certificate_is_found_out(box, factor):
    """The verdict can be no: bounds that are too high or too low are refuted."""
    claimed = replace(box, mu=Bounds(factor * box.mu.lower, factor * box.mu.upper, box.mu.worst_direction))
    simulation = simulate(claimed, wrenches=1)
    assert not simulation.confirmed
    assert simulation.held == (factor < 1.25)  # 0.8 of what is claimed is more than there is
    if factor == 0.6:
        assert simulation.lost_at is None
        assert "never lost" in str(simulation)
    else:
        assert simulation.lost_at == pytest.approx(1.0 / factor, rel=0.04)


QUICK, LONG = ("per_finger", "torques"), ("shared", "per_finger_size", "shared torques")


@pytest.mark.slow
@pytest.mark.parametrize("budget", [*QUICK, *(pytest.param(name, marks=SLOW) for name in LONG)])
def test_every_force_budget(budget):
    arms = [np.eye(3)] * 4
    if budget == "torques":
        budget = ng.JointTorqueLimits(arms, 2.0)
    elif budget == "shared torques":
        budget = ng.SharedJointTorqueLimits(arms, [3.0] * 3, force_limit=10.0)
    corners = np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]]) / np.sqrt(3.0)
    grasp = ng.Grasp(0.03 * corners, -corners, ng.FrictionContact(0.6), torque_origin=[0, 0, 0])
    task = ng.TaskEllipsoid([1, 1, 1, 0.02, 0.02, 0.02])
    bounds = ng.mu(grasp, task, force_budget=budget)
    budget_data = budget if isinstance(budget, str) else budget.to_dict()
    solution = ng.GraspSolution(
        ng.Status.SOLVED,
        "ball",
        {"task": task.to_dict(), "force_budget": budget_data},
        grasp,
        ("surface",) * 4,
        bounds,
        drawing=Drawing(Triangles(*triangles(ng.Sphere(0.03)))),
    )
    simulation = simulate(solution, wrenches=1)
    assert simulation.confirmed, str(simulation)
    assert simulation.effort == pytest.approx(1.0 if not isinstance(budget, str) else 1.0 / bounds.lower)


@pytest.mark.slow
def test_the_heaviest_body_is_carried(box):
    """What the hand can just carry beside the task it does carry, and the fingertips carry themselves."""
    with pytest.raises(InputError, match="mass"):
        simulate(box, share=0.3, mass=10.0)
    heaviest = next(m for m in np.linspace(2.0, 0.1, 20) if _can_carry(box, 0.3, m))
    simulation = simulate(box, share=0.3, mass=0.9 * heaviest, wrenches=2)
    assert all(t.held for t in simulation.of("as solved")), str(simulation)


def _can_carry(solution, share, mass):
    start = build_simulation_input(solution, share, mass, 2)
    loads = share * start.wrenches + start.weight
    return np.all(forces_for_wrenches(start.grasp, start.labels, loads, start.budget, start.effort).margins >= 0.0)


@pytest.mark.slow
def test_much_less_friction_loses_the_wrench_that_needs_it(box, monkeypatch):
    monkeypatch.setattr(sys.modules["nlpgrasp.simulation.simulate"], "LESS_FRICTION", 0.7)
    simulation = simulate(box, wrenches=1)
    hardest, pressing = simulation.of("friction 10% lower")  # the other pushes along the normals, and needs no friction
    assert not hardest.held
    slippery = reduce_friction(box.grasp, 0.7)
    loads = 0.8 * build_simulation_input(box, 0.8, simulation.mass, 1).wrenches
    holdable = ng.finger_forces(slippery, loads)
    assert holdable.used[0] > simulation.effort
    assert holdable.used[1] <= simulation.effort or not pressing.held
    assert all(t.held for t in simulation.of("as solved"))
    assert simulation.confirmed  # of the grasp as solved


@pytest.mark.slow
def test_the_answers_produce_the_wrenches_within_the_effort(box):
    grasp, effort = box.grasp, 1.0 / box.mu.lower
    wrenches = 0.8 * np.array([[5, 0, 0, 0, 0, 0], [0, 0, 0, 0, -0.2, 0], [0, 0, 10, 0, 0, 0]], float)
    loads = forces_for_wrenches(grasp, ("a", "b", "c"), wrenches, ng.budgets.L2Budget(), effort)
    np.testing.assert_allclose(loads.forces @ grasp.G.T, wrenches, atol=1e-6)
    assert np.all(np.linalg.norm(loads.forces, axis=1) <= 0.99001 * effort)
    assert np.all(loads.margins >= 0.0)
    grip = grip_forces(grasp, ng.budgets.L2Budget())
    np.testing.assert_allclose(grasp.G @ grip, 0.0, atol=1e-6)
    pressing = grip[np.cumsum([0, *[c.components(3) for c in grasp.contacts[:-1]]])]
    assert np.all(pressing > 0.1)


def test_moments_are_cut_to_the_contact_model():
    models = [
        ng.SoftContact(0.5, 0.004),
        ng.SoftContact(0.5, 0.004, model="elliptic"),
        ng.PlaneContact(0.01, friction=0.4, model="box"),
    ]
    grasp = ng.Grasp([[-1, 0, 0], [1, 0, 0], [0, 0, 1]], [[1, 0, 0], [-1, 0, 0], [0, 0, -1]], models)
    forces, moments = components(grasp)
    assert forces == [0, 1, 2, 4, 5, 6, 8, 9, 10]
    assert [m.indices for m in moments] == [(3,), (7,), (11,), (12, 13)]
    box, elliptic, torsion, tilt = moments
    assert box.largest(10.0, 5.0) == pytest.approx(0.04)
    assert elliptic.largest(10.0, 0.0) == pytest.approx(0.04)
    assert elliptic.largest(10.0, 3.0) == pytest.approx(0.032)  # (3 / 5)^2 + (tau / 0.04)^2 = 1
    assert elliptic.largest(10.0, 6.0) == 0.0
    assert torsion.largest(1.0, 0.0) == pytest.approx(0.4 * 2 / 3 * 0.01)
    np.testing.assert_allclose(tilt.limit(np.array([3.0, -4.0]), 1.0, 0.0), [0.006, -0.008])  # a disc, not a square
    np.testing.assert_allclose(tilt.limit(np.array([0.003, 0.004]), 1.0, 0.0), [0.003, 0.004])
    np.testing.assert_allclose(box.directions, [[1, 0, 0]])
    np.testing.assert_allclose(torsion.directions, [[0, 0, -1]])


@pytest.mark.slow
def test_contacts_are_put_off_by_what_is_said(box):
    displaced = displace_contacts(box, 2e-3)
    moved = np.linalg.norm(displaced.points - box.grasp.points, axis=1)
    assert np.max(moved) == pytest.approx(2e-3, rel=0.05)
    np.testing.assert_allclose(np.linalg.norm(displaced.normals, axis=1), 1.0, atol=1e-12)
    x = np.arange(float(box.grasp.G.shape[1]))[None]
    felt = forces_in_actual_frames(box.grasp, displaced, x)
    for solved_wrench, actual_wrench in zip(
        box.grasp.contact_wrenches(x[0]), displaced.contact_wrenches(felt[0]), strict=True
    ):
        np.testing.assert_allclose(actual_wrench[:3], solved_wrench[:3], atol=1e-12)
    assert displace_contacts(replace(box, robust=None), 2e-3) is None
    simulation = simulate(replace(box, robust=None), wrenches=1)
    assert len(simulation.conditions) == 3
    assert "not tried" in simulation.notes[0]


@pytest.mark.slow
def test_pads_and_lines_are_held_too():
    pad = ng.PlaneContact(0.006, friction=0.6)
    task = ng.TaskEllipsoid([1, 1, 1, 0.02, 0.02, 0.02])
    box = ng.Box([0.05, 0.04, 0.03])
    problem = ng.GraspProblem(box, [pad] * 2, task, name="pads")
    options = ng.SolveOptions(workers=1)
    simulation = simulate(ng.solve(problem, starts=1, options=options), wrenches=1)
    assert simulation.confirmed, str(simulation)
    assert simulation.lost_at <= 1.1 * simulation.gap


@pytest.mark.slow
def test_the_hardest_wrench_is_found_where_the_file_does_not_say_it(box):
    silent = replace(box, mu=Bounds(box.mu.lower, box.mu.upper))
    simulation = simulate(silent, wrenches=1)
    assert simulation.confirmed, str(simulation)


@pytest.mark.slow
def test_a_strip_of_pictures(simulated, box, tmp_path):
    path = write_strip(simulated, box, tmp_path / "strip.png")
    assert path.read_bytes()[:8] == b"\x89PNG\r\n\x1a\n"
    width, height = size(path)
    assert height == 704  # 6.4 inches at 110 dots an inch
    assert min(panels_drawn(path, width // 330)) > 0.02  # every frame shows something


@pytest.mark.slow
def test_bad_input(box, monkeypatch):
    for share in (0.0, -1.0, 1.0, float("nan")):
        with pytest.raises(InputError, match="share"):
            simulate(box, share=share)
    with pytest.raises(InputError, match=r"mass: got 100.*the hand cannot hold it"):
        simulate(box, mass=100.0)
    with pytest.raises(InputError, match="mass"):
        simulate(box, mass=0.0)
    body = box.drawn().body
    flat = Triangles(body.vertices * [1, 1, 0], body.faces)
    for shape in (flat, Triangles(np.eye(3), np.array([[0, 1, 2]]))):
        with pytest.raises(InputError, match="enclose no volume"):
            simulate(replace(box, drawing=Drawing(shape)))
    with pytest.raises(InputError, match=r"bounds within a factor of 1\.5"):
        simulate(replace(box, mu=Bounds(box.mu.lower, 2.0 * box.mu.upper)))
    with pytest.raises(InputError, match="wrenches"):
        simulate(box, wrenches=0)
    with pytest.raises(InputError, match="a grasp without a drawing"):
        simulate(replace(box, drawing=None, source=None, problem={**box.problem, "hand": {"type": "unknown"}}))
    with pytest.raises(InputError, match="a solution with a grasp"):
        simulate(ng.GraspSolution(ng.Status.NO_GRASP, "none", {"task": {}, "force_budget": "l2"}))
    monkeypatch.setitem(sys.modules, "mujoco", None)
    with pytest.raises(MissingExtraError, match=r'pip install "nlpgrasp\[sim\]"'):
        simulate(box)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["hexagon", "cube", "screwdriver", "filling_cup", "hammer", "power_grasp"])
def test_the_problems_of_this_repository_are_confirmed(problems_folder, name):
    """Every task wrench up to 0.8 of certified mu within 2 mm and 3 degrees; all that is certified is held.

    A hand that keeps much of its effort back loses the hardest wrench before: at 0.981 for the hexagon.
    """
    starts = VALUES[name][0]
    problem = load_problem(problems_folder / f"{name}.py")
    simulation = simulate(ng.solve(problem, starts, options=ng.SolveOptions()), wrenches=2)
    assert simulation.confirmed, str(simulation)
    assert 1.0 <= simulation.lost_at < 1.3
