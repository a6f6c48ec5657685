"""Tests of ``ng.formulate`` against certified quality, finite differences and other solvers."""

import re

import casadi as ca
import numpy as np
import pytest
import trimesh
from scipy.optimize import linprog

import nlpgrasp as ng
from nlpgrasp.errors import InputError
from nlpgrasp.quality import WrenchSet
from tests.cli.test_cli import SMALL, refused, run_here
from tests.hands.urdf import four_finger_hand

BOX = ng.Box([0.08, 0.04, 0.04])
TASK = ng.TaskEllipsoid([5, 5, 10, 0.2, 0.2, 0.2])
HELD = ng.TaskEllipsoid([1.0, 1.0, 1.0, 0.03, 0.03, 0.03])
START = {
    "position 0": [-0.04, 0.012, 0.005],
    "position 1": [-0.04, -0.012, 0.0],
    "position 2": [0.04, 0.012, 0.005],
    "position 3": [0.04, -0.012, 0.0],
}


def box_problem(friction=0.6, **changes):
    parts = {
        "hand": ng.Fingertips(4, radius=0.008),
        "constraints": [ng.Table(-0.02, clearance=0.01)],
    }
    return ng.GraspProblem(BOX, [ng.FrictionContact(friction)] * 4, TASK, **parts | changes)


@pytest.fixture(scope="module")
def compact():
    """Return the program without forces, and its solution from contacts on the right faces."""
    program = ng.formulate(box_problem(), forces=False)
    return program, program.solve(START, tol=1e-10)


def test_table_names_blocks_sizes_and_equations():
    text = str(ng.formulate(box_problem()))
    for line in (
        r"position 0 ... 3 +4 x 3 .* m +p_i of \(3.5-1\)",
        r"forces 0 ... 71 +72 x 12 +\[-1.1, 1.1\] +N +x_j of \(2.5-2\)",
        r"support +72 +>= 0 +\(3.4-3\)",
        r"friction +288 +>= 0 +\(2.4-1\)",
        r"table +4 +>= -0.01 +\(3.5-15\)",
        r"fingertip distance +6 .*\(3.5-16\)",
        r"on the surface +4 += 0 +\(3.5-1\)",
    ):
        assert re.search(line, text), line


def test_beta_is_the_least_support_ratio_of_the_quality_layer(compact):
    """The least ``phi(y_j)`` of independent code at the solution's contacts is beta."""
    program, result = compact
    y = program.p0[: 6 * program.count].reshape(-1, 6)
    np.testing.assert_allclose(TASK.support(y)[0], 1.0)
    ratios = WrenchSet.of(result.grasp).support(y)[0]
    assert ratios.min() == pytest.approx(result.beta, rel=1e-6)
    assert result.beta >= ng.mu(result.grasp, TASK).lower


def test_forces_as_variables_give_the_same_beta(compact):
    result = ng.formulate(box_problem()).solve(START)
    assert compact[0].solve(result).beta == pytest.approx(result.beta, rel=1e-5)
    x = result.values["forces 7"].reshape(4, 3)
    normal = np.sum(x * result.grasp.normals, axis=1)
    assert np.all(np.linalg.norm(x, axis=1) <= np.sqrt(1 + 0.36) * normal + 1e-3)
    assert np.linalg.norm(x) <= 1.0 + 1e-6


def test_vertex_transcription_is_an_inner_one():
    from nlpgrasp.common.unit_directions import directions_inradius

    result = ng.formulate(box_problem(), "vertex").solve(START)
    bounds = ng.mu(result.grasp, TASK)
    assert directions_inradius(6, 1) * result.beta <= bounds.upper
    assert bounds.lower <= result.beta * (1 + 1e-6)
    assert bounds.lower > 0.0915  # the best of README's box is 0.092


@pytest.mark.parametrize("solver", ["sqpmethod", "sleqp"])
def test_other_solvers_reach_the_same_beta(compact, solver):
    program, result = compact
    options = {"qpsol": "qrqp", "qpsol_options": {"print_iter": False, "print_header": False}}
    other = program.solve(result, solver, **(options if solver == "sqpmethod" else {}))
    assert other.beta == pytest.approx(result.beta, rel=1e-5)


def test_kkt_residuals_by_central_differences(compact):
    """Stationarity of minus beta plus multipliers times the constraints, in SI units, by differences of g alone."""
    program, result = compact
    assert result.kkt.is_small
    g = ca.Function("g", [program.x, program.p], [program.g])
    faces = program.p0.copy()
    faces[7 * program.count :] = 0.0
    for i, face in enumerate(result.faces):
        faces[7 * program.count + 6 * i + BOX.face_names.index(face)] = 1.0
    x = np.concatenate([result.values[name] for name in program.names if name in result.values])
    lam = np.concatenate(list(result.multipliers.values()))
    bounds = np.concatenate(list(result.bound_multipliers.values()))
    steps = 1e-6 * np.eye(len(x))
    J = np.stack([(g(x + h, faces).full() - g(x - h, faces).full()).ravel() / 2e-6 for h in steps], axis=1)
    slope = np.zeros(len(x))
    slope[24] = 1.0  # of beta
    residual = slope - lam @ J - bounds
    scale = np.array([0.05] * 12 + [1.0] * 12 + [result.beta])
    assert np.max(np.abs(residual * scale)) / result.beta < 1e-6


@pytest.mark.slow
def test_multiplier_is_the_difference_of_solved_problems(compact):
    program, result = ng.formulate(box_problem(), forces=False), compact[1]
    width = program["position 0"][1] - program["position 1"][1]
    program.add("width", width, 0.02, 0.02)
    solution = program.solve(result, tol=1e-10)
    assert solution.values["position 0"][1] - solution.values["position 1"][1] == pytest.approx(0.02, abs=1e-9)
    betas = []
    for w in (0.0199, 0.0201):
        other = ng.formulate(box_problem(), forces=False)
        other.add("width", other["position 0"][1] - other["position 1"][1], w, w)
        betas.append(other.solve(solution, tol=1e-10).beta)
    assert solution.multipliers["width"][0] == pytest.approx((betas[1] - betas[0]) / 2e-4, rel=0.05)


def test_constraints_of_one_name_keep_all_their_multipliers():
    program = ng.formulate(box_problem(constraints=[ng.Table(-0.02, clearance=0.01), ng.Table(-0.03)]), forces=False)
    result = program.solve(START)
    assert result.multipliers["table, finger 0"].shape == (2,)
    assert sum(map(len, result.multipliers.values())) == len(program.lbg)


POLYGON = ng.Polygon([[-0.05, -0.03], [0.05, -0.04], [0.04, 0.03], [-0.03, 0.045]])
WRENCHES = [[0.0, 1.0, 0.0], [0.5, -0.3, 0.01], [-0.5, -0.3, -0.01], [0.0, 0.3, 0.02]]
SEMI_INFINITE = {
    "polygon": ng.GraspProblem(
        POLYGON, [ng.FrictionContact(0.5)] * 2, ng.TaskEllipsoid([1, 1.5, 0.03], center=[0, 0.5, 0])
    ),
    "box": box_problem(),
    "polytope, shared budget": ng.GraspProblem(
        POLYGON, [ng.FrictionContact(0.5)] * 3, ng.TaskPolytope(WRENCHES), force_budget="shared"
    ),
}


@pytest.mark.parametrize("name", SEMI_INFINITE)
def test_directions_join_until_beta_is_certified(name):
    """From random starts, of which some do not hold the task and say so: beta is then 0. Recomputed by ``mu``."""
    problem = SEMI_INFINITE[name]
    program = ng.formulate(problem, forces=name != "box")
    results = [program.solve(seed, refine=True) for seed in range(3)]
    for result in results:
        assert 0.99 * result.beta - 1e-6 <= result.mu.lower <= result.mu.upper
        recomputed = ng.mu(result.grasp, problem.task, 1e-3, force_budget=problem.budget)
        assert recomputed.upper >= 0.99 * result.beta - 1e-6
    best = max(results, key=lambda result: result.mu.lower)
    assert best.beta > 0.0
    assert best.rounds > 1
    again = program.solve(best, refine=True)  # from the answer it does not fall
    assert again.mu.upper >= best.mu.lower
    assert f"certified {best.mu}" in repr(best)


def test_sampled_once_beta_is_only_a_bound():
    problem = SEMI_INFINITE["polygon"]
    once = ng.formulate(problem).solve(1)
    assert ng.mu(once.grasp, problem.task).upper < 0.95 * once.beta


def test_with_another_objective_directions_join_until_the_grasp_contains_beta():
    """The contact nearest to the middle of the bottom that leaves three tenths of the task."""
    problem = SEMI_INFINITE["polygon"]
    held = ng.solve(problem, starts=1, options=ng.SolveOptions(workers=1, global_bound=False))
    program = ng.formulate(problem)
    program.add("share of the task", program["beta"], 0.3, 0.3)
    program.maximise(-ca.sumsqr(program["position 0"] - np.array([0.0, -0.035])))
    result = program.solve(held, refine=True)
    assert result.mu.lower >= 0.99 * 0.3
    assert result.beta == pytest.approx(0.3)


def test_directions_of_a_polytope_surround_the_origin():
    program = ng.formulate(SEMI_INFINITE["polytope, shared budget"])
    assert program.count >= 6
    with pytest.warns(UserWarning, match="1 directions leave some wrenches without any"):
        completed = ng.formulate(box_problem(), directions=[[1.0, 0, 0, 0, 0, 0]])
    y = completed.p0[: 6 * completed.count].reshape(-1, 6)
    weights = linprog(np.ones(len(y)), A_eq=y.T, b_eq=-np.ones(6) @ np.diag([1, 1, 1, 0.1, 0.1, 0.1])).success
    assert weights
    assert completed.count > 12


def test_rows_that_users_add_are_scaled():
    """In nanometres a row has the same optimum and a multiplier of another unit."""
    problem, results = SEMI_INFINITE["polygon"], []
    for unit in (1.0, 1e9):
        program = ng.formulate(problem, forces=False)
        program.add("width", unit * program["position 0"][0], -np.inf, unit * 0.01)
        results.append(program.solve(2))
    assert results[0].success
    assert results[1].success
    assert results[1].beta == pytest.approx(results[0].beta, rel=1e-5)


def test_a_solver_that_breaks_down_gives_a_result(capfd):
    """On a program with forces, whose quadratic programs are not convex."""
    program = ng.formulate(SEMI_INFINITE["polygon"])
    options = {"print_iter": False, "print_header": False}
    result = program.solve(0, solver="sqpmethod", qpsol="qrqp", qpsol_options=options)
    assert not result.success
    assert result.status
    assert "Input" not in "".join(capfd.readouterr())


def test_another_objective():
    """Least sum of normal forces for a lift of 0.9 N by friction 0.6 on two sides: 0.9 / 0.6."""
    lift = ng.TaskPolytope([[0.0, 0.0, 3.0, 0.0, 0.0, 0.0]])
    problem = ng.GraspProblem(BOX, [ng.FrictionContact(0.6)] * 4, lift, force_budget="per_finger")
    program = ng.formulate(problem, "vertex")
    program.add("share", program["beta"], 0.3, 0.3)
    program.maximise(-sum(program[f"normal {i}"].T @ program["forces 0"][3 * i : 3 * i + 3] for i in range(4)))
    result = program.solve(START)
    assert -result.objective == pytest.approx(0.9 / 0.6, rel=1e-4)


def test_a_mesh_and_its_spline():
    mesh = ng.Mesh(trimesh.creation.icosphere(subdivisions=3, radius=0.05), resolution=16)
    program = ng.formulate(ng.GraspProblem(mesh, [ng.FrictionContact(0.6)] * 3, HELD), forces=False)
    assert isinstance(program.x, ca.MX)
    program.add("apart", program["position 0"].T @ program["position 1"], upper=0.0)
    result = program.solve(0)
    assert result.kkt.is_small
    assert float(result.values["position 0"] @ result.values["position 1"]) <= 1e-9
    assert result.beta >= ng.mu(result.grasp, HELD).lower > 0.5


def test_a_hand_has_joints_and_palm():
    body, hand = ng.Ellipsoid([0.06, 0.03, 0.03]), four_finger_hand()
    program = ng.formulate(ng.GraspProblem(body, ng.FrictionContact(0.6), HELD, hand=hand), forces=False)
    assert program["joints"].shape == (16, 1)
    program.add("palm above", program["palm position"][2], 0.0)
    program.add("first joint", program["joints"][0], 0.1, 0.1)
    result = program.solve(0)
    assert result.kkt.is_small
    assert result.values["joints"][0] == pytest.approx(0.1, abs=1e-7)
    assert result.values["palm position"][2] >= -1e-7


@pytest.mark.slow
def test_constraints_of_the_problem_name_joints_and_palm():
    constraints = [
        ng.Constraint("palm above", lambda p, n, hand: hand["palm position"][2], 0.05),
        ng.Constraint("first joint", lambda p, n, hand: hand["joints"][0], 0.1, 0.4),
    ]
    body, hand = ng.Ellipsoid([0.06, 0.03, 0.03]), four_finger_hand()
    problem = ng.GraspProblem(body, ng.FrictionContact(0.6), HELD, hand=hand, constraints=constraints)
    program = ng.formulate(problem, forces=False)
    assert re.search(r"palm above +1 +>= 0.05 +\(3.5-15\)", str(program))
    result = program.solve(0)
    assert result.kkt.is_small
    assert result.values["palm position"][2] >= 0.05 - 1e-7
    assert 0.1 - 1e-7 <= result.values["joints"][0] <= 0.4 + 1e-7


@pytest.mark.parametrize(
    ("hand", "name", "words"),
    [(True, "joint", "did you mean joints"), (False, "joints", "a hand with joints or a palm")],
)
def test_constraints_on_variables_that_there_are_not(hand, name, words):
    contacts = ng.FrictionContact(0.6) if hand else [ng.FrictionContact(0.6)] * 3
    hand_options = {"hand": four_finger_hand()} if hand else {}
    constraint = ng.Constraint("own", lambda p, n, hand: hand[name][0], 0.0)
    with pytest.raises(InputError, match=words):
        ng.GraspProblem(ng.Sphere(0.04), contacts, HELD, constraints=[constraint], **hand_options)


def test_joint_torques_are_those_of_the_posed_budget(rng):
    """Joint torques at random postures and forces equal those by Jacobians of the hand."""
    hand, body = four_finger_hand(), ng.Ellipsoid([0.06, 0.03, 0.03])
    problem = ng.GraspProblem(body, ng.FrictionContact(0.6), HELD, hand=hand, force_budget="hand_torques")
    program = ng.formulate(problem)
    values, tips = hand.draw(1, np.zeros((1, 3)), rng)
    posture, forces = {name: v[0] for name, v in values.items()}, rng.standard_normal((4, 3))
    jacobians = hand.contact_jacobians(posture, tips[0])
    limits = np.array([hand.torque_limits[name] for name in hand.loaded_joints])
    expected = np.einsum("iaj,ia->j", jacobians[:, :3], forces) / limits
    named = {name.replace("_", " "): v for name, v in posture.items()} | {"forces 0": forces.ravel()}
    named |= {f"position {i}": p for i, p in enumerate(tips[0])}
    variables = [name for name in program.names if name not in ("directions", "reach")]
    x = np.concatenate([np.ravel(named.get(name, np.zeros(program[name].shape[0]))) for name in variables])
    rows = np.ravel(ca.Function("g", [program.x, program.p], [program.g])(x, program.p0).full())
    torques = [
        value for value, name in zip(rows, program.sparsity()[1], strict=True) if name.startswith("torque limit")
    ]
    np.testing.assert_allclose(torques[:16], expected, atol=1e-9)  # of the first direction


def refusals():
    """Return invalid calls by a part of their error message."""
    program = ng.formulate(box_problem(), forces=False)
    beta, p = program["beta"], program["position 0"]
    three = ng.Grasp([[1, 0, 0], [-1, 0, 0], [0, 1, 0]], [[-1, 0, 0], [1, 0, 0], [0, -1, 0]], ng.FrictionContact(0.6))
    return {
        "foreign symbols stranger": lambda: program.add("own", beta + ca.SX.sym("stranger")),
        "casadi.SX symbols": lambda: program.add("own", ca.MX.sym("m")),
        "a number, or 1 of them": lambda: program.add("own", beta, [0.0, 1.0]),
        "lower 2 above upper 1": lambda: program.add("own", beta, 2, 1),
        "a name that no constraint has yet": lambda: program.add("table, finger 0", beta, 0),
        "a scalar": lambda: program.maximise(p),
        "a nonlinear solver that CasADi has": lambda: program.solve(START, "simplex"),
        "No such IPOPT option: tolerance": lambda: program.solve(START, tolerance=1.0),
        "got 3 contacts, expected 4": lambda: program.solve(three),
        "without 'position 3'": lambda: program.solve({k: START[k] for k in list(START)[:3]}),
        "variables: ": lambda: program.solve({**START, "elbow": [0.0]}),
        "'support' or 'vertex'": lambda: ng.formulate(box_problem(), "corner"),
        "did you mean beta": lambda: program["betta"],
        "shape (any, 6)": lambda: ng.formulate(box_problem(), directions=[[1.0, 0.0, 0.0]]),
        "none of them zero": lambda: ng.formulate(box_problem(), directions=np.zeros((1, 6))),
        "no closed form": lambda: ng.formulate(box_problem(), "vertex", forces=False),
        'False with the inner transcription "vertex"': lambda: ng.formulate(box_problem(), "vertex").solve(refine=True),
        "greater than 0": lambda: program.solve(START, refine=True, rtol=0.0),
        "a GraspProblem": lambda: ng.formulate("box"),
    }


@pytest.mark.parametrize("message", list(refusals()))
def test_bad_input_is_one_sentence(message):
    with pytest.raises(InputError) as caught:
        refusals()[message]()
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_options_of_ipopt_reach_the_solver():
    options = ng.SolveOptions(ipopt={"mu_strategy": "adaptive", "max_iter": 7})
    assert options.to_dict()["ipopt"] == {"mu_strategy": "adaptive", "max_iter": 7}
    assert "ipopt" not in ng.SolveOptions().to_dict()
    from nlpgrasp.optimize.compiled_problem import CompiledProblem

    compiled = CompiledProblem(box_problem(), options)
    assert compiled.initial_nlp._options["ipopt.max_iter"] == 7
    assert compiled.cutting_planes.functions._options["ipopt.mu_strategy"] == "adaptive"


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"tolerance": 1}, "No such IPOPT option: tolerance"),
        ({"linear_solver": "abacus"}, "got {'linear_solver': 'abacus'}"),
        ({"tol": [1]}, "a number or a word"),
        (["tol"], "options of IPOPT by name"),
    ],
)
def test_options_that_ipopt_refuses(options, words):
    with pytest.raises(InputError, match=r"^SolveOptions\.ipopt") as caught:
        ng.SolveOptions(ipopt=options)
    assert words in str(caught.value)


def test_command_prints_the_table_and_draws_the_jacobian(tmp_path):
    (tmp_path / "square.py").write_text(SMALL)
    completed = run_here("program", "square.py", "--no-forces", "--spy", "jacobian.png", cwd=tmp_path)
    assert completed.returncode == 0
    assert "beta of (3.5-4)" in completed.stdout
    assert (tmp_path / "jacobian.png").stat().st_size > 5000
    refusal = run_here("program", "square.py", "--transcription", "corner", cwd=tmp_path)
    assert "'support' or 'vertex'" in refused(refusal)


@pytest.mark.slow
@pytest.mark.parametrize("budget", ["l2", "shared"])
def test_random_starts_are_ranked_without_a_closed_form_too(budget):
    problem = ng.GraspProblem(BOX, [ng.SoftContact(0.5, 0.01, model="elliptic")] * 2, HELD, force_budget=budget)
    result = ng.formulate(problem, "vertex").solve(1)
    assert ng.mu(result.grasp, HELD, force_budget=budget).lower > 0.2


def test_limits_are_those_of_their_constraints_beside_an_obstacle():
    shelf = ng.Obstacle(ng.Box([0.2, 0.2, 0.01]), position=[0, 0, 0.06], name="shelf")
    hand = ng.Fingertips(4, radius=0.005)
    program = ng.formulate(
        ng.GraspProblem(box_problem().body, ng.FrictionContact(0.6), TASK, hand=hand, constraints=[shelf]), forces=False
    )
    result = program.solve(1)
    assert result.success
    assert result.kkt.is_small
    points = np.stack([result.values[f"position {i}"] for i in range(4)])
    assert max(abs(program.problem.body.signed_distance(points))) < 1e-8
    tips = points - 0.005 * np.stack([result.values[f"normal {i}"] for i in range(4)])
    assert min(shelf.body.signed_distance(tips - [0, 0, 0.06])) >= 0.005 - 1e-8
