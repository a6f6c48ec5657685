"""What a scene with a hand takes for granted: gains, damping, friction of the joints, the object's mass."""

from __future__ import annotations

from dataclasses import dataclass

from nlpgrasp.common.validation import number

ARM_STIFFNESS = 2e4  # N / m, of what carries the palm


@dataclass(frozen=True)
class HandSceneOptions:
    """What a file of a grasp does not say of a hand's joints and its object.

    A URDF's own damping and friction are left out: many are placeholders that let no joint move.

    Parameters
    ----------
    gain : float, optional
        Of the joints' position control, N m / rad; that of the file's squeeze when left out. Sliding joints keep
        the file's.
    damping : float
        Of the joints, N m s / rad.
    frictionloss : float
        Of the joints, N m: dry friction.
    mass : float, optional
        Of the object, kilograms; when left out the weight that the task carries, else that of water in its place.
    normal_force : float, optional
        What each finger presses with at least in the squeeze, newtons; the file's when left out.
    friction : float
        Share of the contacts' friction that there is: 0.5 of half of it.
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
