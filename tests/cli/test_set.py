"""Commands ``nlpgrasp set``: make, verify, export."""

import json

import pytest

import nlpgrasp as ng
from nlpgrasp.sets import grasp_unit
from nlpgrasp.sets import make_set as module
from tests.cli.test_cli import run_here
from tests.sets.small import UNREFINED, run_starts_once
from tests.sets.small import run_here as run_units_here

SCRIPT = "from tests.sets.small import square\n\ndef problems():\n    return {'rough': square(0.8)}\n"


@pytest.fixture
def call(monkeypatch, tmp_path):
    """Run a command in this process, with units that run here from starts that are not refined."""
    monkeypatch.setattr(module, "run_local", run_units_here)
    monkeypatch.setattr(module, "DEFAULT_OPTIONS", UNREFINED)
    monkeypatch.setattr(grasp_unit, "run_starts", run_starts_once)
    (tmp_path / "squares.py").write_text(SCRIPT)
    return lambda *arguments: run_here("set", *arguments, cwd=tmp_path)


def test_a_set_is_made_verified_and_exported(call, tmp_path):
    done = call("squares.py", "--out", "out", "--grasps", 2, "--distinct", 0.2)
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith(f"2 grasps of 1 problems in {tmp_path / 'out'}")
    assert "CPU seconds" in done.stdout
    assert "2 of 2 grasps, 1 of 1 problems; " in done.stderr
    again = call("make", "squares.py", "--out", "out", "--grasps", 2, "--distinct", 0.2, "--json")
    assert json.loads(again.stdout)["rows"]["grasp"] == 2
    done = call("verify", "out", "--workers", 1)
    assert done.stdout == "verified: 2 grasps verified, 0 partly, 0 not\n"
    done = call("export", "out", "--to", "csv", "--out", "tables")
    assert done.stdout == "1 file written to tables\n"
    assert len(ng.read_grasps(tmp_path / "tables" / "rough.csv")) == 2


def test_proofs_are_stored(call, tmp_path):
    assert call("squares.py", "--out", "out", "--grasps", 1, "--starts", 4, "--proofs").returncode == 0
    assert ng.check_proof(ng.open_set(tmp_path / "out").proof(0))


def test_a_barren_problem_gives_what_its_starts_find(call):
    done = call("squares.py", "--out", "out", "--starts", 1, "--grasps", 2)
    assert done.returncode == 0
    done = call("verify", "out", "--json")
    assert json.loads(done.stdout)["verified"] == 1


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("verify", "."), "no readable set.json, expected the folder of a set of grasps"),
        (("export", ".", "--out", "x"), "no readable set.json"),
        (("lost.py", "--out", "out"), "SCRIPT: got lost.py, expected a Python file that exists"),
        (("squares.py", "--out", "a/b"), "no folder"),
        (("squares.py", "--out", "out", "--grasps", 0), "grasps_per_problem: got 0"),
    ],
)
def test_bad_input_is_one_line(call, arguments, message):
    done = call(*arguments)
    assert done.returncode == 2
    assert message in done.stderr
    assert len(done.stderr.splitlines()) == 1
