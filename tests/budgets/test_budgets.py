"""Conformance tests of every force budget: supports against a conic solver, the program's constraints, files."""

from itertools import product

import casadi as ca
import clarabel
import numpy as np
import pytest
from scipy import sparse
from scipy.linalg import block_diag

import nlpgrasp as ng
from nlpgrasp.budgets import budget_from_dict, force_budget
from nlpgrasp.contacts.product import component_slices
from nlpgrasp.quality import WrenchSet
from tests.contacts.test_contacts import program_variables
from tests.samples import EVERY as CONTACTS
from tests.samples import closed_ellipsoid_grasp

NAMED = ["l2", "per_finger", "shared", "per_finger_size"]
MODELS = ["point", "friction", "soft box", "soft elliptic", "rough line", "rough rectangle", "rough disc"]
PADS = ["coulomb line", "coulomb rectangle"]


def torque_limits(contacts, rng, joints=3):
    """Return limits on fingers that feel every force of their contacts."""
    jacobians = [rng.standard_normal((6, joints + (c.components(3) > 3) * 3)) for c in contacts]
    return ng.JointTorqueLimits(jacobians, [rng.uniform(0.5, 2.0, J.shape[1]) for J in jacobians])


def shared_torque_limits(contacts, rng, joints=4):
    """Return limits on joints that all contacts load, and on every normal force."""
    jacobians = [rng.standard_normal((6, joints)) for _ in contacts]
    return ng.SharedJointTorqueLimits(jacobians, rng.uniform(0.5, 2.0, joints), 1.5)


TORQUES = {"joint_torques": torque_limits, "shared_joint_torques": shared_torque_limits}


def cases(models=MODELS, nth=1):
    """Yield every model with every budget; all but every n-th case with the slow tests."""
    for i, (name, budget) in enumerate(product(models, [*NAMED, *TORQUES])):
        yield pytest.param(name, budget, id=f"{name}, {budget}", marks=pytest.mark.slow if i % nth else ())


def make_case(name, budget, rng, k=2):
    contacts = [CONTACTS[name]] * k
    force_bound = TORQUES[budget](contacts, rng) if budget in TORQUES else force_budget(budget)
    normals = rng.standard_normal((k, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    grasp = ng.Grasp(rng.standard_normal((k, 3)), normals, contacts)
    return grasp, force_bound, force_bound.at(grasp.frames, grasp.contacts)


def largest_work(grasp, bound, z):
    """Maximise <z, x> over the cones and the budget (f = 1) with clarabel."""
    lift = block_diag(*(c.generators(3) for c in grasp.contacts))
    parts = np.cumsum([0] + [c.generators(3).shape[1] for c in grasp.contacts])
    n = lift.shape[1]
    rows, rhs, cones = [], [], []

    def add(matrix, offset):
        rows.append(-matrix)
        rhs.append(offset)
        cones.append(clarabel.NonnegativeConeT(1) if len(matrix) == 1 else clarabel.SecondOrderConeT(len(matrix)))

    for start, stop, contact in zip(parts[:-1], parts[1:], grasp.contacts, strict=True):
        for M in contact.cones(3):
            full = np.zeros((len(M), n))
            full[:, start:stop] = M
            add(full, np.zeros(len(M)))
    for M in bound.cones():
        add(M[:, :-1] @ lift, M[:, -1])
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = 1e-11
    A = sparse.csc_matrix(np.concatenate(rows))
    solution = clarabel.DefaultSolver(
        sparse.csc_matrix((n, n)), -z @ lift, A, np.concatenate(rhs), cones, settings
    ).solve()
    assert "Solved" in str(solution.status)
    return -solution.obj_val


@pytest.mark.parametrize(("name", "budget"), list(cases(MODELS + PADS, nth=5)))
def test_support_is_exact_and_attained(name, budget, rng):
    grasp, _, bound = make_case(name, budget, rng)
    z = rng.standard_normal((25, grasp.G.shape[1]))
    phi, x = bound.support(z)
    np.testing.assert_allclose(np.sum(z * x, axis=1), phi, atol=1e-9)
    assert np.max(bound.gauge(x)) <= 1.0 + 1e-9
    for contact, r in zip(grasp.contacts, component_slices(grasp.contacts, 3), strict=True):
        np.testing.assert_allclose(contact.project(x[:, r]), x[:, r], atol=1e-7)
    expected = [largest_work(grasp, bound, row) for row in z]
    np.testing.assert_allclose(phi, expected, rtol=1e-7, atol=1e-7)


@pytest.mark.parametrize(("name", "budget"), list(cases(MODELS + PADS)))
def test_used_is_what_the_cones_say(name, budget, rng):
    grasp, _, bound = make_case(name, budget, rng)
    n = grasp.G.shape[1]
    x = np.concatenate([c.project(rng.standard_normal((50, c.components(3)))) for c in grasp.contacts], axis=1)
    effort = bound.gauge(x)
    for factor in (0.999, 1.001):
        y = np.concatenate([x, factor * effort[:, None]], axis=1)
        is_inside = np.ones(len(x), dtype=bool)
        for M in bound.cones():
            value = y @ M.T
            is_inside &= value[:, 0] >= (np.linalg.norm(value[:, 1:], axis=1) if len(M) > 1 else 0.0)
        assert is_inside[effort > 0].all() == (factor > 1.0)
        assert is_inside[effort > 0].any() == (factor > 1.0)
    assert M.shape[1] == n + 1


@pytest.mark.parametrize(("name", "budget"), list(cases()))
def test_the_programs_rows_say_the_same(name, budget, rng):
    """A force that uses 0.999 of the budget keeps every row, one that uses 1.001 breaks one."""
    grasp, force_bound, bound = make_case(name, budget, rng)
    for _ in range(10):
        x = np.concatenate([c.project(rng.standard_normal((1, c.components(3))))[0] for c in grasp.contacts])
        effort = bound.gauge(x[None])[0]
        if effort <= 0.0:
            continue
        for factor in (0.999, 1.001):
            forces = [
                ca.DM(program_variables(c, factor * x[r] / effort, n))
                for c, r, n in zip(grasp.contacts, component_slices(grasp.contacts, 3), grasp.normals, strict=True)
            ]
            rows = force_bound.rows(grasp.contacts, forces, [ca.DM(n) for n in grasp.normals])
            is_satisfied = all(row.lower <= float(row.expression) <= row.upper for row in rows)
            assert is_satisfied == (factor < 1.0)


@pytest.mark.parametrize("budget", [*NAMED, *TORQUES])
def test_json_round_trip(budget, rng):
    _, force_bound, _ = make_case("friction", budget, rng)
    restored = budget_from_dict(force_bound.to_dict())
    assert restored.to_dict() == force_bound.to_dict()
    assert restored == force_bound


def test_planar_torque_limits(rng):
    """A planar finger of two joints: the support is that of the polygon cut from the friction cone."""
    grasp = ng.Grasp([[0.0, 1.0]], [[0.0, -1.0]], ng.FrictionContact(0.5))
    budget = ng.JointTorqueLimits([[[1.0, 0.2], [0.3, 1.0]]], 0.7).at(grasp.frames, grasp.contacts)
    z = rng.standard_normal((50, 2))
    phi, _ = budget.support(z)
    grid = np.stack(np.meshgrid(np.linspace(0, 5, 2001), np.linspace(-2.5, 2.5, 2001)), axis=-1).reshape(-1, 2)
    admissible = grid[(np.abs(grid[:, 1]) <= 0.5 * grid[:, 0]) & (budget.gauge(grid) <= 1.0)]
    brute = np.max(z @ admissible.T, axis=1)
    assert np.all(phi >= brute - 1e-9)
    np.testing.assert_allclose(phi, brute, atol=2e-2)


def test_more_budget_never_hurts(rng):
    """shared <= l2-free bounds: per-finger force contains the shared one, and sizes contain nothing more than l2 k."""
    grasp = closed_ellipsoid_grasp(rng)
    y = rng.standard_normal((200, 6))
    phi = {b: WrenchSet.of(grasp, b).support(y)[0] for b in NAMED}
    assert np.all(phi["shared"] <= phi["per_finger"] + 1e-12)
    assert np.all(phi["l2"] <= phi["per_finger_size"] + 1e-12)
    assert np.all(phi["per_finger_size"] <= phi["per_finger"] + 1e-12)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda g: WrenchSet.of(g, "l1"), "one of l2, per_finger, shared, per_finger_size"),
        (lambda g: WrenchSet.of(g, 3), "one of l2"),
        (lambda g: ng.JointTorqueLimits([], 1.0), "one Jacobian a contact"),
        (lambda g: ng.JointTorqueLimits(3, 1.0), "one Jacobian a contact"),
        (lambda g: ng.JointTorqueLimits([np.eye(3)], -1.0), "greater than 0"),
        (lambda g: ng.JointTorqueLimits([np.eye(3)], [1.0, 2.0]), "1, one a contact"),
        (lambda g: ng.JointTorqueLimits([[[np.nan] * 3] * 3], 1.0), "no NaN"),
        (lambda g: WrenchSet.of(g, ng.JointTorqueLimits([np.eye(3)] * 3, 1.0)), "expected 4"),
        (lambda g: WrenchSet.of(g, ng.JointTorqueLimits([np.eye(4)] * 4, 1.0)), "3 or 6 rows"),
        (lambda g: WrenchSet.of(g, ng.JointTorqueLimits([g.tangents[0, :1].T] * 4, 1.0)), "without any torque"),
    ],
)
def test_budgets_that_do_not_fit_are_refused(make, message, rng):
    with pytest.raises(ng.InputError, match=message):
        make(closed_ellipsoid_grasp(rng))


@pytest.mark.parametrize("budget", ["per_finger", "shared"])
def test_normal_force_does_not_bound_bilateral_contacts(budget, rng):
    grasp = closed_ellipsoid_grasp(rng)
    grasp = ng.Grasp(grasp.points, grasp.normals, CONTACTS["bilateral"])
    with pytest.raises(ng.InputError, match='"l2" with bilateral contacts'):
        ng.delta(grasp, force_budget=budget)


def test_narrow_elliptic_cones_under_torque_limits():
    """Torsion of a millimetre: the support once missed most of its extreme points (1.0074 is its least ratio)."""
    corners = np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]]) / np.sqrt(3.0)
    rng = np.random.default_rng(1)
    limits = ng.JointTorqueLimits([rng.standard_normal((6, 3)) for _ in range(4)], 1.0)
    grasp = ng.Grasp(0.05 * corners, -corners, ng.SoftContact(1.0, 0.001, "elliptic"))
    bounds = ng.delta(grasp, 0.05, force_budget=limits)
    bound = limits.at(grasp.frames, grasp.contacts)
    scale = np.array([1, 1, 1, 0.05, 0.05, 0.05])
    z = bounds.worst_direction @ grasp.G
    ratio = largest_work(grasp, bound, z) / np.linalg.norm(scale * bounds.worst_direction)
    assert ratio == pytest.approx(bounds.upper, rel=1e-6)
    assert bounds.gap <= 0.0101
