"""Forty mesh files as users have them: closed, nested and defective ones."""

import numpy as np
import trimesh

from tests.bodies.made_meshes import (
    ALL_TURNED,
    APART,
    BURIED,
    COPIES,
    FILLED,
    HOLLOW,
    JOINED,
    ROUND,
    SOME_TURNED,
    MeshCase,
    ball,
    box,
    figure_eight,
    invert_mesh,
    join_meshes,
    rod,
    round_to_single,
    select_faces,
    tilt_mesh,
)

A = box([0.1, 0.06, 0.04])
LONG = box([0.2, 0.03, 0.02])  # its ends are 2.7 % of its surface
ACROSS = box([0.04, 0.1, 0.03], (0.013, 0.011, 0.004))
INNER = box([0.05, 0.03, 0.02])
SHELL = box([0.099, 0.059, 0.039])  # half a millimetre inside A
WHOLE = ball(0.04)


def forty():
    """Return the meshes by name."""
    return {**_overlapping(), **_nested(), **_touching(), **_turned(), **_broken(), **_crossing()}


def _overlapping():
    pairs = {
        "two boxes": (A, ACROSS),
        "tilted boxes": (tilt_mesh(A), tilt_mesh(ACROSS)),
        "rod through box": (A, rod(0.02, 0.15)),
        "ball in box's side": (A, ball(0.02, (0.05, 0.0, 0.0))),
        "box through ring": (trimesh.creation.torus(0.05, 0.012), box([0.14, 0.01, 0.01])),
        "three in a row": (A, box([0.1, 0.04, 0.03], (0.08, 0.0, 0.0)), rod(0.01, 0.1, (0.12, 0.0, 0.0))),
        "thin plate through box": (A, box([0.0005, 0.1, 0.1], (0.01, 0.0, 0.0))),
        "small screw on a plate": (box([0.2, 0.2, 0.005]), rod(0.002, 0.02, (0.03, 0.05, 0.0))),
        "flush tops": (A, box([0.1, 0.06, 0.04], (0.05, 0.02, 0.0))),
        "far from the origin": tuple(m.copy().apply_translation([0.7, -0.9, 0.4]) for m in (A, ACROSS)),
    }
    rng = np.random.default_rng(2)
    pairs["many small parts"] = tuple(ball(0.012, position, 1) for position in rng.uniform(-0.03, 0.03, (60, 3)))
    return {name: MeshCase(join_meshes(*solids), solids, (JOINED,)) for name, solids in pairs.items()}


def _nested():
    walls = [box(e, np.multiply(0.045, direction)) for e, direction in _walls()]
    return {
        "box in box": MeshCase(join_meshes(A, INNER), (A, INNER), (JOINED,)),
        "three in one another": MeshCase(join_meshes(INNER, A, SHELL), (A,), (JOINED,)),
        "hollow box": MeshCase(join_meshes(A, invert_mesh(INNER)), (A,), (HOLLOW,)),
        "walls of half a millimetre": MeshCase(join_meshes(A, invert_mesh(SHELL)), (A,), (HOLLOW,)),
        "ball in a hollow": MeshCase(join_meshes(A, invert_mesh(SHELL), ball(0.01)), (A,), (JOINED, HOLLOW)),
        "two hollows": MeshCase(
            join_meshes(A, invert_mesh(ball(0.01, (-0.03, 0.0, 0.0))), invert_mesh(ball(0.01, (0.03, 0.0, 0.0)))),
            (A,),
            ("2 closed hollows",),
        ),
        "empty room": MeshCase(join_meshes(*walls), (box([0.1, 0.1, 0.1]),), (JOINED, HOLLOW)),
        "ball in a room": MeshCase(join_meshes(*walls, ball(0.02)), (box([0.1, 0.1, 0.1]),), (JOINED, HOLLOW)),
        "cup of half a millimetre": _cup(),
    }


def _walls():
    for axis in range(3):
        extents = np.where(np.arange(3) == axis, 0.01, 0.1)
        yield from ((extents, sign * np.eye(3)[axis]) for sign in (-1.0, 1.0))


def _cup():
    profile = [[0.0, 0.0], [0.03, 0.0], [0.03, 0.08], [0.0295, 0.08], [0.0295, 0.0005], [0.0, 0.0005]]
    cup = trimesh.creation.revolve(profile, sections=48)
    return MeshCase(cup, (cup,))


def _touching():
    adjacent, small = box([0.1, 0.06, 0.04], (0.1, 0.0, 0.0)), box([0.05, 0.03, 0.02], (0.075, 0.0, 0.0))
    mirrored = A.copy().apply_transform(np.diag([-1.0, 1.0, 1.0, 1.0])).apply_translation([0.1, 0.0, 0.0])
    at_edge, at_corner = box([0.1, 0.06, 0.04], (0.1, 0.06, 0.0)), box([0.1, 0.06, 0.04], (0.1, 0.06, 0.04))
    separate, gap = box([0.05, 0.05, 0.05], (0.12, 0.0, 0.0)), box([0.1, 0.06, 0.04], (0.1 + 2e-8, 0.0, 0.0))
    return {
        "a face in common": MeshCase(join_meshes(A, adjacent), (A, adjacent), (JOINED,)),
        "the same triangles in common": MeshCase(join_meshes(A, mirrored), (A, mirrored), ("back to back",)),
        "small face on large": MeshCase(join_meshes(A, small), (A, small), (JOINED,)),
        "tilted faces": MeshCase(
            join_meshes(tilt_mesh(A), tilt_mesh(small)), (tilt_mesh(A), tilt_mesh(small)), (JOINED,)
        ),
        "tilted faces rounded": MeshCase(
            round_to_single(join_meshes(tilt_mesh(A), tilt_mesh(small))), (tilt_mesh(A), tilt_mesh(small)), (JOINED,)
        ),
        "a gap of rounding": MeshCase(join_meshes(A, gap), (A, gap), ("that touch overlap",)),
        "touching at an edge": MeshCase(join_meshes(A, at_edge), (A, at_edge)),
        "touching at a corner": MeshCase(join_meshes(A, at_corner), (A, at_corner)),
        "two apart": MeshCase(join_meshes(A, separate), (A, separate), (APART,)),
    }


def _turned():
    separate = box([0.05, 0.05, 0.05], (0.12, 0.0, 0.0))
    mixed = np.array(WHOLE.faces)
    mixed[::7] = mixed[::7, ::-1]
    return {
        "all inside out": MeshCase(invert_mesh(A), (A,), (ALL_TURNED,)),
        "two parts inside out": MeshCase(invert_mesh(join_meshes(A, ACROSS)), (A, ACROSS), (ALL_TURNED, JOINED)),
        "hollow inside out": MeshCase(invert_mesh(join_meshes(A, invert_mesh(INNER))), (A,), (ALL_TURNED, HOLLOW)),
        "one part inside out": MeshCase(join_meshes(A, invert_mesh(ACROSS)), (A, ACROSS), (SOME_TURNED, JOINED)),
        "one apart inside out": MeshCase(join_meshes(A, invert_mesh(separate)), (A, separate), (SOME_TURNED, APART)),
        "triangles of both ways": MeshCase(trimesh.Trimesh(WHOLE.vertices, mixed, process=False), (WHOLE,), (ROUND,)),
    }


def _broken():
    lines = np.concatenate([np.asarray(A.faces), [[0, 0, 1], [2, 3, 3]]])
    inner = trimesh.Trimesh([[0.0, 0.0, 0.0], [0.01, 0.0, 0.0], [0.0, 0.01, 0.005]], [[0, 1, 2]])
    flat = trimesh.Trimesh([[0, 0, 0], [0.1, 0, 0], [0, 0.1, 0], [0.1, 0.1, 0]], [[0, 1, 2], [1, 3, 2]])
    return {
        "a copy": MeshCase(join_meshes(WHOLE, WHOLE), (WHOLE,), (COPIES,)),
        "some copies": MeshCase(select_faces(WHOLE, [*range(len(WHOLE.faces)), 5, 9]), (WHOLE,), (COPIES,)),
        "degenerate triangles": MeshCase(trimesh.Trimesh(A.vertices, lines, process=False), (A,)),
        "without an end": MeshCase(select_faces(LONG, LONG.face_normals[:, 0] < 0.5), (LONG,), (FILLED,)),
        "without an end, and a part": MeshCase(
            join_meshes(select_faces(LONG, LONG.face_normals[:, 0] < 0.5), ACROSS), (LONG, ACROSS), (FILLED, JOINED)
        ),
        "without lid": MeshCase(
            select_faces(A, A.face_normals[:, 2] < 0.5), (), ("24 % of the surface, the largest around",)
        ),
        "without lid, and a part": MeshCase(
            join_meshes(select_faces(A, A.face_normals[:, 2] < 0.5), ACROSS),
            (),
            ("15 % of the surface, the largest around",),
        ),
        "a triangle inside": MeshCase(join_meshes(A, inner), (A,), (FILLED, "sheets without volume left out")),
        "half a ball": MeshCase(select_faces(WHOLE, WHOLE.triangles_center[:, 2] < 0.0), (), ("an open surface",)),
        "box of three sides": MeshCase(select_faces(A, np.max(A.face_normals, axis=1) > 0.5), (), ("an open surface",)),
        "a sheet": MeshCase(join_meshes(flat, invert_mesh(flat)), (), ("a mesh with volume",)),
    }


def _crossing():
    hole = select_faces(WHOLE, WHOLE.triangles_center[:, 2] < 0.0393)
    bar = box([0.12, 0.02, 0.02])
    return {
        "a figure of eight": MeshCase(figure_eight(), (figure_eight(),), (BURIED, "not watertight")),
        "a figure of eight inside out": MeshCase(
            invert_mesh(figure_eight()), (figure_eight(),), (ALL_TURNED, BURIED, "not watertight")
        ),
        "ball with a hole, and a bar": MeshCase(join_meshes(hole, bar), (WHOLE, bar), (BURIED, "not watertight")),
    }
