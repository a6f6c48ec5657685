"""Files that a solution was made from: meshes and URDFs, looked for by their recorded names."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path

from nlpgrasp.verify.check import Check, NotMadeError


@dataclass(frozen=True)
class Sources:
    """Where the files are looked for, and what was found of them.

    Parameters
    ----------
    folders : tuple of Path
        In this order.
    claims : list of Check
        For each file that was found, whether its fingerprint is the recorded one.
    """

    folders: tuple[Path, ...] = (Path(),)
    claims: list[Check] = field(default_factory=list)

    @classmethod
    def beside(cls, file: Path | None, more: Iterable[str | Path] = ()) -> Sources:
        """Return the folder of a solution file, the current one and others."""
        own = () if file is None else (file.parent,)
        return cls((*own, Path(), *map(Path, more)))

    def find(self, name: object) -> Path:
        """Return the first file of this name; raise ``NotMadeError`` where there is none."""
        if not isinstance(name, str) or not name:
            raise NotMadeError("the file names no source")
        for folder in self.folders:
            place = folder / name
            if place.is_file():
                return place
        raise NotMadeError(f"{name} is neither beside the file nor in the folders that were named")

    def claim(self, check: Check) -> None:
        """Note what a file's fingerprint says, once."""
        if check not in self.claims:
            self.claims.append(check)
