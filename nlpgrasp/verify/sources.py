"""Search for the mesh and hand files of a solution, by their recorded names."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

from nlpgrasp.common.robot_files import parse_robot
from nlpgrasp.errors import InputError
from nlpgrasp.verify.check import NotCheckedError

LARGEST_SOURCE = 512 * 1024 * 1024  # bytes of a file that is read


def is_regular_file(path: Path) -> bool:
    """Return whether a path is that of a regular file; False for names that no file can have."""
    try:
        return path.is_file()
    except (OSError, ValueError):
        return False


def sha256_of(path: Path) -> str:
    """Return the SHA-256 of a file's content, hexadecimal; raise ``NotCheckedError`` if the file is too large."""
    if path.stat().st_size > LARGEST_SOURCE:
        raise NotCheckedError(f"{path.name} is larger than {LARGEST_SOURCE // 2**20} MiB")
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def mjcf_references(path: Path) -> Iterator[Path]:
    """Yield the files that an MJCF file and those that it includes may refer to."""
    files, seen = [path], set[Path]()
    while files:
        file = files.pop()
        if file.resolve() in seen or not is_regular_file(file):
            continue
        seen.add(file.resolve())
        root = parse_robot(file)
        if not root.tag.startswith("mujoco"):
            return
        folders = {"", *(value for e in root.iter("compiler") for key, value in e.items() if key.endswith("dir"))}
        names = [value for e in root.iter() for key, value in e.items() if key.startswith("file")]
        paths = [base.parent / folder / name for base in (path, file) for folder in folders for name in names]
        files += [found for found in paths if found.suffix.lower() in (".xml", ".mjcf")]
        yield from filter(is_regular_file, paths)


@dataclass(frozen=True)
class SourceFolders:
    """Folders in which mesh and hand files are searched; no other files are read.

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
        """Return the path of the first file with a name; raise ``NotCheckedError`` if there is none in the folders."""
        if not isinstance(name, str) or not name:
            raise NotCheckedError("the file names no source")
        is_outside = False
        for folder in self.folders:
            path = folder / name
            if is_regular_file(path):
                if self.contain(path):
                    return path
                is_outside = True
        self.missing.append(name)
        if is_outside:
            raise NotCheckedError(f"{name} is {self.outside}")
        raise NotCheckedError(f"{name} is not beside the file, in the current folder or in one that was named")

    def check_references(self, path: Path, digests: Iterable[str]) -> None:
        """Raise ``NotCheckedError`` if an MJCF refers to a file outside of the folders whose SHA-256 is not recorded.

        A mesh of a URDF is compared with its SHA-256 when it is read.
        """
        recorded = set(digests)
        try:
            for file in mjcf_references(path):
                if not self.contain(file) and sha256_of(file) not in recorded:
                    raise NotCheckedError(f"{path.name} refers to {file}, {self.outside}")
        except (OSError, InputError) as error:
            raise NotCheckedError(str(error)) from None

    @property
    def outside(self) -> str:
        """Message that a file is outside of the folders."""
        return f"outside of the folders that may be read: {', '.join(str(f.resolve()) for f in self.folders)}"

    def contain(self, path: Path) -> bool:
        """Return whether a file is below one of the folders, with symbolic links followed."""
        return any(path.resolve().is_relative_to(folder.resolve()) for folder in self.folders)
