"""Command ``nlpgrasp report SCRIPT.py``: page of a script's problem."""

import pytest

from tests.cli.test_cli import SMALL, run_here


def test_a_script_has_a_page_of_what_it_asks(tmp_path):
    (tmp_path / "square.py").write_text(SMALL)
    result = run_here("report", "square.py", cwd=tmp_path)
    assert (result.returncode, result.stdout) == (0, "written to square-problem.html\n")
    assert "mu" not in (tmp_path / "square-problem.html").read_text().split("<h1")[1].split("</h1>")[0]
    assert "what is asked" in (tmp_path / "square-problem.html").read_text()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["square.py", "--png"], "--png: got with square.py, a script, expected a solution file with it"),
        (["square.py", "square.json"], "F.json...: got 2 files, with a script, expected solution files, or one script"),
        (["none.py"], "SCRIPT: got none.py, expected a Python file that exists"),
        (["square.py", "--out", "square.py"], "--out: got square.py (the script or file itself)"),
    ],
)
def test_what_it_cannot_show_is_refused(tmp_path, arguments, message):
    (tmp_path / "square.py").write_text(SMALL)
    result = run_here("report", *arguments, cwd=tmp_path)
    assert result.returncode == 2
    assert message in result.stderr
