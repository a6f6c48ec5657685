"""Entry of a task library and its JSON file."""

from __future__ import annotations

import json
import unicodedata
from collections.abc import Iterable
from dataclasses import dataclass
from functools import lru_cache
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from nlpgrasp.common.files import check_schema, read_object, read_text, write_text
from nlpgrasp.common.formatting import FORCE_UNIT, MOMENT_UNIT
from nlpgrasp.common.spatial import space_dimension
from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray, array, prefix_errors, read_only
from nlpgrasp.errors import InputError
from nlpgrasp.tasks.growing_ellipsoids import Learnt, LeastVolume, Normal
from nlpgrasp.tasks.task_ellipsoid import TaskEllipsoid
from nlpgrasp.version import __version__

if TYPE_CHECKING:
    import jsonschema


SCHEMA_NAME = "nlpgrasp-task/1"
UNITS = {"force": FORCE_UNIT, "torque": MOMENT_UNIT}
LONGEST_NAME, LONGEST_TEXT = 100, 2000  # characters
LEARNT: dict[str, type[Learnt]] = {kind.kind: kind for kind in (LeastVolume, Normal)}  # by name in files
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
        """Raise if another frame or reference point differs."""
        if other.words != self.words:
            raise InputError("frame", other.words or "no words", f"{self.words or 'no words'!r}, that of the entry")
        if not same_point(self.about, other.about):
            raise InputError("frame.about", point_words(other.about), f"{point_words(self.about)}, that of the entry")


@dataclass(frozen=True)
class Origin:
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
        many = f"{self.wrenches} wrenches" if self.wrenches else ""
        return ", ".join(part for part in (self.date, self.did, many, self.source) if part)


@dataclass(frozen=True)
class TaskEntry:
    """An entry of a task library.

    Parameters
    ----------
    name : str
        Unique in the library.
    learnt : Learnt
        The ellipsoid, and the statistics to update it.
    frame : Frame
        Axes and reference point of its wrenches.
    description : str
        For readers.
    tags : tuple of str
        Further words for ``search``.
    provenance : tuple of Origin
        Oldest first.
    """

    name: str
    learnt: Learnt
    frame: Frame = Frame()
    description: str = ""
    tags: tuple[str, ...] = ()
    provenance: tuple[Origin, ...] = ()

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
        """Number of recorded wrenches that it was fitted to."""
        return self.learnt.wrenches

    @property
    def rank(self) -> int:
        """Number of directions in which the ellipsoid is not flat."""
        axes = self.learnt.axes
        size = np.max(np.abs(axes), axis=0)
        return int(np.linalg.matrix_rank(axes / np.where(size > 0.0, size, 1.0)))

    def holds(self, words: Iterable[str]) -> bool:
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
            "provenance": [dict(vars(origin)) for origin in self.provenance],
            "task": self.learnt.task.to_dict(),
            "wrenches": self.wrenches,
            "forgotten": self.learnt.forgotten,
        }

    def __str__(self) -> str:
        flat = "" if self.rank == self.dimension else f", flat: {self.rank} of {self.dimension} directions"
        lines = [f"{self.name}: ellipsoid {self.learnt.words()}{flat}"]
        lines += [self.description] if self.description else []
        lines += [f"frame: {self.frame.words or 'not said'}; moments about {point_words(self.frame.about)}"]
        lines += [f"tags: {', '.join(self.tags)}"] if self.tags else []
        return "\n  ".join([*lines, *map(str, self.provenance)])


def frame_data(frame: Frame) -> Json:
    """Return a frame as JSON data."""
    return {"words": frame.words, "about": None if frame.about is None else frame.about.tolist()}


def same_point(a: FloatArray | None, b: FloatArray | None) -> bool:
    """Return whether two reference points are equal."""
    return (a is None and b is None) or (a is not None and b is not None and np.array_equal(a, b))


def point_words(point: FloatArray | None) -> str:
    """Return a reference point as text."""
    return "the problem's torque origin" if point is None else str(point.tolist())


def entry_name(value: object) -> str:
    """Return a validated name of an entry, in Unicode normal form C."""
    name = unicodedata.normalize("NFC", value) if isinstance(value, str) else ""
    if not name or name != " ".join(name.split()) or not name.isprintable() or len(name) > LONGEST_NAME:
        allowed = f"a name of 1 to {LONGEST_NAME} printable characters, with single spaces"
        raise InputError("name", repr(value), allowed)
    return name


def check_text_line(field: str, value: object) -> str:
    """Return a validated line of text, in Unicode normal form C."""
    if not isinstance(value, str) or not value.isprintable() or len(value) > LONGEST_TEXT:
        raise InputError(field, repr(value), f"one line of at most {LONGEST_TEXT} printable characters")
    return unicodedata.normalize("NFC", value)


def tag_words(value: object) -> tuple[str, ...]:
    """Return validated tags from one or several."""
    several = [value] if isinstance(value, str) else value
    if not isinstance(several, list | tuple):
        raise InputError("tags", value, "a word or several")
    return tuple(check_text_line("tags", one) for one in several)


def about_point(value: object, dimension: int, field: str = "about") -> FloatArray | None:
    """Return a validated reference point of moments, (space,), or None."""
    return None if value is None else read_only(array(field, value, (space_dimension(dimension),)))


@lru_cache
def entry_schema() -> Json:
    """Return the JSON Schema of entries of task libraries (task schema 1)."""
    return dict(json.loads(files(__package__).joinpath("nlpgrasp-task-1.schema.json").read_text(encoding="utf-8")))


@lru_cache
def _validator() -> jsonschema.Draft202012Validator:
    import jsonschema

    return jsonschema.Draft202012Validator(entry_schema())


def write_entry(entry: TaskEntry, path: Path) -> Path:
    """Write an entry's file atomically."""
    return write_text(path, entry_json(entry))


def entry_json(entry: TaskEntry) -> str:
    """Return an entry as JSON text, one field per line."""
    data = {
        "schema": SCHEMA_NAME,
        "created_by": {"nlpgrasp": __version__},
        **entry.summary(),
        "fit": entry.learnt.to_dict(),
    }
    del data["wrenches"], data["forgotten"]  # the fit says so
    lines = (f" {json.dumps(k)}: {json.dumps(v, ensure_ascii=False, allow_nan=False)}" for k, v in data.items())
    return "{\n" + ",\n".join(lines) + "\n}\n"


def read_entry(path: Path) -> TaskEntry:
    """Read an entry from a file.

    Raises
    ------
    InputError
        When the file is truncated or invalid, or has other units or dimensions; it names the file and the field.
    """
    return parse_entry(read_text(path, "an entry of a task library", LARGEST_FILE), str(path))


def parse_entry(content: str, name: str) -> TaskEntry:
    """Parse an entry from JSON text; ``name`` is used in messages."""
    data = read_object(content, name)
    if data.get("schema") != SCHEMA_NAME:
        raise InputError(f"{name}: schema", data.get("schema", "nothing"), repr(SCHEMA_NAME))
    units = data.get("units")
    for quantity, unit in UNITS.items():
        given = units.get(quantity, "nothing") if isinstance(units, dict) else units
        if given != unit:
            raise InputError(f"{name}: units.{quantity}", given, f"{unit!r}: entries are in SI units")
    check_schema(data, _validator(), name, EXPECTED)
    with prefix_errors(f"{name}: "):
        return _entry(data)


def _entry(data: Json) -> TaskEntry:
    """Return the entry of data that conform to the schema."""
    d = data["dimension"]
    axes = array("task.axes", data["task"]["axes"], (None, d))
    task = TaskEllipsoid.from_axes(axes, array("task.center", data["task"]["center"], (d,)))
    learnt = LEARNT[data["fit"]["kind"]].from_dict(data["fit"], task)
    return TaskEntry(
        entry_name(data["name"]),
        learnt,
        Frame(data["frame"]["words"], about_point(data["frame"]["about"], d, "frame.about")),
        data["description"],
        tuple(data["tags"]),
        tuple(Origin(one["did"], one["source"], one["wrenches"], one["date"]) for one in data["provenance"]),
    )
