"""The README's script runs as printed, and its commands are the ones there are."""

import os
import re
import subprocess
import sys
from pathlib import Path

import nlpgrasp as ng

README = (Path(__file__).resolve().parents[1] / "README.md").read_text()


def blocks(language):
    return re.findall(rf"```{language}\n(.*?)```", README, re.DOTALL)


def test_the_script_runs_as_printed(tmp_path):
    (script,) = blocks("python")
    path = tmp_path / "readme.py"
    path.write_text(script)
    environment = {**os.environ, "PYTHONWARNINGS": "error"}
    done = subprocess.run(
        [sys.executable, str(path)], cwd=tmp_path, capture_output=True, text=True, timeout=240, env=environment
    )
    assert done.returncode == 0, done.stderr
    stated = re.search(r"mu certified in \[([\d.]+), ([\d.]+)\]", README)
    found = ng.GraspSolution.load(tmp_path / "box.json").mu
    assert float(stated[1]) <= found.upper * 1.01
    assert found.lower <= float(stated[2]) * 1.01
    assert "FAIL" not in done.stdout


def test_the_make_targets_exist():
    makefile = (Path(__file__).resolve().parents[1] / "Makefile").read_text()
    for target in re.findall(r"^make (\w+)", "\n".join(blocks("")), re.MULTILINE):
        assert f"\n{target}:" in makefile


def test_the_problem_scripts_named_exist(problems_folder):
    for name in re.findall(r"problems/(\w+\.py)", README):
        assert (problems_folder / name).is_file()
