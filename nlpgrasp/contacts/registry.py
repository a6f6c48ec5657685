"""Contact models from their JSON data."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from nlpgrasp.contacts.base import ContactModel
from nlpgrasp.contacts.friction import FrictionContact
from nlpgrasp.contacts.point import PointContact
from nlpgrasp.contacts.soft import SoftContact
from nlpgrasp.errors import InputError

KINDS = (PointContact.kind, FrictionContact.kind, SoftContact.kind)


def contact_from_dict(data: Mapping[str, Any]) -> ContactModel:
    """Return the contact model that ``to_dict`` wrote.

    Raises
    ------
    InputError
        When the model is unknown or a coefficient is missing or out of range.
    """
    model = data.get("model")
    if model == PointContact.kind:
        return PointContact()
    if model == FrictionContact.kind:
        return FrictionContact(data.get("friction", float("nan")))
    if model == SoftContact.kind:
        torsion = data.get("torsional_friction", float("nan"))
        return SoftContact(data.get("friction", float("nan")), torsion, data.get("torsion_model", "box"))
    raise InputError("contact.model", model, "one of " + ", ".join(KINDS))
