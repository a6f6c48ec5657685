"""Libraries of tasks by name: what was learnt is kept, and learnt on (Sections 1.1 and 3.3.1)."""

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
    """Task ellipsoids by name, in a folder of JSON files.

    ``library["peg in hole"]`` is the task. Changes hold a lock, and each file is written whole or not at all: processes
    may change one library at the same time, and none of their wrenches is lost.

    Parameters
    ----------
    path : str or Path, optional
        A folder, made with the first entry. The entries that come with the package when left out; they cannot be
        changed, but added to a library of one's own.

    Raises
    ------
    InputError
        When it is no folder.
    """

    def __init__(self, path: str | Path | None = None) -> None:
        self._folder = Folder(path)

    @property
    def path(self) -> Path:
        """Folder that the entries are in."""
        return self._folder.path

    def __getitem__(self, name: str) -> TaskEllipsoid:
        """Return a task, in SI units and the entry's frame; an ``InputError`` names those that are near."""
        return self.entry(name).task

    def __contains__(self, name: object) -> bool:
        return isinstance(name, str) and self._folder.find(name) is not None

    def __iter__(self) -> Iterator[str]:
        """Return the names, sorted."""
        return iter([entry.name for entry in self.entries()])

    def __len__(self) -> int:
        return len(self.entries())

    def entry(self, name: str) -> TaskEntry:
        """Return a task with all that is known of it.

        Raises
        ------
        InputError
            When there is none of this name (near ones are named), or its file cannot be read.
        """
        return self._folder.get(name)[1]

    def entries(self) -> tuple[TaskEntry, ...]:
        """Return all entries, sorted by name."""
        return self._folder.entries()

    def search(self, words: str) -> tuple[str, ...]:
        """Return the names of the entries that have each of these words, in any case, in name, description or tags."""
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
            An ellipsoid or an entry as it is; of wrenches the ellipsoid of least volume. Moments of an array are about
            the frame's origin.
        outliers : float
            Share of the wrenches, below 0.5, that is left out first; see ``fit_ellipsoid``.
        probability : float, optional
            Instead, the ellipsoid of the wrenches' covariance that holds this share of normally distributed ones.
        description, tags, frame, source : str, optional
            Words for people: what the task is, words to find it by (or several), the body frame it is in, and where it
            comes from.

        Raises
        ------
        InputError
            On a name that is taken, or wrenches that cannot be used.

        Warns
        -----
        UserWarning
            When the wrenches do not differ in some direction: the ellipsoid is flat.
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
        """Take in a new recording; wrenches of before need not be given again.

        The ellipsoid of least volume holds every wrench ever given; of a probability, it is exactly that of all.

        Parameters
        ----------
        name : str
            Of an entry of this library.
        wrenches : WrenchRecording, TaskPolytope or (m, d) array
            In the entry's frame, those of an array about its point.
        outliers : float
            Share of these wrenches, below 0.5, that is left out first.
        source : str
            Where they come from; a recording's file when left out.
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
        """Take in all that another entry has learnt; that one stays as it is.

        Parameters
        ----------
        name : str
            Of an entry of this library.
        other : str or TaskEntry
            Of this library, or an entry of another; of the same dimension and frame.
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
        """Leave out a share of the wrenches, those farthest from the others, and return them (k, d).

        Parameters
        ----------
        name : str
            Of an entry of least volume.
        share : float
            Of all its wrenches, below 0.5. Those that are kept one by one can be left out, as the outermost are.
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
        """Return a table of some entries."""
        heads = ["name", "dimension", "wrenches", "units", "description"]
        units = ", ".join(UNITS.values())
        rows = [
            [e.name, str(e.dimension), str(e.wrenches), units, e.description] for e in self.entries() if e.name in names
        ]
        return "\n".join(columns(heads, rows))

    def __str__(self) -> str:
        """Return a table of the entries."""
        return self.table(tuple(self))

    def __repr__(self) -> str:
        return "TaskLibrary()" if self._folder.ready else f"TaskLibrary({str(self.path)!r})"


def _warn_if_flat(entry: TaskEntry) -> None:
    """Say that wrenches do not differ in some direction; a task that was stated so is meant so."""
    if entry.wrenches and entry.rank < entry.dimension:
        words = f"the wrenches differ in {entry.rank} of {entry.dimension} directions only: the ellipsoid is flat"
        warn(f"{entry.name}: {words}")
