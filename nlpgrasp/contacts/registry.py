"""Registry of contact models for JSON files, filled with those of the package."""

from __future__ import annotations

from typing import TypeVar

from nlpgrasp.contacts.base import CONTACTS, ContactModel, require_coefficients
from nlpgrasp.contacts.bilateral import BilateralContact
from nlpgrasp.contacts.friction import FrictionContact
from nlpgrasp.contacts.line import LineContact
from nlpgrasp.contacts.plane import PlaneContact
from nlpgrasp.contacts.point import PointContact
from nlpgrasp.contacts.soft import SoftContact

Kind = TypeVar("Kind", bound=ContactModel)


def register(model: type[Kind]) -> type[Kind]:
    """Register a contact model for JSON files; usable as a decorator.

    Parameters
    ----------
    model : subclass of ContactModel
        With ``from_dict`` and ``kind``, which is the ``model`` in its ``to_dict``.

    Raises
    ------
    InputError
        When another model has that name, or the model does not state its friction coefficients.
    """
    require_coefficients(model)
    CONTACTS.add(model.kind, model)
    return model


register(PointContact)
register(FrictionContact)
register(SoftContact)
register(LineContact)
register(PlaneContact)
register(BilateralContact)
