"""Libraries of named task ellipsoids that are updated with new recordings (Sections 1.1 and 3.3.1)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from importlib.resources import files
from pathlib import Path
from typing import TypedDict, Unpack

import numpy as np
from numpy.typing import ArrayLike

from nlpgrasp.common.files import file_name, hold_lock
from nlpgrasp.common.formatting import columns
from nlpgrasp.common.spatial import move_torque_origin, space_dimension
from nlpgrasp.common.user_warnings import warn
from nlpgrasp.common.validation import NEAREST, FloatArray, similar_names
from nlpgrasp.errors import InputError
from nlpgrasp.tasks.base import Task
from nlpgrasp.tasks.enclosing_ellipsoid import GAP, enclose, wrench_rows
from nlpgrasp.tasks.library.entry import (
    UNITS,
    Frame,
    ProvenanceRecord,
    TaskEntry,
    check_tags,
    check_text_line,
    entry_name,
    format_point,
    read_entry,
    remove_entry,
    write_entry,
)
from nlpgrasp.tasks.library.updatable_fits import CovarianceFit, MinVolumeFit, Moments, UpdatableFit
from nlpgrasp.tasks.recording import WrenchRecording
from nlpgrasp.tasks.task_ellipsoid import TaskEllipsoid
from nlpgrasp.tasks.task_polytope import TaskPolytope

LOCK, READY = ".lock", "ready"  # lock file of a folder; folder of the package's own entries

Wrenches = WrenchRecording | TaskPolytope | ArrayLike


class TaskLibrary:
    """A library of named task ellipsoids, stored as a folder of JSON files, with their wrenches in npz files.

    ``library["peg in hole"]`` is the task. Changes hold a lock and write files atomically, so several processes may
    change a library concurrently without loss.

    Parameters
    ----------
    path : str or Path, optional
        A folder, created with the first entry. By default the package's read-only entries, which can be added to
        another library.

    Raises
    ------
    InputError
        When it is not a folder.
    """

    def __init__(self, path: str | Path | None = None) -> None:
        self._folder = LibraryFolder(path)

    @property
    def path(self) -> Path:
        """Folder of the entry files."""
        return self._folder.path

    def __getitem__(self, name: str) -> TaskEllipsoid:
        """Return a task by name, in SI units and the entry's frame; an ``InputError`` lists similar names."""
        return self.entry(name).task

    def __contains__(self, name: object) -> bool:
        return isinstance(name, str) and self._folder.find(name) is not None

    def __iter__(self) -> Iterator[str]:
        """Return the names, sorted."""
        return iter([entry.name for entry in self.entries()])

    def __len__(self) -> int:
        return len(self.entries())

    def entry(self, name: str) -> TaskEntry:
        """Return an entry by name: task, frame and provenance.

        Raises
        ------
        InputError
            When no entry has this name (similar ones are listed), or its file cannot be read.
        """
        return self._folder.get(name)[1]

    def entries(self) -> tuple[TaskEntry, ...]:
        """Return all entries, sorted by name."""
        return self._folder.entries()

    def search(self, words: str) -> tuple[str, ...]:
        """Return the names of entries whose name, description or tags contain all given words, in any case."""
        return tuple(
            entry.name for entry in self.entries() if entry.contains_words(check_text_line("words", words).split())
        )

    def add(
        self,
        name: str,
        what: TaskEllipsoid | TaskEntry | Wrenches,
        *,
        outliers: float = 0.0,
        probability: float | None = None,
        **notes: Unpack[EntryNotes],
    ) -> TaskEntry:
        """Add a task under a new name.

        Parameters
        ----------
        name : str
            Of the new entry.
        what : TaskEllipsoid, TaskEntry, WrenchRecording, TaskPolytope or (m, d) array
            An ellipsoid or an entry is kept as it is; wrenches give their minimum-volume ellipsoid. Moments of an array
            are about the frame's origin.
        outliers : float
            Share of the wrenches, below 0.5, that is left out first; see ``fit_ellipsoid``.
        probability : float, optional
            Instead, use the covariance ellipsoid that contains this share of normally distributed wrenches.
        description, tags, frame, source : str, optional
            What the task is, search words, its body frame, and its provenance.

        Raises
        ------
        InputError
            On an existing name or invalid wrenches.

        Warns
        -----
        UserWarning
            When the wrenches are constant along some direction: the ellipsoid is flat.
        """
        checked, title = CheckedNotes.of(notes), entry_name(name)
        if isinstance(what, TaskEntry):
            entry = copy_entry(what, title, checked)
        else:
            learnt, about, source = fit_input(what, outliers, probability)
            record = provenance_now("added", checked.source or source, learnt.wrench_count)
            frame = Frame(checked.frame, about)
            entry = TaskEntry(title, learnt, frame, checked.description, checked.tags, (record,))
        with self._folder.lock():
            if self._folder.find(title) is not None:
                raise InputError("name", repr(title), f"a new name: {self._folder.words} has this entry; or update it")
            file = self._folder.file(title)
            if file.exists():  # an entry under another name, whose file was renamed
                raise InputError("name", repr(title), f"a name whose file is free: {file.name} has another entry")
            write_entry(entry, file)
        if not isinstance(what, TaskEntry):
            _warn_if_flat(entry)
        return entry

    def update(self, name: str, wrenches: Wrenches, *, outliers: float = 0.0, source: str = "") -> TaskEntry:
        """Add new wrenches to an entry, whose ellipsoid then covers previous and new ones.

        The previous wrenches are not needed again.

        A minimum-volume ellipsoid contains every wrench ever given; a covariance ellipsoid is exactly that of all.

        Parameters
        ----------
        name : str
            Of an entry of this library.
        wrenches : WrenchRecording, TaskPolytope or (m, d) array
            In the entry's frame; those of an array about its reference point.
        outliers : float
            Share of these wrenches, below 0.5, that is removed first.
        source : str
            Their provenance; by default a recording's file.
        """
        wrench_input, checked_source = WrenchInput.of(wrenches, outliers), check_text_line("source", source)
        with self._folder.lock():
            file, previous = self._folder.get(name)
            rows = wrench_input.at(previous.frame.about, previous.dimension)
            record = provenance_now("updated", checked_source or wrench_input.source, len(rows))
            entry = replace(
                previous, learnt=previous.learnt.updated(rows), provenance=append_provenance(previous, record)
            )
            write_entry(entry, file)
        _warn_if_flat(entry)
        return entry

    def merge(self, name: str, other: str | TaskEntry) -> TaskEntry:
        """Merge another entry's wrenches into the entry of this name.

        The other entry stays unchanged.

        Parameters
        ----------
        name : str
            Of an entry of this library.
        other : str or TaskEntry
            An entry's name in this library, or any entry of the same dimension and frame.
        """
        with self._folder.lock():
            file, previous = self._folder.get(name)
            addition = other if isinstance(other, TaskEntry) else self.entry(other)
            if addition.name == previous.name and not isinstance(other, TaskEntry):
                raise InputError("other", repr(other), "another entry: wrenches count once")
            previous.learnt.check_alike(addition.learnt)
            previous.frame.check_same(addition.frame)
            record = provenance_now("merged", addition.name, addition.wrenches)
            learnt = previous.learnt.merged(addition.learnt)
            entry = replace(previous, learnt=learnt, provenance=(*previous.provenance, *addition.provenance, record))
            write_entry(entry, file)
        return entry

    def forget(self, name: str, share: float) -> FloatArray:
        """Remove the most outlying wrenches of an entry, at most a fraction ``share``, and return them, (k, d).

        Parameters
        ----------
        name : str
            Of an entry with a minimum-volume ellipsoid.
        share : float
            Of all its wrenches, below 0.5. Only those kept individually, which include the outermost, can be removed.
        """
        with self._folder.lock():
            file, previous = self._folder.get(name)
            learnt, outliers = previous.learnt.without_outliers(share)
            record = provenance_now("forgot", f"outliers, at most {share:g} of the wrenches", len(outliers))
            write_entry(replace(previous, learnt=learnt, provenance=append_provenance(previous, record)), file)
        return outliers

    def remove(self, name: str) -> None:
        """Remove an entry and its files."""
        with self._folder.lock():
            remove_entry(self._folder.get(name)[0])

    def table(self, names: Sequence[str]) -> str:
        """Return a text table of the entries with given names."""
        heads = ["name", "dimension", "wrenches", "units", "description"]
        units = ", ".join(UNITS.values())
        rows = [
            [e.name, str(e.dimension), str(e.wrenches), units, e.description] for e in self.entries() if e.name in names
        ]
        return "\n".join(columns(heads, rows))

    def __str__(self) -> str:
        """Return a text table of all entries."""
        return self.table(tuple(self))

    def __repr__(self) -> str:
        return "TaskLibrary()" if self._folder.ready else f"TaskLibrary({str(self.path)!r})"


def _warn_if_flat(entry: TaskEntry) -> None:
    """Warn if the ellipsoid fitted to an entry's wrenches is flat."""
    if entry.wrenches and entry.rank < entry.dimension:
        text = f"the wrenches differ in {entry.rank} of {entry.dimension} directions only: the ellipsoid is flat"
        warn(f"{entry.name}: {text}")


class EntryNotes(TypedDict, total=False):
    """Optional description, tags, frame and source of an entry."""

    description: str
    tags: str | list[str] | tuple[str, ...]
    frame: str
    source: str


@dataclass(frozen=True)
class CheckedNotes:
    """Validated notes of an entry, with defaults for those left out."""

    description: str
    tags: tuple[str, ...]
    frame: str
    source: str

    @classmethod
    def of(cls, notes: EntryNotes) -> CheckedNotes:
        """Return validated notes.

        Raises
        ------
        InputError
            On unknown fields or invalid texts.
        """
        unknown = sorted(set(notes) - set(EntryNotes.__annotations__))
        if unknown:
            raise InputError("notes", ", ".join(unknown), "some of " + ", ".join(EntryNotes.__annotations__))
        lines = [check_text_line(field, notes.get(field, "")) for field in ("description", "frame", "source")]
        return cls(lines[0], check_tags(notes.get("tags", ())), lines[1], lines[2])


def copy_entry(entry: TaskEntry, name: str, notes: CheckedNotes) -> TaskEntry:
    """Return a copy of an entry with another name and, where given, other notes."""
    record = provenance_now("added", notes.source or f"a copy of {entry.name}", 0)
    return replace(
        entry,
        name=name,
        frame=Frame(notes.frame or entry.frame.words, entry.frame.about),
        description=notes.description or entry.description,
        tags=notes.tags or entry.tags,
        provenance=(*entry.provenance, record),
    )


def provenance_now(did: str, source: str, wrenches: int) -> ProvenanceRecord:
    """Return a provenance record with today's date."""
    return ProvenanceRecord(did, source, wrenches, datetime.now(UTC).date().isoformat())


def append_provenance(entry: TaskEntry, record: ProvenanceRecord) -> tuple[ProvenanceRecord, ...]:
    """Return an entry's provenance with a record appended; equal records of one day are combined."""
    *earlier, last = entry.provenance or (record,)
    if not entry.provenance or replace(last, wrenches=record.wrenches) != record:
        return (*entry.provenance, record)
    return (*earlier, replace(record, wrenches=last.wrenches + record.wrenches))


def fit_input(
    value: TaskEllipsoid | Wrenches, outliers: float, probability: float | None
) -> tuple[UpdatableFit, FloatArray | None, str]:
    """Return the fit of a task ellipsoid or of wrenches, with its reference point of moments and its source."""
    if isinstance(value, TaskEllipsoid):
        if outliers:
            raise InputError("outliers", outliers, "wrenches with it: a TaskEllipsoid is taken as it is")
        if probability is not None:
            raise InputError("probability", probability, "wrenches with it: a TaskEllipsoid is taken as it is")
        return MinVolumeFit.of_task(value), value.torque_origin, ""
    if outliers and probability is not None:
        raise InputError("probability", probability, "a share between 0 and 1, without outliers")
    wrench_input = WrenchInput.of(value, outliers)
    has_reference = isinstance(value, WrenchRecording | TaskPolytope)
    about = wrench_input.about if has_reference else np.zeros(space_dimension(wrench_input.rows.shape[1]))
    return wrench_input.fit(probability), about, wrench_input.source


@dataclass(frozen=True)
class WrenchInput:
    """Input wrenches with their reference point and source.

    Parameters
    ----------
    rows : (n, d) array
    about : (space,) array or None
        Reference point of moments; ``None`` if not stated, which means the entry's.
    source : str
        Provenance.
    """

    rows: FloatArray
    about: FloatArray | None
    source: str

    @classmethod
    def of(cls, value: WrenchRecording | Task | ArrayLike, outliers: float) -> WrenchInput:
        """Return the wrenches of a recording, polytope or array, without a fraction ``outliers`` of them.

        Raises
        ------
        InputError
            On other types or invalid wrenches.
        """
        if isinstance(value, WrenchRecording):
            wrench_input = cls(value.wrenches, np.zeros(3), value.source)
        elif isinstance(value, TaskPolytope):
            wrench_input = cls(value.wrenches, value.torque_origin, "the corners of a TaskPolytope")
        elif isinstance(value, Task):
            expected = "a recording, a TaskPolytope or wrenches (m, d); of other tasks a TaskEllipsoid can be added"
            raise InputError("wrenches", f"a {type(value).__name__}", expected)
        else:
            wrench_input = cls(wrench_rows(value), None, "")
        rows = wrench_rows(wrench_input.rows)
        if outliers:
            rows = rows[enclose(rows, outliers, None, None, GAP).inside]
        return cls(rows, wrench_input.about, wrench_input.source)

    def fit(self, probability: float | None) -> UpdatableFit:
        """Return the minimum-volume fit of the wrenches or, if a probability is given, the covariance fit."""
        return (
            MinVolumeFit.of(self.rows) if probability is None else CovarianceFit.of(Moments.of(self.rows), probability)
        )

    def at(self, about: FloatArray | None, dimension: int) -> FloatArray:
        """Return the wrenches with moments about an entry's reference point.

        Raises
        ------
        InputError
            When they have another dimension, or only the entry's point is unknown.
        """
        if self.rows.shape[1] != dimension:
            raise InputError("wrenches", f"dimension {self.rows.shape[1]}", f"dimension {dimension}, that of the entry")
        if self.about is None or (about is not None and np.array_equal(about, self.about)):
            return self.rows
        if about is None:
            moments = f"moments about {format_point(self.about)}"
            raise InputError("wrenches", moments, f"moments about {format_point(None)}, as the entry's are")
        return np.asarray(self.rows @ move_torque_origin(about - self.about).T)


class LibraryFolder:
    """A folder of task library entries.

    Parameters
    ----------
    path : str or Path, optional
        By default the package's read-only entries.
    """

    def __init__(self, path: str | Path | None) -> None:
        if path is not None and (not isinstance(path, str | Path) or not str(path).strip() or "\0" in str(path)):
            raise InputError("library", path, "the path of a folder")
        self.ready = path is None
        self.path = Path(str(files(__package__).joinpath(READY))) if path is None else Path(path).absolute()
        self.words = "the ready library" if self.ready else str(path)
        if self.path.exists() and not self.path.is_dir():
            raise InputError("library", f"{path} (not a folder)", "a folder")

    @contextmanager
    def lock(self) -> Iterator[None]:
        """Create the folder if needed, and lock it against changes by other processes and threads.

        Raises
        ------
        InputError
            When it is the package's folder or not writable.
        """
        if self.ready:
            raise InputError("library", self.words, "ng.TaskLibrary(path): the entries of the package stay as they are")
        try:
            self.path.mkdir(exist_ok=True)
        except OSError as error:
            raise InputError("library", f"{self.words} ({error.strerror})", "a folder in one that exists") from None
        with hold_lock(self.path / LOCK):
            yield

    def entries(self) -> tuple[TaskEntry, ...]:
        """Return all entries, sorted by name.

        Raises
        ------
        InputError
            When the folder is missing, a file is unreadable, or two entries have the same name.
        """
        if not self.path.is_dir():
            raise InputError("library", f"{self.words} (no such folder)", "a folder of task entries")
        entries: dict[str, TaskEntry] = {}
        for file in sorted(self.path.glob("*.json")):
            entry = read_entry(file)
            if entry.name in entries:
                raise InputError(f"{file}: name", entry.name, "a name that no other file of the folder has")
            entries[entry.name] = entry
        return tuple(entries[name] for name in sorted(entries))

    def find(self, name: str) -> tuple[Path, TaskEntry] | None:
        """Return the file and entry of a name, or ``None`` if there is no such entry.

        Raises
        ------
        InputError
            When its file cannot be read.
        """
        normalised, default = entry_name(name), self.file(name)
        if default.is_file():
            entry = read_entry(default)
            if entry.name == normalised:
                return default, entry
        for file in sorted(self.path.glob("*.json")):  # files may have been renamed by users
            with suppress(InputError):
                entry = read_entry(file)
                if entry.name == normalised:
                    return file, entry
        return None

    def get(self, name: str) -> tuple[Path, TaskEntry]:
        """Return the file and entry of a name; raise if there is no such entry.

        Raises
        ------
        InputError
            When no entry has this name; similar names are listed.
        """
        match = self.find(name)
        if match is None:
            names = [entry.name for entry in self.entries()]
            suggestions = ", ".join(map(repr, (similar_names(name, names) or names)[:NEAREST]))
            examples = f", such as {suggestions}" if names else "; the library has none"
            raise InputError(f"task in {self.words}", repr(name), f"the name of an entry{examples}")
        return match

    def file(self, name: str) -> Path:
        """Return the default file of an entry's name."""
        return self.path / f"{file_name(entry_name(name))}.json"
