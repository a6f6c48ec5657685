"""Allowed faces of each contact."""

from __future__ import annotations

from collections.abc import Sequence

from nlpgrasp.bodies import Body
from nlpgrasp.constraints import PlacementConstraint
from nlpgrasp.contacts import ContactModel


def allowed_faces(
    body: Body, models: Sequence[ContactModel], constraints: Sequence[PlacementConstraint], contact: int
) -> tuple[str, ...]:
    """Return the names of a contact's allowed faces: its own or all, without forbidden ones.

    Raises
    ------
    InputError
        On unknown face names.
    """
    chosen = body.select(models[contact].faces, f"contacts[{contact}].faces")
    forbidden: set[str] = set()
    for item in constraints:
        names = item.forbidden_faces()
        body.select(names or None, "Forbid.faces_or_region")
        forbidden |= set(names)
    return tuple(name for name in chosen if name not in forbidden)
