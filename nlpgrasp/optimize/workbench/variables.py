"""Conversion between candidates and a program's vector of variables."""

from __future__ import annotations

import numpy as np

from nlpgrasp.common.validation import FloatArray
from nlpgrasp.hands.base import Values
from nlpgrasp.nlp import Program
from nlpgrasp.nlp.start_values import pressing_forces
from nlpgrasp.optimize.workbench.placed import Placed
from nlpgrasp.optimize.workbench.workbench import Workbench


def variables_of(bench: Workbench, program: Program, placed: Placed) -> FloatArray:
    """Return a vector (n,) of starting values with contacts, normals, the hand and pressing forces filled in."""
    normals = bench.inward_normals(placed)
    z = np.zeros(program.variables[-1].stop)
    put_contacts(bench, program, z, placed.points, normals)
    forces = pressing_forces(bench.problem, normals)
    for name, b in program.hand_blocks:
        z[b.range] = np.ravel(placed.hand[name]) / b.scale
    for b in program.blocks("forces"):
        z[b.range] = forces
    return z


def put_contacts(bench: Workbench, program: Program, z: FloatArray, points: FloatArray, normals: FloatArray) -> None:
    """Set the contacts among a program's variables, in place: points in metres and inward normals."""
    for i, p in enumerate(bench.scaling.position(points)):
        z[program.block("position", i).range] = p
        z[program.block("normal", i).range] = normals[i]


def placed_of(bench: Workbench, program: Program, faces: tuple[str, ...], z: FloatArray) -> Placed:
    """Return the candidate stated by a program's variables, its contacts projected exactly onto their faces."""
    return bench.snapped(Placed(faces, points_of(bench, program, z), hand_of(program, z)))


def points_of(bench: Workbench, program: Program, z: FloatArray) -> FloatArray:
    """Return the contact positions of a program's variables, metres, (k, space)."""
    return bench.scaling.metres(np.stack([z[b.range] for b in program.blocks("position")]))


def hand_of(program: Program, z: FloatArray) -> Values:
    """Return the hand's variables of a program's variables, in the hand's units."""
    return {name: b.scale * z[b.range] for name, b in program.hand_blocks}
