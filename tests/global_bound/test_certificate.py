"""Tests of the global bound's certificate: files, leaves, and recorded digits."""

import hashlib
import json

import pytest

import nlpgrasp as ng
from nlpgrasp.global_bound import branch_and_bound

SQUARE = [[-1, -1], [1, -1], [1, 1], [-1, 1]]


def bound(contacts=3, gap=0.01, **more):
    task = ng.TaskEllipsoid([1.0, 1.0, 1.0])
    problem = ng.GraspProblem(ng.Polygon(SQUARE), [ng.FrictionContact(0.5)] * contacts, task, **more)
    return ng.best_possible(problem, gap=gap, time_limit=None)


@pytest.fixture(scope="module")
def best():
    return bound()


def test_a_file_holds_the_whole_bound(tmp_path, best):
    again = ng.BestPossible.load(best.save(tmp_path / "bound.json"))
    assert again.to_dict() == best.to_dict()
    assert again.grasp.points.tolist() == best.grasp.points.tolist()
    assert again.gap == best.gap


def test_the_bound_claimed_is_the_largest_of_the_leaves(best):
    assert best.upper == max(leaf[2] for leaf in best.certificate["leaves"])
    assert best.certificate["complete"]


@pytest.mark.slow
def test_a_search_with_more_leaves_than_are_kept_claims_what_follows_from_those(monkeypatch):
    fine = bound(gap=0.0005)
    monkeypatch.setattr(branch_and_bound, "MOST_LEAVES", 3)
    coarse = bound(gap=0.0005)
    assert not coarse.certificate["complete"]
    assert len(coarse.certificate["leaves"]) < len(fine.certificate["leaves"])
    assert coarse.upper == max(leaf[2] for leaf in coarse.certificate["leaves"]) > fine.upper
    assert not coarse.closed


def test_a_small_certificate_goes_into_another_file_and_a_large_one_beside_it(tmp_path, monkeypatch, best):
    assert best.kept() == best.certificate
    file = best.save(tmp_path / "bound.json")
    assert best.kept(file) == {"file": "bound.json", "sha256": hashlib.sha256(file.read_bytes()).hexdigest()}
    monkeypatch.setattr("nlpgrasp.solution.quality_record.SMALL", 100)
    with pytest.raises(ng.InputError, match="more than 200 kB"):
        best.kept()


@pytest.mark.parametrize("text", ["", "[]", "{}", '{"schema": "nlpgrasp-1"}', '{"schema": "nlpgrasp-bound/1"}'])
def test_what_is_no_bound_file_is_refused_in_a_sentence(tmp_path, text):
    file = tmp_path / "no.json"
    file.write_text(text)
    with pytest.raises(ng.InputError, match=r"no\.json"):
        ng.BestPossible.load(file)


def test_weights_have_few_digits(best):
    text = json.dumps([weights for _, weights in best.certificate["mixtures"]])
    assert max(len(word) for word in text.replace("[", "").replace("]", "").split(", ")) <= 10


def test_mixtures_and_directions_are_listed_once_and_used():
    search = branch_and_bound.BranchAndBound(cylinder(), 0.02)
    search.branch(150)
    data = search.certificate()[1]
    assert len(data["mixtures"]) < len(data["leaves"])
    assert {leaf[1] for leaf in data["leaves"]} == set(range(len(data["mixtures"])))
    assert len({json.dumps(mixture) for mixture in data["mixtures"]}) == len(data["mixtures"])
    assert {i for numbers, _ in data["mixtures"] for i in numbers} == set(range(len(data["directions"])))
    cut = {nodes[slot] for nodes, slot in data["splits"]}
    assert {cell for group in data["groups"] for cell, *_ in group["cuts"]} == cut


def cylinder():
    return ng.GraspProblem(ng.Cylinder(1.0, 2.0), [ng.FrictionContact(0.5)] * 3, ng.TaskEllipsoid([1.0] * 6))
