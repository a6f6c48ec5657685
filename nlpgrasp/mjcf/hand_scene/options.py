"""Options of scenes with a hand: gains, damping, joint friction, object mass."""

from __future__ import annotations

from dataclasses import dataclass

from nlpgrasp.common.validation import number

ARM_STIFFNESS = 2e4  # N / m, of the arm that carries the palm


@dataclass(frozen=True)
class HandSceneOptions:
    """Simulation parameters of a hand's joints and its object that a grasp's file does not contain.

    A URDF's damping and friction are ignored: many are placeholders that let no joint move.

    Parameters
    ----------
    gain : float, optional
        Of the joints' position control, N m / rad; by default that of the file's squeeze. Prismatic joints keep the
        file's.
    damping : float
        Of the joints, N m s / rad.
    frictionloss : float
        Dry friction of the joints, N m.
    mass : float, optional
        Of the object, kilograms; by default from the weight in the task, else for the density of water.
    normal_force : float, optional
        Least normal force of each finger in the squeeze, newtons; by default the file's.
    friction : float
        Factor on the contacts' friction: 0.5 for half of it.
    """

    gain: float | None = None
    damping: float = 0.1
    frictionloss: float = 0.005
    mass: float | None = None
    normal_force: float | None = None
    friction: float = 1.0

    def __post_init__(self) -> None:
        for name in ("gain", "mass", "normal_force"):
            value = getattr(self, name)
            if value is not None:
                object.__setattr__(self, name, number(name, value, above=0.0))
        for name in ("damping", "frictionloss", "friction"):
            object.__setattr__(self, name, number(name, getattr(self, name), at_least=0.0))
