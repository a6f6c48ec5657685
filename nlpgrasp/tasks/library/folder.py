"""Folder of a task library: one file per entry."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from importlib.resources import files
from pathlib import Path

from nlpgrasp.common.files import file_name
from nlpgrasp.common.given.names import NEAREST, near
from nlpgrasp.common.stored.locks import held
from nlpgrasp.errors import InputError
from nlpgrasp.tasks.library.entry import TaskEntry, entry_name
from nlpgrasp.tasks.library.entry_file import read_entry, write_entry

LOCK, READY = ".lock", "ready"


class Folder:
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
    def changing(self) -> Iterator[None]:
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
        with held(self.path / LOCK):
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
        found: dict[str, TaskEntry] = {}
        for file in sorted(self.path.glob("*.json")):
            entry = read_entry(file)
            if entry.name in found:
                raise InputError(f"{file}: name", entry.name, "a name that no other file of the folder has")
            found[entry.name] = entry
        return tuple(found[name] for name in sorted(found))

    def find(self, name: str) -> tuple[Path, TaskEntry] | None:
        """Return the file and entry of a name, or ``None``.

        Raises
        ------
        InputError
            When its file cannot be read.
        """
        wanted, usual = entry_name(name), self.file(name)
        if usual.is_file():
            entry = read_entry(usual)
            if entry.name == wanted:
                return usual, entry
        for file in sorted(self.path.glob("*.json")):  # files may have been renamed by users
            with suppress(InputError):
                entry = read_entry(file)
                if entry.name == wanted:
                    return file, entry
        return None

    def get(self, name: str) -> tuple[Path, TaskEntry]:
        """Return the file and entry of a name.

        Raises
        ------
        InputError
            When no entry has this name; similar names are listed.
        """
        found = self.find(name)
        if found is None:
            names = [entry.name for entry in self.entries()]
            some = ", ".join(map(repr, (near(name, names) or names)[:NEAREST])) or "none: it has no entries"
            raise InputError(f"task in {self.words}", repr(name), f"the name of an entry, such as {some}")
        return found

    def keep(self, entry: TaskEntry, file: Path | None = None) -> None:
        """Write an entry to its default or a given file."""
        write_entry(entry, self.file(entry.name) if file is None else file)

    def file(self, name: str) -> Path:
        """Return the default file of an entry's name."""
        return self.path / f"{file_name(entry_name(name))}.json"
