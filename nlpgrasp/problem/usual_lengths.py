"""Warnings about lengths that are probably not in metres."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from nlpgrasp.bodies import Body
from nlpgrasp.common.shown.once import say_once
from nlpgrasp.constraints import Obstacle, PlacementConstraint, Table
from nlpgrasp.contacts import ContactModel
from nlpgrasp.hands import Hand, URDFHand

MUCH = 20.0  # times the body's size: implausible torsional friction, fingertip radius or clearance
FAR = 50.0  # times the body's size: implausible distance of a table


def warn_of_lengths(
    body: Body, models: Sequence[ContactModel], constraints: Sequence[PlacementConstraint], hand: Hand | None
) -> None:
    """Warn, once, about a length that is implausibly large for the body.

    Parameters
    ----------
    body : Body
    models : sequence of ContactModel
    constraints : sequence of PlacementConstraint
    hand : Hand or None
    """
    longest = float(np.max(body.bounds[1] - body.bounds[0]))
    for field, given, beyond, most in _lengths(body, models, constraints, hand):
        if beyond > most * body.size:
            say_once(
                f"{field}: {given:g} m beside a body of {longest:.3g} m; if millimetres were meant, {given / 1e3:g}"
            )
            return


def _lengths(
    body: Body, models: Sequence[ContactModel], constraints: Sequence[PlacementConstraint], hand: Hand | None
) -> Iterator[tuple[str, float, float, float]]:
    """Yield each length's name, given value, value to compare, and limit in body sizes."""
    for i, model in enumerate(models):
        torsion = model.coefficients.get("torsional_friction", 0.0)
        yield f"contacts[{i}]: torsional friction", torsion, torsion, MUCH
    for i, constraint in enumerate(constraints):
        if isinstance(constraint, Table | Obstacle):
            yield f"constraints[{i}]: clearance", constraint.clearance, constraint.clearance, MUCH
        if isinstance(constraint, Table):
            height, (low, high) = constraint.height, body.bounds[:, -1]
            yield f"constraints[{i}]: height", height, max(low - height, height - high), FAR
    for link, tip in hand.tips if isinstance(hand, URDFHand) else ():
        yield f"fingertip {link}: radius", tip.standoff, tip.standoff, MUCH
