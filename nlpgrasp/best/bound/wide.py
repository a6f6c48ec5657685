"""What a contact anywhere on several flat pieces does at most: the friction cone grows by the cone of their normals.

A force at a contact with inward normal n is within ``alpha = atan mu`` of n, so within ``alpha + delta`` of any vector
m that is within delta of n. With a moment about the normal of at most ``mu_t`` times the normal force,
``mu_t f_n <= mu_t |f| <= mu_t sqrt(1 + mu'^2) (f . m)`` for ``mu' = tan(alpha + delta)``; along a twist it does at most
``|tau . m| + 2 sin(delta / 2) |tau|`` for each unit. So the contact's forces of unit length do no more than those of a
soft contact with the normal m and these wider coefficients; where ``alpha + delta`` is beyond a right angle, than any
force. A shift of its point by r adds at most ``r |tau|``. Forces of unit normal force are at most
``sqrt(1 + mu^2 + mu_t^2)`` long.
"""

from __future__ import annotations

import numpy as np

from nlpgrasp.common.validation import FloatArray
from nlpgrasp.contacts import ContactModel, Work
from nlpgrasp.contacts.soft import squared_box_support

WIDEST = 1.5  # radians, of a cone: in a wider one any force is


def widened(contact: ContactModel, z: FloatArray, turning: FloatArray, turn: FloatArray, far: FloatArray) -> FloatArray:
    """Return the most work of a force of unit length, of a contact with friction and torsion or without.

    Parameters
    ----------
    contact : ContactModel
    z : (..., 4) array
        Of a soft contact in the middle with normal m.
    turning : (...) array
        ``|tau|``.
    turn, far : (...) arrays
        delta, radians, and r, metres.
    """
    friction, torsion = (contact.coefficients.get(name, 0.0) for name in ("friction", "torsional_friction"))
    angle = np.arctan(friction) + turn
    mu = np.tan(np.minimum(angle, WIDEST))
    along, across = z[..., 0], np.sqrt(z[..., 1] ** 2 + z[..., 2] ** 2)
    every = angle > WIDEST
    if torsion == 0.0:
        c = 1.0 / np.sqrt(1.0 + mu**2)
        edge = np.maximum(c * (along + mu * across), 0.0)
        inside = mu * along >= across
        s = np.where(inside | every, np.hypot(along, across), edge)
        return np.asarray(s + far * turning)
    mu_t = torsion * np.sqrt(1.0 + mu**2)
    about = np.abs(z[..., 3]) + 2.0 * np.sin(0.5 * turn) * turning
    square = squared_box_support(Work(along, across, about), mu, mu_t, np)
    square = np.where(every, along**2 + across**2 + turning**2, square)
    return np.asarray(np.sqrt(square) + far * turning)
