"""Forty meshes as files of users have them: whole ones, parts in one another, and broken ones."""

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
    Made,
    ball,
    box,
    chosen,
    eight,
    inverted,
    joined,
    rod,
    rounded,
    tilted,
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
        "tilted boxes": (tilted(A), tilted(ACROSS)),
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
    pairs["many small parts"] = tuple(ball(0.012, at, 1) for at in rng.uniform(-0.03, 0.03, (60, 3)))
    return {name: Made(joined(*solids), solids, (JOINED,)) for name, solids in pairs.items()}


def _nested():
    room = [box(e, np.multiply(0.045, at)) for e, at in _walls()]
    return {
        "box in box": Made(joined(A, INNER), (A, INNER), (JOINED,)),
        "three in one another": Made(joined(INNER, A, SHELL), (A,), (JOINED,)),
        "hollow box": Made(joined(A, inverted(INNER)), (A,), (HOLLOW,)),
        "walls of half a millimetre": Made(joined(A, inverted(SHELL)), (A,), (HOLLOW,)),
        "ball in a hollow": Made(joined(A, inverted(SHELL), ball(0.01)), (A,), (JOINED, HOLLOW)),
        "two hollows": Made(
            joined(A, inverted(ball(0.01, (-0.03, 0.0, 0.0))), inverted(ball(0.01, (0.03, 0.0, 0.0)))),
            (A,),
            ("2 closed hollows",),
        ),
        "empty room": Made(joined(*room), (box([0.1, 0.1, 0.1]),), (JOINED, HOLLOW)),
        "ball in a room": Made(joined(*room, ball(0.02)), (box([0.1, 0.1, 0.1]),), (JOINED, HOLLOW)),
        "cup of half a millimetre": _cup(),
    }


def _walls():
    for axis in range(3):
        extents = np.where(np.arange(3) == axis, 0.01, 0.1)
        yield from ((extents, sign * np.eye(3)[axis]) for sign in (-1.0, 1.0))


def _cup():
    profile = [[0.0, 0.0], [0.03, 0.0], [0.03, 0.08], [0.0295, 0.08], [0.0295, 0.0005], [0.0, 0.0005]]
    cup = trimesh.creation.revolve(profile, sections=48)
    return Made(cup, (cup,))


def _touching():
    beside, small = box([0.1, 0.06, 0.04], (0.1, 0.0, 0.0)), box([0.05, 0.03, 0.02], (0.075, 0.0, 0.0))
    mirrored = A.copy().apply_transform(np.diag([-1.0, 1.0, 1.0, 1.0])).apply_translation([0.1, 0.0, 0.0])
    at_edge, at_corner = box([0.1, 0.06, 0.04], (0.1, 0.06, 0.0)), box([0.1, 0.06, 0.04], (0.1, 0.06, 0.04))
    apart, gap = box([0.05, 0.05, 0.05], (0.12, 0.0, 0.0)), box([0.1, 0.06, 0.04], (0.1 + 2e-8, 0.0, 0.0))
    return {
        "a face in common": Made(joined(A, beside), (A, beside), (JOINED,)),
        "the same triangles in common": Made(joined(A, mirrored), (A, mirrored), ("back to back",)),
        "small face on large": Made(joined(A, small), (A, small), (JOINED,)),
        "tilted faces": Made(joined(tilted(A), tilted(small)), (tilted(A), tilted(small)), (JOINED,)),
        "tilted faces rounded": Made(rounded(joined(tilted(A), tilted(small))), (tilted(A), tilted(small)), (JOINED,)),
        "a gap of rounding": Made(joined(A, gap), (A, gap), ("that touch overlap",)),
        "touching at an edge": Made(joined(A, at_edge), (A, at_edge)),
        "touching at a corner": Made(joined(A, at_corner), (A, at_corner)),
        "two apart": Made(joined(A, apart), (A, apart), (APART,)),
    }


def _turned():
    apart = box([0.05, 0.05, 0.05], (0.12, 0.0, 0.0))
    mixed = np.array(WHOLE.faces)
    mixed[::7] = mixed[::7, ::-1]
    return {
        "all inside out": Made(inverted(A), (A,), (ALL_TURNED,)),
        "two parts inside out": Made(inverted(joined(A, ACROSS)), (A, ACROSS), (ALL_TURNED, JOINED)),
        "hollow inside out": Made(inverted(joined(A, inverted(INNER))), (A,), (ALL_TURNED, HOLLOW)),
        "one part inside out": Made(joined(A, inverted(ACROSS)), (A, ACROSS), (SOME_TURNED, JOINED)),
        "one apart inside out": Made(joined(A, inverted(apart)), (A, apart), (SOME_TURNED, APART)),
        "triangles of both ways": Made(trimesh.Trimesh(WHOLE.vertices, mixed, process=False), (WHOLE,), (ROUND,)),
    }


def _broken():
    lines = np.concatenate([np.asarray(A.faces), [[0, 0, 1], [2, 3, 3]]])
    inner = trimesh.Trimesh([[0.0, 0.0, 0.0], [0.01, 0.0, 0.0], [0.0, 0.01, 0.005]], [[0, 1, 2]])
    flat = trimesh.Trimesh([[0, 0, 0], [0.1, 0, 0], [0, 0.1, 0], [0.1, 0.1, 0]], [[0, 1, 2], [1, 3, 2]])
    return {
        "a copy": Made(joined(WHOLE, WHOLE), (WHOLE,), (COPIES,)),
        "some copies": Made(chosen(WHOLE, [*range(len(WHOLE.faces)), 5, 9]), (WHOLE,), (COPIES,)),
        "degenerate triangles": Made(trimesh.Trimesh(A.vertices, lines, process=False), (A,)),
        "without an end": Made(chosen(LONG, LONG.face_normals[:, 0] < 0.5), (LONG,), (FILLED,)),
        "without an end, and a part": Made(
            joined(chosen(LONG, LONG.face_normals[:, 0] < 0.5), ACROSS), (LONG, ACROSS), (FILLED, JOINED)
        ),
        "without lid": Made(chosen(A, A.face_normals[:, 2] < 0.5), (), ("24 % of the surface, the largest around",)),
        "without lid, and a part": Made(
            joined(chosen(A, A.face_normals[:, 2] < 0.5), ACROSS), (), ("15 % of the surface, the largest around",)
        ),
        "a triangle inside": Made(joined(A, inner), (A,), (FILLED, BURIED)),
        "half a ball": Made(chosen(WHOLE, WHOLE.triangles_center[:, 2] < 0.0), (), ("an open surface",)),
        "box of three sides": Made(chosen(A, np.max(A.face_normals, axis=1) > 0.5), (), ("an open surface",)),
        "a sheet": Made(joined(flat, inverted(flat)), (), ("a mesh with volume",)),
    }


def _crossing():
    hole = chosen(WHOLE, WHOLE.triangles_center[:, 2] < 0.0393)
    bar = box([0.12, 0.02, 0.02])
    return {
        "a figure of eight": Made(eight(), (eight(),), (BURIED, "not watertight")),
        "a figure of eight inside out": Made(inverted(eight()), (eight(),), (ALL_TURNED, BURIED, "not watertight")),
        "ball with a hole, and a bar": Made(joined(hole, bar), (WHOLE, bar), (BURIED, "not watertight")),
    }
