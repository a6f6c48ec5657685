"""What CONTRIBUTING.md says: its files are there, its commands are the ones there are."""

import re
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
TEXT = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")


def test_files_and_targets_exist():
    named = set(re.findall(r"`((?:tests|docs|nlpgrasp|\.github)/[\w/.]*)`", TEXT)) - {"docs/"}
    assert len(named) > 10
    assert [name for name in sorted(named) if not (ROOT / name).exists()] == []
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    targets = re.findall(r"^make ([\w -]+?)(?=  |$)", TEXT, re.MULTILINE)
    assert len(targets) >= 6
    assert [t for line in targets for t in line.split() if f"\n{t}:" not in makefile and t != "test-all"] == []
