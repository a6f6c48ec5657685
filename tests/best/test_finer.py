"""Finer rows where a bound needs them: never below what all triangles give, and hardly above it."""

import numpy as np
import pytest

import nlpgrasp as ng
from nlpgrasp.best.bound.finer import ENOUGH, heaviest, refined
from nlpgrasp.best.bound.measure import Measure
from nlpgrasp.best.bound.supports import Supports
from nlpgrasp.best.cells.clusters import Clusters
from nlpgrasp.best.cells.mesh import MeshCell
from nlpgrasp.budgets import force_budget
from tests.best.samples import rough_triangles
from tests.best.test_cells import powers_at

CONTACTS = [ng.PointContact(), ng.FrictionContact(0.5), ng.SoftContact(0.5, 0.1)]


@pytest.mark.parametrize("budget", ["l2", "per_finger"])
@pytest.mark.parametrize("contact", CONTACTS, ids=lambda c: c.kind)
def test_refined_rows_reach_the_largest_corner_of_all_triangles(contact, budget):
    rng = np.random.default_rng(5)
    corners, normals = rough_triangles(rng, 2)
    origin = np.array([0.1, -0.2, 0.3])
    clusters = Clusters(corners, normals, 1.3)
    supports = Supports(contact, Measure.of(force_budget(budget)), origin)
    nodes = [1, 2, 5, 21]
    for node in nodes:
        supports.add(MeshCell(clusters, node, 1.3))
    twists = rng.standard_normal((len(nodes), 9, 6))
    weights = rng.dirichlet(np.full(9, 0.3), len(nodes))
    rows = supports.rows_of(np.arange(len(nodes)))
    mixed = np.einsum("bmj,bj->bm", supports.powers(rows, twists), weights)
    bounds, chosen = refined(supports, rows, mixed, twists, weights)
    near = heaviest(supports, rows, mixed, twists, weights)
    for i, node in enumerate(nodes):
        own = clusters.members(node)
        points, inward = corners[own].reshape(-1, 3), np.repeat(normals[own], 3, axis=0)
        largest = np.max(powers_at(contact, budget, points, inward, origin, twists[i]) @ weights[i])
        assert largest * (1 - 1e-9) <= bounds[i] <= largest * (1 + ENOUGH + 1e-9)
        for row, least in ((chosen[i], 1 / (1 + ENOUGH)), (near[i], 0.7)):
            place = supports.points[row][None], supports.normals[row][None]
            found = powers_at(contact, budget, *place, origin, twists[i])[0] @ weights[i]
            assert least * largest <= found <= largest * (1 + 1e-9)


def test_clusters_of_large_meshes_bound_without_their_triangles(monkeypatch):
    rng = np.random.default_rng(6)
    monkeypatch.setattr("nlpgrasp.best.cells.clusters.DEEPEST", 5)
    corners, normals = rough_triangles(rng, 2)
    clusters = Clusters(corners, normals, 1.3)
    assert not clusters.exact
    assert len(clusters.table.points) == 64
    contact = ng.FrictionContact(0.4)
    supports = Supports(contact, Measure.of(force_budget("l2")), np.zeros(3))
    twists = rng.standard_normal((1, 6, 6))
    weights = rng.dirichlet(np.ones(6), 1)
    cell = MeshCell(clusters, 1, 1.3)
    while isinstance(cell, MeshCell):
        supports.add(cell)
        rows = supports.rows_of(np.array([len(supports) - 1]))
        mixed = np.einsum("bmj,bj->bm", supports.powers(rows, twists), weights)
        own = clusters.members(cell.node)
        points, inward = corners[own].reshape(-1, 3), np.repeat(normals[own], 3, axis=0)
        largest = np.max(powers_at(contact, "l2", points, inward, np.zeros(3), twists[0]) @ weights[0])
        assert refined(supports, rows, mixed, twists, weights)[0][0] >= largest * (1 - 1e-9)
        cell = cell.split()[0]
