"""Folder of a set of grasps: plan, problems, and Parquet files of rows.

``set.json`` is the plan; ``problems/NAME.json`` states a problem; ``rows/NAME--3.parquet`` has the rows of its unit 3,
``rows/NAME.parquet`` all rows of a finished problem. Each file is written whole or not at all. A unit always gives the
same rows, so that two processes that run it write the same. Reading executes nothing.
"""

from __future__ import annotations

import json
import os
import time
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import TextIO, TypedDict

from nlpgrasp.common.files import file_name, hold_lock, read_object, try_lock, write_bytes, write_text
from nlpgrasp.common.types import Json
from nlpgrasp.common.value_digest import UNIQUE, is_comparable
from nlpgrasp.errors import InputError
from nlpgrasp.problem.identity import ProblemIdentity, data_digest
from nlpgrasp.sets.grasp_unit import UnitId
from nlpgrasp.version import __version__

SCHEMA = "nlpgrasp-set/1"
PLAN, PROBLEMS, ROWS, LOCKS, LOCK = "set.json", "problems", "rows", ".locks", ".lock"
SET_FOLDER = "the folder of a set of grasps"
ABANDONED = 600.0  # seconds without a change after which a partly written file is of an ended process
DAMAGED = ".damaged"  # appended to the name of a file that cannot be read


@dataclass(frozen=True)
class FinishedUnits:
    """Finished problems and units in a folder at one time.

    Parameters
    ----------
    merged : set of str
        Problems whose rows are merged.
    units : mapping of str to list of int
    """

    merged: set[str]
    units: Mapping[str, list[int]]

    def is_merged(self, problem: str) -> bool:
        """Return whether a problem is finished, so that all its rows are in one file."""
        return file_name(problem) in self.merged

    def unit_indices(self, problem: str) -> list[int]:
        """Return the sorted indices of a problem's finished units."""
        return self.units.get(file_name(problem), [])


class SetPlan(TypedDict):
    """JSON data of a set's plan: settings, and the digest of each problem by name."""

    schema: str
    created_by: dict[str, str]
    settings: Json
    problems: dict[str, str]


@dataclass
class SetFolder:
    """Folder of a set of grasps.

    Parameters
    ----------
    path : Path

    Attributes
    ----------
    claims : dict of UnitId to file
        Units that this process runs, with their locks.
    """

    path: Path
    claims: dict[UnitId, TextIO] = field(default_factory=dict)

    @classmethod
    def of(cls, path: object) -> SetFolder:
        """Return the folder at a path.

        Raises
        ------
        InputError
            When it is no path.
        """
        if not isinstance(path, str | Path) or not str(path).strip() or "\0" in str(path):
            raise InputError("out", path, "the path of a folder")
        return cls(Path(path).absolute())

    # The plan

    def read_plan(self) -> SetPlan:
        """Read the set's plan from its file.

        Raises
        ------
        InputError
            When the folder has none, or one of another schema.
        """
        file = self.path / PLAN
        try:
            data = read_object(file.read_text(encoding="utf-8"), str(file))
        except (OSError, UnicodeDecodeError):
            raise InputError(str(self.path), f"no readable {PLAN}", SET_FOLDER) from None
        if data.get("schema") != SCHEMA:
            raise InputError(f"{file}: schema", data.get("schema", "nothing"), f"{SCHEMA!r}, of this version")
        problems, settings, created_by = (data.get(key) for key in ("problems", "settings", "created_by"))
        if not (isinstance(problems, dict) and isinstance(settings, dict) and isinstance(created_by, dict)):
            raise InputError(str(file), "a plan without problems and settings", SET_FOLDER)
        return {
            "schema": SCHEMA,
            "created_by": {str(k): str(v) for k, v in created_by.items()},
            "settings": settings,
            "problems": {str(name): str(digest) for name, digest in problems.items()},
        }

    def open(self, settings: Json, problems: Mapping[str, ProblemIdentity]) -> list[str]:
        """Create the folder, or check an existing one, and add these problems to the plan; return notes on them.

        Rows of problems that cannot be compared are removed.

        Raises
        ------
        InputError
            When it cannot be written, has other files, or is a set of another version, settings or problems.
        """
        if self.path.exists() and not self.path.is_dir():
            raise InputError(f"out ({self.path})", "a file", "a folder")
        if not self.path.parent.is_dir():
            raise InputError(f"out ({self.path})", f"no folder {self.path.parent}", "a folder in one that exists")
        if self.path.is_dir() and not (self.path / PLAN).is_file():
            foreign = [p.name for p in self.path.iterdir() if p.name not in (LOCK, PROBLEMS, ROWS, LOCKS)]
            if not all(name.startswith(".nlpgrasp-") for name in foreign):
                raise InputError(f"out ({self.path})", "files that are no set's", "a new or empty folder")
        try:
            for name in ("", PROBLEMS, ROWS, LOCKS):
                (self.path / name).mkdir(exist_ok=True)
        except OSError as error:
            raise InputError(f"out ({self.path})", error.strerror, "a folder that can be written") from None
        with hold_lock(self.path / LOCK):
            return self._update_plan(settings, problems)

    def state_simulated(self) -> None:
        """Change the plan to that of a set that was made with simulation."""
        with hold_lock(self.path / LOCK):
            plan = self.read_plan()
            plan["settings"] = {**plan["settings"], "simulate": True}
            write_text(self.path / PLAN, json.dumps(plan, indent=1, allow_nan=False) + "\n")

    def remove_partial_files(self) -> None:
        """Remove partly written files that an ended process left.

        Recent ones are kept, since another process may still write them.
        """
        for file in self.path.rglob(".nlpgrasp-*.tmp"):
            with suppress(OSError):
                if time.time() - file.stat().st_mtime > ABANDONED:
                    file.unlink()

    def _update_plan(self, settings: Json, problems: Mapping[str, ProblemIdentity]) -> list[str]:
        digests, notes = {name: identity.digest for name, identity in problems.items()}, list[str]()
        plan: SetPlan = {
            "schema": SCHEMA,
            "created_by": {"nlpgrasp": __version__},
            "settings": settings,
            "problems": digests,
        }
        if (self.path / PLAN).is_file():
            old = self.read_plan()
            self._check_same(old, plan)
            plan["problems"] = {**old["problems"], **digests}
            for name in old["problems"].keys() & digests:
                if old["problems"][name] != digests[name]:
                    self._remove_rows(name)
                    notes.append(f"{name}: {problems[name].advice}")
        for name, identity in problems.items():
            try:
                self.read_problem(name, digests[name])
            except InputError:  # not there, or damaged
                data = {"name": name, "problem": identity.problem, "identity": identity.rest}
                write_text(self.problem_file(name), json.dumps(data, allow_nan=False) + "\n")
        write_text(self.path / PLAN, json.dumps(plan, indent=1, allow_nan=False) + "\n")
        return notes

    def _remove_rows(self, problem: str) -> None:
        """Remove all rows of a problem.

        Raises
        ------
        InputError
            When another process runs one of its units.
        """
        for file in (self.path / LOCKS).glob(f"{file_name(problem)}--*.lock"):
            with file.open("a") as lock:
                if not try_lock(lock):
                    allowed = f"one run at a time with {problem!r}, which cannot be compared with an earlier one"
                    raise InputError(f"out ({self.path})", "in use by another run", allowed)
        self.merged_file(problem).unlink(missing_ok=True)
        self.remove_units(problem)

    def _check_same(self, old: SetPlan, new: SetPlan) -> None:
        """Raise if version, settings or a common problem differ between two plans.

        Problems may be added, and those that cannot be compared may differ.
        """
        changed = [key for key, value in new["settings"].items() if old["settings"].get(key) != value]
        pairs = ((name, old["problems"].get(name, digest), digest) for name, digest in new["problems"].items())
        differing = [name for name, *digests in pairs if all(map(is_comparable, digests)) and len({*digests}) > 1]
        if old["created_by"] != new["created_by"]:
            other = f"a set of nlpgrasp {old['created_by'].get('nlpgrasp')}"
        elif changed:
            other = f"a set with {changed[0]} {json.dumps(old['settings'].get(changed[0]))}"
        elif differing:
            other = f"a set in which {differing[0]!r} is another problem"
        else:
            return
        raise InputError(f"out ({self.path})", other, "the folder of this set, or a new one")

    # Files

    def problem_file(self, name: str) -> Path:
        """Return the path of a problem's JSON file."""
        return self.path / PROBLEMS / f"{file_name(name)}.json"

    def read_problem(self, name: str, digest: str) -> Json:
        """Read the JSON data of a problem.

        Raises
        ------
        InputError
            When its file cannot be read, or is of a problem with another digest.
        """
        file = self.problem_file(name)
        try:
            data = read_object(file.read_text(encoding="utf-8"), str(file))
            problem, rest = data["problem"], data["identity"]
        except (OSError, UnicodeDecodeError, KeyError):
            raise InputError(str(file), "no readable problem", "a file that ng.make_set wrote") from None
        if not isinstance(problem, dict) or data_digest([problem, rest]) != digest.removeprefix(UNIQUE):
            raise InputError(str(file), "another problem, or damage", f"the problem with digest {digest}")
        return problem

    def unit_file(self, unit: UnitId) -> Path:
        """Return the path of the file with a unit's rows."""
        return self.path / ROWS / f"{file_name(unit.problem)}--{unit.index}.parquet"

    def merged_file(self, problem: str) -> Path:
        """Return the path of the file with all rows of a finished problem."""
        return self.path / ROWS / f"{file_name(problem)}.parquet"

    def finished(self) -> FinishedUnits:
        """Return the problems and units whose row files exist now."""
        units: dict[str, list[int]] = {}
        merged = set[str]()
        for path in (self.path / ROWS).glob("*.parquet"):
            stem, _, index = path.stem.rpartition("--")
            if stem and index.isdigit():
                units.setdefault(stem, []).append(int(index))
            else:
                merged.add(path.stem)
        return FinishedUnits(merged, {stem: sorted(indices) for stem, indices in units.items()})

    def row_files(self, problem: str, finished: FinishedUnits) -> list[Path]:
        """Return the paths of the files with a problem's rows, in order."""
        if finished.is_merged(problem):
            return [self.merged_file(problem)]
        return [self.unit_file(UnitId(problem, index)) for index in finished.unit_indices(problem)]

    def set_aside(self, file: Path) -> str:
        """Rename a damaged file so that its unit is run again, and return the new name."""
        target = file.with_name(file.name + DAMAGED)
        with suppress(OSError):
            os.replace(file, target)
        return target.name

    # Units

    def claim(self, unit: UnitId) -> bool:
        """Lock a unit for this process, and return whether it is locked.

        A unit that is finished, or that another process has locked, is not. The lock is on a file and ends with the
        process. On Windows ``try_lock`` locks nothing: two processes may run the same unit there, to the same rows.
        """
        if unit in self.claims:
            return True
        file = (self.path / LOCKS / f"{self.unit_file(unit).stem}.lock").open("a")
        if try_lock(file) and not self.unit_file(unit).is_file() and not self.merged_file(unit.problem).is_file():
            self.claims[unit] = file
            return True
        file.close()
        return False

    def release(self, unit: UnitId) -> None:
        """Unlock a unit that this process has locked."""
        file = self.claims.pop(unit, None)
        if file is not None:
            file.close()

    def close(self) -> None:
        """Unlock all units of this process."""
        for unit in list(self.claims):
            self.release(unit)

    def write_unit(self, unit: UnitId, content: bytes) -> None:
        """Write the rows of a finished unit, and unlock it."""
        write_bytes(self.unit_file(unit), content)
        self.release(unit)

    def write_merged(self, problem: str, content: bytes) -> None:
        """Write all rows of a finished problem, and remove the files of its units."""
        write_bytes(self.merged_file(problem), content)
        self.remove_units(problem)

    def remove_units(self, problem: str) -> None:
        """Remove the files of the units of a merged problem."""
        prefix = f"{file_name(problem)}--"
        for file in (*(self.path / ROWS).glob(f"{prefix}*"), *(self.path / LOCKS).glob(f"{prefix}*.lock")):
            with suppress(OSError):
                file.unlink()
