"""The vertex transcription: the grasp produces each of the task's sampled wrenches (inner)."""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca

from nlpgrasp.common.rows import Row
from nlpgrasp.nlp.forces import add_forces, add_membership, note_copy, symbolic_wrench
from nlpgrasp.nlp.placement import Scaling, add_placement, add_placement_rows
from nlpgrasp.nlp.program import Program
from nlpgrasp.problem.problem import GraspProblem


def vertex_program(problem: GraspProblem, faces: Sequence[str], count: int) -> Program:
    """Return: maximise beta with ``G x_j = beta w_j``, ``x_j`` in K and in the budget, for j = 1 ... count.

    The wrenches ``w_j = c + L u_j`` are parameters, so that every start may turn them as it likes. With
    inradius r of the directions u_j a centred task has ``mu >= r beta``; a non-grasp never has beta > 0.

    Parameters
    ----------
    problem : GraspProblem
    faces : sequence of k str
        The face each contact is on; a parameter of the program where there are several (``face_parameters``).
    count : int
        Number of wrenches.

    Returns
    -------
    Program
        Variables ``position i``, ``normal i``, ``forces j``, ``beta`` (scaled); parameter ``wrenches``.
    """
    scaling = Scaling.of(problem)
    program = Program()
    contacts = add_placement(program, problem, scaling)
    beta = program.variable("beta", 1, 0.0, 100.0, 1.0 / scaling.beta)
    wrenches = ca.reshape(program.parameter("wrenches", problem.dimension * count), problem.dimension, count)
    for j in range(count):
        forces = add_forces(program, problem, scaling, j)
        produced = symbolic_wrench(problem.models, contacts, forces, scaling.length) / scaling.force
        balance = produced - beta * wrenches[:, j]
        program.constrain(Row("wrench balance", balance, 0.0, 0.0, part=f"direction {j}"))
        add_membership(program, problem, scaling, contacts, forces, j)
        note_copy(program, problem, j, wrenches[:, j])
    add_placement_rows(program, problem, scaling, contacts, faces)
    program.objective = beta
    return program
