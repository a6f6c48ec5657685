"""MJCF parts of a static-hand scene: object, fingertips, contacts and hand links."""

from __future__ import annotations

from collections.abc import Iterable
from xml.etree.ElementTree import Element, SubElement

import numpy as np

from nlpgrasp.common.shown.drawing import Drawing, Triangles
from nlpgrasp.common.spatial import in_space
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.contacts import ContactModel
from nlpgrasp.contacts.product import ranges
from nlpgrasp.grasp.grasp import Grasp
from nlpgrasp.mjcf.scales import Scales
from nlpgrasp.tasks.mass import Mass

TIP, PATCH = 0.3, 0.6  # fingertip radius and patch half side, of the contacts' spread
LEAST_INERTIA = 1e-12  # kg m^2, added to moments of inertia, as MuJoCo requires
TIP_MASS = 0.2  # of the object's mass
FORCE_NAMES = ("normal", "tangent_1", "tangent_2")
UNTOUCHED = {"contype": "0", "conaffinity": "0"}  # collides only in explicit contact pairs


def pressing(grasp: Grasp) -> FloatArray:
    """Return finger forces (n,) with a normal force of one newton at each contact."""
    x = np.zeros(grasp.G.shape[1])
    x[[part.start for part in ranges(grasp.contacts, grasp.space)]] = 1.0
    return x


def force_indices(grasp: Grasp) -> list[int]:
    """Return the indices of force components, without moments."""
    axes = [axis for model in grasp.contacts for axis in model.axes(grasp.space)]
    return [index for index, axis in enumerate(axes) if axis < grasp.space]


def joint_names(i: int, model: ContactModel, space: int) -> list[str]:
    """Return the joint names of a fingertip, one per force component."""
    return [f"tip_{i}_{FORCE_NAMES[axis]}" for axis in model.axes(space) if axis < space]


def add_object(asset: Element, world: Element, grasp: Grasp, drawing: Drawing, mass: Mass) -> Element:
    """Add the free object (in the plane, if planar) with its mesh, and return its body."""
    body = add_free_body(world, mass, grasp.space)
    _add_mesh(asset, "object", drawing.body)
    SubElement(body, "geom", name="object", type="mesh", mesh="object", rgba="0.56 0.64 0.71 0.5")
    return body


def add_free_body(world: Element, mass: Mass, space: int = 3) -> Element:
    """Add the free object's body (in the plane, if planar) without a shape, and return it."""
    body = SubElement(world, "body", name="object")
    if space == 3:
        SubElement(body, "freejoint", name="object")
    else:
        SubElement(body, "joint", name="object_x", type="slide", axis="1 0 0")
        SubElement(body, "joint", name="object_y", type="slide", axis="0 1 0")
        SubElement(body, "joint", name="object_turn", type="hinge", axis="0 0 1")
    moments = numbers((mass.inertia + LEAST_INERTIA * np.eye(3))[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]])
    SubElement(body, "inertial", pos=numbers(mass.center), mass=f"{mass.mass:.9g}", fullinertia=moments)
    return body


def add_patches(body: Element, grasp: Grasp, unit: Scales) -> None:
    """Add a patch of the tangent plane at each contact to the object's body."""
    thick = TIP * unit.length
    half = numbers([thick, PATCH * unit.length, PATCH * unit.length])
    for i, (p, n) in enumerate(zip(in_space(grasp.points), in_space(grasp.normals), strict=True)):
        place = {"pos": numbers(p + thick * n), "xyaxes": _axes(grasp, i), "size": half}
        look = {"group": "4", "rgba": "0 0 0 0"}
        SubElement(body, "geom", {"name": f"patch_{i}", "type": "box", **place, **look, **UNTOUCHED})


def add_links(asset: Element, world: Element, drawing: Drawing) -> None:
    """Add the hand's links in the grasp's posture, for display without collision."""
    if not drawing.links:
        return
    hand = SubElement(world, "body", name="hand")
    for i, (_, shape) in enumerate(drawing.links):
        _add_mesh(asset, f"link_{i}", shape)
        look = {"group": "2", "rgba": "0.71 0.61 0.48 0.6"}
        SubElement(hand, "geom", {"name": f"link_{i}", "type": "mesh", "mesh": f"link_{i}", **look, **UNTOUCHED})


def add_fingertip(world: Element, grasp: Grasp, i: int, unit: Scales, stiffness: bool) -> None:
    """Add a fingertip: a small ball with sliding joints along its contact's force components."""
    p, n, model = in_space(grasp.points)[i], in_space(grasp.normals)[i], grasp.contacts[i]
    radius = TIP * unit.length
    place = {"pos": numbers(p - radius * n), "xyaxes": _axes(grasp, i)}
    tip = SubElement(world, "body", place, name=f"tip_{i}", gravcomp="1")  # the hand carries its own weight
    held = {"stiffness": f"{unit.stiffness if stiffness else 0.0:.9g}", "damping": f"{unit.damping:.9g}"}
    axes = [axis for axis in model.axes(grasp.space) if axis < grasp.space]
    for joint, axis in zip(joint_names(i, model, grasp.space), axes, strict=True):
        SubElement(tip, "joint", {"name": joint, "type": "slide", "axis": numbers(np.eye(3)[axis]), **held})
    own = numbers([0.4 * TIP_MASS * unit.mass * radius**2 + LEAST_INERTIA] * 3)
    SubElement(tip, "inertial", pos="0 0 0", mass=f"{TIP_MASS * unit.mass:.9g}", diaginertia=own)
    look = {"name": f"tip_{i}", "type": "sphere", "rgba": "0.1 0.1 0.1 1", "size": f"{radius:.9g}"}
    SubElement(tip, "geom", {**look, **UNTOUCHED})


def add_contact(contact: Element, i: int, model: ContactModel) -> None:
    """Add the contact pair of a fingertip and its patch."""
    friction = model.coefficients.get("friction", 0.0)
    torsion = model.coefficients.get("torsional_friction", 0.0)
    dimension, coefficients = 1, [1.0] * 5
    if friction:
        dimension = 4 if torsion else 3
        coefficients = [friction, friction, torsion or 1.0, 1.0, 1.0]
    pair = {"name": f"contact_{i}", "geom1": f"tip_{i}", "geom2": f"patch_{i}"}
    SubElement(contact, "pair", pair, condim=str(dimension), friction=numbers(coefficients))


def numbers(values: Iterable[float]) -> str:
    """Format numbers for MJCF."""
    return " ".join(f"{float(v):.9g}" for v in values)


def _add_mesh(asset: Element, name: str, shape: Triangles) -> None:
    faces = " ".join(map(str, shape.faces.ravel().tolist()))
    SubElement(asset, "mesh", name=name, inertia="shell", vertex=numbers(shape.vertices.ravel()), face=faces)


def _axes(grasp: Grasp, i: int) -> str:
    """Return normal and first tangent of a contact's frame, formatted for MJCF."""
    return numbers(np.concatenate([in_space(grasp.normals)[i], in_space(grasp.tangents[i])[0]]))
