"""Verification of bound files, and of edits of them."""

import json
import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import nlpgrasp as ng
from nlpgrasp.common.files import write_text
from nlpgrasp.solution.quality_record import GlobalBound
from nlpgrasp.verify.bound.proof import Proof
from nlpgrasp.verify.sources import SourceFolders
from tests.once import GRASP, solve_once
from tests.quick import every
from tests.verify.edits import put

FRICTION, SOFT = ng.FrictionContact(0.5), ng.SoftContact(0.5, 0.2)
LINE = ng.LineContact(0.3, 0.5, direction=[0.2, 0.3, 1.0])
PAD = ng.PlaneContact(extents=[0.3, 0.2], friction=0.5, direction=[0.2, 0.3, 1.0])
BOX_PAD = replace(PAD, model="box")
PLANE, SPACE = ng.TaskEllipsoid([1.0, 1.0, 1.0]), ng.TaskEllipsoid([1.0] * 6)
SQUARE = ng.Polygon([[-1, -1], [1, -1], [1, 1], [-1, 1]])
TRIANGLE = [[0, 0], [2, 0], [0, 1]]
KEPT = [ng.Table(-0.9), ng.Forbid("edge2"), ng.Workspace(ng.BoxRegion([-2, -2], [2, 0.2]))]
HOLE = [ng.Forbid(ng.BoxRegion([-0.3, -0.3, -0.6], [0.3, 0.3, 0.6])), ng.Table(-0.4)]


def problem(body, contacts, **more):
    return ng.GraspProblem(body, contacts, PLANE if body.space == 2 else SPACE, **more)


PROBLEMS = {
    "square": problem(SQUARE, [FRICTION] * 3),
    "square, limited": problem(SQUARE, [FRICTION] * 2, constraints=KEPT),
    "square, shared": problem(SQUARE, [FRICTION] * 2, force_budget="shared"),
    "ellipsoid, shared": problem(ng.Ellipsoid([2, 1, 1]), [FRICTION] * 3, force_budget="shared"),
    "square, hand": problem(
        SQUARE,
        [FRICTION] * 2,
        force_budget="per_finger",
        constraints=[ng.Spread(0.5), ng.Table(-0.8)],
        hand=ng.Fingertips(2, 0.05, reach=1.5),
    ),
    "sphere": problem(ng.Sphere(1.3), [FRICTION] * 3),
    "sphere by its semi-axes": problem(ng.Ellipsoid([1.3] * 3), [FRICTION] * 3),
    "box": problem(ng.Box([2, 1, 1]), [FRICTION] * 4),
    "box, hole": problem(ng.Box([2, 1, 1]), [FRICTION] * 3, constraints=HOLE),
    "box, soft": problem(ng.Box([2, 1, 1]), [SOFT, SOFT], force_budget="per_finger_size"),
    "cylinder": problem(ng.Cylinder(1.0, 2.0), [FRICTION] * 3),
    "cylinder, mixed": problem(ng.Cylinder(1.0, 2.0), [SOFT, FRICTION, ng.PointContact()]),
    "box, elliptic": problem(ng.Box([2, 1, 1]), [ng.SoftContact(0.5, 0.2, model="elliptic"), ng.PointContact()]),
    "cylinder, all different": problem(
        ng.Cylinder(1.0, 2.0),
        [SOFT, FRICTION, ng.PointContact(), ng.FrictionContact(0.8)],
        constraints=[ng.Table(-0.7)],
    ),
    "box, all different": problem(
        ng.Box([2, 1, 1]), [ng.FrictionContact(0.1 * i) for i in range(4, 9)], constraints=[ng.Table(-0.4)]
    ),
    "torus": problem(ng.Torus(1.0, 0.4), [SOFT] * 2),
    "ellipsoid": problem(ng.Ellipsoid([2, 1, 1]), [FRICTION] * 3),
    "ellipsoid, limited": problem(ng.Ellipsoid([2, 1, 1.5]), [FRICTION] * 3, constraints=[ng.Table(-1)]),
    "prism": problem(
        ng.Prism(TRIANGLE, 1.0), [FRICTION] * 2, constraints=[ng.Obstacle(ng.Sphere(0.5), position=[0, 0, 0.8])]
    ),
    "square, lines": problem(SQUARE, [ng.LineContact(0.2, 0.5), ng.LineContact(0.4)], force_budget="per_finger"),
    "box, pads": problem(ng.Box([2, 1, 1]), [BOX_PAD] * 2),
    "cylinder, pads": problem(ng.Cylinder(1.0, 2.0), [BOX_PAD, LINE], force_budget="per_finger"),
    "ellipsoid, pads": problem(ng.Ellipsoid([2, 1, 1]), [PAD, LINE]),
    "torus, discs": problem(ng.Torus(1.0, 0.4), [ng.PlaneContact(radius=0.1), ng.PlaneContact(0.2, friction=0.5)]),
    "lift": ng.GraspProblem(
        ng.Box([0.08, 0.04, 0.04]), [ng.FrictionContact(0.6)] * 3, ng.lift([0, 0, 0], 0.3) + ng.disturbance(1, 0.01)
    ),
}
ABOVE = 2e-9  # relative: along its directions the task does up to a billionth more than unit work
CURVED = (
    "sphere",
    "sphere by its semi-axes",
    "cylinder",
    "cylinder, mixed",
    "cylinder, all different",
    "torus",
    "ellipsoid",
    "ellipsoid, limited",
    "ellipsoid, shared",
    "cylinder, pads",
    "ellipsoid, pads",
    "torus, discs",
)


def bound_text(name):
    """Return the bound file of one of the problems, from one short search for all tests."""
    path = Path(os.environ["NLPGRASP_CACHE"]) / f"bound of {name}.json"
    if not path.exists():
        seconds = None if name in ("square", "square, limited", "square, hand") else 0.6
        data = ng.best_possible(PROBLEMS[name], gap=0.02, time_limit=seconds).to_dict()
        data["certificate"]["leaves"].sort(key=lambda leaf: -leaf[2])  # the first is what the bound rests on
        write_text(path, json.dumps(data))
    return path.read_text()


def bound_data(name):
    return json.loads(bound_text(name))


def verified(data, tmp_path):
    path = tmp_path / "bound.json"
    path.write_text(json.dumps(data))
    return ng.verify(path)


@pytest.mark.slow
@pytest.mark.parametrize("name", every(4, PROBLEMS))
def test_a_bound_is_computed_again_as_it_is_claimed(name, tmp_path):
    data = bound_data(name)
    verification = verified(data, tmp_path)
    assert verification.passed, str(verification)
    assert verification.not_made == ()
    stated, recomputed = Proof(data["problem"], data["certificate"], SourceFolders()).bounds
    assert np.max(recomputed - stated) <= 1e-12 * np.max(recomputed)
    assert np.max(recomputed) <= data["upper"] * (1.0 + 1e-12)
    assert np.max(recomputed) >= data["upper"] * (1.0 - (0.06 if name in CURVED else ABOVE))
    if name not in CURVED:  # flat cells have nothing to look closer at
        large = recomputed > 0.5 * np.max(recomputed)
        assert np.max(np.abs(stated - recomputed)[large]) <= ABOVE * np.max(recomputed)


@pytest.mark.slow
@pytest.mark.parametrize("name", every(4, CURVED))
def test_a_lower_bound_over_curved_cells_fails(name, tmp_path):
    data = bound_data(name)
    least = np.max(Proof(data["problem"], data["certificate"], SourceFolders()).bounds[1])
    share = 0.93 if data["problem"]["force_budget"] == "l2" else 0.93**2  # bounds on mu^p are equally loose
    data["certificate"]["leaves"][0][2] = data["upper"] = share * min(least, data["upper"])
    verification = verified(data, tmp_path)
    assert {"leaves", "upper"} <= {check.name for check in verification.checks if check.failed}, str(verification)


def share(factor):
    return lambda value: factor * value


def scaled(data):
    data["problem"]["task"]["axes"] = (1.01 * np.array(data["problem"]["task"]["axes"])).tolist()


def without_leaf(data):
    del data["certificate"]["leaves"][0]


def without_root(data):
    del data["certificate"]["groups"][0]["roots"][0]


def without_part(data):
    cut = next(c for c in data["certificate"]["groups"][0]["cuts"] if c[2] is not None)
    cut[2] = None


def in_a_circle(data):
    twins, leaves, motions = (data["certificate"][key] for key in ("twins", "leaves", "motions"))
    motions.append({"rotation": np.eye(2).tolist(), "translation": [0.0, 0.0]})
    cells = leaves.pop(0)[0]
    twins.append([cells, len(motions) - 1, cells])


def other_motion(data):
    motion = data["certificate"]["motions"][0]
    c, s = np.cos(0.01), np.sin(0.01)
    motion["rotation"] = (np.array([[c, -s], [s, c]]) @ motion["rotation"]).tolist()


def other_twin(data):
    twins, leaves = data["certificate"]["twins"], data["certificate"]["leaves"]
    twins[0][2] = leaves[0][0] if leaves[0][0] != twins[0][2] else leaves[1][0]


def loosest(data):
    return max(data["certificate"]["leaves"], key=lambda leaf: leaf[2])


def leaf(i, value):
    return lambda data: put((i,), value)(loosest(data))


def mixture(i, value):
    return lambda data: put((i, 0), value)(data["certificate"]["mixtures"][loosest(data)[1]])


def without_mixtures(data):
    del data["certificate"]["mixtures"]


SQUARE_EDITS = {
    "the bound is lower": (put(("upper",), share(0.999)), "upper"),
    "a leaf's bound is lower": (leaf(2, share(0.999)), "leaves"),
    "a mixture's number": (leaf(1, lambda i: i + 1000), "leaves"),
    "a mixture's number below zero": (leaf(1, -1), "leaves"),
    "a weight": (mixture(1, lambda weight: weight + 0.1), "leaves"),
    "a weight below zero": (mixture(1, share(-1.0)), "leaves"),
    "a direction's number": (mixture(0, lambda i: i + 1), "leaves"),
    "no mixtures": (without_mixtures, "leaves"),
    "a direction": (put(("certificate", "directions", 0, 0), share(1.01)), "directions"),
    "a vertex of a cell": (
        put(("certificate", "groups", 0, "roots", 0, 1, "vertices", 0, 0), share(0.99)),
        "faces covered",
    ),
    "a normal of a cell": (
        put(("certificate", "groups", 0, "roots", 0, 1, "normal"), [0.6, 0.8]),
        "faces covered",
    ),
    "a leaf is left out": (without_leaf, "nodes"),
    "a root is left out": (without_root, "faces covered"),
    "a part of a cell is left out": (without_part, "cuts"),
    "a node rests on itself": (in_a_circle, "nodes"),
    "another motion": (other_motion, "symmetries"),
    "another node in a twin's place": (other_twin, "symmetries"),
    "the task is larger": (scaled, "directions"),
    "the body is larger": (put(("problem", "body", "vertices", 0, 0), -1.01), "faces covered"),
    "more friction": (put(("problem", "contacts", 0, "friction"), 0.51), "alike"),
    "another force budget": (put(("problem", "force_budget"), "per_finger"), "leaves"),
    "another torque origin": (put(("certificate", "origin", 0), 0.01), "symmetries"),
    "something is left out": (put(("dropped",), ["the hand (fingertips)"]), "dropped"),
    "a contact of no group": (put(("certificate", "groups", 0, "contacts"), [0, 1, 1]), "alike"),
    "the grasp's quality": (put(("grasp", "mu"), {"lower": 0.717, "upper": 0.719}), "certified quality"),
    "the grasp's quality above the bound": (
        put(("grasp", "mu"), {"lower": 0.8, "upper": 0.9}),
        "grasp below the bound",
    ),
    "a contact off its face": (put(("grasp", "positions", 0), lambda p: [1.001 * x for x in p]), "grasp"),
    "another face": (put(("grasp", "faces", 0), "edge9"), "grasp"),
    "the gap": (put(("gap",), share(0.9)), "gap"),
    "closed": (put(("closed",), lambda closed: not closed), "gap"),
    "no directions": (put(("certificate", "directions"), []), "leaves"),
    "no cells": (put(("certificate", "groups"), []), "nodes"),
}


@pytest.mark.parametrize("name", SQUARE_EDITS)
def test_an_edit_fails_at_its_check(name, tmp_path):
    edit, check = SQUARE_EDITS[name]
    data = bound_data("square")
    edit(data)
    verification = verified(data, tmp_path)
    assert check in [c.name for c in verification.checks if c.failed], str(verification)


OTHER_EDITS = {
    "hand": ("square, hand", put(("dropped", 0), "the fingers"), "dropped"),
    "table": ("square, limited", put(("problem", "constraints", 0, "height"), -0.95), "faces covered"),
    "forbidden face": ("square, limited", put(("problem", "constraints", 1, "faces"), ["edge1"]), "grasp"),
    "workspace": ("square, limited", put(("problem", "constraints", 2, "region", "upper", 1), 0.3), "faces covered"),
    "radius of fingertips": ("square, hand", put(("problem", "hand", "radius"), 0.01), "faces covered"),
    "hole": ("box, hole", put(("problem", "constraints", 0, "region", "upper", 0), 0.2), "faces covered"),
    "another pad": ("box, pads", put(("problem", "contacts", 1, "extents", 0), 0.31), "alike"),
    "a longer line": ("square, lines", put(("problem", "contacts", 1, "length"), 0.44), "leaves"),
    "a pad's shape": ("box, pads", put(("dropped",), []), "dropped"),
    "extents": ("box", put(("problem", "body", "extents", 0), 2.002), "faces covered"),
    "height": ("cylinder", put(("problem", "body", "height"), 2.01), "turned"),
    "tube": ("torus", put(("problem", "body", "minor_radius"), 0.41), "turned"),
    "semi-axes": ("ellipsoid", put(("problem", "body", "semi_axes", 0), 2.01), "turned"),
    "semi-axes of a cell": (
        "ellipsoid, limited",
        put(("certificate", "groups", 0, "roots", 0, 1, "semi_axes", 0), 1.9),
        "faces covered",
    ),
    "poles of an ellipsoid": ("sphere by its semi-axes", put(("problem", "body", "semi_axes", 0), 1.31), "turned"),
    "pole": ("sphere", put(("problem", "body", "radius"), 1.31), "turned"),
    "task that does not turn": ("sphere", put(("problem", "task", "axes", 0, 0), 1.1), "turned"),
    "constraint that does not turn": (
        "sphere",
        put(("problem", "constraints"), [{"type": "table", "height": -2.0, "clearance": 0.0}]),
        "turned",
    ),
    "turned where it is not": ("box", put(("certificate", "groups", 0, "turned"), "half-plane"), "turned"),
    "torsion": ("box, soft", put(("problem", "contacts", 0, "torsional_friction"), 0.21), "alike"),
}


@pytest.mark.parametrize("name", every(9, OTHER_EDITS))
def test_an_edit_of_another_problem_fails_at_its_check(name, tmp_path):
    which, edit, check = OTHER_EDITS[name]
    data = bound_data(which)
    edit(data)
    verification = verified(data, tmp_path)
    assert check in [c.name for c in verification.checks if c.failed], str(verification)


@pytest.mark.parametrize("value", [None, 0.0, "none", []], ids=str)
def test_a_shared_bound_with_other_thresholds_fails(value, tmp_path):
    data = bound_data("ellipsoid, shared")
    thresholds = data["certificate"]["thresholds"]
    assert max(thresholds) > 0.0
    data["certificate"]["thresholds"] = [] if value == [] else [value] * len(thresholds)
    assert not verified(data, tmp_path).passed


def test_thresholds_do_not_lower_a_bound_under_another_budget(tmp_path):
    data = bound_data("square")
    leaves, thresholds = data["certificate"]["leaves"], [0.0] * len(data["certificate"]["mixtures"])
    data["upper"] *= 0.998
    for leaf in leaves:
        thresholds[leaf[1]] = -0.01 if leaf[2] > 0.0 else 0.0
        leaf[2] *= 0.998
    data["certificate"]["thresholds"] = thresholds
    failed = [check.name for check in verified(data, tmp_path).checks if check.failed]
    assert {"leaves", "upper"} <= set(failed)


def test_a_shared_bound_without_its_thresholds_fails(tmp_path):
    data = bound_data("ellipsoid, shared")
    data["certificate"].pop("thresholds")
    assert not verified(data, tmp_path).passed


def test_a_bound_that_nothing_recomputes_is_not_verified(tmp_path):
    data = bound_data("square")
    data["problem"]["body"] = {"type": "planar_implicit", "bounds": [[-2, -2], [2, 2]]}
    verification = verified(data, tmp_path)
    assert "faces covered" in [check.name for check in verification.not_made]
    assert "bound" in [check.name for check in verification.checks if check.failed]


@pytest.mark.parametrize("schema", ["nlpgrasp-bound/2", "nlpgrasp-bound/"])
def test_another_version_is_refused(schema, tmp_path):
    data = bound_data("square") | {"schema": schema}
    with pytest.raises(ng.InputError, match="schema"):
        verified(data, tmp_path)


def test_a_file_without_its_certificate_is_refused(tmp_path):
    data = bound_data("square")
    del data["certificate"]
    with pytest.raises(ng.InputError, match="no certificate"):
        verified(data, tmp_path)


def test_a_solution_file_holds_its_bound(tmp_path):
    best = bound_of_square()
    solution = with_bound(tmp_path, best.kept(), best.upper)
    checks = {check.name: check for check in ng.verify(solution).checks}
    assert checks["bound, leaves"].passed
    assert checks["bound, upper"].passed
    assert all(check.passed for name, check in checks.items() if name.startswith("bound"))
    low = {c.name for c in ng.verify(with_bound(tmp_path, best.kept(), 0.999 * best.upper)).checks if c.failed}
    assert low == {"bound, upper"}


def test_a_solution_file_names_its_bound(tmp_path):
    best = bound_of_square()
    file = best.save(tmp_path / "square.bound.json")
    solution = with_bound(tmp_path, best.kept(file), best.upper)
    assert ng.verify(solution).passed
    file.write_text(file.read_text().replace('"asked"', '"Asked"'))
    assert "bound" in [check.name for check in ng.verify(solution).checks if check.failed]
    file.unlink()
    assert "bound" in [check.name for check in ng.verify(solution).not_made]


def test_a_bound_without_certificate_is_not_verified(tmp_path):
    solution = with_bound(tmp_path, {}, 2.0)
    assert "bound" in [check.name for check in ng.verify(solution).not_made]


def bound_of_square():
    return ng.BestPossible.from_dict(bound_data("square"))


def with_bound(tmp_path, certificate, upper):
    """Return the file of a solution of the square that states this bound."""
    solution = solve_once(PROBLEMS["square"], 1, GRASP)
    bound = GlobalBound(upper, 10, (), certificate)
    return replace(solution, bound=bound).save(tmp_path / "solution.json")
