"""Command ``nlpgrasp bound``: output, files, refusals."""

import json

import pytest

from nlpgrasp.common.formatting import format_upper
from tests.cli.test_cli import SMALL, refused, run, run_here
from tests.quick import first

HOPELESS = SMALL.replace("ng.FrictionContact(0.5)] * 2", "ng.PointContact()] * 2")


@pytest.mark.parametrize("run_command", first(1, [run_here, run]), ids=["here", "own process"])
def test_a_bound_is_printed_kept_and_verified(tmp_path, run_command):
    (tmp_path / "square.py").write_text(SMALL)
    process = run_command("bound", "square.py", "--gap", "0.05", "--out", "bound.json", cwd=tmp_path)
    assert process.returncode == 0, process.stderr
    assert process.stderr == ""
    first, second, *rest = process.stdout.splitlines()
    assert first.startswith("square: mu at most 0.")
    assert "best grasp met: mu certified in [" in second
    assert "; no placement is more than " in second
    assert second.endswith("% better (as close as asked for)")
    assert sum(" on edge" in line for line in rest) == 2
    data = json.loads((tmp_path / "bound.json").read_text())
    assert format_upper(data["upper"], 6) in first
    again = run_here("verify", "bound.json", cwd=tmp_path)
    assert again.returncode == 0, again.stdout
    assert "ok   leaves:" in again.stdout
    data["upper"] *= 0.999
    (tmp_path / "lower.json").write_text(json.dumps(data))
    lower = run_here("verify", "lower.json", cwd=tmp_path)
    assert lower.returncode == 1
    assert "FAIL upper:" in lower.stdout


@pytest.mark.slow
def test_json_lines_are_the_bound_without_its_certificate(tmp_path):
    (tmp_path / "square.py").write_text(SMALL)
    process = run_here("bound", "square.py", "--gap", "0.2", "--json", cwd=tmp_path)
    data = json.loads(process.stdout)
    assert data["closed"]
    assert data["mu"][0] <= data["upper"] <= 1.2 * data["mu"][0]
    assert "certificate" not in data
    assert data["written"] is None


def test_no_grasp_met_is_exit_code_1(tmp_path):
    (tmp_path / "square.py").write_text(HOPELESS)
    process = run_here("bound", "square.py", "--time-limit", "2", cwd=tmp_path)
    assert process.returncode == 1
    assert "no grasp met" in process.stdout


def test_bad_input_is_one_line_and_exit_code_2(tmp_path):
    (tmp_path / "square.py").write_text(SMALL)
    assert "gap: got 0.0" in refused(run_here("bound", "square.py", "--gap", "0", cwd=tmp_path))
    assert "time_limit: got -1.0" in refused(run_here("bound", "square.py", "--time-limit", "-1", cwd=tmp_path))
    assert "--out" in refused(run_here("bound", "square.py", "--out", "no/where.json", cwd=tmp_path))
    assert "none.py" in refused(run_here("bound", "none.py", cwd=tmp_path))
