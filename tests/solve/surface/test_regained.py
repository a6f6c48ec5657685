"""Contacts on a mesh go back to constraints that its own normals break, and no farther than they have to."""

import numpy as np
import pytest
import trimesh

import nlpgrasp as ng
from nlpgrasp.solve.surface.regained import ALLOWED, regained
from nlpgrasp.solve.surface.scored import Scored
from nlpgrasp.solve.workbench.placed import Placed
from nlpgrasp.solve.workbench.workbench import Workbench

SIDES, RADIUS = 16, 0.02
FLAT = RADIUS * np.cos(np.pi / SIDES)  # from the axis to the middle of a side
TASK = ng.TaskEllipsoid([1.0, 1.0, 1.0, 0.02, 0.02, 0.02])


@pytest.fixture(scope="module")
def bench():
    """A rod of sixteen flat sides between jaws that face each other to three degrees."""
    rod = ng.Mesh(trimesh.creation.cylinder(radius=RADIUS, height=0.08, sections=SIDES))
    jaws = ng.ParallelJaw(opening=0.08)
    problem = ng.GraspProblem(rod, [ng.SoftContact(0.5, 0.004)] * 2, TASK, hand=jaws, edge_margin=0.0)
    return Workbench(problem, ng.SolveOptions(workers=1))


def on_sides(*which, height=(0.0, 0.0)):
    """Middles of sides, counted around the rod, and their inward normals."""
    angles = 2.0 * np.pi * (np.array(which) + 0.5) / SIDES
    outward = np.stack([np.cos(angles), np.sin(angles), np.zeros(len(which))], axis=1)
    return FLAT * outward + np.outer(height, [0.0, 0.0, 1.0]), -outward


def broken(bench, points, normals):
    return float(bench.rows.violations(points[None], normals[None], {})[0])


def regained_from(bench, points, normals):
    start = Placed(("surface", "surface"), points, {})
    return regained(bench, start, points, normals, Scored(bench, np.random.default_rng(0)))


@pytest.mark.parametrize(("sides", "height"), [((0, 9), (0.0, 0.0)), ((3, 11), (0.0, 0.012)), ((5, 12), (0.01, -0.01))])
def test_jaws_that_do_not_face_each_other_come_to_do_so(bench, sides, height):
    points, normals = on_sides(*sides, height=height)
    assert broken(bench, points, normals) > 1e-3
    there, turned = regained_from(bench, points, normals)
    assert broken(bench, there, turned) <= ALLOWED
    _, outward, off = bench.surface.mesh.closest(there)
    assert np.max(off) <= 1e-9
    np.testing.assert_allclose(turned, -outward, atol=1e-6)
    assert np.max(np.linalg.norm(there - points, axis=1)) <= 0.3 * bench.scaling.length + FLAT


def test_contacts_that_keep_their_constraints_stay(bench):
    points, normals = on_sides(2, 10)
    there, turned = regained_from(bench, points, normals)
    np.testing.assert_array_equal(there, points)
    np.testing.assert_array_equal(turned, normals)


def test_where_nothing_keeps_them_contacts_stay():
    wedge = trimesh.convex.convex_hull([[-0.03, 0, 0.02], [-0.03, 0, -0.02], [0.03, 0.02, 0], [0.03, -0.02, 0]])
    problem = ng.GraspProblem(
        ng.Mesh(wedge), [ng.SoftContact(0.5, 0.004)] * 2, TASK, hand=ng.ParallelJaw(opening=0.08), edge_margin=0.0
    )
    tetrahedron = Workbench(problem, ng.SolveOptions(workers=1))  # no two of its sides are near parallel
    points, outward = tetrahedron.surface.mesh.closest(np.array([[0.0, 0.02, 0.005], [0.0, -0.02, 0.005]]))[:2]
    there, turned = regained_from(tetrahedron, points, -outward)
    np.testing.assert_array_equal(there, points)
    np.testing.assert_array_equal(turned, -outward)
