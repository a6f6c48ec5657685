"""Warnings of meshes far from their smoothed surface, with advised values."""

import re
import warnings

import pytest
import trimesh

import nlpgrasp as ng
from nlpgrasp.common import user_warnings as once
from nlpgrasp.problem.checks import warn_of_smoothing


@pytest.fixture(autouse=True)
def clear_warnings(monkeypatch):
    monkeypatch.setattr(once, "_issued", set())


def warning_texts(body, hand=None):
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        warn_of_smoothing(body, hand)
        warn_of_smoothing(body, hand)
    return [str(warning.message) for warning in caught]


def plate(**options):
    return ng.Mesh(trimesh.creation.box([0.06, 0.05, 0.01]), **options)


def test_a_spoiled_wall_is_told_once_with_the_cure():
    (text,) = warning_texts(plate(smoothing=1.5, resolution=12))
    assert re.match(r"the mesh: the smooth surface that the solver works on is \S+ mm or more off a fifth of the", text)
    smoothing, resolution = re.search(r"walls 10 mm thick: .* smoothing=(\S+), resolution=(\d+)$", text).groups()
    assert warning_texts(plate(smoothing=float(smoothing), resolution=int(resolution))) == []


def test_a_small_fingertip_is_told():
    body = plate(smoothing=1.5, resolution=36)
    assert warning_texts(body, ng.Fingertips(3, radius=0.01, reach=0.1)) == []
    (text,) = warning_texts(body, ng.Fingertips(3, radius=0.0001, reach=0.1))
    assert "a fingertip of 0.1 mm radius: ng.Mesh takes smoothing=" in text


def test_where_the_choice_is_the_best_known_a_finer_grid_is_named(monkeypatch):
    body = plate(smoothing=0.25, resolution=24)
    monkeypatch.setattr("nlpgrasp.problem.checks.WALL", 1e-4)
    (text,) = warning_texts(body)
    assert text.endswith("smoothing=0.25, resolution=36")


def test_other_bodies_have_no_smooth_surface():
    assert warning_texts(ng.Sphere(0.03)) == []


@pytest.mark.slow
def test_a_sheet_of_a_tenth_of_a_millimetre_is_solved_with_a_warning():
    """Where the program of a sheet ends without a number, the answer is a sentence all the same."""
    sheet = ng.Mesh(trimesh.creation.box([0.1, 0.1, 1e-4]))
    task = ng.TaskEllipsoid([1.0, 1.0, 1.0, *[0.0035] * 3])
    problem = ng.GraspProblem(sheet, [ng.SoftContact(0.6, 0.0005)] * 2, task)
    options = ng.SolveOptions(workers=1, global_bound=False, rounds=1)
    with pytest.warns(
        UserWarning, match=r"much beside walls 0\.1 mm thick: no grid suits walls below 0\.5 mm; ng\.ParallelJaw"
    ):
        solution = ng.solve(problem, starts=1, options=options)
    assert solution.success or solution.why_not
    assert solution.success or "at once: ." not in str(solution.why_not)
