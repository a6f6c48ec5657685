"""Quality measures of other tools, and cases in which those tools fail."""

import numpy as np
import pytest
from scipy.spatial import QhullError

import nlpgrasp as ng
from nlpgrasp.errors import NlpgraspError
from nlpgrasp.quality import other_measures as pyramids
from tests.quick import first
from tests.samples import closed_ellipsoid_grasp, ellipsoid_grasp, random_rotation


def tetrahedral(friction=0.5):
    corners = np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]]) / np.sqrt(3.0)
    return ng.Grasp(corners, -corners, ng.FrictionContact(friction))


def opposed(friction=0.5):
    return ng.Grasp([[1, 0, 0], [-1, 0, 0]], [[-1, 0, 0], [1, 0, 0]], ng.FrictionContact(friction))


def test_tetrahedral_epsilon():
    """Theory, Section 2: unit sphere, friction 0.5, shared budget: between 0.35342 and 0.35356."""
    bounds = ng.delta(tetrahedral(), rtol=3e-4, force_budget="shared")
    assert bounds.lower <= 0.35356
    assert bounds.upper >= 0.35342
    assert bounds.gap <= 3.001e-4


@pytest.mark.slow
@pytest.mark.parametrize("budget", ["shared", "per_finger"])
def test_pyramids_are_inside_the_cones_and_close_in(budget):
    rng = np.random.default_rng(0)
    grasp = closed_ellipsoid_grasp(rng, k=3, friction=0.8)
    exact = ng.delta(grasp, rtol=1e-3, force_budget=budget)
    edges = (3, 5, 7) if budget == "per_finger" else (4, 8, 16, 32, 64)
    values = [ng.ferrari_canny(grasp, m, force_budget=budget) for m in edges]
    assert max(values) <= exact.upper
    if budget == "shared":
        assert values[-1] >= 0.97 * exact.lower
        volumes = [ng.pyramid_volume(grasp, m) for m in edges]
        assert volumes == sorted(volumes)


def test_unit_edges_make_epsilon_smaller():
    """By about sqrt(1 + mu^2); the exact factor for edges all scaled alike."""
    grasp = tetrahedral(0.5)
    plain, scaled = (ng.ferrari_canny(grasp, 16, unit_edges=u) for u in (False, True))
    assert plain / scaled == pytest.approx(np.sqrt(1.25))


def test_planar_pyramids_are_the_cones(rng):
    angles = 2.0 * np.pi * np.arange(3) / 3.0
    points = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    grasp = ng.Grasp(points, -points, ng.FrictionContact(0.7))
    for budget in ("shared", "per_finger"):
        exact = ng.delta(grasp, rtol=1e-6, force_budget=budget)
        assert ng.ferrari_canny(grasp, force_budget=budget) == pytest.approx(exact.upper, rel=1e-5)
        assert ng.pyramid_volume(grasp, force_budget=budget) in ng.nu(grasp, force_budget=budget)


def test_min_weight_is_its_definition(rng):
    """l in [0, 1] after normalising; weights of l / m each balance; 1 where equal weights do."""
    assert ng.min_weight(tetrahedral()) == pytest.approx(1.0)
    value = ng.min_weight(closed_ellipsoid_grasp(rng))
    assert 0.0 < value <= 1.0
    below = ng.Grasp([[1, 0, 0], [-1, 0.5, 0], [0, -1, 0]], [[0, 0, 1]] * 3, ng.FrictionContact(0.5))
    assert ng.min_weight(below) == 0.0


def test_two_hard_contacts_score_zero_in_every_measure():
    """Measures blind to the rank of G give them a positive value: torque about their line is out of reach."""
    grasp = opposed(1.0)
    assert ng.min_weight(grasp) == 0.0
    assert ng.ferrari_canny(grasp) == 0.0
    assert ng.ferrari_canny(grasp, force_budget="per_finger", edges=4) == 0.0
    assert ng.pyramid_volume(grasp) == 0.0
    assert ng.smallest_singular_value(grasp) == pytest.approx(0.0, abs=1e-12)
    assert ng.isotropy(grasp) == pytest.approx(0.0, abs=1e-12)
    assert ng.delta(grasp).upper == 0.0
    assert ng.delta(grasp, force_budget="shared").upper == 0.0


def test_a_zero_singular_value_is_not_missed():
    """Two frictionless contacts: G is 6 by 2, both its singular values are positive, four more are 0."""
    grasp = ng.Grasp([[1, 0, 0], [-1, 0, 0]], [[-1, 0, 0], [0, 1, 0]], ng.PointContact())
    assert np.min(np.linalg.svd(grasp.G, compute_uv=False)) > 0.0
    assert ng.smallest_singular_value(grasp) == 0.0
    assert ng.isotropy(grasp) == 0.0


@pytest.mark.parametrize("budget", ["l2", "per_finger", "shared"])
def test_friction_changes_the_measure(budget, rng):
    """A coefficient that is read and never used is a trap: twice the friction is clearly better."""
    grasp = closed_ellipsoid_grasp(rng)
    rougher = ng.Grasp(grasp.points, grasp.normals, ng.FrictionContact(1.0))
    assert ng.delta(rougher, force_budget=budget).lower > ng.delta(grasp, force_budget=budget).upper
    assert ng.min_weight(rougher) > ng.min_weight(grasp)


@pytest.mark.parametrize("seed", first(1, range(4)))
def test_friction_does_not_depend_on_where_the_normal_points(seed):
    """Turned as a whole, the grasp keeps its measures: no coordinate axis is special to the tangents."""
    rng = np.random.default_rng(seed)
    grasp = closed_ellipsoid_grasp(rng, k=3)
    A = random_rotation(rng) if seed else np.eye(3)[[2, 0, 1]]  # normals along the axes' old places too
    turned = ng.Grasp(grasp.points @ A.T, grasp.normals @ A.T, grasp.contacts)
    for budget in ("l2", "shared", "per_finger"):
        first, second = (ng.delta(g, rtol=1e-3, force_budget=budget) for g in (grasp, turned))
        assert first.upper == pytest.approx(second.upper, rel=2e-3)


@pytest.mark.slow
def test_normals_along_and_against_the_axes_are_alike():
    """A tangent frame picked by the sign or size of a component must not change a grasp's measure."""
    values = []
    for axis in range(3):
        for sign in (1.0, -1.0):
            A = np.roll(np.eye(3), axis, axis=0) * sign
            points = tetrahedral().points @ A.T
            values.append(ng.delta(ng.Grasp(points, -points, ng.FrictionContact(0.5)), rtol=3e-3).upper)
    np.testing.assert_allclose(values, values[0], rtol=3e-3)


def test_a_failed_hull_is_an_error_not_a_score(monkeypatch):
    def fail(points):
        raise QhullError("QH6154 initial simplex is flat")

    monkeypatch.setattr(pyramids, "ConvexHull", fail)
    with pytest.raises(NlpgraspError, match="cannot be built"):
        ng.ferrari_canny(tetrahedral())
    with pytest.raises(NlpgraspError, match="cannot be built"):
        ng.pyramid_volume(tetrahedral())


@pytest.mark.slow
def test_torque_is_about_the_stated_point():
    """Moving body and origin together changes nothing; moving the origin alone does."""
    grasp = tetrahedral()
    far = np.array([10.0, -3.0, 4.0])
    together = ng.Grasp(grasp.points + far, grasp.normals, grasp.contacts, torque_origin=far)
    shifted = ng.Grasp(grasp.points + far, grasp.normals, grasp.contacts)
    for measure in (ng.ferrari_canny, ng.smallest_singular_value, ng.isotropy):
        assert measure(together) == pytest.approx(measure(grasp))
        assert measure(shifted) < 0.5 * measure(grasp)
    assert ng.delta(together).upper == pytest.approx(ng.delta(grasp).upper, rel=1e-2)
    assert ng.delta(shifted).upper < 0.5 * ng.delta(grasp).lower
    assert ng.min_weight(shifted) == pytest.approx(ng.min_weight(grasp))


def test_soft_contacts_have_edges_too():
    grasp = ng.Grasp([[1, 0, 0], [-1, 0, 0]], [[-1, 0, 0], [1, 0, 0]], ng.SoftContact(0.5, 0.5))
    exact = ng.delta(grasp, force_budget="shared")
    assert 0.9 * exact.lower <= ng.ferrari_canny(grasp, 16) <= exact.upper


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda g: ng.ferrari_canny(g, edges=2), "edges"),
        (lambda g: ng.ferrari_canny(g, edges=8.0), "edges"),
        (lambda g: ng.ferrari_canny(g, edges=100, force_budget="per_finger"), "at most 20000"),
        (lambda g: ng.ferrari_canny(g, force_budget="l2"), "shared"),
        (lambda g: ng.ferrari_canny(g, torque_scale=0.0), "torque_scale"),
        (
            lambda g: ng.min_weight(ng.Grasp(g.points, g.normals, ng.PlaneContact(radius=0.1))),
            "point, friction or soft",
        ),
        (lambda g: ng.isotropy(g, torque_scale=-1.0), "torque_scale"),
    ],
)
def test_bad_input(make, message):
    with pytest.raises(ng.InputError, match=message):
        make(ellipsoid_grasp(np.random.default_rng(0)))
