"""Verification of bounds over meshes, and of edits of them."""

import json
from dataclasses import replace

import numpy as np
import pytest

import nlpgrasp as ng
from nlpgrasp.global_bound.branch_and_bound import BranchAndBound
from nlpgrasp.global_bound.cells import mesh_cells as mesh
from nlpgrasp.optimize import global_search
from nlpgrasp.verify.bound.proof import Proof
from nlpgrasp.verify.bound.stated_cells import halve_triangles
from nlpgrasp.verify.sources import SourceFolders
from tests.global_bound.samples import bent_bar
from tests.quick import every, first
from tests.verify.edits import put

FRICTION, SOFT = ng.FrictionContact(0.5), ng.SoftContact(0.5, 0.2)
TASK = ng.TaskEllipsoid([1.0, 1.0, 1.0, 0.5, 0.5, 0.5])
TABLE = 0.6
LIMITED = [ng.Table(TABLE), ng.Forbid(ng.BoxRegion([0.2, -2, -2], [0.6, 2, 2]))]
PROBLEMS = {
    "friction": ([FRICTION] * 3, {}),
    "soft": ([SOFT, SOFT, FRICTION], {"force_budget": "per_finger", "constraints": LIMITED}),
}
ABOVE = 2e-9  # relative: along its directions the task does up to a billionth more than unit work
FEW = 512  # pieces that make a search, and every check of it, quick
_DATA = {}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Return a folder with the mesh's file, for bound files."""
    directory = tmp_path_factory.mktemp("meshes")
    bent_bar(np.random.default_rng(3)).export(directory / "bar.ply")
    return directory


def few_pieces(directory, name):
    """Return the data of a bound file of a mesh of few pieces, from one short search."""
    if name not in _DATA:
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(mesh, "ENOUGH", FEW)
            patch.setattr(global_search, "FIRST_STARTS", 1)
            patch.setattr(global_search, "LEAST_NODES", 10_000)
            _DATA[name] = bound_data(directory, name, 300)
    return json.loads(_DATA[name])


def bound_data(directory, name, nodes):
    """Return the text of a bound file after a search of about so many nodes."""
    contacts, fields = PROBLEMS[name]
    problem = ng.GraspProblem(ng.Mesh.load(directory / "bar.ply", resolution=8), contacts, TASK, **fields)
    tree, bound = BranchAndBound(problem, 0.01), ng.best_possible(problem, 1.0)
    tree.update_incumbent(bound.mu.lower)
    tree.branch(nodes)
    upper, certificate = tree.certificate()
    certificate["leaves"].sort(key=lambda leaf: -leaf[2])
    return json.dumps(replace(bound, upper=upper, closed=False, nodes=nodes, certificate=certificate).to_dict())


def verified(folder, data, name="bar.bound.json"):
    path = folder / name
    path.write_text(json.dumps(data))
    return ng.verify(path)


def check_again(directory, data):
    """Return the number of bounds, after a check that each is recomputed as stated."""
    verification = verified(directory, data)
    assert verification.passed, str(verification)
    assert verification.not_made == ()
    stated, recomputed = Proof(data["problem"], data["certificate"], SourceFolders((directory,))).bounds
    assert np.max(recomputed - stated) <= 1e-12 * np.max(recomputed)
    assert np.max((stated - recomputed)[recomputed > 0.5 * np.max(recomputed)]) <= ABOVE * np.max(recomputed)
    return len(recomputed)


@pytest.mark.slow
@pytest.mark.parametrize("name", first(1, PROBLEMS))
def test_a_mesh_bound_is_computed_again_as_it_is_claimed(name, folder):
    assert check_again(folder, few_pieces(folder, name)) > 10


@pytest.mark.slow
@pytest.mark.parametrize("name", PROBLEMS)
def test_so_is_one_of_as_many_pieces_as_a_search_has(name, folder):
    data = json.loads(bound_data(folder, name, 1000))
    assert len(data["certificate"]["groups"][0]["roots"][0][1]["order"]) > 4000
    assert check_again(folder, data) > 30


def share(factor):
    return lambda value: factor * value


def without_pieces(data):
    for group in data["certificate"]["groups"]:
        cell = group["roots"][0][1]
        cell["order"] = [cell["order"][0], *cell["order"][:-1]]


def other_halves(data):
    for group in data["certificate"]["groups"]:
        rounds = group["roots"][0][1]["halved"]
        rounds[0] = rounds[0].translate(str.maketrans("012", "120"))


def other_order(data):
    """Move a piece of one end of the mesh to the other: cells are not what their bounds are of."""
    for group in data["certificate"]["groups"]:
        order = group["roots"][0][1]["order"]
        group["roots"][0][1]["order"] = order[len(order) // 2 :] + order[: len(order) // 2]


def without_part(data):
    next(c for c in data["certificate"]["groups"][0]["cuts"] if None not in c)[2] = None


def without_leaf(data):
    del data["certificate"]["leaves"][0]


def loosest(i, value):
    def edit(data):
        put((i,), value)(data["certificate"]["leaves"][0])

    return edit


def mixture(part, value):
    def edit(data):
        put((part, 0), value)(data["certificate"]["mixtures"][data["certificate"]["leaves"][0][1]])

    return edit


def largest_weight(value):
    def edit(data):
        weights = data["certificate"]["mixtures"][data["certificate"]["leaves"][0][1]][1]
        largest = weights.index(max(weights))
        weights[largest] = value(weights[largest])

    return edit


EDITS = {
    "the bound is lower": (put(("upper",), share(0.999)), "upper"),
    "a leaf's bound is lower": (loosest(2, share(0.999)), "leaves"),
    "a weight": (largest_weight(share(1.02)), "leaves"),
    "a weight below zero": (mixture(1, share(-1.0)), "leaves"),
    "a direction's number": (mixture(0, lambda i: i + 1), "leaves"),
    "a mixture's number": (loosest(1, lambda i: i + 1000), "leaves"),
    "a direction": (put(("certificate", "directions", 0), lambda y: [1.01 * x for x in y]), "directions"),
    "pieces are left out": (without_pieces, "faces covered"),
    "triangles are halved otherwise": (other_halves, "leaves"),
    "another order": (other_order, "leaves"),
    "a part is left out": (without_part, "cuts"),
    "a leaf is left out": (without_leaf, "nodes"),
    "another cut": (put(("certificate", "groups", 0, "cuts", 0, 1), lambda n: n - 5), "leaves"),
    "a cut that leaves nothing": (put(("certificate", "groups", 0, "cuts", 0, 1), 0), "nodes"),
    "no cell to begin with": (put(("certificate", "groups", 0, "roots"), []), "faces covered"),
    "another cell": (put(("certificate", "groups", 0, "roots", 0, 1, "kind"), "polygon"), "leaves"),
    "more friction": (put(("problem", "contacts"), [ng.FrictionContact(0.51).to_dict()] * 3), "leaves"),
    "another torque origin": (put(("certificate", "origin", 0), lambda x: x + 0.01), "leaves"),
    "a contact off the mesh": (put(("grasp", "positions", 0), lambda p: [1.01 * x for x in p]), "grasp"),
}


@pytest.mark.parametrize("name", every(4, EDITS))
def test_an_edit_of_a_mesh_bound_fails_at_its_check(name, folder):
    edit, check = EDITS[name]
    data = few_pieces(folder, "friction")
    edit(data)
    verification = verified(folder, data)
    assert check in [c.name for c in verification.checks if c.failed], str(verification)


@pytest.mark.slow
def test_a_constraint_that_leaves_more_fails(folder):
    data = few_pieces(folder, "soft")
    data["problem"]["constraints"][0]["height"] = -2.0
    assert "cuts" in [c.name for c in verified(folder, data).checks if c.failed]


def test_without_its_mesh_nothing_of_a_bound_is_known(folder, tmp_path):
    data = few_pieces(folder, "friction")
    verification = verified(tmp_path, data)
    assert {"faces covered", "leaves", "upper"} <= {check.name for check in verification.not_made}
    assert "bound" in [check.name for check in verification.checks if check.failed]
    assert not verification.passed
    bent_bar(np.random.default_rng(4)).export(tmp_path / "bar.ply")
    other = verified(tmp_path, data)
    assert "leaves" in [check.name for check in other.not_made]
    assert not other.passed


def test_halves_of_triangles_are_where_characters_say():
    corners = np.array([[[0.0, 0, 0], [2, 0, 0], [0, 1, 0]], [[0, 0, 1], [1, 0, 1], [0, 1, 1]]])
    pieces, triangle = halve_triangles(corners, ["0-", "-2-"])
    assert triangle.tolist() == [0, 1, 0, 1]
    assert pieces[0].tolist() == [[0, 0, 0], [1, 0, 0], [0, 1, 0]]
    assert pieces[2].tolist() == [[1, 0, 0], [2, 0, 0], [0, 1, 0]]
    assert pieces[1].tolist() == [[0, 1, 1], [0, 0.5, 1], [1, 0, 1]]
    assert pieces[3].tolist() == [[0, 0.5, 1], [0, 0, 1], [1, 0, 1]]
    with pytest.raises(ValueError, match="characters"):
        halve_triangles(corners, ["0"])
