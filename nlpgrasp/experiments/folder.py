"""The output folder of an experiment: one file a solve, written whole or not at all.

``experiment.json`` is the plan, ``solves/`` holds a solution file for each finished solve, and for each that failed a
small file that says why. Nothing here is executed when it is read.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
from pathlib import Path
from typing import Any

from nlpgrasp.atomic import write_text
from nlpgrasp.errors import InputError
from nlpgrasp.experiments.experiment import SolveId
from nlpgrasp.experiments.plan import check_same, read_plan
from nlpgrasp.solution import GraspSolution

try:
    import fcntl
except ImportError:  # not on Windows: two runs in one folder are then not kept apart
    fcntl = None  # type: ignore[assignment]

PLAN, SOLVES, LOCK = "experiment.json", "solves", ".lock"
FAILURE_SCHEMA = "nlpgrasp-failure/1"


class Folder:
    """The output folder, held by this process while it is open.

    Parameters
    ----------
    path : str or Path
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path).absolute()
        self._lock: Any = None

    def open(self, plan: dict[str, Any], resume: bool) -> None:
        """Take the folder for an experiment, making it where there is none.

        Raises
        ------
        InputError
            When it is no folder, cannot be written, holds another experiment or other files, is in use, or holds
            this experiment and ``resume`` is false.
        """
        if self.path.exists() and not self.path.is_dir():
            raise InputError(f"out ({self.path})", "not a folder", "a folder")
        if not self.path.parent.is_dir():
            raise InputError(f"out ({self.path})", f"no folder {self.path.parent}", "a folder in one that exists")
        known = (self.path / PLAN).is_file()
        if known:
            check_same(self.plan(), plan, str(self.path))
            if not resume:
                raise InputError(
                    f"out ({self.path})", "results of this experiment", "--resume to go on, or another folder"
                )
        elif self.path.is_dir() and any(p.name != LOCK for p in self.path.iterdir()):
            raise InputError(f"out ({self.path})", "files that are no experiment's", "a new or empty folder")
        try:
            (self.path / SOLVES).mkdir(parents=True, exist_ok=True)
            self._hold()
        except OSError as error:
            raise InputError(f"out ({self.path})", error.strerror, "a folder that can be written") from None
        write_text(self.path / PLAN, json.dumps(plan, indent=1) + "\n")

    def close(self) -> None:
        """Let the folder go."""
        if self._lock is not None:
            self._lock.close()
            self._lock = None

    def _hold(self) -> None:
        """Keep other runs off; the system lets go when this process ends, however it ends."""
        self._lock = (self.path / LOCK).open("w")
        if fcntl is not None:
            try:
                fcntl.flock(self._lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                self.close()
                raise InputError(f"out ({self.path})", "in use by another run", "a folder of its own") from None

    def plan(self) -> dict[str, Any]:
        """Return the plan.

        Raises
        ------
        InputError
            When there is none.
        """
        file = self.path / PLAN
        try:
            text = file.read_text(encoding="utf-8")
        except (OSError, UnicodeDecodeError):
            raise InputError(str(self.path), f"no readable {PLAN}", "the folder of an experiment") from None
        return read_plan(text, str(file))

    def file(self, solve: SolveId) -> Path:
        """Return where the solution of a solve is, or will be."""
        return self.path / SOLVES / f"{_plain(solve.variation)}--seed{solve.seed}.json"

    def failure_file(self, solve: SolveId) -> Path:
        """Return where it says why a solve failed."""
        return self.file(solve).with_suffix(".failed.json")

    def keep(self, solve: SolveId, text: str) -> None:
        """Write the solution of a finished solve.

        Raises
        ------
        InputError
            When it cannot be written, for example because the disk is full.
        """
        write_text(self.file(solve), text)
        self.failure_file(solve).unlink(missing_ok=True)

    def keep_failure(self, solve: SolveId, message: str) -> None:
        """Write why a solve failed."""
        data = {"schema": FAILURE_SCHEMA, "variation": solve.variation, "seed": solve.seed, "message": message}
        write_text(self.failure_file(solve), json.dumps(data, indent=1) + "\n")

    def load(self, solve: SolveId) -> GraspSolution | None:
        """Return the solution of a solve, or None where there is none.

        Raises
        ------
        InputError
            When the file is no solution, or not one of this solve.
        """
        file = self.file(solve)
        if not file.exists():
            return None
        solution = GraspSolution.load(file)
        if solution.solver.get("seed") != solve.seed:
            raise InputError(f"{file}: solver.seed", solution.solver.get("seed"), str(solve.seed))
        return solution

    def failure(self, solve: SolveId) -> str | None:
        """Return why a solve failed, or None where nothing says so."""
        try:
            data = json.loads(self.failure_file(solve).read_text(encoding="utf-8"))
            return str(data["message"])
        except FileNotFoundError:
            return None
        except (OSError, ValueError, KeyError, TypeError) as error:
            return f"its failure file cannot be read: {type(error).__name__}"

    def sweep(self) -> None:
        """Remove what a run that was ended left half written."""
        for stale in [*self.path.glob(".nlpgrasp-*.tmp"), *(self.path / SOLVES).glob(".nlpgrasp-*.tmp")]:
            os.unlink(stale)


def _plain(name: str) -> str:
    """Return a file name for a variation: readable, and different for different names on any file system."""
    plain = re.sub(r"[^a-z0-9.]+", "-", name.lower()).strip("-.")[:60]
    if plain == name:
        return plain
    return f"{plain}-{hashlib.sha256(name.encode()).hexdigest()[:6]}"
