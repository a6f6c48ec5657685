"""The code blocks of the documentation run as printed."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

PAGES = sorted((Path(__file__).resolve().parents[1] / "docs").glob("*.md"))


SLOW = ("hands",)
RUN = [
    pytest.param(p, marks=[pytest.mark.slow] if p.stem in SLOW else [], id=p.stem)
    for p in PAGES
    if "```python" in p.read_text()
]


@pytest.mark.parametrize("page", RUN)
def test_code_blocks_run(page, tmp_path):
    (tmp_path / "problems").symlink_to(page.parents[1] / "problems")
    script = tmp_path / "page.py"
    script.write_text("\n".join(re.findall(r"```python\n(.*?)```", page.read_text(), re.DOTALL)))
    done = subprocess.run(
        [sys.executable, "-W", "error", str(script)], capture_output=True, text=True, timeout=120, cwd=tmp_path
    )
    assert done.returncode == 0, done.stderr
    assert "nan" not in done.stdout
    if page.stem == "hands":
        assert "mu certified in [0.4" in done.stdout
        assert "spread, fingers" in done.stdout
    if page.stem == "tasks":
        assert "of 2000 wrenches inside" in done.stdout
        assert "less friction leave" in done.stdout
    if page.stem == "experiments":
        assert "plate: 8 of 8 solves done" in done.stdout
        assert "1 free, rough [0.8" in done.stdout
    if page.stem == "interop":
        assert "stable: True [0." in done.stdout
    if page.stem == "measures":
        assert "True True" in done.stdout
        assert "False [" in done.stdout
