"""Pages and notebook cards of bodies: face labels, frame, extents."""

import json
import re
from html import unescape
from pathlib import Path

import numpy as np
import pytest
import trimesh

import nlpgrasp as ng
from nlpgrasp.common import display as face
from nlpgrasp.errors import InputError
from nlpgrasp.report.body_page import body_figures, body_scene
from tests.samples import BODIES

FILES = Path(__file__).parents[1] / "solution" / "files"


def page_in_frame(html):
    """The page inside a notebook's frame, and its data."""
    (source,) = re.findall(r'<iframe srcdoc="([^"]*)"', html)
    page = unescape(source)
    return page, json.loads(re.search(r'<script type="application/json">(.*?)</script>', page, re.DOTALL)[1])


def plain(text):
    """The text with plain spaces."""
    return text.replace("\N{NO-BREAK SPACE}", " ")


@pytest.mark.parametrize("name", ["cylinder", "box", "prism", "polygon"])
def test_each_face_is_named_at_a_point_of_its_own(name):
    body = BODIES[name]
    labels = body_scene(body)["contacts"]
    assert [label["label"] for label in labels] == list(body.face_names)
    for label in labels:
        at = np.array([label["at"]])[:, : body.space]
        h, slope, outward, extent = body.evaluate(label["label"], at)
        assert abs(h[0] / slope[0]) <= 0.01 * body.size
        assert extent[0] <= 0.01 * body.size
        assert np.dot(label["inward"][: body.space], outward[0]) < -0.9


def test_a_body_of_one_face_has_no_labels():
    assert body_scene(BODIES["sphere"])["contacts"] == []


def test_the_page_says_how_large_the_body_is(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(face, "has_display", lambda: False)
    page = ng.Box([0.08, 0.04, 0.03]).show(tmp_path / "box.html")
    assert capsys.readouterr().out == f"No browser was opened; the page is {page}\n"
    text = page.read_text(encoding="utf-8")
    assert "80 \N{MULTIPLICATION SIGN} 40 \N{MULTIPLICATION SIGN} 30" in text
    assert (
        "<code>+x</code>, <code>-x</code>, <code>+y</code>, <code>-y</code>, <code>+z</code>, <code>-z</code>" in text
    )
    assert "http" not in re.sub(r"http://www.w3.org\S*", "", text)


def test_the_bounds_are_named_with_the_table_under_them():
    body = ng.Prism([[-0.045, -0.029], [0.0473, -0.029], [0.0473, 0.029], [-0.045, 0.029]], 0.095)
    bounds = next(fact for fact in body_figures(body) if fact.title == "Bounds")
    assert plain(bounds.value) == "x -45 to 47.3 mm, y -29 to 29 mm, z -47.5 to 47.5 mm"
    assert "A table under it: <code>ng.Table(-0.0475)</code>" in bounds.more
    flat = next(fact for fact in body_figures(ng.Polygon([[0, 0], [0.03, 0], [0, 0.04]])) if fact.title == "Bounds")
    assert plain(flat.value) == "x 0 to 30 mm, y 0 to 40 mm"
    assert "ng.Table(0)" in flat.more


def test_a_table_under_a_mesh_is_where_the_mesh_ends(tmp_path):
    cup = trimesh.creation.cylinder(0.02, 0.0951)
    cup.apply_translation([0.0, 0.0, 0.04755 + 1e-9])
    cup.export(tmp_path / "cup.stl")
    body = ng.Mesh.load(tmp_path / "cup.stl", resolution=16)
    bounds, surface = (
        next(f for f in body_figures(body) if f.title == title) for title in ("Bounds", "Smooth surface")
    )
    assert "z 0 to 95.1 mm" in plain(bounds.value)
    assert "ng.Table(0)" in bounds.more
    assert re.fullmatch(r"within [\d.]+ mm of the mesh over 80 % of it", surface.value)


@pytest.mark.parametrize("name", [name for name in BODIES if "implicit" not in name])  # whose bounds are wide
def test_axes_are_drawn_at_the_origin_and_stick_out(name):
    body = BODIES[name]
    drawn = body_scene(body)
    axes = drawn["axes"]
    high = body.bounds[1]
    assert axes["at"] == [0.0, 0.0, 0.0]
    for i, end in enumerate(axes["ends"]):
        assert [v for j, v in enumerate(end) if j != i] == [0.0, 0.0]
        assert end[i] >= max(high[i], 0.0) + 0.2 * drawn["size"]
    assert len(axes["ends"]) == body.space
    assert all(end in drawn["frame"] for end in axes["ends"])


def test_an_origin_far_away_leaves_the_axes_at_the_bodys_corner():
    mesh = trimesh.creation.box([0.08, 0.04, 0.03])
    mesh.apply_translation([0.5, 0.2, -0.3])
    body = ng.Mesh(mesh, resolution=16)
    axes, bounds = body_scene(body)["axes"], next(fact for fact in body_figures(body) if fact.title == "Bounds")
    assert axes["at"] == pytest.approx([0.46, 0.18, -0.315])
    assert np.subtract(axes["ends"], axes["at"]) * (1.0 - np.eye(3)) == pytest.approx(np.zeros((3, 3)))
    assert "drawn at the body's corner, as its origin is far away" in bounds.more
    assert "ng.Table(-0.315)" in bounds.more


def test_the_box_of_an_implicit_body_says_nothing_of_a_table():
    bounds = next(fact for fact in body_figures(BODIES["implicit"]) if fact.title == "Bounds")
    assert "of the box that was stated" in bounds.more
    assert "ng.Table" not in bounds.more


def test_the_axes_are_on_at_first():
    for page in (page_in_frame(BODIES["box"]._repr_html_())[0], page_in_frame(BODIES["polygon"]._repr_html_())[0]):
        assert '<input type="checkbox" data-show="triad" checked><span>Axes</span>' in page


def test_a_body_in_millimetres_is_doubted():
    size, *_ = body_figures(ng.Box([80, 40, 30]))
    assert (size.tone, "lengths are metres" in size.lines[0]) == ("weak", True)


def test_the_page_of_a_mesh_says_what_was_mended(tmp_path, monkeypatch):
    monkeypatch.setattr(face, "has_display", lambda: False)
    trimesh.creation.box([0.08, 0.04, 0.03]).export(tmp_path / "part.stl")
    body = ng.Mesh.load(tmp_path / "part.stl", resolution=16)
    text = body.show(tmp_path / "part.html").read_text(encoding="utf-8")
    assert '<h1 id="name">part.stl</h1>' in text
    assert "12 triangles" in text
    assert "walls: 30\N{NO-BREAK SPACE}mm; smoothing=1.5, resolution=16" in text


def test_a_path_that_cannot_be_written_is_refused(tmp_path):
    with pytest.raises(InputError, match=r"show\.path: got .* \(no folder"):
        ng.Sphere(0.03).show(tmp_path / "no" / "body.html")


def test_a_body_in_a_notebook_is_one_frame():
    page, data = page_in_frame(ng.Box([0.08, 0.04, 0.03])._repr_html_())
    assert page.startswith("<!doctype html>")
    assert len(data["scenes"][0]["contacts"]) == 6


def test_a_solution_in_a_notebook_is_the_scene_with_its_slider():
    solution = ng.GraspSolution.load(FILES / "box.json")
    page, data = page_in_frame(solution._repr_html_())
    assert len(data["labels"]) == len(data["scenes"][0]["arrows"]) > 6
    assert f'max="{len(data["labels"]) - 1}"' in page
    assert "the task takes" in page


def test_a_solution_without_a_grasp_is_shown_too():
    solution = ng.GraspSolution.load(FILES / "none.json")
    page, data = page_in_frame(solution._repr_html_())
    assert "no grasp" in page
    assert data["labels"] == []
