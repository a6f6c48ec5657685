"""Pregrasp of a hand: opened along the contact normals by Newton steps, free of collision."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nlpgrasp.common.quadratic_program import Linearised, quadratic_step, step_bounds
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.hands.base import Values
from nlpgrasp.motion.clearance import HandClearance


@dataclass(frozen=True)
class Pregrasp:
    """Hand configuration before contact.

    Parameters
    ----------
    clearance : float
        Distance that every fingertip has moved away along its contact normal, metres.
    hand : dict
        Values of the hand's variables. The palm has the orientation of the grasp, and its position if joints suffice.
    """

    clearance: float
    hand: Values


def find_pregrasp(
    model: HandClearance,
    grasp: Values,
    normals: FloatArray,
    clearance: float,
    finest: float = 0.05,
    enough: float = 0.2,
) -> Pregrasp:
    """Return the pregrasp of a grasp: the hand opened along the contact normals, free of collision.

    Each fingertip moves back by the clearance along its normal with the least motion of the joints; links and
    fingertips avoid the body, its surroundings and each other, and come no deeper than in the grasp. Where the joints
    alone do not suffice, the pregrasp has the largest clearance that they reach; where that is too little, the palm
    moves as well.

    Parameters
    ----------
    model : HandClearance
    grasp : dict
        Values of the hand's variables.
    normals : (k, 3) array
        Inward unit normals at the contacts.
    clearance : float
        Metres.
    finest, enough : float
        Shares of the clearance: the smallest step of the opening, and the least that joints alone have to reach.
    """
    best, least = Pregrasp(0.0, grasp), np.minimum(model.clearances(grasp), 0.0)
    for moves_palm in (False, True):
        opened, increase = Pregrasp(0.0, grasp), clearance
        while increase > clearance * finest and opened.clearance < clearance:
            distance = min(opened.clearance + increase, clearance)
            values = _opened(model, grasp, least, opened.hand, normals, distance, moves_palm)
            if values is None:
                increase /= 2.0
            else:
                opened = Pregrasp(distance, values)
        best = max(best, opened, key=lambda pregrasp: pregrasp.clearance)
        if best.clearance >= enough * clearance:
            break
    return best


def _opened(
    model: HandClearance, grasp: Values, least: FloatArray, start: Values, normals: FloatArray, distance: float,
    moves_palm: bool, steps: int = 8, longest: float = 0.2, accuracy: float = 1e-7,
) -> Values | None:  # fmt: skip
    """Return the hand with every fingertip at a distance from its contact; None where Newton steps do not get there."""
    tree, values, contacts = model.hand.tree, start, _fingertips(model, grasp)[0]
    lower, upper = tree.joint_limits
    size, shifted = len(lower), 3 if moves_palm else 0
    moving = np.concatenate([np.arange(shifted), np.arange(6, 6 + size)])  # of the twist: the palm does not turn
    scale = np.concatenate([np.full(shifted, tree.span), np.ones(size)])  # a radian counts as the hand's span
    for _ in range(steps):
        tips, motion = _fingertips(model, values)
        distances, by_twist = np.sum((contacts - tips) * normals, axis=1), -np.einsum("kx,kxn->kn", normals, motion)
        near, clearances, rows = model.rows(values)
        closed = np.zeros((0, 6 + size))
        if tree.robot.has_linkages:
            linkages = tree.linkages.jacobian(values["joints"])
            closed = np.hstack([np.zeros((len(linkages), 6)), linkages])
        target, kept = np.full(len(tips), distance), np.zeros(len(closed))
        room = step_bounds(values["joints"], (lower, upper), longest)
        linearised = Linearised(
            np.concatenate([distances, kept, clearances]) / tree.span,
            np.concatenate([by_twist, closed, rows])[:, moving] * scale / tree.span,
            np.concatenate([target, kept, least[near]]) / tree.span,
            np.concatenate([target, kept, np.full(len(near), np.inf)]) / tree.span,
            np.concatenate([np.full(shifted, -longest), room[0]]),
            np.concatenate([np.full(shifted, longest), room[1]]),
        )
        if linearised.violation * tree.span < accuracy:
            return values if np.all(model.clearances(values) >= least - model.tolerance) else None
        step = quadratic_step(linearised)
        if step is None:
            return None
        twist = np.zeros(6 + size)
        twist[moving] = scale * step.d
        joints = tree.close(np.clip(values["joints"] + twist[6:], lower, upper))
        values = {**values, "palm_position": values["palm_position"] + twist[:3], "joints": joints}
    return None


def _fingertips(model: HandClearance, values: Values) -> tuple[FloatArray, FloatArray]:
    """Return the middles of the fingertips (k, 3), metres, and their derivatives by the twist, (k, 3, 6 + m)."""
    frames, tips = model.moving_frames(values), model.hand.tips
    at, groups = frames.links.in_groups([link for link, _ in tips], np.array([tip.centre for _, tip in tips]))
    points = frames.points(at, groups)
    return points[0], frames.motions(points, groups, frames.t[:, 0])[0]
