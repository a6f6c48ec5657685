"""Refinement of a hand's grasp under joint-limit margins, where these cost little of mu.

The ranges of the joints are narrower by their margins. Joints that cannot go inside where the fingertips touch keep
their whole range; so do those whose margins take more of mu, to first order by their multipliers, than the price.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from nlpgrasp.common.stopping.stop import Stop
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.hands import URDFHand
from nlpgrasp.optimize.ascent.cuts import most_relevant
from nlpgrasp.optimize.ascent.refine import Refined, refine
from nlpgrasp.optimize.ascent.steps.linear import Linearisation
from nlpgrasp.optimize.posture.margins import Margins
from nlpgrasp.optimize.start.touch import TOUCHING, touching
from nlpgrasp.optimize.workbench.placed import Placed
from nlpgrasp.optimize.workbench.workbench import Workbench

NEARBY = 1e-3  # over the body's size: trust-region radius of the linearised program that prices the margins


def refined_with_room(bench: Workbench, placed: Placed, stop: Stop) -> tuple[Workbench, Refined]:
    """Return the refined candidate, and the compiled problem with the joint limits used.

    Parameters
    ----------
    bench : Workbench
        Of a problem whose hand has a pose.
    placed : Placed
        Contacts and hand, whose joints may be anywhere in their ranges.
    stop : Stop
    """
    hand, options = bench.problem.hand, bench.options
    if not isinstance(hand, URDFHand) or not options.seeks_room:
        return bench, refine(bench, placed, stop)
    margins = Margins.of(hand, options.joint_margin)
    inside, placed = _inside(bench, margins, placed)
    own = bench.with_joints(margins.narrowed(inside))
    refined = refine(own, placed, stop)
    dear = _dear(own, refined, inside * margins.wanted)
    if np.any(dear):
        own = bench.with_joints(margins.narrowed(inside & ~dear))
        refined = refine(own, refined.point.placed, stop)
    return own, refined


def _inside(bench: Workbench, margins: Margins, placed: Placed) -> tuple[NDArray[np.bool_], Placed]:
    """Return the mask of joints that can keep their margins with all fingertips touching, (m,), and the hand there."""
    lacking = margins.lacking(placed.hand["joints"])
    for inside in (np.ones_like(lacking), ~lacking) if np.any(lacking) else ():
        limits = margins.narrowed(inside)
        clipped = np.clip(placed.hand["joints"], limits[0], limits[1])
        own = bench.with_joints(limits)
        moved, left = touching(own, replace(placed, hand={**placed.hand, "joints": clipped}))
        if left <= TOUCHING:
            return inside, own.snapped(moved)
    return ~lacking, placed


def _dear(bench: Workbench, refined: Refined, margins: FloatArray) -> NDArray[np.bool_]:
    """Return the mask of joints, (m,), whose margins are dropped so that the others cost little enough of mu."""
    point, program = refined.point, bench.exchange.compiled.program
    nothing = np.zeros(len(margins), dtype=bool)
    if point.value <= 0.0 or not bench.exchange.linearises:
        return nothing
    linear = Linearisation(bench, point.placed, most_relevant(bench, point.placed, point.cuts))
    step = linear.quadratic_step(NEARBY)
    if step is None:
        return nothing
    joints = next(block for name, block in program.hand_blocks if name == "joints")
    gain = np.abs(step.bound_multipliers[joints.range]) / (joints.scale * bench.scaling.beta)  # of mu, a unit of range
    cost = gain * margins / point.value
    cheapest = np.argsort(cost)
    nothing[cheapest] = np.cumsum(cost[cheapest]) > bench.options.room_price
    return nothing
