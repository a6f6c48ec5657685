"""From an STL file to a picture of a grasp in a notebook."""

import os
import re
import subprocess
import sys
from html import unescape
from pathlib import Path

import pytest
import trimesh

DOCS = Path(__file__).resolve().parents[2] / "docs"
LINES, SECONDS, CORES = 12, 20.0, 2
SHOWN = 'open("seen.html", "w", encoding="utf-8").write(solution._repr_html_())\n'


@pytest.mark.slow
def test_from_an_stl_to_its_picture(tmp_path):
    """In few lines; processor time, which other work on the machine does not change much, within two cores' 20 s."""
    resource = pytest.importorskip("resource", reason="counts processor time")
    (lines,) = re.findall(r"```python\n(import nlpgrasp as ng\n.*?)```", (DOCS / "see_it.md").read_text(), re.DOTALL)
    assert len([line for line in lines.splitlines() if line]) <= LINES
    trimesh.creation.capsule(height=60.0, radius=20.0).export(tmp_path / "part.stl")
    (tmp_path / "cell.py").write_text(lines + SHOWN)
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    environment = {**os.environ, "OMP_NUM_THREADS": "1", "NLPGRASP_CACHE": str(tmp_path / "cache")}
    result = subprocess.run(
        [sys.executable, "-W", "error", "cell.py"], cwd=tmp_path, capture_output=True, text=True, env=environment
    )
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    assert result.returncode == 0, result.stderr
    assert after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime < CORES * SECONDS
    page = unescape((tmp_path / "seen.html").read_text(encoding="utf-8"))
    assert "the task takes" in page
    assert '"arrows":[[[[' in page
