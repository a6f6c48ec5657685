"""Colours of the body by marginal bounds, from a solution file alone."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh

import nlpgrasp as ng
from nlpgrasp.global_bound.marginal_bound import MarginalBound
from nlpgrasp.report import write_report
from nlpgrasp.report.solution_sections import (
    COLOUR_SCALE,
    FORBIDDEN_COLOUR,
    _interpolate_colour,
    colour_by_marginal_bound,
    marginal_colours,
)

ONE = ng.SolveOptions(workers=1, analyses=["drawing"])
BOX = ng.GraspProblem(
    ng.Box([0.08, 0.04, 0.04]),
    [ng.FrictionContact(0.6)] * 3,
    ng.lift([0, 0, 0], 0.3) + ng.disturbance(1.0, 0.01),
    constraints=[ng.Forbid("+x")],
)


@pytest.fixture(scope="module")
def loaded(tmp_path_factory):
    path = ng.solve(BOX, starts=1, options=ONE).save(tmp_path_factory.mktemp("worth") / "box.json")
    return ng.GraspSolution.load(path)


def coloured_middles(solution):
    """Colours of the triangles, and their middles."""
    corners, colours = marginal_colours(solution)
    return np.array(colours), corners.mean(axis=1)


@pytest.mark.slow
def test_a_face_that_no_contact_may_be_on_is_grey(loaded):
    colours, middles = coloured_middles(loaded)
    x = middles[:, 0]
    assert len(colours) == len(x) >= 1500  # the box itself is drawn with 16
    assert set(colours[x > 0.0399]) == {FORBIDDEN_COLOUR}
    assert FORBIDDEN_COLOUR not in colours[x < -0.0399]


@pytest.mark.slow
def test_the_brightest_triangles_are_worth_most(loaded):
    """By the problem itself, at points of the sides that the file knows nothing of."""
    colours, at = coloured_middles(loaded)
    side = (at[:, 1] > 0.0199) & (np.abs(at[:, 0]) < 0.038)
    exact = MarginalBound.of(BOX).at(at[side], np.tile([0.0, -1.0, 0.0], (np.sum(side), 1)))
    brightness = [sum(int(c[i : i + 2], 16) for i in (1, 3, 5)) for c in colours[side]]
    assert np.corrcoef(exact, brightness)[0, 1] > 0.99


@pytest.mark.slow
def test_a_mesh_is_coloured_by_what_is_drawn_of_it(tmp_path):
    """A ball: every place is worth the same to a task without a direction, but for the mesh's own corners."""
    ball = ng.Mesh(trimesh.creation.icosphere(subdivisions=3, radius=0.03))
    problem = ng.GraspProblem(ball, [ng.FrictionContact(0.6)] * 4, ng.TaskEllipsoid([1, 1, 1, 0.03, 0.03, 0.03]))
    path = ng.solve(problem, starts=1, options=ONE).save(tmp_path / "ball.json")
    colours = coloured_middles(ng.GraspSolution.load(path))[0]
    red = np.array([int(c[1:3], 16) for c in colours])
    assert len(colours) > 500
    assert np.min(red) > int(_interpolate_colour(0.8)[1:3], 16)


def test_no_colours_where_no_bound_covers_the_problem(loaded):
    assert colour_by_marginal_bound(replace(loaded, bound=None)) is None
    assert colour_by_marginal_bound(replace(loaded, drawing=None)) is None


@pytest.mark.parametrize(
    ("share", "colour"),
    [(0.0, COLOUR_SCALE[0]), (1.0, COLOUR_SCALE[-1]), (0.2, COLOUR_SCALE[1]), (np.nan, FORBIDDEN_COLOUR)],
)
def test_shares_have_the_scales_colours(share, colour):
    assert _interpolate_colour(share) == colour


@pytest.mark.slow
def test_the_page_says_how_far_the_best_can_be(loaded, tmp_path):
    text = write_report({"box": loaded}, tmp_path / "box.html").read_text()
    assert "no placement is more than" in text
    assert "Where a contact is worth most" in text
    without = write_report({"box": replace(loaded, bound=None)}, tmp_path / "none.html").read_text()
    assert 'data-show="worth"' not in without
