"""The page of promises names code and tests that exist."""

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PAGE = (ROOT / "docs" / "promises.md").read_text(encoding="utf-8")
ROWS = [row for row in PAGE.splitlines() if row.startswith("| ") and not row.startswith(("| ---", "| promise"))]


def functions(path):
    return {node.name for node in ast.walk(ast.parse(path.read_text())) if isinstance(node, ast.FunctionDef)}


def test_every_row_has_a_promise_code_and_a_test():
    assert len(ROWS) > 25
    for row in ROWS:
        cells = row.strip("|").split(" | ")
        assert len(cells) == 4, row
        assert all(cell.strip() for cell in cells), row


@pytest.mark.parametrize("row", ROWS, ids=lambda row: row.strip("| ")[:40])
def test_what_a_row_names_is_there(row):
    _, _, code, tests = row.strip("|").split(" | ")
    for name in re.findall(r"`([^`]+)`", code):
        assert (ROOT / "nlpgrasp" / name).exists(), name
    for name in re.findall(r"`([^`]+)`", tests):
        path, _, function = name.partition("::")
        assert (ROOT / path).is_file(), path
        assert not function or function in functions(ROOT / path), name
