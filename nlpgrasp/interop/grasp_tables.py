"""Import of stacks of grasps from files of any import format, and from arrays."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from nlpgrasp.contacts import ContactModel
from nlpgrasp.errors import InputError
from nlpgrasp.interop.base import ReadGrasp, ReadOptions
from nlpgrasp.interop.grasp_arrays import grasps_of_arrays
from nlpgrasp.interop.registry import reader_of
from nlpgrasp.problem.problem import GraspProblem
from nlpgrasp.quality.grasp import GraspStack, check_distinct_names, check_spans, warn_of_units_and_normals


def read_grasps(
    source: str | Path | Mapping[str, ArrayLike],
    *,
    friction: float | None = None,
    unit: str = "m",
    torque_origin: ArrayLike | None = None,
    problem: GraspProblem | None = None,
) -> GraspStack:
    """Read the grasps of a file or of arrays as one stack.

    Parameters
    ----------
    source : str, Path, or mapping of str to (b, ...) array
        A table of contacts (``.csv``, ``.parquet``; the column ``grasp``, ``grasp_id`` or ``id`` names the grasp,
        whose rows stand together), arrays (``.npz``, or a mapping): ``points``
        and ``normals``, (b, k, 3), optionally ``ids``, ``friction`` and ``torsional_friction``; postures of a hand
        (isaac_grasp ``.yaml``, ``grasp_qpos`` in ``.npz``); or a solution.
    friction : float, optional
        Of contacts that state none; by default they are frictionless, with a warning.
    unit : {"m", "dm", "cm", "mm", "in", "ft"}
        Unit of the points in tables and arrays.
    torque_origin : (space,) array, optional
        Reference point of moments, metres; by default that of the problem or solution, or the frame's origin.
    problem : GraspProblem, optional
        With the body and the hand that postures are for.

    Returns
    -------
    GraspStack
        b grasps in the order of the source.

    Raises
    ------
    InputError
        On a file without such columns or arrays, normals that are not unit vectors within 1 %, ids that are repeated
        (also by rows of a grasp that are not one after another), contacts more than 10 m apart, and grasps of different
        contacts: ``read_grasp_stacks`` returns a stack for each kind.

    Warns
    -----
    UserWarning
        On contacts assumed frictionless, points that seem not to be in metres, and normals that seem to point outwards.
    """
    stacks = read_grasp_stacks(source, friction=friction, unit=unit, torque_origin=torque_origin, problem=problem)
    if len(stacks) > 1:
        contact_counts = sorted({len(stack.contacts) for stack in stacks})
        kinds = (
            f"{contact_counts[0]} to {contact_counts[-1]} contacts"
            if len(contact_counts) > 1
            else "contacts of several models"
        )
        allowed = "grasps of the same contacts; nlpgrasp.interop.read_grasp_stacks returns a stack for each kind"
        raise InputError(_name(source), f"grasps of {kinds}", allowed)
    return stacks[0]


def read_grasp_stacks(
    source: str | Path | Mapping[str, ArrayLike],
    *,
    friction: float | None = None,
    unit: str = "m",
    torque_origin: ArrayLike | None = None,
    problem: GraspProblem | None = None,
) -> tuple[GraspStack, ...]:
    """Read the grasps of a file or of arrays as stacks, one for each sequence of contact models.

    Parameters are those of ``read_grasps``; ``ng.measure`` takes the result.
    """
    options = ReadOptions(friction, None, None if problem is None else lambda: problem, unit)
    if isinstance(source, Mapping):
        grasps = list(grasps_of_arrays("arrays", source, options))
    else:
        reader = reader_of(source)
        for option, value in {"friction": friction, "problem": problem, "unit": unit}.items():
            if value not in (None, "m") and option not in reader.options:
                raise InputError(option, value, f"another kind of file than {_name(source)} with it")
        grasps = list(reader.read(Path(source), options))
    return stack_grasps(_name(source), grasps, torque_origin)


def stack_grasps(
    name: str, grasps: Sequence[ReadGrasp], torque_origin: ArrayLike | None = None
) -> tuple[GraspStack, ...]:
    """Group imported grasps with the same contact models into stacks, in the order of the stacks' first grasps.

    Parameters
    ----------
    name : str
        Of the source, for messages.
    grasps : sequence of ReadGrasp
    torque_origin : (space,) array, optional
        By default that of grasps with a task, else the frame's origin.
    """
    if not grasps:
        raise InputError(name, "no grasp", "one or more")
    check_distinct_names(f"{name}: ids", [read.name for read in grasps])
    spaces = {read.grasp.space for read in grasps}
    if len(spaces) > 1:
        raise InputError(name, "grasps in the plane and in space", "one of them")
    first_grasp, has_task = grasps[0].grasp, grasps[0].task is not None
    origin = first_grasp.torque_origin if has_task and torque_origin is None else torque_origin
    groups: dict[tuple[ContactModel, ...], list[ReadGrasp]] = {}
    for read in grasps:
        groups.setdefault(read.grasp.contacts, []).append(read)
    stacks = []
    for models, members in groups.items():
        points, normals = (np.stack([getattr(m.grasp, field) for m in members]) for field in ("points", "normals"))
        check_spans(name, points)
        warn_of_units_and_normals(name, points, normals)
        stacks.append(GraspStack(points, normals, models, origin, [member.name for member in members]))
    return tuple(stacks)


def _name(source: str | Path | Mapping[str, ArrayLike]) -> str:
    """Return the name of a file or of arrays, for messages."""
    return "arrays" if isinstance(source, Mapping) else Path(source).name
