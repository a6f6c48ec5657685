"""Descriptions and provenance of library entries."""

from __future__ import annotations

from dataclasses import dataclass, replace
from datetime import UTC, datetime
from typing import TypedDict

from nlpgrasp.errors import InputError
from nlpgrasp.tasks.library.entry import Frame, Origin, TaskEntry, tag_words, text


class Notes(TypedDict, total=False):
    """Optional description, tags, frame and source of an entry."""

    description: str
    tags: str | list[str] | tuple[str, ...]
    frame: str
    source: str


@dataclass(frozen=True)
class Said:
    """Validated notes with defaults."""

    description: str
    tags: tuple[str, ...]
    frame: str
    source: str

    @classmethod
    def of(cls, notes: Notes) -> Said:
        """Return validated notes.

        Raises
        ------
        InputError
            On unknown fields or invalid texts.
        """
        unknown = sorted(set(notes) - set(Notes.__annotations__))
        if unknown:
            raise InputError("notes", ", ".join(unknown), "some of " + ", ".join(Notes.__annotations__))
        lines = [text(field, notes.get(field, "")) for field in ("description", "frame", "source")]
        return cls(lines[0], tag_words(notes.get("tags", ())), lines[1], lines[2])


def copied(entry: TaskEntry, name: str, said: Said) -> TaskEntry:
    """Return a copy of an entry under another name, with given notes replacing its own."""
    origin = origin_now("added", said.source or f"a copy of {entry.name}", 0)
    return replace(
        entry,
        name=name,
        frame=Frame(said.frame or entry.frame.words, entry.frame.about),
        description=said.description or entry.description,
        tags=said.tags or entry.tags,
        provenance=(*entry.provenance, origin),
    )


def origin_now(did: str, source: str, wrenches: int) -> Origin:
    """Return a provenance record with today's date."""
    return Origin(did, source, wrenches, datetime.now(UTC).date().isoformat())


def after(entry: TaskEntry, origin: Origin) -> tuple[Origin, ...]:
    """Return an entry's provenance with a record appended; equal records of one day are combined."""
    *before, last = entry.provenance or (origin,)
    if not entry.provenance or replace(last, wrenches=origin.wrenches) != origin:
        return (*entry.provenance, origin)
    return (*before, replace(origin, wrenches=last.wrenches + origin.wrenches))
