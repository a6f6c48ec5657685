"""Tests of the branch-and-bound tree: children of nodes, and incomplete records."""

import json
from itertools import combinations_with_replacement, product
from types import SimpleNamespace

import numpy as np
import pytest
import trimesh

import nlpgrasp as ng
from nlpgrasp.global_bound import branch_and_bound, shared_weights
from nlpgrasp.global_bound.contact_cells import NONE
from nlpgrasp.global_bound.node_tree import children

TASK = ng.TaskEllipsoid([1.0] * 6)


def halves(cells):
    """Return the parts 2 c and 2 c + 1 of cells c; part 7 is excluded."""
    children = 2 * cells[:, None] + np.arange(2)
    return np.where(children == 7, NONE, children)


@pytest.mark.parametrize("slot", range(5))
def test_identical_contacts_of_a_split_cell_go_to_its_halves_in_every_way(slot):
    groups = [
        (SimpleNamespace(child_indices=halves), slice(0, 3)),
        (SimpleNamespace(child_indices=halves), slice(3, 5)),
    ]
    nodes = np.array([[1, 1, 1, 1, 1], [2, 3, 3, 3, 3], [2, 2, 3, 4, 6], [4, 5, 6, 2, 2]])
    cells, parent = children(groups, nodes, np.full(len(nodes), slot))
    for i, node in enumerate(nodes.tolist()):
        slots = slice(0, 3) if slot < 3 else slice(3, 5)
        group, cell = node[slots], node[slot]
        parts = [part for part in (2 * cell, 2 * cell + 1) if part != 7]
        rest = [c for c in group if c != cell]
        ways = combinations_with_replacement(parts, group.count(cell))
        expected = [node[: slots.start] + sorted([*rest, *way]) + node[slots.stop :] for way in ways]
        assert sorted(cells[parent == i].tolist()) == sorted(expected)


def test_no_nodes_have_no_parts():
    cells, parent = children(
        [(SimpleNamespace(child_indices=halves), slice(0, 2))],
        np.ones((0, 2), dtype=np.int64),
        np.zeros(0, dtype=np.int64),
    )
    assert cells.shape == (0, 2)
    assert parent.shape == (0,)


def test_parts_cover_their_node():
    """Every placement of two contacts in a node's cells is in one of its children."""
    groups = [(SimpleNamespace(child_indices=lambda c: 2 * c[:, None] + np.arange(2)), slice(0, 2))]
    cells, _ = children(groups, np.array([[1, 1]]), np.array([0]))
    for places in product((2, 3), repeat=2):
        assert sorted(places) in cells.tolist()


@pytest.mark.parametrize(("body", "nodes"), [("box", 400), pytest.param("mesh", 4000, marks=pytest.mark.slow)])
def test_a_record_that_ends_before_the_search_is_verified(body, nodes, tmp_path, monkeypatch):
    monkeypatch.setattr(branch_and_bound, "MOST_LEAVES", 30)
    monkeypatch.setattr(shared_weights, "MOST_LEAVES", 30)
    trimesh.creation.box([2, 1, 1]).export(tmp_path / "box.stl")
    shape = ng.Box([2, 1, 1]) if body == "box" else ng.Mesh.load(tmp_path / "box.stl", unit="m", resolution=8)
    problem = ng.GraspProblem(shape, [ng.FrictionContact(0.5)] * 3, TASK)
    search = branch_and_bound.BranchAndBound(problem, 0.01)
    search.branch(nodes)
    upper, data = search.certificate()
    assert not data["complete"]
    assert upper > search.upper
    assert 30 <= len(data["leaves"]) < 100
    file = {"schema": "nlpgrasp-bound/1", "upper": upper, "gap": None, "closed": False, "nodes": search.nodes}
    file |= {"seconds": 0.0, "dropped": list(search.scope.dropped), "problem": problem.to_dict(), "grasp": None}
    path = tmp_path / "box.bound.json"
    path.write_text(json.dumps({**file, "certificate": data}))
    verification = ng.verify(path)
    assert verification.passed, str(verification)
    assert verification.not_made == ()
