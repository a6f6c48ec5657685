"""The table of docs/paper/11_every_row.md: no row of the paper without a counterpart and its test, or a reason."""

import ast
import importlib
import re
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "docs" / "paper" / "11_every_row.md"
COLUMNS = ("the paper", "what it says", "here", "test", "true")

# Everything that the paper numbers. Of equations with letters each letter, in the order of the paper.
EQUATIONS = [
    f"{section}-{number}"
    for section, numbers in (
        ("2.1", "1 2 3 4a 4b 5 6"),
        ("2.2", "1a 1b 1c 2 3 4"),
        ("2.3", "1 2 3a 3b 4 5 6 7"),
        ("2.4", "1"),
        ("2.5", "1 2 3 4 5 6 7 8"),
        ("3.1", "1a 1b"),
        ("3.2", "1 2"),
        ("3.3", "1 2 3 4a 5 6 7a 7b 4b 8 9"),
        ("3.4", "1 2 3 4 5"),
        ("3.5", "1 2 3 4 5 6 7 8 9 10 11 12 13 14 15 16"),
        ("4", "1 2"),
    )
    for number in numbers.split()
]
STATEMENTS = [
    *("Theorem 2-1", "Example 2-2", "Definition 2-3", "Definition 2-4", "Proposition 2-5", "Corollary 2-6"),
    *("Proposition 2-7", "Corollary 2-8", "Proposition 2-9", "Theorem 2-10", "Example 2-11"),
    *("Proposition 3-1", "Theorem 3-2", "Example 3-3", "Example 3-4", "Example 3-5", "Definition 3-6", "Example 3-7"),
    *("Definition 3-8", "Theorem 3-9", "Example 3-10"),
]
REMARKS = [f"Remark {i}" for i in range(1, 9)]
FIGURES = [f"Figure {i}" for i in range(1, 9)]
SECTIONS = ("1.1", "1.2", "1.3", "3.3.1", "3.4", "3.5.1", "3.6", "4")  # that state something without a number


def rows():
    """Return the rows of all tables of the page, each with its cells by column."""
    found = []
    for line in PAGE.read_text(encoding="utf-8").splitlines():
        if line.startswith("|"):
            cells = [cell.strip() for cell in line.strip().strip("|").split("|")]
            assert len(cells) == len(COLUMNS), line
            if cells[0] not in (COLUMNS[0], "---"):
                found.append(dict(zip(COLUMNS, cells, strict=True)))
            else:
                assert cells[0] == "---" or tuple(cells) == COLUMNS
    return found


ROWS = rows()
HELD = [row for row in ROWS if not row["here"].startswith("none: ")]
CHECKED = [row for row in ROWS if row["true"]]


def by_label(those):
    return pytest.mark.parametrize("row", those, ids=[row["the paper"] for row in those])


def names(cell):
    """Return what a cell has between backticks."""
    return re.findall(r"`([^`]+)`", cell)


def found(name):
    """Return what a dotted name stands for: a module, or what its attributes lead to."""
    parts = name.split(".")
    for count in range(len(parts), 0, -1):
        try:
            thing = importlib.import_module(".".join(parts[:count]))
        except ModuleNotFoundError:
            continue
        for attribute in parts[count:]:
            thing = getattr(thing, attribute)
        return thing
    raise ModuleNotFoundError(name)


@cache
def assertions_of(path):
    """Return the test functions of a file, each with the number of its assertions."""
    tree = ast.parse((ROOT / path).read_text(encoding="utf-8"))
    return {
        node.name: sum(
            isinstance(part, ast.Assert)
            or (isinstance(part, ast.Call) and "assert_" in ast.unparse(part.func))
            or (isinstance(part, ast.Call) and isinstance(part.func, ast.Name) and part.func.id.startswith("same_"))
            for part in ast.walk(node)
        )
        for node in tree.body
        if isinstance(node, ast.FunctionDef)
    }


def test_the_paper_s_numbers_have_one_row_each():
    labels = [row["the paper"] for row in ROWS]
    assert len(set(labels)) == len(labels)
    assert [label.strip("()") for label in labels if label.startswith("(")] == EQUATIONS
    words = r"(Theorem|Example|Definition|Proposition|Corollary) "
    assert sorted(label for label in labels if re.match(words, label)) == sorted(STATEMENTS)
    assert sorted(label for label in labels if label.startswith("Remark")) == REMARKS
    assert sorted(label for label in labels if label.startswith("Figure")) == FIGURES
    rest = {re.match(r"Section ([\d.]*\d)", label).group(1) for label in labels if label.startswith("Section")}
    assert rest >= set(SECTIONS)
    assert all(re.match(rf"\(|{words}|Remark |Figure |Section ", label) for label in labels)


def test_every_row_has_a_counterpart_and_a_test_or_a_reason():
    for row in ROWS:
        label = row["the paper"]
        assert row["what it says"], label
        if row in HELD:
            assert names(row["here"]), label
            assert names(row["test"]), label
        else:
            assert len(row["here"]) > len("none: ") + 20, label
            assert not row["test"], label
    without = [row["the paper"] for row in ROWS if row not in HELD]
    assert not [label for label in without if label.startswith("(") or label in STATEMENTS]


@by_label(HELD)
def test_what_a_row_names_is_there(row):
    for name in names(row["here"]):
        assert name.startswith(("nlpgrasp.", "problems."))
        assert found(name) is not None
    for node in names(row["test"]):
        path, function = node.split("::")
        assert assertions_of(path).get(function, 0) > 0, f"{node}: no such test, or one that asserts nothing"


@pytest.fixture(scope="module")
def scope():
    """What the page's first block defines."""
    block = re.search(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL).group(1)
    values = {}
    exec(compile(block, str(PAGE), "exec"), values)  # noqa: S102 - the page's own code, as test_docs runs it
    return values


@by_label(CHECKED)
def test_what_a_row_says_is_true(row, scope):
    (expression,) = names(row["true"])
    assert bool(eval(expression, scope)), expression  # noqa: S307 - the page's own code


def test_most_equations_are_evaluated():
    labels = {row["the paper"].strip("()") for row in CHECKED}
    assert len(labels & set(EQUATIONS)) >= 0.75 * len(EQUATIONS)
