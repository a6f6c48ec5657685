"""Selection of the first kept grasp that a user's function accepts; table of kept grasps."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from nlpgrasp.common.shown.text import one_line
from nlpgrasp.errors import InputError
from nlpgrasp.solution.many.found import FoundGrasp

Accepts = Callable[[FoundGrasp], bool]


def first_accepted(grasps: Sequence[FoundGrasp], accepts: Accepts) -> FoundGrasp:
    """Return the first grasp that a function accepts.

    Raises
    ------
    InputError
        Where it accepts none, raises, or returns neither True nor False.
    """
    if not callable(accepts):
        raise InputError("select", accepts, "a function of an ng.FoundGrasp that returns True or False")
    for i, found in enumerate(grasps):
        try:
            answer = accepts(found)
        except Exception as error:  # whatever the user's function raises
            raise InputError(f"select, at grasps[{i}]", one_line(error), "a function that raises nothing") from error
        if not isinstance(answer, bool | np.bool_):
            raise InputError(f"select, at grasps[{i}]", answer, "True or False")
        if answer:
            return found
    kept = f"{len(grasps)} grasp{'s' * (len(grasps) != 1)}" if grasps else "no grasps"
    raise InputError("select", f"a function that is true for none of {kept}", "one that accepts a grasp, or more kept")


def table(grasps: Sequence[FoundGrasp], asked: int = 1) -> list[str]:
    """Return a table of several grasps as text lines: certified quality, remaining quality at worst, faces.

    Where there are fewer grasps than requested, the first line says so.
    """
    fewer = f"  {len(grasps)} of the {asked} grasps asked for: more starts, or a smaller distinct, may find others"
    said = [fewer] if 0 < len(grasps) < asked else []
    if len(grasps) < 2:
        return said
    lines = [*said, f"  {len(grasps)} grasps kept, best first (certified quality, what is left at worst, faces):"]
    for i, found in enumerate(grasps):
        left = "" if found.robust is None else f"{found.robust.mu.upper:.4g} left"
        fragile = ", fragile" if found.is_fragile else ""
        lines.append(f"  {i:4d}  {found.mu!s:20}  {left + fragile:20}  {', '.join(found.faces)}".rstrip())
    return lines
