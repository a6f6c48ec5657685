"""Finger forces as symbols: the wrench they make, and membership in the force domains."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import accumulate

import casadi as ca
import numpy as np

from nlpgrasp.common.rows import Row
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.contacts import ContactModel
from nlpgrasp.nlp.blocks import Range
from nlpgrasp.nlp.placement import ContactSymbols, Scaling
from nlpgrasp.nlp.program import Program
from nlpgrasp.nlp.repeats import Copy
from nlpgrasp.problem.problem import GraspProblem


def add_forces(program: Program, problem: GraspProblem, scaling: Scaling, direction: int) -> list[ca.SX]:
    """Add one copy of all finger forces, in solver units; return each contact's in newtons, as columns."""
    sizes = [m.variables(problem.body.space) for m in problem.models]
    most = problem.budget.largest
    block = program.variable("forces", sum(sizes), -most, most, scaling.force, index=direction)
    return list(ca.vertsplit(scaling.force * block, [0, *accumulate(sizes)]))


def symbolic_wrench(
    models: Sequence[ContactModel], contacts: ContactSymbols, forces: Sequence[ca.SX], length: float
) -> ca.SX:
    """Return the wrench of the finger forces about the torque origin, in solver units (d,).

    Parameters
    ----------
    models : sequence of k ContactModel
    contacts : ContactSymbols
    forces : sequence of k columns
        Force variables: forces in newtons, moments in newton-metres.
    length : float
        Metres a solver unit of length; torques come out divided by it.
    """
    total = ca.SX(0.0)
    for model, p, n, x in zip(models, contacts.positions, contacts.normals, forces, strict=True):
        force, own = model.split(x, n)
        moment = p[0] * force[1] - p[1] * force[0] if p.shape[0] == 2 else ca.cross(p, force)
        if own is not None:
            moment = moment + own / length
        total = total + ca.vertcat(force, moment)
    return total


def add_membership(
    program: Program,
    problem: GraspProblem,
    scaling: Scaling,
    contacts: ContactSymbols,
    forces: Sequence[ca.SX],
    direction: int,
) -> None:
    """Add "each force is in its cone" and "all forces together are within the budget" for one direction."""
    for i, (model, n, x) in enumerate(zip(problem.models, contacts.normals, forces, strict=True)):
        for name, expression in model.membership(x / scaling.force, n):
            program.constrain(Row(name, expression, 0.0, fingers=(i,), part=f"direction {direction}"))
    for row in problem.budget.rows(problem.models, forces, contacts.normals):
        part = ", ".join(filter(None, (row.part, f"direction {direction}")))
        program.constrain(replace(row, part=part))


def note_copy(program: Program, problem: GraspProblem, direction: int, parameters: ca.SX) -> None:
    """Note the rows since the direction before as one more copy, where forces at several points make them many.

    Where forces are the contacts' components, CasADi's derivatives of the whole graph are as quick.
    """
    space = problem.body.space
    if all(m.generators(space).shape[1] == m.components(space) for m in problem.models):
        return
    begin = program.copies[-1].rows.stop if program.copies else 0
    rows = Range(begin, program.rows[-1].stop)
    program.copies.append(Copy(program.block("forces", direction), rows, parameters))


def pressing_forces(models: Sequence[ContactModel], normals: FloatArray, size: float) -> FloatArray:
    """Return force variables (n,) of every finger pressing with the same normal force."""
    return np.concatenate([size * m.pressing(n) for m, n in zip(models, normals, strict=True)])
