"""Record of one solve, and its table row."""

import csv
from dataclasses import replace
from pathlib import Path

import pytest

import nlpgrasp as ng
from nlpgrasp.experiments.experiment_result import COLUMNS, Entry, row_of, write_csv
from nlpgrasp.experiments.solve_record import NOT_DONE, SolveRecord, measure_digest

BOX = Path(__file__).parents[1] / "solution" / "files" / "box.json"


@pytest.fixture(scope="module")
def solution():
    return ng.GraspSolution.load(BOX)


def test_a_row_says_what_the_solution_says(solution):
    row = row_of(Entry("boxes", SolveRecord.of("rough", 3, solution), 2, "solves/rough.json"))
    assert list(row) == [column.name for column in COLUMNS]
    assert (row["experiment"], row["variation"], row["seed"], row["rank"]) == ("boxes", "rough", 3, 2)
    assert (row["status"], row["mu_lower"], row["mu_upper"]) == ("solved", solution.mu.lower, solution.mu.upper)
    assert (row["contacts"], row["starts"]) == (3, len(solution.starts))
    assert row["file"] == "solves/rough.json"


@pytest.mark.parametrize(("failure", "status"), [(NOT_DONE, "not_done"), ("RuntimeError: boom", "failed")])
def test_a_row_without_a_solution(failure, status):
    row = row_of(Entry("boxes", SolveRecord("rough", 0, failure=failure), None, "solves/rough.json"))
    assert (row["status"], row["failure"], row["file"], row["rank"]) == (status, failure, "", None)
    assert (row["mu_lower"], row["mu_upper"]) == (0.0, 0.0)


def test_rows_as_csv(solution, tmp_path):
    row = row_of(Entry("boxes", SolveRecord.of("a, b", 0, solution), None, "x.json"))
    with write_csv([row], tmp_path / "t.csv").open(newline="") as file:
        (read,) = csv.DictReader(file)
    assert read["variation"] == "a, b"
    assert read["rank"] == ""
    assert float(read["mu_lower"]) == row["mu_lower"]


def test_digests_tell_measures_apart(solution):
    problem = dict(solution.problem)
    assert measure_digest(replace(solution, problem={**problem, "force_budget": "shared"})) != measure_digest(solution)
    assert measure_digest(replace(solution, problem={**problem, "contacts": []})) == measure_digest(solution)
