"""Imports point down only, no two files import each other in a circle, and rooms stay small (docs/architecture.md)."""

import ast
import pickle
import re
import runpy
import subprocess
import sys
from functools import lru_cache
from pathlib import Path

import cloudpickle
import pytest

import nlpgrasp as ng

PACKAGE = Path(__file__).resolve().parents[1] / "nlpgrasp"
DOCS = PACKAGE.parent / "docs"
TABLE = re.search(r"```text\n(.*?)```", (DOCS / "architecture.md").read_text(encoding="utf-8"), re.DOTALL)[1]
# the table of docs/architecture.md from the bottom up, and the package's own front doors
LAYERS = [re.split(r" {3,}", line)[0].split() for line in reversed(TABLE.strip().splitlines())]
LAYERS.append(["__init__", "__main__"])
LEVEL = {name: level for level, names in enumerate(LAYERS) for name in names}
# the command line stands on the public names
ALLOWED = {("cli", "__init__")}
FILES = sorted(PACKAGE.rglob("*.py"))
NAMES = [str(p.relative_to(PACKAGE)) for p in FILES]


def part_of(path):
    """The room at the top of the package that a file is in."""
    relative = path.relative_to(PACKAGE)
    return relative.parts[0] if len(relative.parts) > 1 else relative.stem


def module_file(name):
    """The file of a module, None where the name is no module of the package."""
    base = PACKAGE.parent.joinpath(*name.split("."))
    return next((f for f in (base.with_suffix(".py"), base / "__init__.py") if f.is_file()), None)


TEXT = re.compile(r'"""[\s\S]*?"""')
IMPORT = re.compile(r"^[ \t]*((?:from|import) [^\n(]*(?:\([^)]*\))?)", re.MULTILINE)  # statements, also in brackets


@lru_cache
def imports(path):
    """The package's files that a file imports, anywhere in it; also for type checkers alone."""
    found = set()
    code = TEXT.sub("", path.read_text(encoding="utf-8"))
    statements = [text for text in IMPORT.findall(code) if "nlpgrasp" in text]
    for node in ast.parse("\n".join(statements)).body:
        if isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] == "nlpgrasp":
            for alias in node.names:
                found.add(module_file(f"{node.module}.{alias.name}") or module_file(node.module))
        elif isinstance(node, ast.Import):
            found |= {module_file(a.name) for a in node.names if a.name.split(".")[0] == "nlpgrasp"}
    return frozenset(found - {None})


def test_every_room_is_in_a_layer():
    """The table of docs/architecture.md has them all."""
    assert {part_of(path) for path in FILES} - set(LEVEL) == set()


def test_imports_point_down():
    across = {(path, part_of(path), other) for path in FILES for other in map(part_of, imports(path))}
    assert len(across) > len(FILES)
    up = [
        f"{path.relative_to(PACKAGE)} ({here}) imports {other}"
        for path, here, other in across
        if other != here and (here, other) not in ALLOWED and LEVEL[other] >= LEVEL[here]
    ]
    assert up == []


def test_no_circles():
    done, on_the_way = set(), []

    def visit(path):
        assert path not in on_the_way, " -> ".join(
            str(p.relative_to(PACKAGE)) for p in [*on_the_way[on_the_way.index(path) :], path]
        )
        if path not in done:
            on_the_way.append(path)
            for other in sorted(imports(path)):
                visit(other)
            on_the_way.pop()
            done.add(path)

    for path in FILES:
        visit(path)


def test_the_front_door_loads_what_is_asked_for():
    code = (
        "import sys, nlpgrasp as ng\n"
        "print(*[m for m in ('numpy', 'casadi', 'trimesh', 'scipy') if m in sys.modules])\n"
        "ng.solve, ng.verify\n"
        "import nlpgrasp.optimize.options, nlpgrasp.verify.verify\n"
        "print(callable(ng.solve), callable(ng.verify), set(ng.__all__) <= set(dir(ng)))\n"
        "print(*[m for m in ('scipy.stats', 'mujoco', 'manifold3d', 'rich') if m in sys.modules])\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.stdout.splitlines() == ["", "True True True", ""], done.stderr


def test_the_front_door_is_pickled_by_name():
    assert pickle.loads(pickle.dumps(ng)) is ng  # noqa: S301
    assert pickle.loads(cloudpickle.dumps(lambda: ng.Box([1, 1, 1])))().kind == "box"  # noqa: S301


def test_the_help_loads_no_mathematics():
    code = (
        "import sys; sys.argv = ['nlpgrasp', '--help']\n"
        "from nlpgrasp.cli.main import main\n"
        "try:\n    main()\nfinally:\n"
        "    print('loaded', *[m for m in ('casadi', 'trimesh', 'scipy', 'nlpgrasp.optimize') if m in sys.modules])\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert "Find the best grasp" in done.stdout
    assert done.stdout.splitlines()[-1] == "loaded"


def test_few_layers():
    assert len(LAYERS) <= 15
    assert {p.name for p in PACKAGE.iterdir() if (p / "__init__.py").is_file()} <= set(LEVEL)


def test_the_pictures_of_layers_and_stages_are_those_of_the_tables():
    made = runpy.run_path(str(DOCS / "make_layers.py"), run_name="read")
    assert made["drawn"](made["layers"]()) == (DOCS / "pictures" / "layers.svg").read_text(encoding="utf-8")
    for name, (heading, label) in made["STAGES"].items():
        stages = made["stages"](heading)
        assert made["drawn_stages"](stages, label) == (DOCS / "pictures" / f"{name}.svg").read_text(encoding="utf-8")
        assert all((PACKAGE / file).is_file() for _, file, _ in stages)


@pytest.mark.parametrize("room", ["quality", "verify"])
def test_certificates_share_nothing_with_the_program(room):
    """What is behind every import made at run time, the package's own front door apart."""
    code = (
        "import sys, types\n"
        f"front = types.ModuleType('nlpgrasp'); front.__path__ = [{str(PACKAGE)!r}]; sys.modules['nlpgrasp'] = front\n"
        "import importlib, pkgutil\n"
        f"room = importlib.import_module('nlpgrasp.{room}')\n"
        f"[importlib.import_module(m.name) for m in pkgutil.walk_packages(room.__path__, 'nlpgrasp.{room}.')]\n"
        "wrong = [m for m in sys.modules if m.split('.')[0] in ('casadi', 'adam')]\n"
        "wrong += [m for m in sys.modules if m.split('.')[:2] in (['nlpgrasp', 'nlp'], ['nlpgrasp', 'optimize'])]\n"
        "print(*wrong)\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert done.stdout.split() == []


def test_the_top_level_holds_no_other_files():
    assert {p.name for p in PACKAGE.glob("*.py")} == {"__init__.py", "__main__.py", "version.py", "errors.py"}
