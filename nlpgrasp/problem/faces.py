"""Which faces of the body each contact may use."""

from __future__ import annotations

from collections.abc import Sequence

from nlpgrasp.bodies import Body
from nlpgrasp.constraints import PlacementConstraint
from nlpgrasp.contacts import ContactModel


def allowed_faces(
    body: Body, models: Sequence[ContactModel], constraints: Sequence[PlacementConstraint], contact: int
) -> tuple[str, ...]:
    """Return names of the faces that contact ``contact`` may use: its own, or all, but for those forbidden.

    Raises
    ------
    InputError
        On names of faces that the body does not have.
    """
    chosen = body.select(models[contact].faces, f"contacts[{contact}].faces")
    forbidden: set[str] = set()
    for item in constraints:
        names = item.forbidden_faces()
        body.select(names or None, "Forbid.faces_or_region")
        forbidden |= set(names)
    return tuple(name for name in chosen if name not in forbidden)
