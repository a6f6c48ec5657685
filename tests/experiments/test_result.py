"""Result of an experiment: ranks, ties, tables, pictures, page."""

import csv
import json
import re
import shutil
from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import pytest

import nlpgrasp as ng
from nlpgrasp.cli.experiment_command import write_outputs
from nlpgrasp.common.formatting import format_interval
from nlpgrasp.common.scalar_constraints import ScalarConstraint
from nlpgrasp.errors import InputError
from nlpgrasp.experiments.experiment import SolveId
from nlpgrasp.experiments.experiment_result import COLUMNS, overlapping_intervals, rank_intervals
from nlpgrasp.experiments.output_folder import OutputFolder
from nlpgrasp.experiments.solve_record import active_constraints
from nlpgrasp.quality import Bounds
from nlpgrasp.report.experiment_page import wilson_interval
from nlpgrasp.solution.records import ConstraintReport
from tests.experiments.small import experiment
from tests.quick import every, first


@pytest.fixture(scope="module")
def result(finished, tmp_path_factory):
    folder = shutil.copytree(finished.folder, tmp_path_factory.mktemp("result") / "out")
    plan = experiment({"rough": {"friction": 0.8}, "smooth": {}, "same": {}, "broken": lambda: 1 / 0})
    run_result = ng.run_experiment(plan, folder, workers=1, resume=True)
    assert write_outputs(run_result) == []
    return run_result


def test_ranks_count_only_what_is_certain():
    bounds = [Bounds(1.0, 2.0), Bounds(1.5, 2.5), Bounds(2.1, 3.0), Bounds(0.0, 0.5), Bounds(0.5, 0.6)]
    assert rank_intervals(bounds) == [2, 1, 1, 4, 4]
    assert overlapping_intervals(bounds) == [(1,), (0, 2), (1,), (4,), (3,)]


@pytest.mark.slow
def test_variations_within_the_gap_are_ties(result):
    assert result.ranks() == [1, 2, 2, 4]
    assert result.ties() == [(), ("same",), ("smooth",), ()]
    text = str(result)
    assert "8 solves done" in text
    assert re.search(r"2 +smooth .*same", text)
    assert "broken, seed 0: ZeroDivisionError: division by zero" in text


def test_a_variation_has_the_best_of_its_seeds(result):
    rough = result["rough"]
    assert rough.mu.lower == max(s.mu.lower for s in rough.solves)
    assert rough.mu.upper == max(s.mu.upper for s in rough.solves)
    assert result.solution("rough").mu == rough.best.mu
    assert rough.starts == (2, 2)
    with pytest.raises(KeyError):
        result["smoother"]


def test_csv_parquet_and_frame_hold_the_same_numbers(result):
    import pyarrow.parquet

    with (result.folder / "table.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert list(rows[0]) == [column.name for column in COLUMNS]
    assert len(rows) == 8
    stored = pyarrow.parquet.read_table(result.folder / "table.parquet").to_pylist()
    frame = result.frame()
    for row, other, exact in zip(rows, stored, result.rows(), strict=True):
        assert other == exact
        assert float(row["mu_lower"]) == exact["mu_lower"]
        assert row["variation"] == exact["variation"]
    assert frame.groupby("variation").mu_lower.max()["rough"] == result["rough"].mu.lower
    assert set(frame[frame.status == "failed"].variation) == {"broken"}
    data = json.loads((result.folder / frame.file[0]).read_text())
    assert data["quality"]["mu"]["lower"] == frame.mu_lower[0]


def test_load_gives_the_same_result(result):
    loaded_again = ng.ExperimentResult.load(result.folder)
    assert loaded_again.rows() == result.rows()
    assert str(loaded_again) == str(result)
    with pytest.raises(InputError, match=r"no readable experiment\.json"):
        ng.ExperimentResult.load(result.folder.parent)


def plan(**changes):
    return json.dumps(
        {"schema": "nlpgrasp-experiment/1", "name": "x", "seeds": [0], "variations": {"a": {}}, **changes}
    )


NO_PLANS = {
    "empty": "",
    "schema": '{"schema": "else"}',
    "deep": "[" * 100_000,
    "no seeds": plan(seeds=[]),
    "seeds twice": plan(seeds=[0, 0]),
    "huge seed": plan(seeds=[10**300]),
    "negative seed": plan(seeds=[-1]),
    "no variations": plan(variations={}),
    "number": plan(variations={"a": 3}),
    "problem": plan(variations={"a": {"problem": 3}}),
    "surrogate": plan(variations={"\ud800": {}}),
    "name": plan(variations={"": {}}),
}


@pytest.mark.parametrize("text", NO_PLANS.values(), ids=NO_PLANS.keys())
def test_a_plan_that_is_none_is_refused(text, tmp_path):
    (tmp_path / "experiment.json").write_text(text)
    with pytest.raises(InputError, match="the plan of an experiment") as caught:
        ng.ExperimentResult.load(tmp_path)
    assert "\n" not in str(caught.value)


WRONG = [None, 3, "x", [], {}, 1e300]


@pytest.mark.parametrize("wrong", every(6, WRONG), ids=repr)
@pytest.mark.parametrize("field", first(1, ["seconds", "iterations", "seed"]))
def test_a_wrong_entry_in_one_file_costs_that_solve_alone(result, tmp_path, field, wrong):
    folder = tmp_path / "out"
    shutil.copytree(result.folder, folder)
    file = folder / "solves" / "rough--seed0.json"
    data = json.loads(file.read_text())
    data["solver"][field] = wrong
    file.write_text(json.dumps(data))
    loaded = ng.ExperimentResult.load(folder)
    assert loaded["same"].done == 2
    assert loaded["rough"].done in (1, 2)
    assert len(loaded.notes) == 2 - loaded["rough"].done
    assert write_outputs(loaded) == []


class Page(HTMLParser):
    def __init__(self, text):
        super().__init__()
        self.images, self.cells, self.links = [], [], []
        self.feed(text)

    def handle_starttag(self, tag, attributes):
        values = dict(attributes)
        if tag == "img":
            self.images.append(values)
        self.links += [v for k, v in values.items() if k in ("src", "href")]

    def handle_data(self, data):
        self.cells.append(data.strip())


def test_the_page_stands_alone_and_says_all(result):
    page = Page((result.folder / "report.html").read_text())
    assert len(page.images) == 4
    assert all(image["alt"] and image["src"].startswith("data:image/png;base64,") for image in page.images)
    assert all(link.startswith("data:") for link in page.links)
    assert " to ".join(format_interval(result["rough"].mu.lower, result["rough"].mu.upper)) in page.cells
    assert any("ZeroDivisionError" in cell for cell in page.cells)
    assert any('"nlpgrasp-experiment/1"' in cell for cell in page.cells)


@pytest.mark.slow
def test_names_are_escaped_on_the_page_and_in_pictures(tmp_path):
    plan = experiment({"<script>alert(1)</script>": {}, r"a $\foo$ b": {}, "摩擦": {}}, seeds=[0])
    run_result = ng.run_experiment(plan, tmp_path / "out", workers=1)
    assert write_outputs(run_result) == []
    assert "<script>" not in (tmp_path / "out" / "report.html").read_text()


def test_pictures_are_pictures(result):
    names = {p.name for p in result.folder.glob("*.png")}
    assert names == {"mu_by_variation.png", "mu_against_time.png", "convergence.png", "success_rate.png"}
    import matplotlib.image

    for name in names:
        picture = matplotlib.image.imread(result.folder / name)
        assert min(picture.shape[:2]) > 150
        assert np.ptp(picture[..., :3]) > 0.5


def test_wilson_interval():
    low, high = wilson_interval(8, 10)  # Brown, Cai and DasGupta (2001), doi:10.1214/ss/1009213286
    assert (low, high) == (pytest.approx(0.4902, abs=1e-4), pytest.approx(0.9433, abs=1e-4))
    assert wilson_interval(0, 4)[0] == pytest.approx(0.0, abs=1e-12)


def test_active_constraints_are_named_once():
    def report(row, active=True):
        return ConstraintReport(row.name, 0.0, 0.0, 1.0, 0.0, active, row.kind, row.fingers)

    reports = [report(ScalarConstraint("table", None, fingers=(i,))) for i in (1, 2)]
    reports += [report(ScalarConstraint("reach", None, fingers=(0,)), False), report(ScalarConstraint("x", None))]
    reports += [report(ScalarConstraint("fingertip distance", None, fingers=(0, 1)))]
    reports += [report(ScalarConstraint("workspace", None, fingers=(2,), part=axis)) for axis in "xz"]
    reports += [report(ScalarConstraint("level", None, part=f"[{i}]")) for i in range(2)]
    assert active_constraints(reports) == (
        "table, fingers 1, 2",
        "x",
        "fingertip distance, fingers 0 and 1",
        "workspace, finger 2",
        "level[0]",
        "level[1]",
    )


def test_equations_are_not_among_active_constraints():
    equation = ConstraintReport("palm quaternion of unit length", 1.0, 1.0, 1.0, 5.0, True)
    assert active_constraints([equation, ConstraintReport("spread", 0.1, 0.0, 0.1, 0.0, True)]) == ("spread",)


def test_active_constraints_of_older_files_keep_their_names():
    reports = [ConstraintReport(f"table, finger {i}", 0.0, 0.0, 1.0, 0.0, True) for i in (1, 2)]
    assert active_constraints(reports) == ("table, finger 1", "table, finger 2")


def test_file_names_differ_where_names_do(tmp_path):
    place = OutputFolder(tmp_path)
    names = ["a", "A", "a b", "a-b", "a/b", "..", "ä", "x" * 100, "x" * 101, "con?"]
    files = {place.solution_file(SolveId(name, 0)).name.lower() for name in names}
    hashed = place.solution_file(SolveId("A", 0)).name.removesuffix("--seed0.json")
    assert place.solution_file(SolveId(hashed, 0)) != place.solution_file(SolveId("A", 0))
    assert len(files) == len(names)
    assert all(re.fullmatch(r"[a-z0-9.-]+--seed0\.json", f) for f in files)
    assert all(place.solution_file(SolveId(name, 0)).parent == tmp_path / "solves" for name in names)


def test_compare_ranks_solutions(result):
    solutions = {name: result.solution(name) for name in ("smooth", "rough", "same")}
    compared = ng.compare(solutions)
    assert compared.names[0] == "rough"
    assert compared.ranks == (1, 2, 2)
    assert set(compared.ties[1]) == set({"smooth", "same"} - {compared.names[1]})
    assert compared.comparable
    assert "rough" in str(compared).splitlines()[1]
    unnamed = ng.compare([result.solution("rough"), result.solution("same")])
    assert unnamed.names == ("square (1)", "square (2)")
    named = [replace(result.solution("rough"), name=n) for n in ("a", "a", "a (1)")]
    assert len(ng.compare(named).names) == 3


def test_compare_says_when_mu_measures_different_things(result, tmp_path):
    plan = experiment({"x": {"task": ng.TaskEllipsoid([1, 2, 1])}}, seeds=[0])
    other = ng.run_experiment(plan, tmp_path / "out", workers=1)
    compared = ng.compare({"a": result.solution("rough"), "b": other.solution("x")})
    assert not compared.comparable
    assert "different things" in str(compared)


@pytest.mark.parametrize(
    ("given", "message"), [([], "at least one"), (3, "solutions: got 3"), ([3], "a GraspSolution")]
)
def test_compare_refuses(given, message):
    with pytest.raises(InputError, match=message):
        ng.compare(given)
