"""The folder of a library: a file an entry, found by the entry's name."""

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
    """A folder of entries.

    Parameters
    ----------
    path : str or Path, optional
        The entries that come with the package when left out, which cannot be changed.
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
        """Make the folder where there is none, and keep other processes and threads from changing it meanwhile.

        Raises
        ------
        InputError
            When it is that of the package, or cannot be written.
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
        """Return all entries, by name.

        Raises
        ------
        InputError
            When there is no folder, a file cannot be read, or two have one name.
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
        """Return an entry and its file, ``None`` where there is none of this name.

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
        for file in sorted(self.path.glob("*.json")):  # one that somebody has put there under another name
            with suppress(InputError):
                entry = read_entry(file)
                if entry.name == wanted:
                    return file, entry
        return None

    def get(self, name: str) -> tuple[Path, TaskEntry]:
        """Return an entry and its file.

        Raises
        ------
        InputError
            When there is none of this name: with those that are near.
        """
        found = self.find(name)
        if found is None:
            names = [entry.name for entry in self.entries()]
            some = ", ".join(map(repr, (near(name, names) or names)[:NEAREST])) or "none: it has no entries"
            raise InputError(f"task in {self.words}", repr(name), f"the name of an entry, such as {some}")
        return found

    def keep(self, entry: TaskEntry, file: Path | None = None) -> None:
        """Write an entry, to a file of its own or where it was."""
        write_entry(entry, self.file(entry.name) if file is None else file)

    def file(self, name: str) -> Path:
        """Return where an entry of this name is, or will be."""
        return self.path / f"{file_name(entry_name(name))}.json"
