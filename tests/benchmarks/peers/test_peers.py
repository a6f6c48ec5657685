"""The study of peers on one body, with what needs no further package, and its answers evaluate again."""

import csv

import numpy as np
import pytest

import nlpgrasp as ng
from benchmarks.peers import antipodal, by_slsqp, call, ours, random_search
from benchmarks.peers.cases import BALL, CASES, Case
from benchmarks.peers.epsilon import epsilon, least_reach, pyramid_wrenches
from benchmarks.peers.judge import evaluate
from benchmarks.peers.results import COLUMNS, append, read, write_header
from benchmarks.peers.run import run
from benchmarks.peers.surface import face_functions
from benchmarks.peers.tables import BEGIN, END, by_body, by_method, write_block
from benchmarks.peers.with_drake import _Balance, _Cones

PEBBLE = CASES["pebble"]


@pytest.mark.slow
def test_a_run_writes_a_row_a_method_whose_mu_is_that_of_the_package(tmp_path):
    path, said = tmp_path / "peers.csv", []
    run(path, ["pebble"], ["random_search"], starts=1, budget=0.01, say=said.append)  # one batch in a cold process
    with path.open(newline="") as file:
        lines = list(csv.DictReader(file))
    assert tuple(lines[0]) == COLUMNS
    assert [line["method"] for line in lines] == ["random search", "random search, 10x"]
    assert len(said) == 3
    for line in lines:
        points = np.array([[float(x) for x in p.split()] for p in line["points"].split(";")])
        inward = -PEBBLE.body.evaluate("surface", points)[2]
        grasp = ng.Grasp(points, inward, PEBBLE.contacts, torque_origin=PEBBLE.body.centroid)
        assert float(line["mu"]) == pytest.approx(ng.mu(grasp, PEBBLE.task).lower, rel=1e-5)
        assert float(line["mu"]) > 0.0


@pytest.mark.slow
def test_methods_without_further_packages_hold_a_cube():
    for method in (ours, by_slsqp, antipodal):
        (answer,) = method.answers(CASES["cube"], 1, 0.0)
        row = evaluate(CASES["cube"], answer)
        assert row.points.shape == (2, 3), row.note
        assert (row.mu > 0.0) == (row.note == "")
        assert row.method == method.NAME
        if method is not by_slsqp:  # which may end where its directions mislead it
            assert row.mu > 0.1


def test_the_epsilon_of_a_ball_is_below_the_exact_one_and_its_bound_above():
    case = Case("ball", lambda: ng.Sphere(0.03), 4, BALL)
    start = random_search.start_placement(case, 0)
    wrenches = pyramid_wrenches(case, start.points[None], start.normals[None])
    grasp = ng.Grasp(start.points, start.normals, case.contacts)
    exact = ng.delta(grasp, torque_scale=case.body.size, rtol=1e-3, force_budget="shared")
    pyramids = ng.ferrari_canny(grasp, 8, case.body.size)
    assert epsilon(wrenches[0]) == pytest.approx(pyramids, rel=1e-9)
    assert pyramids <= exact.upper
    assert least_reach(wrenches)[0] >= epsilon(wrenches[0])
    judge = evaluate(case, random_search.Answer("start", start.points, start.faces, 0.0))
    assert judge.epsilon == pytest.approx(exact.lower, rel=0.011)


def test_what_leaves_the_body_is_worth_nothing():
    points = 1.01 * random_search.start_placement(PEBBLE, 0).points
    row = evaluate(PEBBLE, random_search.Answer("lifted", points, ("surface",) * 2, 0.0))
    assert (row.mu, row.epsilon) == (0.0, 0.0)
    assert "off the body" in row.note


def test_derivatives_of_faces_are_those_of_differences():
    for name in ("cylinder", "torus"):
        body = CASES[name].body
        face = body.face_names[0]
        point = body.sample(face, 1, np.random.default_rng(0))[0] / body.size
        (function,) = face_functions(body, [face])
        *_, dd, dn, de = function.derivatives(point)
        for i, step in enumerate(1e-6 * np.eye(3)):
            up, down = function.values(point + step), function.values(point - step)
            for slope, after, before in zip((dd, dn, de), up, down, strict=True):
                np.testing.assert_allclose(slope[:, i], (np.ravel(after) - np.ravel(before)) / 2e-6, atol=1e-5)


def test_an_antipodal_pair_is_in_both_cones():
    points, normals = antipodal.antipodal_pairs(CASES["torus"], np.random.default_rng(0))
    line = points[:, 1] - points[:, 0]
    line /= np.linalg.norm(line, axis=1, keepdims=True)
    least = np.cos(np.arctan(0.5)) - 1e-9
    assert len(points) > 10
    assert np.all(np.sum(line * normals[:, 0], axis=1) >= least)
    assert np.all(np.sum(-line * normals[:, 1], axis=1) >= least)


def test_a_missing_package_is_said_and_left_out(tmp_path, monkeypatch):
    monkeypatch.setitem(call.METHODS, "with_drake", "no_such_package")
    said = []
    run(tmp_path / "peers.csv", ["pebble"], ["with_drake"], say=said.append)
    assert said[0] == "with_drake: left out, no no_such_package here"
    assert read(tmp_path / "peers.csv") == []


def test_tables_name_every_method_and_body(tmp_path):
    write_header(tmp_path / "peers.csv")
    (answer,) = antipodal.answers(PEBBLE, 1, 0.0)
    append(tmp_path / "peers.csv", PEBBLE, evaluate(PEBBLE, answer))
    rows = read(tmp_path / "peers.csv")
    assert "| antipodal sampler | 1 of 1 | 100% (100%) | 1 | 100% |" in by_method(rows)
    assert "pebble, 2 fingers, lift" in by_body(rows)
    page = tmp_path / "page.md"
    page.write_text(f"before\n{BEGIN}\nold\n{END}\nafter\n")
    write_block(page, rows)
    text = page.read_text()
    assert "old" not in text
    assert text.startswith("before")
    assert text.endswith("after\n")


@pytest.mark.parametrize("name", ["cylinder", "pebble"])
def test_derivatives_given_to_drake_are_those_of_differences(name):
    case, rng = CASES[name], np.random.default_rng(0)
    start = random_search.start_placement(case, 0)
    functions, width = face_functions(case.body, start.faces), 4 if case.fingers == 2 else 3
    p, k = start.points / case.body.size, case.fingers
    balance = _Balance(functions, case.body.centroid / case.body.size, rng.standard_normal(6), np.array(case.shape))
    for function, x in (
        (_Cones(functions[0], case, 2), np.concatenate([p[0], rng.standard_normal(2 * width)])),
        (balance, np.concatenate([p.ravel(), rng.standard_normal(k * width + 1)])),
    ):
        steps = 1e-6 * np.eye(len(x))
        differences = np.stack([(function(x + h)[0] - function(x - h)[0]) / 2e-6 for h in steps], axis=1)
        np.testing.assert_allclose(function(x)[1], differences, atol=1e-6)
