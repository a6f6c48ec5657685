"""The kinds of body that a file may hold."""

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
from nlpgrasp.common.solids import SOLIDS, solid_from_dict
from nlpgrasp.common.types import Json

Kind = TypeVar("Kind", bound=Body)


def register(body: type[Kind]) -> type[Kind]:
    """Add a kind of body, of this package or another, to those that files may hold; also as a decorator.

    Parameters
    ----------
    body : subclass of Body
        With ``kind``, the name that its ``to_dict`` gives as ``type``. A class that is not a dataclass needs
        ``from_dict`` as well.

    Raises
    ------
    InputError
        When another body has that name.
    """
    SOLIDS.add(body.kind, body)
    return body


def body_from_dict(data: Json) -> Body:
    """Return the body that ``to_dict`` wrote, of any registered kind.

    Raises
    ------
    InputError
        When the type is unknown, the numbers make no body, or the data do not say all of it.
    """
    found = solid_from_dict(data)
    if not isinstance(found, Body):
        raise SOLIDS.unknown(data.get("type"))
    return found


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
