"""Line and pad contacts with Coulomb friction, against friction contacts at their ends or corners."""

from dataclasses import replace

import casadi as ca
import clarabel
import numpy as np
import pytest
from scipy import sparse
from scipy.linalg import block_diag

import nlpgrasp as ng
from nlpgrasp.contacts import contact_from_dict
from nlpgrasp.contacts.cone_sums import FrictionConeSum
from nlpgrasp.quality import WrenchSet
from nlpgrasp.verify.quality_checks import model_checks
from tests.memberships import components, inside, most_work, places, slack
from tests.samples import PADS
from tests.verify.stated import stated_file

models = pytest.mark.parametrize("contact", PADS.values(), ids=PADS.keys())
SMALL = {
    "short line": ng.LineContact(0.01, 0.5, direction=[1, 0, 0]),
    "slippery line": ng.LineContact(0.4, 0.01, direction=[1, 0, 0]),
    "sticky rectangle": ng.PlaneContact(extents=[0.04, 0.002], friction=3.0, direction=[1, 0, 0]),
    "fingertip": ng.PlaneContact(extents=[0.008, 0.008], friction=0.8, direction=[1, 0, 0]),
}
EVERY = {**PADS, **SMALL}
every = pytest.mark.parametrize("contact", EVERY.values(), ids=EVERY.keys())


def in_cone(contact, rng, shape):
    """Return random forces (*shape, 3) of one friction cone, some on its boundary, some zero."""
    normal = rng.exponential(size=shape) * rng.integers(0, 2, shape)
    angle = rng.uniform(0.0, 2.0 * np.pi, shape)
    size = contact.friction * normal * np.minimum(1.0, rng.uniform(0.0, 1.5, shape))
    return np.stack([normal, size * np.cos(angle), size * np.sin(angle)], axis=-1)


def forces_of(contact, rng, count):
    """Return force components (count, n) of random friction forces at the points."""
    points = places(contact)
    return components(contact, points, in_cone(contact, rng, (count, len(points))))


def pressures(contact, rng, count, number=7):
    """Return force components of random friction forces anywhere on the line or pad."""
    points = places(contact)
    share = rng.dirichlet(np.ones(len(points)), (count, number))
    return components(contact, share @ points, in_cone(contact, rng, (count, number)))


def samples(contact, rng, count):
    """Return points of unit length: anything, moments and forces of equal weight, beside the cone, a straight pull."""
    z = rng.standard_normal((2 * count, contact.components(3)))
    z[count:, 3:] /= np.max(np.abs(places(contact)))
    x = forces_of(contact, rng, count)
    adjacent = x + 0.1 * np.linalg.norm(x, axis=1, keepdims=True) * z[:count]
    z = np.concatenate([z, adjacent, -np.eye(z.shape[1])[:1]])
    return z / np.maximum(np.linalg.norm(z, axis=1, keepdims=True), 1e-300)


@models
def test_any_pressure_is_that_of_forces_at_the_points(contact, rng):
    """Pressure inside the pad's convex hull, friction along it: nothing of it is outside, and it projects on itself."""
    x = pressures(contact, rng, 60)
    assert max(slack(contact, force) for force in x) <= 1e-9
    np.testing.assert_allclose(contact.project(x), x, atol=1e-8)


def test_a_line_in_closed_form(rng):
    """Of two ends, the normal and transverse forces follow; the rest is shared: a definition without end forces."""
    line = PADS["coulomb line"]
    z = rng.standard_normal((400, 5)) * [3.0, 1.0, 1.0, 0.2, 0.2]
    half, mu = line.length / 2, line.friction
    normal = np.stack([z[:, 0] - z[:, 4] / half, z[:, 0] + z[:, 4] / half]) / 2
    transverse = np.stack([z[:, 2] + z[:, 3] / half, z[:, 2] - z[:, 3] / half]) / 2
    capacity = (mu * normal) ** 2 - transverse**2
    is_inside = np.all((normal >= 0.0) & (capacity >= 0.0), axis=0)
    is_inside &= np.abs(z[:, 1]) <= np.sqrt(np.maximum(capacity, 0.0)).sum(axis=0)
    np.testing.assert_array_equal(inside(line, z), is_inside)
    is_fixed = np.linalg.norm(line.project(z) - z, axis=1) <= 1e-9
    np.testing.assert_array_equal(is_fixed, is_inside)
    assert 20 < is_inside.sum() < 380


@every
@pytest.mark.parametrize("power", [-100, 0, 99])
def test_moreau(contact, power, rng):
    """z = P(z) + q with P(z) in the cone, q in its polar, and both orthogonal: three conditions that only P meets."""
    z = samples(contact, rng, 40)
    x = contact.project(z * 10.0**power) / 10.0**power
    q = z - x
    assert np.max(np.abs(np.sum(x * q, axis=1))) <= 1e-13
    assert np.max(most_work(contact, q)) <= 1e-13
    assert max(slack(contact, force) for force in x[::6]) <= 1e-9
    assert np.min(x[:, 0]) >= -1e-15
    goes = most_work(contact, z) < 0.0
    assert goes.sum() > 1
    np.testing.assert_array_equal(x[goes], 0.0)


@models
def test_projection_agrees_with_a_conic_solver(contact, rng):
    """The nearest sum of friction forces at the points, by clarabel."""
    points = places(contact)
    count = 3 * len(points)
    A = components(contact, points, np.eye(count).reshape(count, len(points), 3)).T
    cones = [clarabel.SecondOrderConeT(3)] * len(points)
    M = -np.kron(np.eye(len(points)), np.diag([contact.friction, 1.0, 1.0]))
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = 1e-12
    for z in samples(contact, rng, 6):
        solver = clarabel.DefaultSolver(
            sparse.csc_matrix(np.triu(A.T @ A)), -A.T @ z, sparse.csc_matrix(M), np.zeros(count), cones, settings
        )
        expected = A @ np.array(solver.solve().x)
        projection = contact.project(z[None])[0]
        np.testing.assert_allclose(projection, expected, atol=1e-5)
        assert np.sum((projection - z) ** 2) == pytest.approx(np.sum((expected - z) ** 2), abs=1e-10)


@every
def test_corner_forces_add_up_to_the_projection(contact, rng):
    z = samples(contact, rng, 1000)
    A, x = contact.generators(3), contact.project(z)
    u = contact.project_lifted(z)
    error = np.linalg.norm(u @ A.T - x, axis=1)
    assert np.quantile(error, 0.98) <= 1e-12
    assert np.max(error) <= 1e-6  # of points that the method of multipliers projects
    for M in contact.cones(3):
        assert np.max(np.linalg.norm(u @ M[1:].T, axis=1) - u @ M[0]) <= 1e-14
    x = contact.extreme(z)[1]  # the force of a single point, on its cone's edge
    np.testing.assert_allclose(contact.project_lifted(x) @ A.T, x, atol=1e-13)


@every
def test_projecting_twice_is_projecting_once(contact, rng):
    """Points on the boundary of the cone, where the projection is hardest."""
    x = contact.project(samples(contact, rng, 40))
    x = x[np.linalg.norm(x, axis=1) > 1e-6]
    x /= np.linalg.norm(x, axis=1, keepdims=True)
    projected = contact.project(x)
    np.testing.assert_allclose(np.linalg.norm(projected, axis=1), 1.0, rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(projected, x, atol=1e-6)


@models
def test_zero_and_nothing(contact):
    n = contact.components(3)
    np.testing.assert_array_equal(contact.project(np.zeros((3, n))), 0.0)
    assert contact.project(np.zeros((0, n))).shape == (0, n)
    assert contact.project(np.ones((2, 3, n))).shape == (2, 3, n)
    assert contact.derivative_entries(np.zeros((0, n))).shape == (n * (n + 1) // 2, 0)
    straight = np.eye(n)[:1]
    np.testing.assert_allclose(contact.project(straight), straight, atol=1e-12)
    np.testing.assert_array_equal(contact.project(-straight), 0.0)


@models
def test_derivative_by_differences(contact, rng):
    """Central differences, where both sides agree: elsewhere is a kink, where any between them will do."""
    z, h = samples(contact, rng, 40), 1e-5
    matrix, projection = contact.derivative(z), contact.project(z)
    steps = np.eye(z.shape[1])
    forward = np.stack([(contact.project(z + h * e) - projection) / h for e in steps], axis=2)
    backward = np.stack([(projection - contact.project(z - h * e)) / h for e in steps], axis=2)
    smooth = np.max(np.abs(forward - backward), axis=(1, 2)) < 1e-3
    assert smooth.sum() > 60
    np.testing.assert_allclose(matrix[smooth], 0.5 * (forward + backward)[smooth], atol=2e-4)
    np.testing.assert_allclose(matrix, matrix.transpose(0, 2, 1), atol=0.0)
    values = np.linalg.eigvalsh(matrix)
    assert np.min(values) >= -1e-6
    assert np.max(values) <= 1.0 + 1e-6


@every
def test_extreme_force_does_the_most_work(contact, rng):
    """More than any pressure of unit normal force, and as much as the force that it names."""
    z = samples(contact, rng, 40)
    value, force = contact.extreme(z)
    np.testing.assert_allclose(value, np.maximum(most_work(contact, z), 0.0), atol=1e-13)
    np.testing.assert_allclose(np.sum(z * force, axis=1), value, atol=1e-13)
    np.testing.assert_allclose(force[value > 0.0, 0], 1.0)
    forces_of_unit = pressures(contact, rng, 2000)
    forces_of_unit = forces_of_unit[forces_of_unit[:, 0] > 1e-6]
    forces_of_unit /= forces_of_unit[:, :1]
    assert np.max(forces_of_unit @ z.T - value) <= 1e-12


@models
def test_generators_and_cones_describe_the_force_domain(contact, rng):
    A, cones = contact.generators(3), contact.cones(3)
    points = places(contact)
    u = in_cone(contact, rng, (50, len(points)))
    np.testing.assert_allclose(u.reshape(50, -1) @ A.T, components(contact, points, u), atol=1e-12)
    u[:25, 0, 1] += 1.01 * contact.friction * u[:25, 0, 0] * 2.0 + 0.1  # out of the first point's cone
    y = np.stack([u.reshape(50, -1) @ M.T for M in cones], axis=1)
    is_inside = np.linalg.norm(y[..., 1:], axis=-1) <= y[..., 0] + 1e-12
    assert is_inside[:, 1:].all()
    assert is_inside[25:, 0].all()
    assert not is_inside[:25, 0].any()


def program_variables(contact, normal, forces):
    """Return the program's variables of forces (N, 3) at the points, from the contact frame."""
    frame = np.concatenate([normal[None], contact.tangents(normal[None])[0]])
    return (forces @ frame).ravel()


def random_normal(rng):
    normal = rng.standard_normal(3)
    return normal / np.linalg.norm(normal)


@every
def test_program_and_grasp_agree(contact, rng):
    """On the wrench of end forces, their length in the budget, the normal force, and what friction allows."""
    points = places(contact)
    for _ in range(8):
        normal = random_normal(rng)
        forces = in_cone(contact, rng, (1, len(points)))
        x = program_variables(contact, normal, forces[0])
        assert len(x) == contact.variables(3)
        z = components(contact, points, forces)[0]
        force, moment = contact.split(ca.DM(x), ca.DM(normal))
        wrench = ng.Grasp([[0.3, -0.2, 0.5]], normal[None], contact).contact_wrenches(z)[0]
        np.testing.assert_allclose(force.full().ravel(), wrench[:3], atol=1e-9)
        np.testing.assert_allclose(moment.full().ravel(), wrench[3:], atol=1e-9)
        assert float(contact.normal_force(ca.DM(x), ca.DM(normal))) == pytest.approx(z[0])
        assert float(contact.squared_size(ca.DM(x), ca.DM(normal))) == pytest.approx(z @ z)
        rows = contact.membership(ca.DM(x), ca.DM(normal))
        assert len(rows) == 2 * len(points)
        assert min(float(v) for _, v in rows) >= -1e-12
        x[-3:] += 10.0 * (1.0 + contact.friction) * np.cross(normal, random_normal(rng))
        assert min(float(v) for _, v in contact.membership(ca.DM(x), ca.DM(normal))) < 0.0


def expanded(grasp):
    """Return the grasp with friction contacts at the points in place of its pads."""
    points, normals = [], []
    for p, frame, contact in zip(grasp.points, grasp.frames, grasp.contacts, strict=True):
        ends = places(contact)
        points.append(p + ends @ frame.T)
        normals.append(np.tile(frame[:, 0], (len(ends), 1)))
    friction = [ng.FrictionContact(c.friction) for c in grasp.contacts for _ in places(c)]
    return ng.Grasp(np.concatenate(points), np.concatenate(normals), friction, grasp.torque_origin)


def held(contact, rng, k=3):
    """Return pads all around a body."""
    angles = 2.0 * np.pi * np.arange(k) / k
    points = np.stack([np.cos(angles), np.sin(angles), 0.0 * angles], axis=1) + 0.1 * rng.standard_normal((k, 3))
    return ng.Grasp(points, -points / np.linalg.norm(points, axis=1, keepdims=True), contact)


@models
def test_normal_force_alone_counts_the_same_at_the_points(contact, rng):
    """Under the shared budget the pad and the friction contacts at its points have the same wrench set."""
    grasp = held(contact, rng)
    y = rng.standard_normal((300, 6))
    pad, points = (WrenchSet.of(g, "shared").support(y)[0] for g in (grasp, expanded(grasp)))
    np.testing.assert_allclose(pad, points, atol=1e-12)
    w = rng.standard_normal((6, 6))
    pad, points = (ng.finger_forces(g, w, force_budget="shared") for g in (grasp, expanded(grasp)))
    assert pad.feasible.all()
    np.testing.assert_allclose(pad.used, points.used, rtol=1e-6)


@models
def test_least_forces(contact, rng):
    """Of least length, in the cones, and as long as a conic program's."""
    grasp = held(contact, rng)
    w = rng.standard_normal((12, 6))
    result = ng.finger_forces(grasp, w)
    assert result.feasible.all()
    np.testing.assert_allclose(result.forces @ grasp.G.T, w, atol=1e-8)
    for i in range(3):
        part = result.forces[:, contact.components(3) * i :][:, : contact.components(3)]
        assert max(slack(contact, item) for item in part) <= 1e-8 * np.max(result.used)
    points = places(contact)
    count = 3 * len(points)
    A = components(contact, points, np.eye(count).reshape(count, len(points), 3)).T
    lift = np.kron(np.eye(3), A)
    M = -np.kron(np.eye(3 * len(points)), np.diag([contact.friction, 1.0, 1.0]))
    system = sparse.csc_matrix(np.concatenate([grasp.G @ lift, M]))
    cones = [clarabel.ZeroConeT(6)] + [clarabel.SecondOrderConeT(3)] * (3 * len(points))
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    quadratic = sparse.csc_matrix(np.triu(lift.T @ lift))
    for item, size in zip(w, result.used, strict=True):
        rhs = np.concatenate([item, np.zeros(len(M))])
        solver = clarabel.DefaultSolver(quadratic, np.zeros(lift.shape[1]), system, rhs, cones, settings)
        assert size == pytest.approx(np.linalg.norm(lift @ np.array(solver.solve().x)), rel=1e-5)


def work_of(grasp, budget, z):
    """Return the most that the pads' forces do along z (n,), by clarabel over forces at the points."""
    parts = []
    for contact in grasp.contacts:
        points = places(contact)
        count = 3 * len(points)
        parts.append(components(contact, points, np.eye(count).reshape(count, len(points), 3)).T)
    lift = block_diag(*parts)
    number = lift.shape[1] // 3
    friction = -np.kron(np.eye(number), np.diag([grasp.contacts[0].friction, 1.0, 1.0]))
    rows, cones = [friction], [clarabel.SecondOrderConeT(3)] * number
    if budget == "l2":
        rows += [np.zeros((1, 3 * number)), -lift]
        cones.append(clarabel.SecondOrderConeT(1 + len(lift)))
    else:
        rows.append(lift[[sum(len(p) for p in parts[:i]) for i in range(len(parts))]])
        cones.append(clarabel.NonnegativeConeT(len(parts)))
    b = np.zeros(sum(len(r) for r in rows))
    b[3 * number : 3 * number + (1 if budget == "l2" else len(parts))] = 1.0
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = 1e-11
    zero = sparse.csc_matrix((3 * number, 3 * number))
    system = sparse.csc_matrix(np.concatenate(rows))
    return -clarabel.DefaultSolver(zero, -z @ lift, system, b, cones, settings).solve().obj_val


@models
@pytest.mark.parametrize("budget", ["l2", "per_finger"])
def test_certificates_against_conic_programs(contact, budget, rng):
    """No direction's true ratio is below the lower bound, and the worst direction's is the upper bound."""
    grasp, task = held(contact, rng), ng.TaskEllipsoid([1.0, 1.0, 1.0, 0.4, 0.4, 0.4])
    bounds = ng.mu(grasp, task, 0.2, force_budget=budget)
    assert 0.0 < bounds.lower <= bounds.upper <= 1.2 * bounds.lower
    wrenches = WrenchSet.of(grasp, budget)
    for y in [*rng.standard_normal((20, 6)), bounds.worst_direction]:
        true = work_of(grasp, budget, grasp.G.T @ y)
        assert wrenches.support(y[None])[0][0] == pytest.approx(true, rel=1e-7, abs=1e-9)
        assert true / task.support(y[None])[0][0] >= bounds.lower * (1.0 - 1e-7)
    assert true / task.support(y[None])[0][0] == pytest.approx(bounds.upper, rel=1e-6)


def test_the_box_is_neither_inside_nor_outside(rng):
    """Box and Coulomb set each contain points that the other lacks."""
    line = PADS["coulomb line"]
    box = ng.LineContact(line.length, line.friction, direction=line.direction, model="box")
    x = rng.uniform(-1.0, 1.0, (400, 5)) * [0.0, 0.0, 0.0, box.torsional_friction, line.length / 2]
    x[:, 0] = 1.0
    angle, size = rng.uniform(0.0, 2.0 * np.pi, 400), line.friction * np.sqrt(rng.uniform(0.0, 1.0, 400))
    x[:, 1], x[:, 2] = size * np.cos(angle), size * np.sin(angle)
    assert inside(box, x, 1e-12).all()
    assert 0.3 < np.mean(inside(line, x)) < 0.7
    line_forces = forces_of(line, rng, 400)
    assert 0.02 < np.mean(~inside(box, line_forces, 1e-9)) < 0.5


def test_files():
    line = {"model": "line", "length": 0.4, "friction": 0.5, "torsional_friction": 0.02, "direction": None}
    old = contact_from_dict(line)
    assert (old.model, old.torsional_friction, old.label) == ("box", 0.02, "line (box)")
    pad = {"model": "plane", "radius": 0.1, "friction": 0.5, "torsional_friction": 0.02}
    assert contact_from_dict(pad) == ng.PlaneContact(0.1, friction=0.5, torsional_friction=0.02, model="box")
    for contact in PADS.values():
        data = contact.to_dict()
        assert data["friction_model"] == "coulomb"
        assert data["torsional_friction"] is None
        assert contact_from_dict(data) == contact
        assert contact.label == contact.kind
    smooth = ng.LineContact(0.4)
    assert smooth.to_dict()["friction_model"] is None
    assert contact_from_dict({"model": "line", "length": 0.4}) == smooth == ng.LineContact(0.4, model="box")
    with pytest.raises(ng.InputError, match="'coulomb' or 'box'"):
        contact_from_dict({**line, "friction_model": "magnet"})


def test_which_model_a_plane_has_when_it_is_left_out():
    """A rectangle obeys Coulomb's law, as a line does; a disc has no corners and is the box."""
    rectangle, disc = ng.PlaneContact(extents=[0.4, 0.2], friction=0.5), ng.PlaneContact(0.4, friction=0.5)
    assert (rectangle.model, rectangle.label, rectangle.torsional_friction) == ("coulomb", "plane", None)
    assert (disc.model, disc.label) == ("box", "plane (box)")
    assert rectangle == ng.PlaneContact(extents=[0.4, 0.2], friction=0.5, model="coulomb")
    old = contact_from_dict({"model": "plane", "extents": [0.4, 0.2], "friction": 0.5, "torsional_friction": 0.05})
    assert old == ng.PlaneContact(extents=[0.4, 0.2], friction=0.5, torsional_friction=0.05, model="box")
    for smooth in (ng.PlaneContact(extents=[0.4, 0.2]), ng.PlaneContact(0.4)):
        assert contact_from_dict(smooth.to_dict()) == smooth == replace(smooth, model="box")
        assert smooth.turned(np.eye(3)) == smooth
        assert replace(smooth, friction=0.5).model == ("coulomb" if smooth.extents else "box")


def test_old_files_are_boxes(rng):
    """Solutions of before there was a choice, which are certified as they were."""
    lines = {m: ng.LineContact(0.02, 0.5, direction=[0, 1, 0], model=m) for m in ("coulomb", "box")}
    task, places_of = ng.TaskEllipsoid([1.0, 1.0, 1.0, 0.01, 0.01, 0.01]), [[0.03, 0.0, 0.0], [-0.03, 0.0, 0.0]]
    for model, line in lines.items():
        problem = ng.GraspProblem(ng.Box([0.06, 0.04, 0.04]), [line] * 2, task)
        data = stated_file(problem, ["+x", "-x"], places_of, [[-1.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
        loaded = ng.GraspSolution.from_dict(data, "file.json")
        assert loaded.grasp.contacts == (line, line)
        assert model_checks(loaded, loaded.grasp, task)[0].passed
        if model == "box":
            for contact in (*data["problem"]["contacts"], *data["grasp"]["contacts"]):
                assert contact.pop("friction_model") == "box"
            old = ng.GraspSolution.from_dict(data, "file.json")
            assert old.grasp.contacts == (line, line)
            assert old.grasp.contacts[0].torsional_friction == pytest.approx(0.0025)
            assert model_checks(old, old.grasp, task)[0].passed
            y = rng.standard_normal((50, 6))
            supports = [WrenchSet.of(s.grasp).support(y)[0] for s in (old, loaded)]
            np.testing.assert_array_equal(*supports)
        else:
            data["grasp"]["contacts"][0]["friction_model"] = "box"
            edited = ng.GraspSolution.from_dict(data, "file.json")
            assert model_checks(edited, edited.grasp, task)[0].failed


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: ng.LineContact(0.4, 0.5, 0.1), "LineContact.torsional_friction: got 0.1, expected none: friction dec"),
        (lambda: ng.PlaneContact(None, [0.4, 0.2], 0.5, 0.1), "model='box' has one"),
        (lambda: ng.PlaneContact(0.4, friction=0.5, model="coulomb"), "'box' for a disc: only rectangles have corners"),
        (lambda: ng.PlaneContact(0.4, friction=0.5, model="Coulomb"), "PlaneContact.model: got Coulomb, expected 'cou"),
        (lambda: ng.LineContact(0.4, model=None), "'coulomb' or 'box'"),
    ],
)
def test_what_makes_no_sense_is_refused(make, message):
    with pytest.raises(ng.InputError) as caught:
        make()
    assert message in str(caught.value)


def test_in_the_plane_both_are_the_same(rng):
    law, box = ng.LineContact(0.4, 0.5), ng.LineContact(0.4, 0.5, model="box")
    z = rng.standard_normal((200, 3))
    np.testing.assert_array_equal(law.project(z), box.project(z))
    np.testing.assert_array_equal(law.extreme(z)[0], box.extreme(z)[0])
    ends = ng.Grasp([[0.2, 0.0], [-0.2, 0.0]], [[0.0, 1.0]] * 2, ng.FrictionContact(0.5))
    line = ng.Grasp([[0.0, 0.0]], [[0.0, 1.0]], law)
    y = rng.standard_normal((200, 3))
    line_support, ends_support = (WrenchSet.of(g, "shared").support(y)[0] for g in (line, ends))
    np.testing.assert_allclose(line_support, ends_support, atol=1e-12)


def test_equal_contacts_share_their_points():
    first, second = (ng.LineContact(0.4, 0.5, direction=[1, 0, 0]) for _ in range(2))
    assert first.points(5) is second.points(5)
    assert first.points(5) == FrictionConeSum(((0.2, 0.0), (-0.2, 0.0)), 0.5, (0, 1, 2, 3, 5))
    assert first.with_friction(0.5).points(5).friction == 0.25
    assert first.points(3) is None
    assert ng.LineContact(0.4).points(2) is None
