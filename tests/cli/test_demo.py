"""``nlpgrasp demo``: README's example, from nothing to a page."""

import contextlib
import io
import re
from pathlib import Path

import pytest

import nlpgrasp as ng
from nlpgrasp.cli.demo.command import demo_command
from nlpgrasp.cli.demo.example import STARTS, problem
from nlpgrasp.cli.main import main
from nlpgrasp.errors import InputError
from tests.verify import honest

ROOT = Path(__file__).resolve().parents[2]


def test_the_example_is_that_of_the_readme():
    (script,) = re.findall(r"```python\n(.*?)solution = ng.solve\((.*?)\)", (ROOT / "README.md").read_text(), re.DOTALL)
    names = {}
    exec(script[0], names)  # noqa: S102
    assert names["problem"].to_dict() == problem().to_dict()
    assert script[1] == f"problem, starts={STARTS}"


def test_it_prints_the_verdict_and_says_where_the_page_is(tmp_path, monkeypatch):
    monkeypatch.setattr(ng, "solve", lambda *_, **__: ng.GraspSolution.from_dict(honest.box()))
    monkeypatch.chdir(tmp_path)
    told = io.StringIO()
    monkeypatch.setattr("sys.argv", ["nlpgrasp", "demo", "--no-open"])
    with contextlib.redirect_stdout(told), pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 0
    assert re.search(r"^verified: \d+ checks passed", told.getvalue(), re.MULTILINE)
    assert told.getvalue().endswith("written to demo.json and demo.html\n")
    assert "data-grasp" in (tmp_path / "demo.html").read_text(encoding="utf-8")


@pytest.mark.parametrize("out", ["no/demo.json", "demo.html"])
def test_a_file_that_cannot_be_written_is_refused_before_the_solve(out, tmp_path, monkeypatch):
    monkeypatch.setattr(ng, "solve", pytest.fail)
    with pytest.raises(InputError, match="--out"):
        demo_command(tmp_path / out, show=False)
