"""What a quick solve leaves out, added later."""

import json
from dataclasses import replace

import numpy as np
import pytest
import trimesh

import nlpgrasp as ng
from tests.hands.urdf import four_finger_hand

MADE = ("delta", "nu", "robust")
CONTACTS = [ng.FrictionContact(0.6)] * 3


def box(**more):
    task = ng.TaskEllipsoid([1.0, 1.0, 1.0, 0.03, 0.03, 0.03])
    return ng.GraspProblem(ng.Box([0.08, 0.05, 0.04]), CONTACTS, task, constraints=[ng.Table(-0.015)], **more)


def quick_and_whole(problem):
    return [ng.solve(problem, 1, options=ng.SolveOptions(workers=1, extras=extras)) for extras in (False, True)]


def test_from_the_file_alone_all_is_added_as_a_whole_solve_finds_it(tmp_path):
    quick, whole = quick_and_whole(box())
    path = quick.save(tmp_path / "box.json")
    found = ng.with_extras(ng.GraspSolution.load(path))
    for name in MADE:
        assert str(getattr(found, name)) == str(getattr(whole, name)) != "None"
    np.testing.assert_allclose(found.drawing.body.vertices, whole.drawing.body.vertices)
    mine, theirs = ({p.name: p.gain for p in s.prices} for s in (found, whole))
    assert mine.keys() == theirs.keys() != set()
    assert mine == pytest.approx(theirs, rel=0.05, abs=1e-3)
    assert ng.verify(found.save(path))
    again = ng.GraspSolution.load(path)
    assert ng.with_extras(again).to_dict() == again.to_dict()


@pytest.mark.slow
def test_a_mesh_and_a_hand_need_the_problem(tmp_path):
    trimesh.creation.box(extents=[0.08, 0.05, 0.04]).export(tmp_path / "box.stl")
    body = ng.Mesh.load(tmp_path / "box.stl", unit="m", resolution=16)
    problem = replace(box(), body=body, constraints=[])
    quick = ng.solve(problem, 1, options=ng.SolveOptions(workers=1, extras=False))
    alone, helped = ng.with_extras(quick), ng.with_extras(quick, problem)
    assert alone.delta is not None
    assert alone.nu is not None
    assert (alone.robust, alone.drawing, alone.prices) == (None, None, ())
    assert (helped.delta, helped.nu) == (alone.delta, alone.nu)
    assert 0.0 <= helped.robust.mu.lower <= helped.mu.upper
    assert len(helped.drawing.body.faces) == 12


@pytest.mark.slow
def test_of_a_hand_the_depth_of_its_links_too():
    task = ng.TaskEllipsoid([1.0, 1.0, 1.0, 0.03, 0.03, 0.03])
    problem = ng.GraspProblem(ng.Sphere(0.03), ng.FrictionContact(0.7), task, hand=four_finger_hand())
    quick, whole = quick_and_whole(problem)
    assert quick.hand["link_depth"] == pytest.approx(whole.hand["link_depth"])  # never left out
    found = ng.with_extras(quick, problem)
    assert found.hand["link_depth"] == pytest.approx(whole.hand["link_depth"])
    assert len(found.drawing.links) == len(whole.drawing.links) > 10
    assert found.robust.mu.lower == pytest.approx(whole.robust.mu.lower, rel=0.02)
    assert ng.with_extras(quick).drawing is None


@pytest.mark.parametrize(
    ("part", "changed"),
    [
        ("body", {"body": ng.Box([0.08, 0.05, 0.05])}),
        ("contacts", {"contacts": [ng.FrictionContact(0.5)] * 3}),
        ("task", {"task": ng.TaskEllipsoid([1.0, 1.0, 2.0, 0.03, 0.03, 0.03])}),
        ("constraints", {"constraints": []}),
        ("hand", {"hand": ng.Fingertips(3, radius=0.004)}),
    ],
)
def test_another_problem_is_refused(part, changed):
    quick = ng.solve(box(), 1, options=ng.SolveOptions(workers=1, extras=False))
    with pytest.raises(ng.InputError, match=rf"problem\.{part}: got another than the solution's"):
        ng.with_extras(quick, replace(box(), **changed))


def test_without_a_grasp_nothing_is_added():
    problem = replace(box(), contacts=[ng.FrictionContact(0.6)])
    found = ng.solve(problem, 1, options=ng.SolveOptions(workers=1, extras=False))
    assert found.grasp is None
    assert json.dumps(ng.with_extras(found).to_dict()) == json.dumps(found.to_dict())
