"""Execution of problem scripts: Python files that define a function such as ``problem()`` or ``experiment()``."""

from __future__ import annotations

import ast
import importlib
import runpy
import sys
import traceback
from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

import nlpgrasp as ng
from nlpgrasp.common.files import file_kind
from nlpgrasp.errors import InputError

if TYPE_CHECKING:
    from nlpgrasp.report.parts import PartTask

WITH_MODULE = "--with-module"
RUN_NAME = "nlpgrasp_script"  # not "__main__": what a script does when run by itself is not wanted here
T = TypeVar("T")


def load_modules(arguments: Sequence[str]) -> list[str]:
    """Import the file of each ``--with-module F.py`` among arguments, and return the other arguments.

    The files register kinds of their own. They are imported by name, so that workers and pickled problems find them.

    Raises
    ------
    InputError
        When an option has no file, or its file is missing or fails.
    """
    left, words = list[str](), iter(arguments)
    for word in words:
        if word.partition("=")[0] != WITH_MODULE:
            left.append(word)
            continue
        file = Path(word.partition("=")[2] or next(words, ""))
        if file.suffix != ".py" or not file.is_file():
            raise InputError(WITH_MODULE, str(file), "a Python file that exists")
        sys.path.insert(0, str(file.resolve().parent))
        try:
            importlib.import_module(file.stem)
        except InputError:
            raise
        except Exception as error:
            raise InputError(f"{WITH_MODULE} {file}", _error_place(error, file.resolve()), "a file that runs") from None
    return left


def load_problem(path: str | Path) -> ng.GraspProblem:
    """Run a script and return the problem that its ``problem()`` makes.

    Raises
    ------
    InputError
        When the file is missing or not Python, fails, has no ``problem()``, or that returns something else.
    """
    return _run_function(path, "problem", ng.GraspProblem, "a GraspProblem")


def load_problems(path: str | Path) -> object:
    """Run a script and return the result of its ``problems()``, or a list with the result of its ``problem()``.

    Raises
    ------
    InputError
        As ``load_problem``.
    """
    if _missing_function(Path(path), "problems", "GraspProblem") is not None:
        return [load_problem(path)]
    return _run_function(path, "problems", object, "problems by name")


def load_experiment(path: str | Path) -> ng.Experiment:
    """Run a script and return the experiment that its ``experiment()`` makes.

    Raises
    ------
    InputError
        As ``load_problem``; also when two variations are written with one name, of which Python keeps the last.
    """
    _check_duplicate_names(path)
    return _run_function(path, "experiment", ng.Experiment, "an ng.Experiment")


def load_part_task(path: str | Path) -> tuple[PartTask, ng.ParallelJaw | None]:
    """Run a script and return its function of part and gripper, and its gripper or ``None``.

    The function is its ``problem(part, gripper)``, or else its ``task(part)``.

    Raises
    ------
    InputError
        When the file is missing or not Python, fails, or has neither function.
    """
    names = _run_script(path)
    problem, task, gripper = (names.get(name) for name in ("problem", "task", "gripper"))
    jaws = _call(gripper, "gripper", path, ng.ParallelJaw, "an ng.ParallelJaw") if callable(gripper) else None
    if callable(problem):
        return problem, jaws
    if not callable(task):
        allowed = "a script with a function task(part) or problem(part, gripper)"
        raise InputError(str(path), "neither task() nor problem()", allowed)
    return lambda part, _: task(part), jaws


def _run_function(path: str | Path, name: str, kind: type[T], expected: str) -> T:
    """Run a script, call one of its functions and return the checked result."""
    file = Path(path)
    if file_kind(file) == "a mesh" and file.is_file():
        body = f'a function {name}(), in which ng.Mesh.load("{file.name}", unit="mm") is the body'
        raise InputError("SCRIPT", f"{path}, a mesh", f"a Python script with {body}")
    if file.is_file() and (defect := _missing_function(file, name, kind.__name__)) is not None:
        raise InputError(str(path), defect, f"a script with a function {name}() -> {kind.__name__}")
    function = _run_script(path).get(name)
    if not callable(function):
        raise InputError(str(path), f"no function {name}()", f"a script with a function {name}() -> {kind.__name__}")
    return _call(function, name, path, kind, expected)


def _run_script(path: str | Path) -> dict[str, object]:
    """Run a script and return its global variables by name."""
    file = Path(path)
    if not file.is_file():
        raise InputError("SCRIPT", str(path), "a Python file that exists")
    module = sys.modules.get(file.stem)
    if module is not None and module.__file__ == str(file.resolve()):  # of --with-module: it has registered its kinds
        return vars(module)
    sys.path.insert(0, str(file.resolve().parent))  # neighbours may be imported, also later and by workers
    try:
        return runpy.run_path(str(file), run_name=RUN_NAME)
    except InputError:
        raise
    except SyntaxError as error:
        line = f"line {error.lineno}: " if error.lineno else ""
        raise InputError(str(path), f"{line}{error.msg}", "a Python script") from None
    except KeyboardInterrupt:
        raise
    except BaseException as error:  # also what is raised to end the script
        raise InputError(str(path), _error_place(error, file), "a script that runs") from None


def _call(function: Callable[[], object], name: str, path: str | Path, kind: type[T], expected: str) -> T:
    """Call a script's function and return the checked result."""
    try:
        result = function()
    except InputError as error:
        raise InputError(f"{path}: {error.field}", error.given, error.allowed) from None
    except KeyboardInterrupt:
        raise
    except BaseException as error:
        raise InputError(
            f"{path}: {name}()", _error_place(error, Path(path)), f"a function that returns {expected}"
        ) from None
    if not isinstance(result, kind):
        raise InputError(f"{path}: {name}()", type(result).__name__, expected)
    return result


def _missing_function(file: Path, name: str, kind: str) -> str | None:
    """Return a text that says how a script fails to define a function, or ``None``.

    The script is parsed, not run.
    """
    try:
        tree = ast.parse(file.read_bytes())
    except (OSError, SyntaxError, ValueError, MemoryError, RecursionError):
        return None  # reported when it is run
    assignments: list[ast.AST] = []
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef | ast.ClassDef) and node.name == name:
            return None
        if isinstance(node, ast.alias) and (node.asname or node.name) in (name, "*"):
            return None
        if isinstance(node, ast.Name) and node.id in ("exec", "globals", "setattr"):
            return None
        if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store) and node.id == name:
            assignments.append(node)
    if not assignments:
        return f"no function {name}()"
    values = [node.value for node in ast.walk(tree) if isinstance(node, ast.Assign) and assignments[0] in node.targets]
    factory = values[0].func if values and isinstance(values[0], ast.Call) else None
    if isinstance(factory, ast.Attribute) and factory.attr == kind:
        return f"a variable {name}, no function: write it as def {name}(): return ng.{kind}(...)"
    return None


def _check_duplicate_names(path: str | Path) -> None:
    """Raise if a dictionary of variations in a script has the same name twice.

    Python would silently keep only the last of two variations.
    """
    try:
        tree = ast.parse(Path(path).read_bytes())
    except (OSError, SyntaxError, ValueError, MemoryError, RecursionError):
        return  # reported when it is run
    for node in ast.walk(tree):
        if isinstance(node, ast.Dict):
            pairs = zip(node.keys, node.values, strict=True)
            keys = [k.value for k, v in pairs if isinstance(k, ast.Constant) and not isinstance(v, ast.Constant)]
            for name, count in Counter(keys).items():
                if count > 1 and isinstance(name, str):
                    raise InputError(f"{path}, line {node.lineno}", f"two entries named {name!r}", "each name once")


def _error_place(error: BaseException, file: Path) -> str:
    """Return a text with the error and the line of the script at which it occurred."""
    lines = [f.lineno for f in traceback.extract_tb(error.__traceback__) if Path(f.filename) == file]
    line = f" (line {lines[-1]})" if lines else ""
    return f"{type(error).__name__}: {error}{line}"
