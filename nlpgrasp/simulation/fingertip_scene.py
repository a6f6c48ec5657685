"""MJCF scene of a grasp by free fingertips: object, motors, contacts, mass, characteristic units.

MuJoCo collides meshes as their convex hulls, on which contacts on a concave part would float. Each fingertip therefore
touches only a patch of the object's tangent plane at its own contact, the surface of the grasp model. The mesh itself,
as its hull, collides with anything else in the scene.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from xml.etree.ElementTree import Comment, Element, SubElement, indent, tostring

import numpy as np
from scipy.spatial import QhullError

from nlpgrasp.common.drawing import Drawing, Triangles, drawing_size
from nlpgrasp.common.meshes.mass_properties import volume_integrals
from nlpgrasp.common.spatial import in_space
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.contacts import ContactModel
from nlpgrasp.contacts.product import component_slices
from nlpgrasp.errors import InputError
from nlpgrasp.quality.grasp import Grasp
from nlpgrasp.solution.solution import GraspSolution

STIFFNESS, DAMPING = 20.0, 1.0  # gains of a fingertip's joints, in characteristic units
LEAST_SIZE, MAX_SIZE, FLAT_VOLUME = 1e-6, 1e6, 1e-12  # m, accepted sizes; volume over size cubed that counts as zero
MIN_MOMENT_RATIO = 1e-3  # least principal moment over the largest: simulators refuse bodies without thickness
TIP, PATCH = 0.3, 0.6  # fingertip radius and half side of a patch, as shares of the contacts' spread
LEAST_INERTIA = 1e-12  # kg m^2, added to moments of inertia, as MuJoCo requires
TIP_MASS = 0.2  # mass of a fingertip, as a share of the object's
FORCE_NAMES = ("normal", "tangent_1", "tangent_2")
NO_COLLISION = {"contype": "0", "conaffinity": "0"}  # collides only in explicit contact pairs
DENSITY = 1000.0  # kg / m^3, of an object whose mass is not given
STEP = 0.005  # time step, as a share of the characteristic time
CONTACT_STEPS = 4.0  # time constant of contacts in time steps: smaller ones bounce
# of MuJoCo's no-slip solver: without it a held object creeps 0.1 to 1.5 mm a minute
NOSLIP = {"noslip_iterations": "10", "noslip_tolerance": "1e-8"}
TOUCHING = "Fingertips touch the object's tangent plane at their contacts, and nothing else."
STICTION = "Elliptic cones and noslip_iterations keep what is held from creeping: settled, under 0.2 mm a minute."
SOLVER = {
    "integrator": "implicitfast",
    "cone": "elliptic",
    "impratio": "50",
    "solver": "Newton",
    "iterations": "100",
    "tolerance": "1e-12",
    **NOSLIP,
}


def mjcf(solution: GraspSolution, options: SceneOptions | None = None) -> str:
    """Return the scene of a grasp as MJCF text; metres, newtons, world frame = body frame, no gravity.

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
    settings = SceneOptions() if options is None else options
    drawing, grasp = solution.require_drawing(), _check_grasp_presses(solution, settings.grasp)
    mass = solid_mass(drawing.body, DENSITY) if settings.mass is None else settings.mass
    x = unit_normal_forces(grasp) if settings.forces is None else settings.forces
    unit = dynamic_scales(grasp, float(np.linalg.norm(x)), mass.mass) if settings.unit is None else settings.unit
    root, asset, world = _empty_scene(solution, grasp, unit)
    root.insert(0, Comment(f" {TOUCHING} {STICTION} "))
    add_patches(add_object(asset, world, grasp, drawing, mass), grasp, unit)
    add_links(asset, world, drawing)
    add_gripper_frame(world, solution)
    contact, actuator = SubElement(root, "contact"), SubElement(root, "actuator")
    for i, model in enumerate(grasp.contacts):
        add_fingertip(world, grasp, i, unit, settings.stiffness)
        add_contact(contact, i, model)
        for joint in joint_names(i, model, grasp.space):
            SubElement(actuator, "motor", name=f"{joint}_motor", joint=joint)
    SubElement(SubElement(root, "keyframe"), "key", name="grasp", ctrl=format_numbers(x[force_indices(grasp)]))
    return xml_text(root)


@dataclass(frozen=True)
class SceneOptions:
    """Options of a scene that override a solution's data.

    Parameters
    ----------
    grasp : Grasp, optional
        Replaces the solution's grasp.
    mass : Mass, optional
        By default for the density of water.
    forces : (n,) array, optional
        Finger forces of the keyframe ``grasp``, contact by contact as in G; by default normal forces of one newton.
    unit : DynamicScales, optional
        By default that of the keyframe's forces.
    stiffness : bool
        Whether joint springs hold the fingertips in place in addition to their motors.
    """

    grasp: Grasp | None = None
    mass: Mass | None = None
    forces: FloatArray | None = None
    unit: DynamicScales | None = None
    stiffness: bool = True


def _check_grasp_presses(solution: GraspSolution, grasp: Grasp | None) -> Grasp:
    """Return the grasp of the options or the solution; raise if contacts are bilateral."""
    checked = solution.require_grasp() if grasp is None else grasp
    require_pressing(checked)
    return checked


def require_pressing(grasp: Grasp) -> None:
    """Raise if contacts are bilateral."""
    for model in grasp.contacts:
        if not model.unilateral:
            raise InputError("contacts", model, "contacts that press: a simulator's fingertips cannot pull")


def _empty_scene(solution: GraspSolution, grasp: Grasp, unit: DynamicScales) -> tuple[Element, Element, Element]:
    """Return an empty scene with light and time step, its assets element, and its world element."""
    step, size = STEP * unit.time, drawing_size(solution.drawn(), grasp.points)
    root = Element("mujoco", model="".join(c for c in solution.name if c.isprintable()))
    SubElement(root, "compiler", angle="radian", autolimits="true")
    SubElement(root, "option", SOLVER, timestep=f"{step:.6g}", gravity="0 0 0")
    SubElement(SubElement(root, "default"), "pair", solref=f"{CONTACT_STEPS * step:.6g} 1", solimp="0.95 0.99 1e-6")
    asset, world = SubElement(root, "asset"), SubElement(root, "worldbody")
    SubElement(world, "light", pos=format_numbers([0.0, 0.0, 4.0 * size]), dir="0 0 -1")
    return root, asset, world


def add_object(asset: Element, world: Element, grasp: Grasp, drawing: Drawing, mass: Mass) -> Element:
    """Add the free object with its mesh to a scene, and return the object's body.

    A planar body moves in the plane.
    """
    body = add_free_body(world, mass, grasp.space)
    _add_mesh(asset, "object", drawing.body)
    SubElement(body, "geom", name="object", type="mesh", mesh="object", rgba="0.56 0.64 0.71 0.5")
    return body


def add_free_body(world: Element, mass: Mass, space: int = 3) -> Element:
    """Add the free object's body without a shape to a scene, and return it.

    A planar body moves in the plane.
    """
    body = SubElement(world, "body", name="object")
    if space == 3:
        SubElement(body, "freejoint", name="object")
    else:
        SubElement(body, "joint", name="object_x", type="slide", axis="1 0 0")
        SubElement(body, "joint", name="object_y", type="slide", axis="0 1 0")
        SubElement(body, "joint", name="object_turn", type="hinge", axis="0 0 1")
    moments = format_numbers((mass.inertia + LEAST_INERTIA * np.eye(3))[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]])
    SubElement(body, "inertial", pos=format_numbers(mass.center), mass=f"{mass.mass:.9g}", fullinertia=moments)
    return body


def _add_mesh(asset: Element, name: str, shape: Triangles) -> None:
    """Add a mesh to the assets, as a shell without volume."""
    faces = " ".join(map(str, shape.faces.ravel().tolist()))
    SubElement(asset, "mesh", name=name, inertia="shell", vertex=format_numbers(shape.vertices.ravel()), face=faces)


def add_patches(body: Element, grasp: Grasp, unit: DynamicScales) -> None:
    """Add a patch of the tangent plane at each contact to the object's body."""
    thickness = TIP * unit.length
    half = format_numbers([thickness, PATCH * unit.length, PATCH * unit.length])
    for i, (p, n) in enumerate(zip(in_space(grasp.points), in_space(grasp.normals), strict=True)):
        pose = {"pos": format_numbers(p + thickness * n), "xyaxes": _format_axes(grasp, i), "size": half}
        appearance = {"group": "4", "rgba": "0 0 0 0"}
        SubElement(body, "geom", {"name": f"patch_{i}", "type": "box", **pose, **appearance, **NO_COLLISION})


def add_links(asset: Element, world: Element, drawing: Drawing) -> None:
    """Add the hand's links in the grasp's posture, for display only."""
    if not drawing.links:
        return
    hand = SubElement(world, "body", name="hand")
    for i, (_, shape) in enumerate(drawing.links):
        _add_mesh(asset, f"link_{i}", shape)
        appearance = {"group": "2", "rgba": "0.71 0.61 0.48 0.6"}
        SubElement(
            hand, "geom", {"name": f"link_{i}", "type": "mesh", "mesh": f"link_{i}", **appearance, **NO_COLLISION}
        )


def add_gripper_frame(world: Element, solution: GraspSolution) -> None:
    """Add a site at the frame of a gripper's pose, with a comment on its axes and tool centre point."""
    pose, text = (solution.hand or {}).get("palm_pose"), solution.gripper_frame_line()
    if pose is not None and text:
        world.append(Comment(f" {text} "))
        place = {"pos": format_numbers(pose["position"]), "quat": format_numbers(pose["quaternion_wxyz"])}
        SubElement(world, "site", {"name": "gripper_frame", **place, "group": "4"})


def add_fingertip(world: Element, grasp: Grasp, i: int, unit: DynamicScales, stiffness: bool) -> None:
    """Add a fingertip: a small ball with a sliding joint along each force component of its contact."""
    p, n, model = in_space(grasp.points)[i], in_space(grasp.normals)[i], grasp.contacts[i]
    radius = TIP * unit.length
    pose = {"pos": format_numbers(p - radius * n), "xyaxes": _format_axes(grasp, i)}
    tip = SubElement(world, "body", pose, name=f"tip_{i}", gravcomp="1")  # the hand carries its own weight
    spring = {"stiffness": f"{unit.stiffness if stiffness else 0.0:.9g}", "damping": f"{unit.damping:.9g}"}
    axes = [axis for axis in model.axes(grasp.space) if axis < grasp.space]
    for joint, axis in zip(joint_names(i, model, grasp.space), axes, strict=True):
        SubElement(tip, "joint", {"name": joint, "type": "slide", "axis": format_numbers(np.eye(3)[axis]), **spring})
    inertia = format_numbers([0.4 * TIP_MASS * unit.mass * radius**2 + LEAST_INERTIA] * 3)
    SubElement(tip, "inertial", pos="0 0 0", mass=f"{TIP_MASS * unit.mass:.9g}", diaginertia=inertia)
    appearance = {"name": f"tip_{i}", "type": "sphere", "rgba": "0.1 0.1 0.1 1", "size": f"{radius:.9g}"}
    SubElement(tip, "geom", {**appearance, **NO_COLLISION})


def add_contact(contact: Element, i: int, model: ContactModel) -> None:
    """Add the contact pair of a fingertip and its patch on the object."""
    friction = model.coefficients.get("friction", 0.0)
    torsion = model.coefficients.get("torsional_friction", 0.0)
    dimension, coefficients = 1, [1.0] * 5
    if friction:
        dimension = 4 if torsion else 3
        coefficients = [friction, friction, torsion or 1.0, 1.0, 1.0]
    pair = {"name": f"contact_{i}", "geom1": f"tip_{i}", "geom2": f"patch_{i}"}
    SubElement(contact, "pair", pair, condim=str(dimension), friction=format_numbers(coefficients))


def _format_axes(grasp: Grasp, i: int) -> str:
    """Return normal and first tangent of a contact's frame as MJCF text."""
    return format_numbers(np.concatenate([in_space(grasp.normals)[i], in_space(grasp.tangents[i])[0]]))


@dataclass(frozen=True)
class DynamicScales:
    """Characteristic units of a grasp's dynamics, which set time step and stiffness for any size.

    Parameters
    ----------
    length : float
        Root mean square distance of the contacts from their mean, metres.
    force : float
        Newtons.
    mass : float
        Of the object, kilograms.
    """

    length: float
    force: float
    mass: float

    @property
    def time(self) -> float:
        """Characteristic time, seconds, in which the characteristic force moves the object by the length."""
        return float(np.sqrt(self.mass * self.length / self.force))

    @property
    def stiffness(self) -> float:
        """Stiffness of the spring that holds a fingertip in place, N / m."""
        return STIFFNESS * self.force / self.length

    @property
    def damping(self) -> float:
        """Near-critical damping of the spring that holds a fingertip in place, N s / m."""
        return DAMPING * float(np.sqrt(STIFFNESS)) * self.mass / self.time


def dynamic_scales(grasp: Grasp, force: float, mass: float) -> DynamicScales:
    """Return the characteristic units of a grasp's dynamics."""
    length = float(np.sqrt(np.mean(np.sum((grasp.points - grasp.points.mean(axis=0)) ** 2, axis=1))))
    return DynamicScales(length or grasp.mean_arm, force, mass)


@dataclass(frozen=True)
class Mass:
    """Mass, centre of mass and inertia of a body.

    Parameters
    ----------
    mass : float
        Kilograms.
    center : (3,) array
        Centre of mass, metres, body frame.
    inertia : (3, 3) array
        About the centre of mass, kg m^2.
    """

    mass: float
    center: FloatArray
    inertia: FloatArray

    def scaled(self, mass: float) -> Mass:
        """Return the same mass distribution with another total mass."""
        return Mass(mass, self.center, self.inertia * (mass / self.mass))


def solid_mass(shape: Triangles, density: float) -> Mass:
    """Return mass and inertia of a homogeneous triangulated body.

    A surface that is not closed is replaced by its convex hull.

    Raises
    ------
    InputError
        On triangles that enclose no volume.
    """
    import trimesh

    size = float(np.max(np.ptp(shape.vertices, axis=0), initial=0.0))
    mesh = trimesh.Trimesh(shape.vertices, shape.faces)
    volume = 0.0
    if LEAST_SIZE <= size <= MAX_SIZE:
        try:
            with np.errstate(all="ignore"):  # of triangles in a plane
                if not mesh.is_watertight or mesh.volume <= 0.0:
                    mesh = mesh.convex_hull
                volume = float(mesh.volume)
        except (QhullError, ValueError, IndexError):
            volume = 0.0
    if not volume > FLAT_VOLUME * size**3:
        raise InputError("drawing.body", f"{len(shape.faces)} triangles that enclose no volume", "a solid body")
    integrals = volume_integrals(mesh)
    moments, axes = np.linalg.eigh(density * integrals.inertia)
    moments = np.maximum(moments, MIN_MOMENT_RATIO * moments[-1])
    return Mass(density * integrals.volume, integrals.centre, axes @ np.diag(moments) @ axes.T)


def unit_normal_forces(grasp: Grasp) -> FloatArray:
    """Return finger forces (n,) with a normal force of one newton at each contact and nothing else."""
    x = np.zeros(grasp.G.shape[1])
    x[[part.start for part in component_slices(grasp.contacts, grasp.space)]] = 1.0
    return x


def force_indices(grasp: Grasp) -> list[int]:
    """Return the indices of the force components, moments excluded."""
    axes = [axis for model in grasp.contacts for axis in model.axes(grasp.space)]
    return [index for index, axis in enumerate(axes) if axis < grasp.space]


def joint_names(i: int, model: ContactModel, space: int) -> list[str]:
    """Return the names of a fingertip's joints, one per force component."""
    return [f"tip_{i}_{FORCE_NAMES[axis]}" for axis in model.axes(space) if axis < space]


def format_numbers(values: Iterable[float]) -> str:
    """Return numbers as text for MJCF."""
    return " ".join(f"{float(v):.9g}" for v in values)


def xml_text(root: Element) -> str:
    """Return a scene as indented XML text."""
    indent(root)
    return tostring(root, encoding="unicode") + "\n"
