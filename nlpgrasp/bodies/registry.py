"""Registry of body types for JSON files, and the places in which a new type is entered."""

from __future__ import annotations

from typing import TypeVar

from nlpgrasp.bodies.base import Body
from nlpgrasp.bodies.box import Box
from nlpgrasp.bodies.cylinder import Cylinder
from nlpgrasp.bodies.ellipsoid import Ellipsoid
from nlpgrasp.bodies.implicit import Implicit, PlanarImplicit
from nlpgrasp.bodies.mesh.mesh import Mesh
from nlpgrasp.bodies.polygon import Polygon
from nlpgrasp.bodies.prism import Prism
from nlpgrasp.bodies.sphere import Sphere
from nlpgrasp.bodies.superquadric import Superquadric
from nlpgrasp.bodies.torus import Torus
from nlpgrasp.common.registry import SOLIDS, solid_from_dict
from nlpgrasp.common.types import Json

Kind = TypeVar("Kind", bound=Body)


def register(body: type[Kind]) -> type[Kind]:
    """Register a body type for JSON files; below, the entries that verification and global bounds need.

    Usable as a decorator. Files with the body are verified by its own functions, or, which claims more, by a numeric
    counterpart (``nlpgrasp.verify.register_body``). Placements on it are bounded, and the bounds verified, where it
    states ``charts``.

    Parameters
    ----------
    body : subclass of Body
        Its ``kind`` is the ``type`` in its ``to_dict``. A class that is not a dataclass also needs ``from_dict``.

    Raises
    ------
    InputError
        When another body type has that name.
    """
    SOLIDS.add(body.kind, body)
    return body


def body_from_dict(data: Json) -> Body:
    """Return a body of any registered type from the data of its ``to_dict``.

    Raises
    ------
    InputError
        When the type is unknown, or the data are invalid or incomplete.
    """
    body = solid_from_dict(data)
    if not isinstance(body, Body):
        raise SOLIDS.unknown(data.get("type"))
    return body


register(Box)
register(Cylinder)
register(Ellipsoid)
register(Implicit)
register(Mesh)
register(PlanarImplicit)
register(Polygon)
register(Prism)
register(Sphere)
register(Superquadric)
register(Torus)
