"""Quality measures from the singular values of G, which ignore friction and unilateral contact."""

from __future__ import annotations

from typing import overload

import numpy as np

from nlpgrasp.common.validation import FloatArray
from nlpgrasp.grasp.grasp import Grasp
from nlpgrasp.grasp.stack import GraspStack
from nlpgrasp.quality.arguments import require_grasp
from nlpgrasp.quality.certificate.units import over_length


@overload
def smallest_singular_value(grasp: Grasp, torque_scale: float = 1.0) -> float: ...
@overload
def smallest_singular_value(grasp: GraspStack, torque_scale: float = 1.0) -> FloatArray: ...
def smallest_singular_value(grasp: Grasp | GraspStack, torque_scale: float = 1.0) -> float | FloatArray:
    """Return the smallest of the d singular values of G (Li and Sastry 1988, doi:10.1109/56.769).

    A grasp map with fewer columns than rows has a zero among them. Friction is ignored, so a value above 0 does not
    imply stability.

    Parameters
    ----------
    grasp : Grasp or GraspStack
        Contacts in place; of a stack every grasp is measured.
    torque_scale : float
        Metres: torques count as ``torque / torque_scale``.

    Returns
    -------
    float, or (b,) array for a stack
        Newtons per unit of the L2 norm of all finger forces.
    """
    values = _singular_values(grasp, torque_scale)[..., -1]
    return float(values) if isinstance(grasp, Grasp) else values


@overload
def isotropy(grasp: Grasp, torque_scale: float = 1.0) -> float: ...
@overload
def isotropy(grasp: GraspStack, torque_scale: float = 1.0) -> FloatArray: ...
def isotropy(grasp: Grasp | GraspStack, torque_scale: float = 1.0) -> float | FloatArray:
    """Return the isotropy index, G's smallest over its largest singular value (Kim, Oh, Yi and Suh 2001).

    Parameters
    ----------
    grasp : Grasp or GraspStack
        Contacts in place; of a stack every grasp is measured.
    torque_scale : float
        Metres: torques count as ``torque / torque_scale``.

    Returns
    -------
    float, or (b,) array for a stack
        From 0, without full rank, to 1.
    """
    values = _singular_values(grasp, torque_scale)
    ratio = np.asarray(values[..., -1] / np.maximum(values[..., 0], 1e-300))
    return float(ratio) if isinstance(grasp, Grasp) else ratio


def _singular_values(grasp: Grasp | GraspStack, torque_scale: float) -> FloatArray:
    """Return all d singular values of G with torques over ``torque_scale``, largest first (..., d)."""
    require_grasp(grasp, stack=True)
    G = grasp.G * over_length(grasp, torque_scale)[:, None]
    values = np.linalg.svd(G, compute_uv=False)
    missing = G.shape[-2] - values.shape[-1]
    return np.concatenate([values, np.zeros((*values.shape[:-1], max(0, missing)))], axis=-1)
