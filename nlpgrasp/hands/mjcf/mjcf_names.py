"""Names of a compiled model's parts, with numbers for unnamed ones."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from mujoco import MjModel


def body_name(model: MjModel, body: int) -> str:
    """Return a body's name."""
    return str(model.body(body).name) or f"body_{body}"


def joint_name(model: MjModel, joint: int) -> str:
    """Return a joint's name."""
    return str(model.joint(joint).name) or f"joint_{joint}"


def tendon_name(model: MjModel, tendon: int) -> str:
    """Return a tendon's name."""
    return str(model.tendon(tendon).name) or f"tendon_{tendon}"


def geom_name(model: MjModel, geom: int) -> str:
    """Return a geometry's name."""
    return str(model.geom(geom).name) or f"geom_{geom}"
