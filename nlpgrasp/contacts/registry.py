"""The kinds of contact model that a file may hold."""

from __future__ import annotations

from typing import TypeVar

from nlpgrasp.contacts.base import CONTACTS, ContactModel
from nlpgrasp.contacts.bilateral import BilateralContact
from nlpgrasp.contacts.friction import FrictionContact
from nlpgrasp.contacts.line import LineContact
from nlpgrasp.contacts.plane import PlaneContact
from nlpgrasp.contacts.point import PointContact
from nlpgrasp.contacts.soft import SoftContact

Kind = TypeVar("Kind", bound=ContactModel)


def register(model: type[Kind]) -> type[Kind]:
    """Add a contact model, of this package or another, to those that files may hold; also as a decorator.

    Parameters
    ----------
    model : subclass of ContactModel
        With ``kind``, the name that its ``to_dict`` gives as ``model``, and ``from_dict``.

    Raises
    ------
    InputError
        When another model has that name.
    """
    CONTACTS.add(model.kind, model)
    return model


register(PointContact)
register(FrictionContact)
register(SoftContact)
register(LineContact)
register(PlaneContact)
register(BilateralContact)
