"""Output folder of an experiment: a plan, and one file per solve.

``experiment.json`` is the plan; ``solves/`` contains a solution file for each finished solve, and a small file with the
reason for each failed one. For a solve whose answer is a grasp of another variation, ``own/`` contains its own result,
and ``handed_on.json`` states the solves between which grasps were exchanged. Reading executes nothing.
"""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, NotRequired, TextIO, TypedDict

from nlpgrasp.common.files import FOLDER_LOCK, file_name, json_round_trip, lock_folder, parse_json, write_text
from nlpgrasp.common.formatting import error_line, single_line
from nlpgrasp.errors import InputError
from nlpgrasp.experiments.experiment import CaseData, Experiment, SolveId, check_names, check_seeds
from nlpgrasp.solution.file import DEEPEST, depth
from nlpgrasp.solution.solution import GraspSolution
from nlpgrasp.version import __version__

PLAN_SCHEMA = "nlpgrasp-experiment/1"
PLAN, SOLVES = "experiment.json", "solves"
OWN_RESULTS, EXCHANGE_STATE = "own", "handed_on.json"
FAILURE_SCHEMA = "nlpgrasp-failure/1"


class Plan(TypedDict):
    """JSON data of an experiment's plan."""

    schema: str
    created_by: NotRequired[dict[str, str]]
    name: str
    seeds: list[int]
    variations: dict[str, CaseData]


def plan_of(experiment: Experiment, digests: Mapping[str, str]) -> Plan:
    """Return the plan of an experiment: all data that determine its results, and the package's version.

    ``digests`` are those of its variations' identities; a variation that a function creates has none.
    """
    variations = {
        name: {"deferred": True}
        if experiment.deferred(name)
        else {**experiment.case(name).to_dict(), "digest": digests[name]}
        for name in experiment.names
    }
    plan = {
        "schema": PLAN_SCHEMA,
        "created_by": {"nlpgrasp": __version__},
        "name": experiment.name,
        "seeds": list(experiment.seeds),
        "variations": variations,
    }
    json_plan: Plan = json_round_trip(plan)
    return json_plan


def read_plan(text: str, source: str) -> Plan:
    """Parse the plan of an experiment from JSON text.

    Raises
    ------
    InputError
        When it is not the plan of an experiment.
    """
    allowed = f"the plan of an experiment ({PLAN_SCHEMA})"
    if depth(text) > DEEPEST:
        raise InputError(source, f"nesting deeper than {DEEPEST}", allowed)
    try:
        plan: Plan = parse_json(text)
        if plan["schema"] != PLAN_SCHEMA or not isinstance(plan["variations"], dict):
            raise ValueError("another schema")
        check_names(list(plan["variations"]))
        check_seeds(plan["seeds"])
        if not all(isinstance(v, dict) and isinstance(v.get("problem", {}), dict) for v in plan["variations"].values()):
            raise ValueError("variations that are none")
        plan["name"] = single_line(str(plan.get("name", "")))
    except (ValueError, TypeError, KeyError) as error:
        raise InputError(source, f"no plan ({error_line(error)})", allowed) from None
    return plan


def check_same_experiment(old: Plan, new: Plan, path: str) -> None:
    """Raise if a folder's plan belongs to another experiment.

    Variations and seeds may be added. Functions are not compared: each solution states the digest of its problem.

    Raises
    ------
    InputError
        Naming the differences.
    """
    old_cases = {name: _without_digests(case) for name, case in old["variations"].items()}
    new_cases = {name: _without_digests(case) for name, case in new["variations"].items()}
    missing = [name for name in old_cases if name not in new_cases]
    changed = [name for name in old_cases if name in new_cases and old_cases[name] != new_cases[name]]
    seeds = [seed for seed in old["seeds"] if seed not in new["seeds"]]
    difference = None
    if old.get("name") != new["name"]:
        difference = f"the experiment {old.get('name')!r}"
    elif missing:
        difference = f"an experiment with a variation {missing[0]!r}"
    elif changed:
        old_case, new_case = old_cases[changed[0]], new_cases[changed[0]]
        parts = _differing_keys(old_case, new_case)
        parts += _differing_keys(old_case.get("problem", {}), new_case.get("problem", {}))
        difference = f"an experiment whose variation {changed[0]!r} is another ({', '.join(parts)})"
    elif seeds:
        difference = f"an experiment with seed {seeds[0]}"
    if difference is not None:
        raise InputError(f"out ({path})", difference, "the folder of this experiment, or a new one")


def _without_digests(data: Any) -> Any:
    """Return a variation's data without the digests of its functions and of the whole."""
    if isinstance(data, Mapping):
        return {name: _without_digests(entry) for name, entry in data.items() if name not in ("digest", "function")}
    return [_without_digests(entry) for entry in data] if isinstance(data, list) else data


def _differing_keys(first: Mapping[str, object], second: Mapping[str, object]) -> list[str]:
    """Return the keys of the second mapping whose values differ from those of the first."""
    return [key for key, value in second.items() if first.get(key) != value]


class OutputFolder:
    """Output folder of an experiment, locked while it is open.

    Parameters
    ----------
    path : str or Path
    """

    def __init__(self, path: str | Path) -> None:
        if not isinstance(path, str | Path) or not str(path).strip() or "\0" in str(path):
            raise InputError("out", path, "the path of a folder")
        self.path = Path(path).absolute()
        self._lock: TextIO | None = None

    def open(self, plan: Plan, resume: bool) -> None:
        """Create the folder if it is missing, check its plan, and lock it.

        Raises
        ------
        InputError
            When it is not a folder, cannot be written, holds another experiment or other files, is in use, or holds
            this experiment and ``resume`` is false. The folder is then not locked.
        """
        try:
            self._open(plan, resume)
        except OSError as error:
            self.close()
            raise InputError(f"out ({self.path})", error.strerror, "a folder that can be written") from None
        except InputError:
            self.close()
            raise

    def _open(self, plan: Plan, resume: bool) -> None:
        """Open the folder as ``open`` does; an error may leave it locked.

        Raises
        ------
        InputError, OSError
            As in ``open``; ``OSError`` when a folder or the lock cannot be created.
        """
        path = self.path
        if path.is_symlink() and not path.exists():
            raise InputError(f"out ({path})", "a link to nothing", "a folder")
        if path.exists() and not path.is_dir():
            raise InputError(f"out ({path})", "a file", "a folder")
        if not path.parent.is_dir():
            raise InputError(f"out ({path})", f"no folder {path.parent}", "a folder in one that exists")
        if (path / PLAN).is_file():
            check_same_experiment(self.plan(), plan, str(path))
            if not resume:
                raise InputError(f"out ({path})", "results of this experiment", "--resume to go on, or another folder")
        elif path.is_dir() and not all(self._is_leftover(p) for p in path.iterdir()):
            raise InputError(f"out ({path})", "files that are no experiment's", "a new or empty folder")
        path.mkdir(exist_ok=True)
        self._lock = lock_folder(path)
        write_text(path / PLAN, json.dumps(plan, indent=1) + "\n")
        (path / SOLVES).mkdir(exist_ok=True)

    @staticmethod
    def _is_leftover(path: Path) -> bool:
        """Return whether a file may stem from a run that ended before writing its plan."""
        is_empty_folder = path.name == SOLVES and path.is_dir() and not any(path.iterdir())
        return (
            is_empty_folder
            or path.name == FOLDER_LOCK
            or (path.name.startswith(".nlpgrasp-") and path.suffix == ".tmp")
        )

    def close(self) -> None:
        """Unlock the folder."""
        if self._lock is not None:
            self._lock.close()
            self._lock = None

    def plan(self) -> Plan:
        """Read the plan of the folder.

        Raises
        ------
        InputError
            When the folder has no plan.
        """
        file = self.path / PLAN
        try:
            text = file.read_text(encoding="utf-8")
        except (OSError, UnicodeDecodeError):
            raise InputError(str(self.path), f"no readable {PLAN}", "the folder of an experiment") from None
        return read_plan(text, str(file))

    def solution_file(self, solve: SolveId) -> Path:
        """Return the path of a solve's solution file."""
        return self.path / SOLVES / f"{file_name(solve.variation)}--seed{solve.seed}.json"

    def failure_file(self, solve: SolveId) -> Path:
        """Return the path of the file that states why a solve failed."""
        return self.solution_file(solve).with_suffix(".failed.json")

    def write_solution(self, solve: SolveId, text: str) -> None:
        """Write the solution file of a finished solve.

        Raises
        ------
        InputError
            When it cannot be written, for example because the disk is full.
        """
        write_text(self.solution_file(solve), text)
        for stale in (self._own_copy(solve), self.failure_file(solve)):
            with suppress(OSError):
                stale.unlink()

    def _own_copy(self, solve: SolveId) -> Path:
        return self.path / OWN_RESULTS / self.solution_file(solve).name

    def own_result_file(self, solve: SolveId) -> Path:
        """Return the path of a solve's result before the exchange of warm starts."""
        copy = self._own_copy(solve)
        return copy if copy.is_file() else self.solution_file(solve)

    def write_exchanged(self, texts: Mapping[SolveId, str], solves: Sequence[SolveId], state: str) -> None:
        """Write the solutions that an exchange of warm starts changed.

        The files of all other solves get back the result from before any exchange.

        Parameters
        ----------
        texts : mapping
            By solve.
        solves : sequence of SolveId
            All finished solves.
        state : str
            Digest of the results that the texts are based on.

        Raises
        ------
        InputError
            When one cannot be written.
        """
        with suppress(OSError):
            (self.path / EXCHANGE_STATE).unlink()
        for solve in solves:
            own_result = self._own_copy(solve)
            if solve in texts:
                own_result.parent.mkdir(exist_ok=True)
                if not own_result.is_file():
                    write_text(own_result, self.solution_file(solve).read_text(encoding="utf-8"))
                write_text(self.solution_file(solve), texts[solve])
            elif own_result.is_file():
                os.replace(own_result, self.solution_file(solve))
        write_text(self.path / EXCHANGE_STATE, state)

    def exchange_state(self) -> str:
        """Return the text that identifies the inputs of the last exchange, or an empty text."""
        try:
            return (self.path / EXCHANGE_STATE).read_text(encoding="utf-8")
        except (OSError, UnicodeDecodeError):
            return ""

    def write_failure(self, solve: SolveId, message: str) -> None:
        """Write the failure file of a solve."""
        data = {"schema": FAILURE_SCHEMA, "variation": solve.variation, "seed": solve.seed, "message": message}
        write_text(self.failure_file(solve), json.dumps(data, indent=1) + "\n")

    def load(self, solve: SolveId) -> GraspSolution | None:
        """Load the solution of a solve, or return ``None`` if there is none.

        Raises
        ------
        InputError
            When the file is not a solution, or its seed is not that of the solve; nothing else is compared.
        """
        file = self.solution_file(solve)
        if not file.exists():
            return None
        solution = GraspSolution.load(file)
        if solution.solver.get("seed") != solve.seed:
            raise InputError(f"{file}: solver.seed", solution.solver.get("seed"), str(solve.seed))
        return solution

    def failure(self, solve: SolveId) -> str | None:
        """Read the reason why a solve failed, or return ``None`` if it did not fail."""
        try:
            data = parse_json(self.failure_file(solve).read_text(encoding="utf-8"))
            return single_line(str(data["message"])) or "failed"
        except FileNotFoundError:
            return None
        except (OSError, ValueError, KeyError, TypeError) as error:
            return f"its failure file cannot be read: {type(error).__name__}"

    def remove_partial_files(self) -> None:
        """Remove partly written files that aborted runs left."""
        for stale in (p for name in ("", SOLVES, OWN_RESULTS) for p in (self.path / name).glob(".nlpgrasp-*.tmp")):
            with suppress(OSError):
                os.unlink(stale)
