"""Constraints against overlap of round fingertips of one hand."""

from __future__ import annotations

from itertools import combinations

import casadi as ca

from nlpgrasp.common.rows import TIPS_APART, Row
from nlpgrasp.common.types import Expression
from nlpgrasp.hands.urdf.link_tree import LinkTree


def tips_that_meet(tree: LinkTree) -> tuple[tuple[int, int], ...]:
    """Return the pairs of round fingertips that can collide: not those on neighbouring links of a chain."""
    groups, robot = tree.robot.rigid_groups, tree.robot
    round_ones = [(i, link) for i, (link, tip) in enumerate(tree.tips) if tip.standoff > 0.0]
    return tuple(
        (i, j) for (i, a), (j, b) in combinations(round_ones, 2) if groups[a] != groups[b] and not robot.adjacent(a, b)
    )


def tips_apart(tree: LinkTree, variables: dict[str, Expression]) -> list[Row]:
    """Return one constraint per pair: the ball centres are at least the sum of the radii apart.

    Parameters
    ----------
    tree : LinkTree
    variables : dict
        Symbols of the hand's variables, by name.
    """
    centres, radii = tree.tip_centres(variables), [tip.standoff for _, tip in tree.tips]
    rows = []
    for i, j in tips_that_meet(tree):
        a, b = centres[i], centres[j]
        if a is not None and b is not None:
            squared, least = ca.sumsqr(a - b), (radii[i] + radii[j]) ** 2
            rows.append(Row(TIPS_APART, squared, least, scale=tree.span**2, unit="m2", fingers=(i, j)))
    return rows
