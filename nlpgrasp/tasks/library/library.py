"""Libraries of named task ellipsoids that are updated with new recordings (Sections 1.1 and 3.3.1)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Unpack

from nlpgrasp.common.shown.said import warn
from nlpgrasp.common.shown.text import columns
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.errors import InputError
from nlpgrasp.tasks.ellipsoid import TaskEllipsoid
from nlpgrasp.tasks.library.entry import UNITS, Frame, TaskEntry, entry_name, text
from nlpgrasp.tasks.library.folder import Folder
from nlpgrasp.tasks.library.given import Given, Wrenches, learnt_from
from nlpgrasp.tasks.library.notes import Notes, Said, after, copied, origin_now


class TaskLibrary:
    """A library of named task ellipsoids, stored as a folder of JSON files.

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
        self._folder = Folder(path)

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
        return tuple(entry.name for entry in self.entries() if entry.holds(text("words", words).split()))

    def add(
        self,
        name: str,
        what: TaskEllipsoid | TaskEntry | Wrenches,
        *,
        outliers: float = 0.0,
        probability: float | None = None,
        **notes: Unpack[Notes],
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
        said, given = Said.of(notes), entry_name(name)
        if isinstance(what, TaskEntry):
            made = copied(what, given, said)
        else:
            learnt, about, source = learnt_from(what, outliers, probability)
            origin = origin_now("added", said.source or source, learnt.wrenches)
            frame = Frame(said.frame, about)
            made = TaskEntry(given, learnt, frame, said.description, said.tags, (origin,))
        with self._folder.changing():
            if self._folder.find(given) is not None:
                raise InputError("name", repr(given), f"a new name: {self._folder.words} has this entry; or update it")
            self._folder.keep(made)
        if not isinstance(what, TaskEntry):
            _warn_if_flat(made)
        return made

    def update(self, name: str, wrenches: Wrenches, *, outliers: float = 0.0, source: str = "") -> TaskEntry:
        """Update an entry with new wrenches, without the previous ones.

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
        given, said = Given.of(wrenches, outliers), text("source", source)
        with self._folder.changing():
            file, old = self._folder.get(name)
            rows = given.at(old.frame.about, old.dimension)
            origin = origin_now("updated", said or given.source, len(rows))
            entry = replace(old, learnt=old.learnt.updated(rows), provenance=after(old, origin))
            self._folder.keep(entry, file)
        _warn_if_flat(entry)
        return entry

    def merge(self, name: str, other: str | TaskEntry) -> TaskEntry:
        """Merge another entry into one; the other stays unchanged.

        Parameters
        ----------
        name : str
            Of an entry of this library.
        other : str or TaskEntry
            An entry's name in this library, or any entry of the same dimension and frame.
        """
        with self._folder.changing():
            file, old = self._folder.get(name)
            joined = other if isinstance(other, TaskEntry) else self.entry(other)
            if joined.name == old.name and not isinstance(other, TaskEntry):
                raise InputError("other", repr(other), "another entry: wrenches count once")
            old.learnt.check_alike(joined.learnt)
            old.frame.check_same(joined.frame)
            origin = origin_now("merged", joined.name, joined.wrenches)
            learnt = old.learnt.merged(joined.learnt)
            entry = replace(old, learnt=learnt, provenance=(*old.provenance, *joined.provenance, origin))
            self._folder.keep(entry, file)
        return entry

    def forget(self, name: str, share: float) -> FloatArray:
        """Remove a share of the wrenches, those farthest from the others, and return them (k, d).

        Parameters
        ----------
        name : str
            Of an entry with a minimum-volume ellipsoid.
        share : float
            Of all its wrenches, below 0.5. Only those kept individually, which include the outermost, can be removed.
        """
        with self._folder.changing():
            file, old = self._folder.get(name)
            learnt, out = old.learnt.without_outliers(share)
            origin = origin_now("forgot", f"outliers, at most {share:g} of the wrenches", len(out))
            self._folder.keep(replace(old, learnt=learnt, provenance=after(old, origin)), file)
        return out

    def remove(self, name: str) -> None:
        """Remove an entry and its file."""
        with self._folder.changing():
            self._folder.get(name)[0].unlink(missing_ok=True)

    def table(self, names: Sequence[str]) -> str:
        """Return a text table of named entries."""
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
    """Warn about a flat ellipsoid of wrenches; a flat task that was given is intended."""
    if entry.wrenches and entry.rank < entry.dimension:
        words = f"the wrenches differ in {entry.rank} of {entry.dimension} directions only: the ellipsoid is flat"
        warn(f"{entry.name}: {words}")
