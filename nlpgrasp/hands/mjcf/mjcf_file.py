"""MJCF file reader: MuJoCo compiles the file; the bodies below the palm become links."""

from __future__ import annotations

import hashlib
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from nlpgrasp.common.extras.mujoco import import_mujoco
from nlpgrasp.hands.mjcf.couplings import coupled
from nlpgrasp.hands.mjcf.efforts import with_efforts
from nlpgrasp.hands.mjcf.mjcf_joints import closed, joints_to, transform
from nlpgrasp.hands.mjcf.mjcf_names import body_name
from nlpgrasp.hands.mjcf.mjcf_shapes import read_geoms
from nlpgrasp.hands.robot.robot import Robot
from nlpgrasp.hands.urdf.inertials import Inertial
from nlpgrasp.hands.urdf.urdf_mimics import check_ranges
from nlpgrasp.hands.urdf.urdf_values import bad

if TYPE_CHECKING:
    from mujoco import MjModel


def read_mjcf(path: Path, palm: str | None = None) -> Robot:
    """Return the bodies below the palm as links, their hinges and slides as joints, with their collision shapes.

    The palm's own joints, and everything above it, are left out, as its pose is a variable. Joint positions are
    MuJoCo's: at its reference position a joint leaves the body as in the file.

    Parameters
    ----------
    path : Path
    palm : str, optional
        The body that everything else hangs from; the world's only one when left out.

    Raises
    ------
    InputError
        When MuJoCo cannot read the file, the palm is no body, a joint below it is a ball or free, slides without
        limits, or follows another by anything but a straight line.
    MissingExtraError
        Without MuJoCo (extra ``sim``).
    """
    model = _compiled(path)
    start = _start(path, model, palm)
    bodies = [start]
    for body in range(start + 1, model.nbody):
        if model.body_parentid[body] in bodies:
            bodies.append(body)
    joints, links = [], [body_name(model, start)]
    for body in bodies[1:]:
        found = joints_to(path, model, body)
        joints += found
        links += [joint.child for joint in found]
    shapes, missing, bare = read_geoms(model, bodies)
    digest = hashlib.sha256(path.read_bytes()).hexdigest()
    name = str(model.names[: model.names.index(b"\0")], "utf-8") or path.stem
    robot = Robot(name, links[0], tuple(links), tuple(joints), shapes, missing, path.name, digest, bare)
    robot = coupled(path, model, robot)
    robot = with_efforts(model, replace(robot, joints=tuple(closed(path, joint) for joint in robot.joints)))
    check_ranges(path, robot)
    return robot


def mjcf_links(path: Path) -> tuple[str, ...]:
    """Return the names of all bodies, in the file's order.

    Raises
    ------
    InputError
        When MuJoCo cannot read the file.
    MissingExtraError
        Without MuJoCo (extra ``sim``).
    """
    model = _compiled(path)
    return tuple(body_name(model, body) for body in range(1, model.nbody))


def mjcf_inertials(path: Path) -> dict[str, Inertial]:
    """Return mass and inertia of the bodies with mass, stated or from their geometries' density.

    Raises
    ------
    InputError
        When MuJoCo cannot read the file.
    MissingExtraError
        Without MuJoCo (extra ``sim``).
    """
    model, result = _compiled(path), {}
    for body in range(1, model.nbody):
        pose = transform(model.body_ipos[body], model.body_iquat[body])
        turn, mass = pose[:3, :3], float(model.body_mass[body])
        if mass > 0.0:
            tensor = turn @ np.diag(model.body_inertia[body]) @ turn.T
            result[body_name(model, body)] = Inertial(mass, pose[:3, 3].copy(), tensor)
    return result


def _compiled(path: Path) -> MjModel:
    mujoco = import_mujoco(f"{path.name}: reading MJCF")
    try:
        spec = mujoco.MjSpec.from_file(str(path))
        spec.compiler.fusestatic = False  # every body stays a separate link
        return spec.compile()
    except (ValueError, mujoco.FatalError) as error:
        bad(path, " ".join(str(error).split()), "an MJCF file that MuJoCo reads, with its meshes")


def _start(path: Path, model: MjModel, palm: str | None) -> int:
    names = [body_name(model, body) for body in range(model.nbody)]
    if palm is not None:
        if palm not in names[1:]:
            bad(path, f"palm {palm!r}", "a body of the file: " + ", ".join(names[1:]))
        return names.index(palm)
    roots = [int(body) for body in np.flatnonzero(model.body_parentid == 0) if body > 0]
    if not roots:
        bad(path, "no <body>", "a hand with bodies")
    if len(roots) > 1:
        bad(path, "bodies " + ", ".join(names[b] for b in roots) + " side by side", "palm=, the hand's own body")
    return roots[0]
