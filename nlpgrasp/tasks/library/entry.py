"""Entry of a task library: its JSON file, and its wrenches in an npz file beside it."""

from __future__ import annotations

import hashlib
import io
import json
import unicodedata
from collections.abc import Iterable
from dataclasses import dataclass
from functools import lru_cache
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from nlpgrasp.common.array_files import read_arrays
from nlpgrasp.common.files import check_schema, read_object, read_text, write_bytes, write_text
from nlpgrasp.common.formatting import FORCE_UNIT, MOMENT_UNIT
from nlpgrasp.common.spatial import space_dimension
from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray, array, prefix_errors, read_only
from nlpgrasp.errors import InputError
from nlpgrasp.tasks.library.updatable_fits import CovarianceFit, MinVolumeFit, UpdatableFit
from nlpgrasp.tasks.task_ellipsoid import TaskEllipsoid
from nlpgrasp.version import __version__

if TYPE_CHECKING:
    import jsonschema


SCHEMA_NAME = "nlpgrasp-task/1"
UNITS = {"force": FORCE_UNIT, "torque": MOMENT_UNIT}
LONGEST_NAME, LONGEST_TEXT = 100, 2000  # characters
FITS: dict[str, type[UpdatableFit]] = {kind.kind: kind for kind in (MinVolumeFit, CovarianceFit)}  # by name in files
HASH = 16  # hexadecimal digits of the content's hash in names of wrench files
LARGEST_FILE = 64 * 1024 * 1024  # bytes
EXPECTED = "what task schema 1 says (docs/task_libraries.md)"


@dataclass(frozen=True)
class Frame:
    """Reference frame of an entry's wrenches.

    Parameters
    ----------
    words : str
        Description of the body frame's origin and axes.
    about : (space,) array or None
        Reference point of moments; ``None`` stands for the torque origin of the problem that it is used with.
    """

    words: str = ""
    about: FloatArray | None = None

    def check_same(self, other: Frame) -> None:
        """Raise if the other frame has another description or reference point."""
        if other.words != self.words:
            raise InputError("frame", other.words or "no words", f"{self.words or 'no words'!r}, that of the entry")
        if not is_same_point(self.about, other.about):
            raise InputError("frame.about", format_point(other.about), f"{format_point(self.about)}, that of the entry")


@dataclass(frozen=True)
class ProvenanceRecord:
    """Provenance record: one change of an entry.

    Parameters
    ----------
    did : str
        ``"added"``, ``"updated"``, ``"merged"`` or ``"forgot"``.
    source : str
        Such as a recording's file, a section of a paper, or a derivation.
    wrenches : int
        Number of wrenches.
    date : str
        Such as ``"2026-01-31"``; may be empty.
    """

    did: str
    source: str
    wrenches: int
    date: str = ""

    def __str__(self) -> str:
        count = f"{self.wrenches} wrenches" if self.wrenches else ""
        return ", ".join(part for part in (self.date, self.did, count, self.source) if part)


@dataclass(frozen=True)
class TaskEntry:
    """Entry of a task library: a named task with frame, description and provenance.

    Parameters
    ----------
    name : str
        Unique in the library.
    learnt : UpdatableFit
        The ellipsoid, and what an update needs.
    frame : Frame
        Axes and reference point of its wrenches.
    description : str
        For readers.
    tags : tuple of str
        Further words for ``search``.
    provenance : tuple of ProvenanceRecord
        Oldest first.
    """

    name: str
    learnt: UpdatableFit
    frame: Frame = Frame()
    description: str = ""
    tags: tuple[str, ...] = ()
    provenance: tuple[ProvenanceRecord, ...] = ()

    @property
    def task(self) -> TaskEllipsoid:
        """The task, in newtons and newton-metres, in the entry's frame."""
        task = self.learnt.task
        return task if self.frame.about is None else task.given_about(self.frame.about)

    @property
    def dimension(self) -> int:
        """Dimension of wrench space: 3 or 6."""
        return self.learnt.dimension

    @property
    def wrenches(self) -> int:
        """Number of recorded wrenches that the ellipsoid was fitted to."""
        return self.learnt.wrench_count

    @property
    def rank(self) -> int:
        """Number of directions in which the ellipsoid is not flat."""
        axes = self.learnt.axes
        size = np.max(np.abs(axes), axis=0)
        return int(np.linalg.matrix_rank(axes / np.where(size > 0.0, size, 1.0)))

    def contains_words(self, words: Iterable[str]) -> bool:
        """Return whether name, description or tags contain all given words, in any case."""
        text = " ".join([self.name, self.description, *self.tags]).casefold()
        return all(unicodedata.normalize("NFC", word).casefold() in text for word in words)

    def summary(self) -> Json:
        """Return the entry as JSON data, without the statistics for updates."""
        return {
            "name": self.name,
            "description": self.description,
            "tags": list(self.tags),
            "dimension": self.dimension,
            "units": UNITS,
            "frame": frame_data(self.frame),
            "provenance": [dict(vars(record)) for record in self.provenance],
            "task": self.learnt.task.to_dict(),
            "wrenches": self.wrenches,
            "forgotten": self.learnt.forgotten,
        }

    def __str__(self) -> str:
        flat = "" if self.rank == self.dimension else f", flat: {self.rank} of {self.dimension} directions"
        lines = [f"{self.name}: ellipsoid {self.learnt.describe()}{flat}"]
        lines += [self.description] if self.description else []
        lines += [f"frame: {self.frame.words or 'not said'}; moments about {format_point(self.frame.about)}"]
        lines += [f"tags: {', '.join(self.tags)}"] if self.tags else []
        return "\n  ".join([*lines, *map(str, self.provenance)])


def frame_data(frame: Frame) -> Json:
    """Return a frame as JSON data."""
    return {"words": frame.words, "about": None if frame.about is None else frame.about.tolist()}


def is_same_point(a: FloatArray | None, b: FloatArray | None) -> bool:
    """Return whether two reference points are equal."""
    return (a is None and b is None) or (a is not None and b is not None and np.array_equal(a, b))


def format_point(point: FloatArray | None) -> str:
    """Return a reference point as text."""
    return "the problem's torque origin" if point is None else str(point.tolist())


def entry_name(value: object) -> str:
    """Return the validated name of an entry, in Unicode normal form C."""
    name = unicodedata.normalize("NFC", value) if isinstance(value, str) else ""
    if not name or name != " ".join(name.split()) or not name.isprintable() or len(name) > LONGEST_NAME:
        expected = f"a name of 1 to {LONGEST_NAME} printable characters, with single spaces"
        raise InputError("name", repr(value), expected)
    return name


def check_text_line(field: str, value: object) -> str:
    """Return the validated line of text, in Unicode normal form C."""
    if not isinstance(value, str) or not value.isprintable() or len(value) > LONGEST_TEXT:
        raise InputError(field, repr(value), f"one line of at most {LONGEST_TEXT} printable characters")
    return unicodedata.normalize("NFC", value)


def check_tags(value: object) -> tuple[str, ...]:
    """Return the validated tags, given as one text or as several."""
    tags = [value] if isinstance(value, str) else value
    if not isinstance(tags, list | tuple):
        raise InputError("tags", value, "a word or several")
    return tuple(check_text_line("tags", tag) for tag in tags)


def about_point(value: object, dimension: int, field: str = "about") -> FloatArray | None:
    """Return the validated reference point of moments, (space,), or ``None``."""
    return None if value is None else read_only(array(field, value, (space_dimension(dimension),)))


@lru_cache
def entry_schema() -> Json:
    """Return the JSON Schema of entries of task libraries (task schema 1)."""
    return dict(json.loads(files(__package__).joinpath("nlpgrasp-task-1.schema.json").read_text(encoding="utf-8")))


@lru_cache
def _validator() -> jsonschema.Draft202012Validator:
    """Return the validator of the schema of entries."""
    import jsonschema

    return jsonschema.Draft202012Validator(entry_schema())


def write_entry(entry: TaskEntry, path: Path) -> Path:
    """Write an entry's file atomically, with its wrenches beside it.

    The wrenches get a new file named by their content, before the entry's file is replaced. The file of the previous
    wrenches is then removed.
    """
    previous, current = wrench_file(path), None
    wrenches = entry.learnt.stored_wrenches
    if len(wrenches):
        buffer = io.BytesIO()
        np.savez(buffer, wrenches=wrenches)
        content = buffer.getvalue()
        current = path.with_name(f"{path.stem}-{hashlib.sha256(content).hexdigest()[:HASH]}.npz")
        write_bytes(current, content)
    write_text(path, entry_json(entry, current))
    if previous is not None and previous != current:
        previous.unlink(missing_ok=True)
    return path


def remove_entry(path: Path) -> None:
    """Remove an entry's file and its wrenches."""
    wrenches = wrench_file(path)
    path.unlink(missing_ok=True)
    if wrenches is not None:
        wrenches.unlink(missing_ok=True)


def wrench_file(path: Path) -> Path | None:
    """Return the path of the file with an entry's wrenches, or ``None`` if there is none."""
    if not path.is_file():
        return None
    name = read_object(_read_text(path), str(path))["fit"].get("wrenches")
    return None if name is None else path.with_name(name)


def read_wrenches(path: Path, dimension: int) -> FloatArray:
    """Read an entry's wrenches, (n, d).

    Raises
    ------
    InputError
        When the file is truncated, or its wrenches have another dimension.
    FileNotFoundError
        When it does not exist.
    """
    try:
        wrenches = read_arrays(path, ("wrenches",), "an npz file with wrenches")["wrenches"]
    except (InputError, KeyError):
        raise InputError("fit.wrenches", f"{path.name}, which cannot be read", "an npz file with wrenches") from None
    return array("fit.wrenches", wrenches, (None, dimension))


def entry_json(entry: TaskEntry, wrenches: Path | None = None) -> str:
    """Return an entry as JSON text, one field per line, with the name of its wrench file."""
    fit = entry.learnt.to_dict()
    data = {
        "schema": SCHEMA_NAME,
        "created_by": {"nlpgrasp": __version__},
        **entry.summary(),
        "fit": fit if wrenches is None else {**fit, "wrenches": wrenches.name},
    }
    del data["wrenches"], data["forgotten"]  # the fit says so
    lines = (f" {json.dumps(k)}: {json.dumps(v, ensure_ascii=False, allow_nan=False)}" for k, v in data.items())
    return "{\n" + ",\n".join(lines) + "\n}\n"


def read_entry(path: Path) -> TaskEntry:
    """Read an entry and its wrenches from their files.

    Raises
    ------
    InputError
        When the file is truncated or invalid, has other units or dimensions, or its wrenches are missing; it names the
        file and the field.
    """
    content = _read_text(path)
    while True:
        try:
            return parse_entry(content, path)
        except FileNotFoundError as error:
            earlier, content = content, _read_text(path)
            if content == earlier:  # not replaced by another process meanwhile
                missing = f"{Path(error.filename).name}, which is not there"
                raise InputError(f"{path}: fit.wrenches", missing, "the file beside the entry's") from None


def _read_text(path: Path) -> str:
    """Return the text of an entry's file."""
    return read_text(path, "an entry of a task library", LARGEST_FILE)


def parse_entry(content: str, path: Path) -> TaskEntry:
    """Parse an entry from the JSON text of its file, and read its wrenches."""
    name = str(path)
    data = read_object(content, name)
    if data.get("schema") != SCHEMA_NAME:
        raise InputError(f"{name}: schema", data.get("schema", "nothing"), repr(SCHEMA_NAME))
    units = data.get("units")
    for quantity, unit in UNITS.items():
        stated = units.get(quantity, "nothing") if isinstance(units, dict) else units
        if stated != unit:
            raise InputError(f"{name}: units.{quantity}", stated, f"{unit!r}: entries are in SI units")
    check_schema(data, _validator(), name, EXPECTED)
    with prefix_errors(f"{name}: "):
        return _entry(data, path.parent)


def _entry(data: Json, folder: Path) -> TaskEntry:
    """Build the entry from validated JSON data, and read its wrenches from a folder."""
    d = data["dimension"]
    axes = array("task.axes", data["task"]["axes"], (None, d))
    task = TaskEllipsoid.from_axes(axes, array("task.center", data["task"]["center"], (d,)))
    file = data["fit"].get("wrenches")
    wrenches = None if file is None else read_wrenches(folder / file, d)
    learnt = FITS[data["fit"]["kind"]].from_dict(data["fit"], task, wrenches)
    return TaskEntry(
        entry_name(data["name"]),
        learnt,
        Frame(data["frame"]["words"], about_point(data["frame"]["about"], d, "frame.about")),
        data["description"],
        tuple(data["tags"]),
        tuple(
            ProvenanceRecord(record["did"], record["source"], record["wrenches"], record["date"])
            for record in data["provenance"]
        ),
    )
