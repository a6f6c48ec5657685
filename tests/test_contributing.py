"""What CONTRIBUTING.md says: its contact model works, its files are there, its commands are the ones there are."""

import re
from pathlib import Path
from unittest.mock import patch

import numpy as np
import pytest

import nlpgrasp as ng
from nlpgrasp.contacts import contact_from_dict
from nlpgrasp.contacts.base import CONTACTS

ROOT = Path(__file__).resolve().parents[1]
TEXT = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")


def test_the_contact_model_of_24_lines():
    (block,) = re.findall(r"```python\n(.*?)```", TEXT, re.DOTALL)
    written = block[block.index("@register") :]
    assert len([line for line in written.splitlines() if line.strip()]) <= 24
    with patch.dict(CONTACTS._kinds):
        names = {"__name__": "gecko"}
        exec(block, names)  # noqa: S102
        gecko = names["Gecko"](0.5)
        assert contact_from_dict(gecko.to_dict()) == gecko
        corners = np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]]) / np.sqrt(3.0)
        task = ng.TaskEllipsoid([1, 1, 2, 0.5, 0.5, 0.5])
        assert gecko.with_friction(0.9) == names["Gecko"](0.45)
        ours, theirs = (ng.mu(ng.Grasp(corners, -corners, c), task) for c in (gecko, ng.FrictionContact(0.5)))
    assert ours.lower == pytest.approx(theirs.lower, rel=0.02)
    assert "gecko" not in CONTACTS._kinds


def test_files_and_targets_exist():
    named = set(re.findall(r"`((?:tests|docs|nlpgrasp|\.github)/[\w/.]*)`", TEXT)) - {"docs/"}
    assert len(named) > 10
    assert [name for name in sorted(named) if not (ROOT / name).exists()] == []
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    targets = re.findall(r"^make ([\w -]+?)(?=  |$)", TEXT, re.MULTILINE)
    assert len(targets) >= 6
    assert [t for line in targets for t in line.split() if f"\n{t}:" not in makefile and t != "test-all"] == []
