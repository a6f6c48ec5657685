"""Recognition of the columns of a table of contacts: positions and normals of one contact, or several, in a row."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

from nlpgrasp.common.validation import LENGTHS
from nlpgrasp.errors import InputError

POSITION, NORMAL = ("p_x", "p_y", "p_z"), ("n_x", "n_y", "n_z")
COEFFICIENTS = ("friction", "torsional_friction")
EXPECTED = (
    f"one each of {', '.join((*POSITION, *NORMAL))} (or x, y, z, nx, ny, nz; pos_x and normal_x; numbered, as c0_x and "
    "c0_nx, for several contacts in a row), then rows"
)
WORD = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+|\d+")  # also of camelCase, and a number behind a word
AXIS = re.compile(r"(p|n|pos|point|normal)?([xyz])")  # axis, perhaps with the quantity before it
OWNERS = {"c", "contact", "contacts", "finger", "fingertip", "tip"}  # words for what a component is of
POSITIONS = {"p", "pos", "position", "positions", "point", "points", "pt", "location", "coordinate", "coord"} | OWNERS
NORMALS = {"n", "normal", "normals", "nrm", "norm"}
BESIDE_NORMALS = {"inward", "unit", "surface", "p", "pos", "point"} | OWNERS
MOST_SHOWN = 24  # columns in a message


@dataclass(frozen=True)
class ContactColumns:
    """Columns of one contact in the rows of a table.

    Parameters
    ----------
    indices : dict of str to int
        Column of each of ``p_x ... n_z`` and of the coefficients.
    unit : str or None
        Unit of length that the names of the positions state.
    """

    indices: dict[str, int]
    unit: str | None


@dataclass(frozen=True)
class _Component:
    """Component that the name of a column states.

    Parameters
    ----------
    name : str
        Of ``p_x ... n_z``, or a coefficient.
    spelling : tuple of str
        The other words of the name.
    number : int or None
        Number of the contact.
    unit : str or None
    """

    name: str
    spelling: tuple[str, ...]
    number: int | None
    unit: str | None


def has_contacts(header: Sequence[str]) -> bool:
    """Return whether a row names positions and normals."""
    names = {component.name for column in header if (component := _component_of(column)) is not None}
    return names >= {*POSITION[:2], *NORMAL[:2]}


def contact_columns(name: str, header: Sequence[str]) -> list[ContactColumns]:
    """Return the columns of each contact in a row.

    Raises
    ------
    InputError
        When columns are missing or ambiguous.
    """
    components = [_component_of(column) for column in header]
    stated = {component.name for component in components if component is not None}
    space = 3 if stated & {POSITION[2], NORMAL[2]} else 2
    wanted = (*POSITION[:space], *NORMAL[:space])
    missing = [component for component in wanted if component not in stated]
    shown = ", ".join(header[:MOST_SHOWN]) + (", ..." if len(header) > MOST_SHOWN else "")
    if missing:
        raise InputError(f"{name}: header", f"no column {missing[0]} among {shown}", EXPECTED)
    positions, normals = (_only_group(name, components, names[:space], header) for names in (POSITION, NORMAL))
    if positions.keys() != normals.keys():
        given = f"positions of {_format_contacts(positions)} and normals of {_format_contacts(normals)} in {shown}"
        raise InputError(f"{name}: header", given, EXPECTED)
    coefficients = {(c.name, c.number): i for i, c in enumerate(components) if c is not None and c.name in COEFFICIENTS}
    result = []
    for number in sorted(positions, key=lambda number: -1 if number is None else number):
        units = {_unit_of(components[i]) for i in positions[number].values()}
        if len(units) > 1:
            given = ", ".join(header[i] for i in positions[number].values())
            raise InputError(f"{name}: header", given, "one unit for the positions of all axes")
        own = {c: coefficients[c, n] for c in COEFFICIENTS for n in (None, number) if (c, n) in coefficients}
        result.append(ContactColumns(positions[number] | normals[number] | own, units.pop()))
    if len({columns.unit for columns in result}) > 1:
        raise InputError(f"{name}: header", shown, "one unit for the positions of all contacts")
    return result


def _only_group(
    name: str, components: Sequence[_Component | None], names: Sequence[str], header: Sequence[str]
) -> dict[int | None, dict[str, int]]:
    """Return the columns of positions or of normals, by contact number and component.

    Columns that are spelt alike belong together. The names themselves come before other spellings.
    """
    if set(names) <= set(header):
        return {None: {component: header.index(component) for component in names}}
    groups: dict[tuple[tuple[str, ...], bool], dict[int | None, dict[str, int]]] = {}
    for i, component in enumerate(components):
        if component is not None and component.name in names:
            group = groups.setdefault((component.spelling, component.number is None), {})
            contact = group.setdefault(component.number, {})
            if component.name in contact:
                given = f"columns {header[contact[component.name]]} and {header[i]}"
                raise InputError(f"{name}: header", given, f"one column for {component.name}")
            contact[component.name] = i
    complete = [group for group in groups.values() if _is_complete(group, len(names))]
    if len(complete) == 1:
        return complete[0]
    candidates = [
        header[i] for i, component in enumerate(components) if component is not None and component.name in names
    ]
    given = f"columns {', '.join(candidates[:MOST_SHOWN])}{' ...' if len(candidates) > MOST_SHOWN else ''}"
    raise InputError(f"{name}: header", f"{given} for {', '.join(names)}", EXPECTED)


def _is_complete(group: dict[int | None, dict[str, int]], space: int) -> bool:
    """Return whether all contacts of a group have all components, and numbers from 0 or 1."""
    numbers = sorted(number for number in group if number is not None)
    is_numbered = not numbers or numbers in ([*range(len(numbers))], [*range(1, len(numbers) + 1)])
    return is_numbered and all(len(contact) == space for contact in group.values())


def _format_contacts(group: dict[int | None, dict[str, int]]) -> str:
    """Return a text that names the contacts of a group."""
    return "no number" if None in group else f"{len(group)} contacts from {min(n for n in group if n is not None)}"


def _unit_of(component: _Component | None) -> str | None:
    """Return the unit that a component's name states."""
    return None if component is None else component.unit


def _component_of(column: str) -> _Component | None:
    """Return the component that the name of a column states, or ``None`` for other columns."""
    tokens = [token.lower() for token in WORD.findall(column)]
    numbers, words = [t for t in tokens if t.isdigit()], [t for t in tokens if not t.isdigit()]
    if len(numbers) > 1 or not words:
        return None
    number = int(numbers[0]) if numbers else None
    for coefficient in reversed(COEFFICIENTS):
        parts = coefficient.split("_")
        if words[-len(parts) :] == parts and set(words[: -len(parts)]) <= OWNERS:
            return _Component(coefficient, tuple(words[: -len(parts)]), number, None)
    unit = None
    if len(words) > 1 and words[-1] in LENGTHS:
        unit = LENGTHS[words.pop()]
        if len(words) > 1 and words[-1] == "in":
            words.pop()
    match = AXIS.fullmatch(words[-1])
    if match is not None:
        spelling, axis = [*words[:-1], *([match[1]] if match[1] else [])], match[2]
    elif words[0] in ("x", "y", "z"):  # x_pos
        spelling, axis = words[1:], words[0]
    else:
        return None
    is_normal = bool(NORMALS & set(spelling))
    if not set(spelling) <= (NORMALS | BESIDE_NORMALS if is_normal else POSITIONS):
        return None
    return _Component(f"{'n' if is_normal else 'p'}_{axis}", tuple(spelling), number, unit)
