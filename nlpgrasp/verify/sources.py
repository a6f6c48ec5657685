"""Search for the mesh and hand files of a solution, by their recorded names."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path

from nlpgrasp.verify.check import NotCheckedError


@dataclass(frozen=True)
class SourceFolders:
    """Folders in which mesh and hand files are searched.

    Parameters
    ----------
    folders : tuple of Path
        In this order.

    Attributes
    ----------
    missing : list of str
        Names of the files that were not found.
    """

    folders: tuple[Path, ...] = (Path(),)
    missing: list[str] = field(default_factory=list, init=False, repr=False, compare=False)

    @classmethod
    def of_file(cls, file: Path | None, more: Iterable[str | Path] = ()) -> SourceFolders:
        """Return the folders in which a file's sources are searched: the file's folder, the current one and others."""
        file_folders = () if file is None else (file.parent,)
        return cls((*file_folders, Path(), *map(Path, more)))

    def find(self, name: object) -> Path:
        """Return the path of the first file with a name; raise ``NotCheckedError`` if there is none."""
        if not isinstance(name, str) or not name:
            raise NotCheckedError("the file names no source")
        for folder in self.folders:
            path = folder / name
            if path.is_file():
                return path
        self.missing.append(name)
        raise NotCheckedError(f"{name} is not beside the file, in the current folder or in one that was named")
