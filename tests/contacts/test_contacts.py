"""Conformance tests of every contact model."""

import casadi as ca
import clarabel
import numpy as np
import pytest
from scipy import sparse

import nlpgrasp as ng
from nlpgrasp.contacts import Work, contact_from_dict
from nlpgrasp.quality import WrenchSet
from tests.memberships import inside, ranges
from tests.samples import CONTACTS

models = pytest.mark.parametrize("contact", CONTACTS.values(), ids=CONTACTS.keys())


def samples(contact, rng, count=4000):
    z = rng.standard_normal((count, contact.components(3))) * 10.0 ** rng.uniform(-3, 3, (count, 1))
    z[:200, 1:] *= 1e-9  # near the axis
    z[200:400, 0] *= 1e-9  # near the tangent plane
    return z


@models
def test_projection_lands_in_the_cone(contact, rng):
    z = samples(contact, rng)
    x = contact.project(z)
    assert inside(contact, x, 1e-12 * np.linalg.norm(z, axis=1)).all()


@models
def test_projection_is_idempotent(contact, rng):
    x = contact.project(samples(contact, rng))
    size = np.linalg.norm(x, axis=1, keepdims=True)
    assert np.max(np.abs(contact.project(x) - x) / np.where(size > 0, size, 1.0)) < 1e-12


@models
def test_projection_is_orthogonal_and_the_rest_is_polar(contact, rng):
    """Moreau: z = P(z) + q with <P(z), q> = 0 and <q, x> <= 0 for every x of the cone."""
    z = samples(contact, rng, 600)
    z /= np.linalg.norm(z, axis=1, keepdims=True)
    x = contact.project(z)
    assert np.max(np.abs(np.sum(x * (z - x), axis=1))) < 1e-9
    cone_points = contact.project(samples(contact, rng, 500))
    cone_points = cone_points[np.linalg.norm(cone_points, axis=1) > 0]
    cone_points /= np.linalg.norm(cone_points, axis=1, keepdims=True)
    assert np.max((z - x) @ cone_points.T) < 1e-7


@models
def test_projection_agrees_with_a_conic_solver(contact, rng):
    """No point the solver finds is nearer than the projection, and the projection is no farther than its point."""
    for z in rng.standard_normal((15, contact.components(3))):
        distance = np.linalg.norm(contact.project(z[None])[0] - z)
        assert distance == pytest.approx(np.linalg.norm(conic_projection(contact, z) - z), abs=1e-8)


def conic_projection(contact, z):
    """Minimise ||x - z||^2 over the cone with clarabel."""
    n = len(z)
    rows, cones = [], []

    def second_order(matrix):
        rows.append(-np.array(matrix))
        cones.append(clarabel.SecondOrderConeT(len(matrix)))

    def unit(i, value=1.0):
        row = np.zeros(n)
        row[i] = value
        return row

    if contact.kind == "bilateral":
        return z
    rows.append(-np.eye(n)[:1])
    cones.append(clarabel.NonnegativeConeT(1))
    if getattr(contact, "model", None) == "elliptic":
        mu, mu_t = contact.friction, contact.torsional_friction
        second_order([unit(0), unit(1, 1 / mu), unit(2, 1 / mu), unit(3, 1 / mu_t)])
    else:
        for block, most in ranges(contact, n):
            second_order([unit(0, most), *[unit(i) for i in block]])
    A = np.concatenate(rows)
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = 1e-12
    solver = clarabel.DefaultSolver(
        sparse.eye(n, format="csc"), -z, sparse.csc_matrix(A), np.zeros(len(A)), cones, settings
    )
    return np.array(solver.solve().x)


@models
def test_derivative_is_that_of_the_projection(contact, rng):
    """Against central differences, away from the kinks; symmetric and a contraction everywhere."""
    n = contact.components(3)
    z = rng.standard_normal((400, n))
    matrix = contact.derivative(z)
    np.testing.assert_allclose(matrix, matrix.transpose(0, 2, 1), atol=1e-9)
    assert np.max(np.linalg.norm(matrix, 2, axis=(1, 2))) <= 1.0 + 1e-6
    h = 1e-6
    columns = [(contact.project(z + h * e) - contact.project(z - h * e)) / (2 * h) for e in np.eye(n)]
    error = np.max(np.abs(np.stack(columns, axis=2) - matrix), axis=(1, 2))
    assert np.mean(error < 1e-6) > 0.98


@models
def test_extreme_force_attains_the_largest_work_of_unit_normal_force(contact, rng):
    if contact.kind == "bilateral":
        with pytest.raises(ng.InputError, match="bilateral"):
            contact.extreme(np.zeros((1, 3)))
        return
    z = rng.standard_normal((300, contact.components(3)))
    value, force = contact.extreme(z)
    assert inside(contact, force, 1e-12).all()
    assert np.max(force[:, 0]) <= 1.0
    np.testing.assert_allclose(np.sum(z * force, axis=1), value, atol=1e-12)
    cone_points = contact.project(rng.standard_normal((3000, contact.components(3))))
    cone_points = cone_points[cone_points[:, 0] > 1e-6]
    cone_points /= cone_points[:, :1]
    assert np.max(cone_points @ z.T - value) <= 1e-9


@models
def test_cones_describe_the_force_domain(contact, rng):
    z = rng.standard_normal((300, contact.components(3)))
    z[:, 0] = np.abs(z[:, 0]) * 3.0
    is_inside = np.ones(len(z), dtype=bool)
    for M in contact.cones(3):
        y = z @ M.T
        is_inside &= np.linalg.norm(y[:, 1:], axis=1) <= y[:, 0] if y.shape[1] > 1 else y[:, 0] >= 0.0
    np.testing.assert_array_equal(is_inside, inside(contact, z))
    assert np.sum(is_inside) > 0


@models
def test_closed_form_support_is_the_norm_of_the_projection(contact, rng):
    z = samples(contact, rng, 500)
    sliding = np.linalg.norm(z[:, 1:3], axis=1)
    torsion = np.abs(z[:, 3]) if z.shape[1] == 4 else np.zeros(len(z))
    squared = contact.squared_support(Work(z[:, 0], sliding, torsion), np)
    if squared is None:
        assert contact.kind in ("line", "plane") or contact.model == "elliptic"
    else:
        np.testing.assert_allclose(squared, np.sum(contact.project(z) ** 2, axis=1), rtol=1e-10, atol=1e-15)


def program_variables(contact, z, normal):
    """Return the program's variables of force components z, from the contact frame."""
    first, second = contact.tangents(normal[None])[0]
    if contact.kind == "bilateral":
        contact = contact.model
    rough = contact.kind in ("friction", "soft") or getattr(contact, "friction", None)
    force = z[0] * normal + z[1] * first + z[2] * second if rough else z[:1]
    rest = z[3:] if rough else z[1:]
    if contact.kind == "plane":  # the moment is n x v
        v = rest[-1] * first - rest[-2] * second
        rest = np.concatenate([rest[:-2], v])
    return np.concatenate([force, rest])


def random_normal(rng):
    normal = rng.standard_normal(3)
    return normal / np.linalg.norm(normal)


@models
def test_membership_agrees_with_the_definition(contact, rng):
    """The program's inequalities, written for body-frame forces, hold exactly inside the cone."""
    for z in rng.standard_normal((300, contact.components(3))) * np.array([3.0] + [1.0] * (contact.components(3) - 1)):
        normal = random_normal(rng)
        values = [float(v) for _, v in contact.membership(ca.DM(program_variables(contact, z, normal)), ca.DM(normal))]
        assert (min(values, default=0.0) >= 0.0) == bool(inside(contact, z))


@models
def test_program_and_grasp_agree_on_the_wrench_of_a_force(contact, rng):
    for z in rng.standard_normal((20, contact.components(3))):
        normal = random_normal(rng)
        x = program_variables(contact, z, normal)
        assert len(x) == contact.variables(3)
        force, moment = contact.split(ca.DM(x), ca.DM(normal))
        wrench = ng.Grasp([[0.3, -0.2, 0.5]], normal[None], contact).contact_wrenches(z)[0]
        np.testing.assert_allclose(force.full().ravel(), wrench[:3], atol=1e-9)
        np.testing.assert_allclose(np.zeros(3) if moment is None else moment.full().ravel(), wrench[3:], atol=1e-9)
        assert float(contact.normal_force(ca.DM(x), ca.DM(normal))) == pytest.approx(z[0])


@models
def test_pressing_is_inside_and_splits_into_a_unit_normal_force(contact, rng):
    normal = random_normal(rng)
    x = contact.pressing(normal)
    assert len(x) == contact.variables(3)
    assert min((float(v) for _, v in contact.membership(ca.DM(x), ca.DM(normal))), default=0.0) >= 0.0
    np.testing.assert_allclose(contact.split(ca.DM(x), ca.DM(normal))[0].full().ravel(), normal, atol=1e-12)


@models
def test_json_round_trip(contact):
    assert contact_from_dict(contact.to_dict()) == contact


@pytest.mark.parametrize(
    ("contact", "components"),
    [
        (ng.PointContact(), 1),
        (ng.LineContact(0.1, direction=[1, 0, 0]), 2),
        (ng.FrictionContact(0.5), 3),
        (ng.PlaneContact(radius=0.1), 3),
        (ng.SoftContact(0.5, 0.1), 4),
        (ng.LineContact(0.1, friction=0.5, direction=[1, 0, 0]), 5),
        (ng.PlaneContact(radius=0.1, friction=0.5), 6),
    ],
)
def test_salisburys_seven_types(contact, components):
    grasp = ng.Grasp([[0.0, 0.0, 0.0]], [[0.0, 0.0, 1.0]], contact)
    assert contact.components(3) == components
    assert np.linalg.matrix_rank(grasp.G) == components
    assert len(ng.allowed_twists(grasp)) == 6 - components


def same_wrench_sets(first, second, rng):
    """Under the shared budget (normal force alone counts) the support functions agree exactly."""
    y = rng.standard_normal((300, first.dimension))
    a, b = (WrenchSet.of(g, "shared").support(y)[0] for g in (first, second))
    np.testing.assert_allclose(a, b, atol=1e-12)


def test_a_smooth_line_is_the_point_contacts_at_its_ends(rng):
    line = ng.Grasp([[0.1, 0.2, 0.3]], [[0, 0, 1.0]], ng.LineContact(0.4, direction=[1, 1, 7]))
    direction = np.array([1.0, 1.0, 0.0]) / np.sqrt(2.0)
    ends = np.array([0.1, 0.2, 0.3]) + np.outer([0.2, -0.2], direction)
    same_wrench_sets(line, ng.Grasp(ends, [[0, 0, 1.0]] * 2, ng.PointContact()), rng)


def test_a_smooth_rectangle_is_the_point_contacts_at_its_corners(rng):
    plane = ng.Grasp([[0.1, 0.2, 0.3]], [[0, 0, 1.0]], ng.PlaneContact(extents=[0.4, 0.2], direction=[1, 0, 0]))
    corners = [[0.1 + sx * 0.2, 0.2 + sy * 0.1, 0.3] for sx in (1, -1) for sy in (1, -1)]
    same_wrench_sets(plane, ng.Grasp(corners, [[0, 0, 1.0]] * 4, ng.PointContact()), rng)


def test_a_planar_line_is_the_contacts_at_its_ends(rng):
    line = ng.Grasp([[0.0, 1.0]], [[0.0, -1.0]], ng.LineContact(0.4))
    same_wrench_sets(line, ng.Grasp([[0.2, 1.0], [-0.2, 1.0]], [[0.0, -1.0]] * 2, ng.PointContact()), rng)


def test_a_wide_box_contains_the_friction_contacts_at_its_ends(rng):
    box = ng.LineContact(0.4, 0.5, torsional_friction=0.1, direction=[1, 0, 0], model="box")
    line = ng.Grasp([[0, 0, 0]], [[0, 0, 1.0]], box)
    ends = ng.Grasp([[0.2, 0, 0], [-0.2, 0, 0]], [[0, 0, 1.0]] * 2, ng.FrictionContact(0.5))
    y = rng.standard_normal((300, 6))
    assert np.all(WrenchSet.of(line, "shared").support(y)[0] >= WrenchSet.of(ends, "shared").support(y)[0] - 1e-12)


def test_even_pressure_gives_the_torsion_when_it_is_left_out(rng):
    disc = ng.PlaneContact(radius=0.3, friction=0.5, model="box")
    square = ng.PlaneContact(extents=[0.3, 0.5], friction=0.5, model="box")
    assert disc.torsional_friction == pytest.approx(0.5 * 0.2)
    x = rng.uniform(-0.5, 0.5, (400_000, 2)) * [0.3, 0.5]
    assert square.torsional_friction == pytest.approx(0.5 * np.mean(np.linalg.norm(x, axis=1)), rel=2e-3)
    assert ng.LineContact(0.4, friction=0.5, model="box").torsional_friction == pytest.approx(0.05)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: ng.LineContact(0.0), r"LineContact\.length"),
        (lambda: ng.LineContact(0.1, torsional_friction=0.1), "none without friction"),
        (lambda: ng.LineContact(0.1, direction=[0, 0, 0]), "a direction of some length"),
        (lambda: ng.PlaneContact(), "one of the two"),
        (lambda: ng.PlaneContact(radius=0.1, extents=[1, 1]), "one of the two"),
        (lambda: ng.PlaneContact(extents=[0.1, -0.1]), r"PlaneContact\.extents"),
        (lambda: ng.PlaneContact(radius=0.1).components(2), "planar body"),
        (lambda: ng.BilateralContact(0.5), r"BilateralContact\.model"),
        (lambda: ng.Grasp([[0, 0, 0]], [[0, 0, 1]], ng.LineContact(0.1)), "or tangents"),
        (lambda: ng.Grasp([[0, 0, 0]], [[0, 0, 1]], ng.LineContact(0.1, direction=[0, 0, 2])), "off the normal"),
    ],
)
def test_contacts_that_make_no_sense_are_refused(make, message):
    with pytest.raises(ng.InputError, match=message):
        make()


def test_planar_components():
    assert ng.LineContact(0.1).components(2) == 2
    assert ng.LineContact(0.1, friction=0.5).components(2) == 3
    assert ng.FrictionContact(0.5).components(2) == 2
    assert ng.PointContact().components(2) == 1
    with pytest.raises(ng.InputError, match="no torsion"):
        ng.SoftContact(0.5, 0.1).components(2)


@pytest.mark.parametrize("value", [0.0, -0.5, float("nan"), float("inf"), "rough", None, True])
def test_friction_that_is_not_positive_is_refused(value):
    with pytest.raises(ng.InputError, match=r"FrictionContact\.friction: got .*, expected a number greater than 0"):
        ng.FrictionContact(value)
    with pytest.raises(ng.InputError, match=r"SoftContact\.torsional_friction"):
        ng.SoftContact(0.5, value)


def test_unknown_torsion_model_lists_the_valid_ones():
    with pytest.raises(ng.InputError, match="'box' or 'elliptic'"):
        ng.SoftContact(0.5, 0.1, "square")


def test_unknown_model_in_a_file_is_refused():
    with pytest.raises(ng.InputError, match="one of point, friction, soft"):
        contact_from_dict({"model": "magnet"})


@pytest.mark.parametrize("data", ["friction", None, {"model": "bilateral", "of": "point"}, {"model": ["friction"]}])
def test_what_is_no_contact_model_is_refused_in_a_sentence(data):
    with pytest.raises(ng.InputError, match=r"contact\.model: got .*, expected one of point, friction"):
        contact_from_dict(data)
