"""Binary glTF (GLB) export of a grasp as a 3D scene."""

from __future__ import annotations

import numpy as np
import trimesh

from nlpgrasp.common.drawing import CONE, NORMAL, drawing_size
from nlpgrasp.common.palette import COLOURS
from nlpgrasp.common.spatial import in_space
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.interop.base import ExportFormat
from nlpgrasp.solution.solution import GraspSolution

POINT_COLOUR = "#141414"
OPAQUE, TRANSPARENT = 255, 140  # opacities, of 255
POINT_RADIUS, ARROW_RADIUS = 0.02, 0.006  # shares of the body's size


def glb(solution: GraspSolution) -> bytes:
    """Return the 3D scene of a grasp as the bytes of a GLB file, in metres and the body frame.

    Shown are body, hand, contacts, normals and friction cones; the axes are the body's.

    Raises
    ------
    InputError
        Without a grasp.
    """
    grasp = solution.require_grasp()
    scene = trimesh.Scene()
    drawing = solution.drawn()
    if drawing is not None:
        shapes = [("body", drawing.body, "body"), *((name, s, "link") for name, s in drawing.links)]
        for name, shape, role in shapes:
            scene.add_geometry(_paint(trimesh.Trimesh(shape.vertices, shape.faces), COLOURS[role]), name, name)
    size = drawing_size(drawing, grasp.points)
    points, normals = in_space(grasp.points), in_space(grasp.normals)
    for i, (point, normal, model) in enumerate(zip(points, normals, grasp.contacts, strict=True)):
        ball = trimesh.creation.icosphere(2, POINT_RADIUS * size).apply_translation(point)
        scene.add_geometry(_paint(ball, POINT_COLOUR), f"contact {i}", f"contact {i}")
        line = trimesh.creation.cylinder(ARROW_RADIUS * size, segment=[point, point + NORMAL * size * normal])
        scene.add_geometry(_paint(line, COLOURS["normal"]), f"inward normal {i}", f"inward normal {i}")
        friction = model.coefficients.get("friction")
        if friction is not None:
            cone = trimesh.creation.cone(CONE * size * friction, CONE * size)
            cone.apply_transform(_cone_pose(point, normal, CONE * size))
            scene.add_geometry(_paint(cone, COLOURS["cone"], TRANSPARENT), f"cone {i}", f"cone {i}")
    return bytes(scene.export(file_type="glb"))


def _paint(mesh: trimesh.Trimesh, colour: str, alpha: int = OPAQUE) -> trimesh.Trimesh:
    """Return the mesh with a colour and an opacity."""
    material = trimesh.visual.material.PBRMaterial(
        baseColorFactor=[*bytes.fromhex(colour[1:]), alpha],
        alphaMode="BLEND" if alpha < OPAQUE else "OPAQUE",
        doubleSided=True,
    )
    mesh.visual = trimesh.visual.TextureVisuals(material=material)
    return mesh


def _cone_pose(point: FloatArray, normal: FloatArray, height: float) -> FloatArray:
    """Return the pose, (4, 4), of a drawn friction cone with its apex at the contact and its base outside the body."""
    pose = np.eye(4)
    pose[:3, :3] = trimesh.geometry.align_vectors([0.0, 0.0, 1.0], normal)[:3, :3]
    pose[:3, 3] = point - height * normal
    return pose


GLB = ExportFormat("glb", ".glb", "a scene", lambda solution, _: glb(solution))
