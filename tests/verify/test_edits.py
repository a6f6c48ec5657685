"""Detection of single edits of good files by ``verify``."""

import json

import numpy as np
import pytest
import trimesh

import nlpgrasp as ng
from nlpgrasp.solution.file import parse
from nlpgrasp.verify.check import Verification
from tests.hands.urdf import FOLDER, three_finger_hand
from tests.once import WITHOUT_VOLUME, solve_once
from tests.verify import honest, walk
from tests.verify.edits import put, row
from tests.verify.stated import edited, recomputed_file

TASK = ng.TaskEllipsoid([1.0, 1.0, 1.0, 0.03, 0.03, 0.03])

CONSTRAINTS = [ng.Table(-0.018), ng.Spread(min=0.02)]


@pytest.fixture(scope="module")
def solved():
    """A box on a table between fingertips, as a solve writes it."""
    problem = ng.GraspProblem(
        ng.Box([0.08, 0.04, 0.04]),
        [ng.FrictionContact(0.6)] * 3,
        TASK,
        hand=ng.Fingertips(3, radius=0.004),
        constraints=CONSTRAINTS,
    )
    return json.loads(json.dumps(solve_once(problem, starts=1, options=WITHOUT_VOLUME).to_dict()))


def times(factor):
    return lambda value: (np.asarray(value) * factor).tolist()


def first(name, change):
    return put(["grasp", "contacts", 0, name], change)


def shifted(axis, by):
    def change(value):
        result = list(value)
        result[axis] += by
        return result

    return change


def certificate(change):
    """Return an edit of the leaf of the largest bound in the bound's certificate."""

    def edit(data):
        leaves = data["quality"]["best_possible"]["certificate"]["leaves"]
        leaf = max(leaves, key=lambda item: item[2])
        leaf[2] = change(leaf[2])

    return edit


def largest_force(factor):
    """Return an edit of the largest finger force of the first wrench."""

    def edit(data):
        forces = data["forces"][0]["forces"]
        finger = int(np.argmax(np.linalg.norm(forces, axis=1)))
        forces[finger] = times(factor)(forces[finger])

    return edit


EDITS = {
    "body's length": put(["problem", "body", "extents", 0], 0.5),
    "body's height": put(["problem", "body", "extents", 2], 0.5),
    "body's width": put(["problem", "body", "extents", 1], 0.0400002),
    "another body": put(["problem", "body"], {"type": "sphere", "radius": 0.04}),
    "position along the face": first("position", shifted(2, 1e-3)),
    "position off the face": first("position", lambda p: (1.0001 * np.asarray(p)).tolist()),
    "normal turned": first("normal", lambda n: [n[0], n[1] * np.cos(0.01), np.sin(0.01)]),
    "normal outwards": first("normal", times(-1.0)),
    "face": first("face", "+z"),
    "face that is not there": first("face", "lid"),
    "friction of the problem": put(["problem", "contacts", 0, "friction"], 0.9),
    "friction of the grasp": put(["grasp", "contacts", 0, "friction"], 0.9),
    "task": put(["problem", "task", "axes"], times(0.5)),
    "task's centre": put(["problem", "task", "center", 0], 0.3),
    "torque origin": put(["grasp", "torque_origin", 2], 0.01),
    "force budget": put(["problem", "force_budget"], "per_finger"),
    "edge margin": put(["problem", "edge_margin"], 0.003),
    "a stated edge distance": row("edge margin, finger 0", "value", 0.005),
    "table's height": put(["problem", "constraints", 0, "height"], -0.03),
    "limit of a stated row": row("spread, fingers 0 and 1", "bound", [0.0, None]),
    "value of a stated row": row("table, finger 0", "value", lambda v: v + 1e-3),
    "radius of the fingertips": put(["problem", "hand", "radius"], 0.006),
    "lower bound of mu": put(["quality", "mu", "lower"], lambda v: 1.05 * v),
    "mu": put(["quality", "mu"], lambda mu: {**mu, "lower": 1.5 * mu["lower"], "upper": 1.5 * mu["upper"]}),
    "delta": put(["quality", "delta"], lambda b: {**b, "lower": 0.5 * b["lower"], "upper": 0.5 * b["lower"]}),
    "what is left at worst": put(
        ["quality", "robust", "mu"], lambda b: {**b, "lower": b["upper"], "upper": 1.2 * b["upper"]}
    ),
    "finger forces": largest_force(0.5),
    "bound over all placements": put(["quality", "best_possible", "upper"], lambda v: 0.99 * v),
    "certificate of the bound": certificate(lambda bound: 0.9 * bound),
}


@pytest.mark.slow
def test_the_file_passes_as_it_is(solved, tmp_path):
    assert checked(solved, tmp_path).passed


@pytest.mark.slow
@pytest.mark.parametrize("name", EDITS)
def test_an_edit_is_seen(name, solved, tmp_path):
    data = edited(solved, EDITS[name])
    assert data != solved
    assert seen(data, tmp_path)


@pytest.mark.usefixtures("without_link_checks")
def test_a_hand_that_is_elsewhere_is_seen():
    data = honest.fingers()
    assert not any(check.failed for check in recomputed_file(data, FOLDER).values())
    moved = edited(data, put(["hand", "palm_pose", "position", 0], lambda x: x + 1e-3))
    assert any(check.failed for check in recomputed_file(moved, FOLDER).values())


def test_another_fingerprint_of_a_mesh_is_seen(tmp_path):
    data = honest.block(tmp_path)
    assert not any(check.failed for check in recomputed_file(data, tmp_path).values())
    other = edited(data, put(["problem", "body", "sha256"], lambda text: text[::-1]))
    assert recomputed_file(other, tmp_path)["mesh file"].failed


def walked_box():
    return honest_solve(ng.Box([0.08, 0.04, 0.04]), 3, hand=ng.Fingertips(3, radius=0.004), constraints=CONSTRAINTS)


def walked_mesh(folder):
    trimesh.creation.cylinder(0.02, 0.08).export(folder / "bar.stl")
    return honest_solve(ng.Mesh.load(folder / "bar.stl"), 3)


def walked_hand():
    return honest_solve(ng.Ellipsoid([0.05, 0.03, 0.03]), 3, model=ng.SoftContact(0.7, 0.01), hand=three_finger_hand())


def walked_gripper():
    hand = ng.ParallelJaw(0.08, finger_length=0.05, finger_thickness=0.01)
    body, table = ng.Box([0.06, 0.04, 0.03]), ng.Table(-0.015, clearance=0.0)
    return honest_solve(body, 2, model=ng.SoftContact(0.6, 0.01), hand=hand, constraints=[table])


def honest_solve(body, count, model=None, **fields):
    """Return the file of a short solve with all analyses."""
    problem = ng.GraspProblem(body, [model or ng.FrictionContact(0.6)] * count, TASK, **fields)
    options = ng.SolveOptions(workers=1, analyses=["robustness", "delta"], global_bound=count == 3 and not fields)
    return json.loads(json.dumps(solve_once(problem, starts=1, options=options).to_dict()))


def unseen_edits(data, folders, monkeypatch, count=None):
    """Return the edits of a file that are not seen and not listed as no lie."""
    walk.remembered(monkeypatch)

    def verification(data):
        return ng.verify(
            ng.GraspSolution.from_dict(parse(json.dumps(data), "grasp.json"), "grasp.json"), folders=folders
        )

    assert verification(data).passed, str(verification(data))
    edits = [edit for edit in walk.edits(data, np.random.default_rng(0)) if not walk.is_no_lie(edit[0])]
    unseen = []
    for name, edit in edits[:: 1 if count is None else len(edits) // count]:
        try:
            found = verification(edit)
        except ng.InputError:
            continue
        unseen += [name] if found.passed and found.complete else []
    return unseen


@pytest.mark.parametrize("count", [20, pytest.param(None, marks=pytest.mark.slow)])
def test_every_entry_of_a_planar_file_is_checked(count, monkeypatch):
    assert unseen_edits(honest.planar(), (), monkeypatch, count) == []


@pytest.mark.slow
def test_every_entry_of_a_box_is_checked(monkeypatch):
    assert unseen_edits(walked_box(), (), monkeypatch) == []


@pytest.mark.slow
def test_every_entry_of_a_mesh_is_checked(monkeypatch, tmp_path):
    unseen = unseen_edits(walked_mesh(tmp_path), [tmp_path], monkeypatch)
    # a margin that is kept may be stated smaller: what counts as an edge of a mesh is a convention
    assert set(unseen) <= {"less constraints.#.value"}


@pytest.mark.slow
def test_every_entry_of_a_hand_is_checked(monkeypatch):
    unseen = unseen_edits(walked_hand(), [FOLDER], monkeypatch)
    # an ellipsoid has no edges; the clearance of the pregrasp is stated a millimetre less than it is
    assert {name for name in unseen if "problem.edge_margin" not in name} <= {"more hand.phases.#.clearance"}


@pytest.mark.slow
def test_every_entry_of_a_gripper_is_checked(monkeypatch):
    unseen = unseen_edits(walked_gripper(), (), monkeypatch)
    # neither contacts nor fingers are near the sides along y: one of three lengths of the box is walked at random
    assert [name for name in unseen if "problem.body.extents" not in name] == []


def seen(data, folder):
    """Return whether a file with these data is refused when it is read, or fails."""
    try:
        return not checked(data, folder).passed
    except ng.InputError as error:
        return "grasp.json" in str(error)


def checked(data, folder) -> Verification:
    """Return the verification of a file with these data."""
    path = folder / "grasp.json"
    path.write_text(json.dumps(data))
    return ng.verify(path)
