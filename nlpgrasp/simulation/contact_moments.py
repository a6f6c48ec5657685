"""Moments that contacts transmit about their points: torsion of soft fingers, tilting moments of pads."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nlpgrasp.common.validation import FloatArray
from nlpgrasp.contacts import ContactModel
from nlpgrasp.contacts.product import ranges
from nlpgrasp.grasp.grasp import Grasp
from nlpgrasp.mjcf.parts import force_indices


@dataclass(frozen=True)
class ContactMoment:
    """Moment components of a contact with one common limit.

    Parameters
    ----------
    contact : int
    model : ContactModel
    share : float
        Largest magnitude over the normal force, metres.
    indices : tuple of b int
        Indices among all components.
    directions : (b, 3) array
        Axes of the moments, body frame.
    """

    contact: int
    model: ContactModel
    share: float
    indices: tuple[int, ...]
    directions: FloatArray

    def most(self, normal: float, rubbing: float) -> float:
        """Return the largest moment transmitted at this normal and tangential force (newtons)."""
        return self.share * self.model.left_for_moments(normal, rubbing)

    def cut(self, moment: FloatArray, normal: float, rubbing: float) -> FloatArray:
        """Return a moment (b,) limited to what is transmitted."""
        size, most = float(np.linalg.norm(moment)), self.most(normal, rubbing)
        return moment if size <= most else moment * (most / size)


def components(grasp: Grasp) -> tuple[list[int], list[ContactMoment]]:
    """Return the indices of the force components, and the moments."""
    forces = force_indices(grasp)
    moments: list[ContactMoment] = []
    for i, (model, part) in enumerate(zip(grasp.contacts, ranges(grasp.contacts, grasp.space), strict=True)):
        axes = model.axes(grasp.space)
        for where, share in model.blocks(model.components(grasp.space)):
            parts = [j for j in range(where.start, where.stop) if axes[j] >= grasp.space]
            if parts:
                about = np.array([_direction(grasp, i, axes[j]) for j in parts])
                moments.append(ContactMoment(i, model, share, tuple(part.start + j for j in parts), about))
    return forces, moments


def _direction(grasp: Grasp, i: int, axis: int) -> FloatArray:
    """Return the axis of a moment component, body frame."""
    return np.eye(3)[2] if grasp.space == 2 else np.asarray(grasp.frames[i][:, axis - 3])
