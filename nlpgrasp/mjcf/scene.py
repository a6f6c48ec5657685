"""MJCF text of a scene with a free object, motor-driven fingertips and a keyframe.

MuJoCo collides meshes as their convex hulls, on which contacts on a concave part would float. Each fingertip therefore
touches only a patch of the object's tangent plane at its own contact, the surface of the grasp model. The mesh itself,
as its hull, collides with anything else in the scene.
"""

from __future__ import annotations

from dataclasses import dataclass
from xml.etree.ElementTree import Comment, Element, SubElement, indent, tostring

import numpy as np

from nlpgrasp.common.shown.drawing import drawn_size
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.errors import InputError
from nlpgrasp.grasp.grasp import Grasp
from nlpgrasp.mjcf.parts import (
    add_contact,
    add_fingertip,
    add_links,
    add_object,
    add_patches,
    force_indices,
    joint_names,
    numbers,
    pressing,
)
from nlpgrasp.mjcf.scales import Scales, scales
from nlpgrasp.solution.solution import GraspSolution
from nlpgrasp.tasks.mass import Mass, mass_of

DENSITY = 1000.0  # kg / m^3, of an object whose mass is not given
STEP = 0.005  # time step, of the characteristic time
STIFF = 4.0  # time constant of contacts in time steps: smaller ones bounce
SOLVER = {
    "integrator": "implicitfast",
    "cone": "elliptic",
    "impratio": "50",
    "solver": "Newton",
    "iterations": "100",
    "tolerance": "1e-12",
}


@dataclass(frozen=True)
class SceneOptions:
    """Options that replace a solution's data in a scene.

    Parameters
    ----------
    grasp : Grasp, optional
        Replaces the solution's grasp.
    mass : Mass, optional
        By default for the density of water.
    forces : (n,) array, optional
        Finger forces of the keyframe ``grasp``, contact by contact as in G; by default normal forces of one newton.
    unit : Scales, optional
        By default that of the keyframe's forces.
    stiffness : bool
        Whether joint springs hold the fingertips in place in addition to their motors.
    """

    grasp: Grasp | None = None
    mass: Mass | None = None
    forces: FloatArray | None = None
    unit: Scales | None = None
    stiffness: bool = True


def mjcf(solution: GraspSolution, options: SceneOptions | None = None) -> str:
    """Return the scene as MJCF text; metres, newtons, world frame = body frame, no gravity.

    Parameters
    ----------
    solution : GraspSolution
        One with a grasp.
    options : SceneOptions, optional
        Masses, sizes and gains of the scene.

    Raises
    ------
    InputError
        Without a grasp or a drawing, or with bilateral contacts.
    """
    given = SceneOptions() if options is None else options
    drawing, held = solution.require_drawing(), _pressed(solution, given.grasp)
    mass = mass_of(drawing.body, DENSITY) if given.mass is None else given.mass
    x = pressing(held) if given.forces is None else given.forces
    unit = scales(held, float(np.linalg.norm(x)), mass.mass) if given.unit is None else given.unit
    root, asset, world = _empty(solution, held, unit)
    root.insert(0, Comment(" fingertips touch the object's tangent plane at their contacts, and nothing else "))
    add_patches(add_object(asset, world, held, drawing, mass), held, unit)
    add_links(asset, world, drawing)
    contact, actuator = SubElement(root, "contact"), SubElement(root, "actuator")
    for i, model in enumerate(held.contacts):
        add_fingertip(world, held, i, unit, given.stiffness)
        add_contact(contact, i, model)
        for joint in joint_names(i, model, held.space):
            SubElement(actuator, "motor", name=f"{joint}_motor", joint=joint)
    SubElement(SubElement(root, "keyframe"), "key", name="grasp", ctrl=numbers(x[force_indices(held)]))
    return text(root)


def _pressed(solution: GraspSolution, grasp: Grasp | None) -> Grasp:
    """Return the given or the solution's grasp; raise for bilateral contacts."""
    held = solution.require_grasp() if grasp is None else grasp
    require_pressing(held)
    return held


def require_pressing(held: Grasp) -> None:
    """Raise for bilateral contacts."""
    for given in held.contacts:
        if not given.unilateral:
            raise InputError("contacts", given, "contacts that press: a simulator's fingertips cannot pull")


def _empty(solution: GraspSolution, held: Grasp, unit: Scales) -> tuple[Element, Element, Element]:
    """Return an empty scene with a light and time step, its assets, and its world."""
    step, size = STEP * unit.time, drawn_size(solution.drawn(), held.points)
    root = Element("mujoco", model="".join(c for c in solution.name if c.isprintable()))
    SubElement(root, "compiler", angle="radian", autolimits="true")
    SubElement(root, "option", SOLVER, timestep=f"{step:.6g}", gravity="0 0 0")
    SubElement(SubElement(root, "default"), "pair", solref=f"{STIFF * step:.6g} 1", solimp="0.95 0.99 1e-6")
    asset, world = SubElement(root, "asset"), SubElement(root, "worldbody")
    SubElement(world, "light", pos=numbers([0.0, 0.0, 4.0 * size]), dir="0 0 -1")
    return root, asset, world


def text(root: Element) -> str:
    """Return a scene as indented XML text."""
    indent(root)
    return tostring(root, encoding="unicode") + "\n"
