"""Descriptions of a problem: line, lines, page, notebook."""

import json
import re
from html import unescape

import numpy as np
import pytest
import trimesh

import nlpgrasp as ng
from nlpgrasp.common import display as face
from nlpgrasp.problem.description import TIMES, usable_faces
from nlpgrasp.report.body_page import problem_scene

BOX = ng.Box([0.08, 0.04, 0.03])
WALL = ng.Obstacle(ng.Box([0.02, 0.06, 0.08]), position=[0.08, 0, 0.02], name="<wall>")


def problem(**changes):
    parts = {
        "contacts": [ng.FrictionContact(0.6), ng.FrictionContact(0.6), ng.SoftContact(0.5, 0.004, faces=["+y"])],
        "task": ng.TaskEllipsoid([5, 5, 10, 0.2, 0.2, 0.2]),
        "constraints": [ng.Table.under(BOX), ng.Forbid(["+x"]), WALL],
        "hand": ng.Fingertips(3, 0.006),
        "name": "a <box>",
        **changes,
    }
    return ng.GraspProblem(BOX, **parts)


def lines_of(grasp_problem):
    return str(grasp_problem).replace(TIMES, "x").splitlines()


def test_it_prints_its_parts():
    assert lines_of(problem(max_force=15)) == [
        "a <box>, what is asked:",
        "  body: 80 x 40 x 30 mm; Box(extents=(0.08, 0.04, 0.03))",
        "  contacts: 3",
        "    2 x FrictionContact(friction=0.6), on -x, +y, -y, +z",
        "    1 x SoftContact(friction=0.5, torsional_friction=0.004, model='box'), on +y",
        "  task: exert f_x, f_y ±5 N; f_z ±10 N; m_x, m_y, m_z ±0.2 N m; "
        "moments about [0, 0, 0] mm, the body's centroid",
        "  hand: 3 fingertips; Fingertips(count=3, radius=0.006, spread=None, reach=None)",
        "  constraints: 3",
        "    Table(height=-0.015, clearance=0.0005)",
        "    Forbid(faces_or_region=('+x',))",
        "    Obstacle(body=Box(extents=(0.02, 0.06, 0.08)), clearance=0.0, position="
        "(0.08, 0.0, 0.02), quaternion=None, name='<wal...",
        "  edge margin: 3 mm; contacts stay that far away from sharp edges",
        "  force budget: l2",
        "    counts the L2 norm of all finger forces",
        "    max_force: no finger is to press harder than 15 N",
    ]


def test_its_repr_is_a_short_line():
    assert repr(problem()) == "GraspProblem('a <box>': Box, 3 contacts, Fingertips, TaskEllipsoid)"
    minimal = ng.GraspProblem(ng.Sphere(0.03), [ng.FrictionContact(0.5)], ng.TaskEllipsoid([1.0] * 6))
    assert repr(minimal) == "GraspProblem('grasp': Sphere, 1 contact, TaskEllipsoid)"


def test_a_body_that_is_less_than_its_box_says_so():
    ball = ng.Implicit(lambda p: p.T @ p - 0.03**2, [[-0.05] * 3, [0.05] * 3])
    grasp_problem = ng.GraspProblem(
        ball, [ng.FrictionContact(0.5)] * 3, ng.TaskEllipsoid([1.0] * 6), torque_origin=[0, 0, 0.02]
    )
    lines = lines_of(grasp_problem)
    bounds = "[[-0.05, -0.05, -0.05], [0.05, 0.05, 0.05]]"
    assert lines[1] == f"  body: within 100 x 100 x 100 mm; Implicit(h=<lambda>, bounds={bounds})"
    assert "; moments about [0, 0, 20] mm" in lines[3]
    assert "  constraints: none" in lines


@pytest.mark.parametrize(
    ("height", "faces"),
    [
        (-0.02, {"+x", "-x", "+y", "-y", "+z", "-z"}),
        (-0.015, {"+x", "-x", "+y", "-y", "+z"}),  # the lower side stands on it
        (0.0, {"+x", "-x", "+y", "-y", "+z"}),
    ],
)
def test_faces_that_stand_on_a_table_are_none_for_contacts(height, faces):
    grasp_problem = problem(contacts=[ng.FrictionContact(0.6)] * 3, constraints=[ng.Table(height)])
    assert set(usable_faces(grasp_problem)) == faces
    assert {label["label"] for label in problem_scene(grasp_problem)["contacts"]} == faces


def test_tables_and_obstacles_are_in_the_scene():
    scene = problem_scene(problem())
    assert [(part["group"], part["name"]) for part in scene["parts"]] == [("body", "body"), ("obstacle", "<wall>")]
    assert scene["tables"][0]["at"] == pytest.approx([0.0, 0.0, -0.015])
    assert scene["unseen"] == []
    assert np.max(scene["frame"], axis=0)[0] == pytest.approx(0.09)  # the wall's far side is in the picture
    box = trimesh.creation.box([0.02, 0.02, 0.02])
    with_mesh = problem(constraints=[ng.Obstacle(ng.Mesh(box, resolution=12), position=[0.1, 0, 0])])
    assert [part["group"] for part in problem_scene(with_mesh)["parts"]] == ["body", "obstacle"]


def test_a_planar_problem_has_its_table_from_aside():
    plate = ng.Polygon([[-0.03, -0.02], [0.03, -0.02], [0.03, 0.02], [-0.03, 0.02]])
    task = ng.TaskEllipsoid([1, 1, 0.03])
    scene = problem_scene(ng.GraspProblem(plate, [ng.FrictionContact(0.5)] * 2, task, constraints=[ng.Table(-0.02)]))
    assert [part["group"] for part in scene["parts"]] == ["body", "table"]
    assert {label["label"] for label in scene["contacts"]} == {"edge1", "edge2", "edge3"}


def test_its_page_opens_from_disk_and_quotes_what_was_given(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(face, "has_display", lambda: False)
    page = problem().show(tmp_path / "asked.html")
    assert capsys.readouterr().out == f"No browser was opened; the page is {page}\n"
    text = page.read_text(encoding="utf-8")
    assert '<h1 id="name">a &lt;box&gt;</h1>' in text
    assert "on -x, +y, -y, +z</p>" in text  # names to be copied: with signs as they are written
    assert "http" not in re.sub(r"http://www.w3.org\S*", "", text)
    with pytest.raises(ng.InputError, match=r"^show\.path: got .*no folder"):
        problem().show(tmp_path / "none" / "asked.html")


def test_a_notebook_shows_the_scene_and_the_task():
    (source,) = re.findall(r'<iframe srcdoc="([^"]*)"', problem()._repr_html_())
    page = unescape(source).replace("\N{NO-BREAK SPACE}", " ")
    assert "exert f_x, f_y ±5 N" in page
    data = json.loads(re.search(r'<script type="application/json">(.*?)</script>', page, re.DOTALL)[1])
    assert data["scenes"][0]["tables"]
