"""Test whether one contact model can exert every force of another."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.optimize import linear_sum_assignment

from nlpgrasp.contacts.base import ContactModel
from nlpgrasp.contacts.friction import FrictionContact
from nlpgrasp.contacts.pad import Arms, PadContact
from nlpgrasp.contacts.plane import PlaneContact
from nlpgrasp.contacts.point import PointContact
from nlpgrasp.contacts.soft import SoftContact
from nlpgrasp.errors import InputError

ROUNDING = 1e-12  # relative tolerance of inclusion
Ranges = list[tuple[frozenset[int], float]]  # axes of a contact-frame wrench, and their range per unit normal force


def contains(wider: ContactModel, other: ContactModel, space: int) -> bool:
    """Return whether one contact is known to exert every force of another.

    That is, whether ``B_other K_other`` lies in ``B_wider K_wider``; also false where that is undecided.

    Most domains have the shape ``|x_j| <= c_j x_n`` (for the elliptic soft contact the sum of both squared ratios is at
    most 1). The largest ``|x_S|`` that the other reaches with unit normal force is the root of the sum of its squared
    ranges over the blocks that meet S, since all of them may be at their limits at once; it is included exactly if that
    is at most the range of S for every block S of the wider one, and no component is left over. A pad with Coulomb
    friction equals friction contacts at its ends or corners; it includes contacts at points between these with no more
    friction. Undecided, unless equal, are contacts of other shapes and patches with different directions.

    Parameters
    ----------
    wider, other : ContactModel
        Their faces are ignored.
    space : int
        2 or 3.
    """
    if wider == other:
        return True
    try:
        wider_ranges, other_ranges = _block_ranges(wider, space), _block_ranges(other, space)
    except InputError:
        return False
    if not set(other.axes(space)) <= set(wider.axes(space)):
        return False
    if not _same_frames(wider, other, space):
        return False
    if isinstance(wider, PadContact) and wider.points(wider.components(space)) is not None:
        return _acts_within(other, wider)
    if _is_elliptic(wider):
        ratios = [_largest_norm(other_ranges, axes) / c for axes, c in wider_ranges]
        combined = max(ratios) if _is_elliptic(other) else float(np.linalg.norm(ratios))
        return combined <= 1.0 + ROUNDING
    return all(_largest_norm(other_ranges, axes) <= c * (1.0 + ROUNDING) for axes, c in wider_ranges)


def assign_contacts(
    small: Sequence[ContactModel], large: Sequence[ContactModel], space: int, groups: Sequence[int] | None = None
) -> list[int] | None:
    """Return the index of a large contact that contains each small contact; None if there is no such assignment.

    A large contact contains a small one if it can exert every force of it. Each is assigned at most once.

    Parameters
    ----------
    small, large : sequences of k and m >= k ContactModel
        A small contact's allowed faces must be among those of the large one.
    space : int
    groups : sequence of int, optional
        For k = m contacts: only those of equal group may be assigned; by default all may.
    """
    fits = np.array([[contains(b, a, space) and _faces_within(a, b) for b in large] for a in small])
    if groups is not None:
        fits &= np.equal.outer(groups, groups)
    k = len(small)
    if len(large) < k:
        return None
    # of all choices the one that keeps most contacts in their places
    rows, columns = linear_sum_assignment(np.where(fits, 0.0, 2.0 * k) - np.eye(k, len(large)) * 0.5)
    return [int(c) for c in columns] if fits[rows, columns].all() else None


def _faces_within(a: ContactModel, b: ContactModel) -> bool:
    """Return whether contact b allows all faces that contact a allows."""
    return b.faces is None or (a.faces is not None and set(a.faces) <= set(b.faces))


def _acts_within(other: ContactModel, pad: PadContact) -> bool:
    """Return whether a contact's forces act at points of a pad, with at most the pad's friction."""
    points: Arms = ((0.0, 0.0),)  # at which the other contact's forces act
    if isinstance(other, PadContact):
        if other.friction is not None and other.model == "box":
            return False  # its moments are not those of forces in friction cones at its ends or corners
        if isinstance(other, PlaneContact) and other.extents is None:
            return False  # its corners are unknown
        points = other.arms
    elif not isinstance(other, PointContact | FrictionContact):
        return False  # other models may exert moments about their point
    is_between = np.all(np.max(np.abs(points), axis=0) <= np.max(np.abs(pad.arms), axis=0) * (1.0 + ROUNDING))
    friction = other.coefficients.get("friction", 0.0)
    return bool(is_between and friction <= pad.coefficients["friction"] * (1.0 + ROUNDING))


def _is_elliptic(model: ContactModel) -> bool:
    """Return whether a contact is a soft finger with the elliptic cone."""
    return isinstance(model, SoftContact) and model.model == "elliptic"


def _block_ranges(model: ContactModel, space: int) -> Ranges:
    """Return the wrench components and the coefficient of each block of a contact."""
    axes = model.axes(space)
    return [(frozenset(axes[block]), float(c)) for block, c in model.blocks(len(axes))]


def _largest_norm(ranges: Ranges, axes: frozenset[int]) -> float:
    """Return the largest norm of some wrench components under unit normal force."""
    return float(np.sqrt(sum(c**2 for block_axes, c in ranges if block_axes & axes)))


def _same_frames(first: ContactModel, second: ContactModel, space: int) -> bool:
    """Return whether two contacts have the same tangents, or one is rotationally symmetric."""
    if space == 2 or _is_round(first) or _is_round(second):
        return True
    normals = np.random.default_rng(0).standard_normal((4, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return bool(np.allclose(first.tangents(normals), second.tangents(normals), rtol=0.0, atol=1e-9))


def _is_round(model: ContactModel) -> bool:
    """Return whether a contact's force domain is symmetric under rotation about the normal."""
    pairs = [frozenset(pair) & axes for pair in ((1, 2), (4, 5)) for axes, _ in _block_ranges(model, 3)]
    return all(len(pair) != 1 for pair in pairs)
