"""Contact models from their JSON data."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from nlpgrasp.contacts.base import ContactModel
from nlpgrasp.contacts.bilateral import BilateralContact
from nlpgrasp.contacts.friction import FrictionContact
from nlpgrasp.contacts.line import LineContact
from nlpgrasp.contacts.plane import PlaneContact
from nlpgrasp.contacts.point import PointContact
from nlpgrasp.contacts.soft import SoftContact
from nlpgrasp.errors import InputError

MISSING = float("nan")  # refused by every model that needs the number
READERS: dict[str, Callable[[Mapping[str, Any]], ContactModel]] = {
    PointContact.kind: lambda data: PointContact(),
    FrictionContact.kind: lambda data: FrictionContact(data.get("friction", MISSING)),
    SoftContact.kind: lambda data: SoftContact(
        data.get("friction", MISSING), data.get("torsional_friction", MISSING), data.get("torsion_model", "box")
    ),
    LineContact.kind: lambda data: LineContact(
        data.get("length", MISSING), data.get("friction"), data.get("torsional_friction"), data.get("direction")
    ),
    PlaneContact.kind: lambda data: PlaneContact(
        data.get("radius"),
        data.get("extents"),
        data.get("friction"),
        data.get("torsional_friction"),
        data.get("direction"),
    ),
    BilateralContact.kind: lambda data: BilateralContact(contact_from_dict(data.get("of", {}))),
}


def contact_from_dict(data: Mapping[str, Any]) -> ContactModel:
    """Return the contact model that ``to_dict`` wrote.

    Raises
    ------
    InputError
        When the model is unknown or a coefficient is missing or out of range.
    """
    reader = READERS.get(str(data.get("model"))) if isinstance(data, Mapping) else None
    if reader is None:
        given = data.get("model") if isinstance(data, Mapping) else data
        raise InputError("contact.model", given, "one of " + ", ".join(READERS))
    return reader(data)
