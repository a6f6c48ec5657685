"""Drawings: triangles as data, sizes, pictures by matplotlib."""

import sys

import numpy as np
import pytest
from matplotlib import pyplot as plt

from nlpgrasp.common.drawing import Drawing, Triangles, drawing_size
from nlpgrasp.common.optional_packages import draw_triangles, import_mujoco, pyplot, show_at_one_scale, write_figure
from nlpgrasp.errors import InputError, MissingExtraError

CORNERS = np.array([[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [0.0, 2.0, 0.0], [0.0, 0.0, 1.0]])
TETRAHEDRON = Triangles(CORNERS, np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]))


def test_size_is_half_the_diagonal_of_what_there_is():
    assert drawing_size(Drawing(TETRAHEDRON), np.zeros((1, 3))) == pytest.approx(1.5)
    assert drawing_size(None, np.array([[0.0, 0.0], [3.0, 4.0]])) == pytest.approx(2.5)
    assert drawing_size(None, None) == 1.0


def test_data_returns_the_drawing():
    drawing = Drawing(TETRAHEDRON, (("thumb", TETRAHEDRON),))
    restored = Drawing.from_dict(drawing.to_dict(), "drawing")
    assert np.array_equal(restored.body.vertices, CORNERS)
    assert restored.links[0][0] == "thumb"
    assert np.array_equal(restored.links[0][1].faces, TETRAHEDRON.faces)


def test_faces_that_name_no_vertex_are_refused():
    data = TETRAHEDRON.to_dict() | {"faces": [[0, 1, 4]]}
    with pytest.raises(InputError, match="numbers that name no vertex, expected whole numbers below 4"):
        Triangles.from_dict(data, "body")


def test_triangles_that_face_the_light_are_brighter(tmp_path):
    figure = plt.figure()
    ax = figure.add_subplot(projection="3d")
    draw_triangles(ax, TETRAHEDRON, "#808080", 1.0)
    show_at_one_scale(ax, CORNERS)
    reds = ax.collections[0].get_facecolor()[:, 0]
    slope = 0.65 + 0.35 * (0.4 + 0.3 + 2 * 0.85) / np.sqrt(6.0 * (0.4**2 + 0.3**2 + 0.85**2))
    bottom = 0.65 - 0.35 * 0.85 / np.sqrt(0.4**2 + 0.3**2 + 0.85**2)
    assert max(reds) == pytest.approx(slope * 128 / 255)
    assert min(reds) == pytest.approx(bottom * 128 / 255)
    assert np.ptp(ax.get_xlim()) == pytest.approx(np.ptp(ax.get_zlim()))
    path = write_figure(figure, tmp_path / "body.png")
    assert path.read_bytes().startswith(b"\x89PNG")
    assert not plt.fignum_exists(figure.number)


def test_missing_packages_name_their_extra(monkeypatch):
    monkeypatch.setitem(sys.modules, "mujoco", None)
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    with pytest.raises(MissingExtraError, match=r"nlpgrasp\[sim\]"):
        import_mujoco("a simulation")
    with pytest.raises(MissingExtraError, match=r"nlpgrasp\[viz\]"):
        pyplot("a picture")
