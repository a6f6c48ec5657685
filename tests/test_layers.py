"""Imports point down only, and siblings do not import each other (docs/architecture.md)."""

import ast
from pathlib import Path

import pytest

PACKAGE = Path(__file__).resolve().parents[1] / "nlpgrasp"
LAYERS = [
    ["version", "errors"],
    ["validation", "atomic"],
    ["spatial", "directions", "rows", "schema", "conic_solver", "pyplot"],
    ["bodies", "contacts", "tasks", "hands", "constraints"],
    ["budgets", "grasp", "grasp_stack"],
    ["quality"],
    ["problem_rows", "quality_data"],
    ["problem_check"],
    ["problem"],
    ["findings", "drawing"],
    ["robust_data", "why_not_data"],
    ["solution", "solution_data", "solution_file"],
    ["nlp", "verify_measures"],
    ["verify"],
    ["solve"],
    ["experiments", "pictures"],
    ["report"],
    ["interop"],
    ["simulation"],
    ["cli"],
    ["__init__", "__main__"],
]
LEVEL = {name: level for level, names in enumerate(LAYERS) for name in names}
# a dataclass with save() and load() beside the module that does them; types only where annotations are circular
ALLOWED = {
    ("grasp_stack", "grasp"),
    ("solution", "solution_file"),
    ("solution_file", "solution"),
    ("solution_file", "solution_data"),
    ("solution_data", "solution"),
    ("problem_check", "problem"),
}


def part_of(path):
    relative = path.relative_to(PACKAGE)
    return relative.parts[0] if len(relative.parts) > 1 else relative.stem


def imports(path):
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.ImportFrom) and node.module and node.module.startswith("nlpgrasp"):
            yield node.module.split(".")[1] if "." in node.module else "__init__"
        elif isinstance(node, ast.Import):
            for alias in node.names:
                if alias.name.startswith("nlpgrasp"):
                    yield alias.name.split(".")[1] if "." in alias.name else "__init__"


FILES = sorted(PACKAGE.rglob("*.py"))


@pytest.mark.parametrize("path", FILES, ids=[str(p.relative_to(PACKAGE)) for p in FILES])
def test_imports_point_down(path):
    here = part_of(path)
    assert here in LEVEL, f"{here} is in no layer: add it to LAYERS and docs/architecture.md"
    for other in imports(path):
        if other == here or (here, other) in ALLOWED:
            continue
        assert LEVEL[other] < LEVEL[here], f"{path.name} ({here}) imports {other}"


@pytest.mark.parametrize("part", ["quality", "verify"])
def test_certificates_share_nothing_with_the_program(part):
    for path in FILES:
        if part_of(path) == part:
            assert not {"nlp", "solve"} & set(imports(path))
            assert "casadi" not in path.read_text()


@pytest.mark.parametrize("path", FILES, ids=[str(p.relative_to(PACKAGE)) for p in FILES])
def test_files_are_short(path):
    assert len(path.read_text().splitlines()) <= 250
