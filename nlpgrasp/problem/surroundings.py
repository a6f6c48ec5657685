"""Warnings about implausible tables and hand sizes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from nlpgrasp.bodies import Body
from nlpgrasp.common.shown.numbers import rounded
from nlpgrasp.common.shown.once import say_once
from nlpgrasp.constraints import PlacementConstraint, Table
from nlpgrasp.hands import Hand, URDFHand

THROUGH = 0.02  # of the body's size: depth below a table above which a mistake is likely
ACROSS = 2.0  # times the fingertips' reach from the palm: upper bound of the hand's opening


def warn_of_surroundings(body: Body, constraints: Sequence[PlacementConstraint], hand: Hand | None) -> None:
    """Warn about a table that intersects the body, and a hand too small for any side of the body.

    Parameters
    ----------
    body : Body
    constraints : sequence of PlacementConstraint
    hand : Hand or None
    """
    (low, high), extents = body.bounds[:, -1], body.bounds[1] - body.bounds[0]
    for i, table in enumerate(constraints):
        if isinstance(table, Table) and body.tight and THROUGH * body.size < table.height - low < high - low:
            below = f"the body reaches {rounded(1e3 * (table.height - low))} mm below the table"
            where = f"height {rounded(table.height)} m, lowest point {rounded(low, least=1e-9)} m"
            say_once(f"constraints[{i}]: {below} ({where}); a table that it stands on is ng.Table.under(body)")
    shortest = float(np.min(extents))
    if isinstance(hand, URDFHand) and shortest > ACROSS * hand.tree.span:
        given = f"a body whose shortest side is {rounded(shortest)} m, for a hand whose fingertips reach"
        say_once(
            f"GraspProblem.body: {given} {rounded(hand.tree.span)} m from its palm; are both in metres? A mesh in "
            'millimetres takes unit="mm"'
        )
