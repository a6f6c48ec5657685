"""Command ``nlpgrasp demo``: the example of README."""

import contextlib
import io
import re
from pathlib import Path

import pytest

import nlpgrasp as ng
from nlpgrasp.cli.main import DEMO_STARTS, demo_command, main, readme_problem
from nlpgrasp.errors import InputError
from tests.verify import honest

ROOT = Path(__file__).resolve().parents[2]


def test_the_example_is_that_of_the_readme():
    (script,) = re.findall(r"```python\n(.*?)solution = ng.solve\((.*?)\)", (ROOT / "README.md").read_text(), re.DOTALL)
    names = {}
    exec(script[0], names)  # noqa: S102
    assert names["problem"].to_dict() == readme_problem().to_dict()
    assert script[1] == f"problem, starts={DEMO_STARTS}"


def demo():
    """Exit code and what is printed by the command."""
    output = io.StringIO()
    with contextlib.redirect_stdout(output), pytest.raises(SystemExit) as ended:
        main()
    return ended.value.code, output.getvalue()


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("sys.argv", ["nlpgrasp", "demo", "--no-open"])
    return tmp_path


@pytest.mark.slow
def test_a_grasp_that_is_not_verified_is_exit_code_1(folder, monkeypatch):
    monkeypatch.setattr(ng, "solve", lambda *_, **__: ng.GraspSolution.from_dict(honest.jaws()))
    code, output = demo()
    assert (code, "\nNOT verified: 2 of 14 checks failed (certified quality, width)" in output) == (1, True)
    assert output.endswith("written to demo.json and demo.html\n")
    assert "data-grasp" in (folder / "demo.html").read_text(encoding="utf-8")


@pytest.mark.slow
def test_the_example_is_solved_and_verified(folder):
    code, output = demo()
    assert (code, re.search(r"^verified: \d+ checks passed$", output, re.MULTILINE) is not None) == (0, True)
    assert ng.GraspSolution.load(folder / "demo.json").mu.lower == pytest.approx(0.092, rel=0.01)


@pytest.mark.parametrize("out", ["no/demo.json", "demo.html"])
def test_a_file_that_cannot_be_written_is_refused_before_the_solve(out, tmp_path, monkeypatch):
    monkeypatch.setattr(ng, "solve", pytest.fail)
    with pytest.raises(InputError, match="--out"):
        demo_command(tmp_path / out, show=False)
