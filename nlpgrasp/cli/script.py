"""Problem scripts: Python files with a function ``problem()``."""

from __future__ import annotations

import runpy
import sys
import traceback
from pathlib import Path
from typing import Any

from nlpgrasp.errors import InputError
from nlpgrasp.problem import GraspProblem

RUN_NAME = "nlpgrasp_script"  # not "__main__": what a script does when run by itself is not wanted here


def load_problem(path: str | Path) -> GraspProblem:
    """Run a script and return what its ``problem()`` returns.

    Raises
    ------
    InputError
        When the file is missing or not Python, fails, has no ``problem()``, or that returns something else.
    """
    file = Path(path)
    if not file.is_file():
        raise InputError("SCRIPT", str(path), "a Python file that exists")
    sys.path.insert(0, str(file.resolve().parent))  # neighbours may be imported, also later and by workers
    try:
        names = runpy.run_path(str(file), run_name=RUN_NAME)
    except InputError:
        raise
    except SyntaxError as error:
        raise InputError(str(path), f"line {error.lineno}: {error.msg}", "a Python script") from None
    except (Exception, SystemExit) as error:
        raise InputError(str(path), _where(error, file), "a script that runs") from None
    function = names.get("problem")
    if not callable(function):
        raise InputError(str(path), "no function problem()", "a script with a function problem() -> GraspProblem")
    return _called(function, path, file)


def _called(function: Any, path: str | Path, file: Path) -> GraspProblem:
    try:
        result = function()
    except InputError as error:
        raise InputError(f"{path}: {error.field}", error.given, error.allowed) from None
    except (Exception, SystemExit) as error:
        raise InputError(f"{path}: problem()", _where(error, file), "a function that returns a GraspProblem") from None
    if not isinstance(result, GraspProblem):
        raise InputError(f"{path}: problem()", type(result).__name__, "a GraspProblem")
    return result


def _where(error: BaseException, file: Path) -> str:
    """Return the error and the last line of the script it passed through."""
    lines = [f.lineno for f in traceback.extract_tb(error.__traceback__) if Path(f.filename) == file]
    place = f" (line {lines[-1]})" if lines else ""
    return f"{type(error).__name__}: {error}{place}"
