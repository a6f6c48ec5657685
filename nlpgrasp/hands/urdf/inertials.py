"""Mass and inertia of a URDF's links."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from nlpgrasp.common.validation import FloatArray
from nlpgrasp.hands.urdf.urdf_file import urdf_root
from nlpgrasp.hands.urdf.urdf_values import numbers

MOMENTS = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")


@dataclass(frozen=True)
class Inertial:
    """Mass, centre of mass and inertia of a link.

    Parameters
    ----------
    mass : float
        Kilograms.
    center : (3,) array
        Centre of mass, metres, link frame.
    inertia : (3, 3) array
        About the centre of mass, in axes parallel to the link's, kg m^2.
    """

    mass: float
    center: FloatArray
    inertia: FloatArray


def urdf_inertials(path: str | Path) -> Mapping[str, Inertial]:
    """Return mass and inertia of the links of a URDF that state a mass above zero.

    Raises
    ------
    InputError
        On numbers that cannot be read.
    """
    source, result = Path(path), {}
    for link in urdf_root(source).findall("link"):
        name, stated = link.get("name", ""), link.find("inertial")
        if stated is None:
            continue
        label, origin = f"inertial of link {name}", stated.find("origin")
        weight, moments = stated.find("mass"), stated.find("inertia")
        mass = float(numbers(source, f"{label}, mass", None if weight is None else weight.get("value"), [0.0])[0])
        if mass <= 0.0:
            continue
        pose = [None if origin is None else origin.get(key) for key in ("xyz", "rpy")]
        center, rpy = (numbers(source, f"{label}, origin", value, np.zeros(3)) for value in pose)
        told = [None if moments is None else moments.get(key) for key in MOMENTS]
        values = [float(numbers(source, f"{label}, inertia", value, [0.0])[0]) for value in told]
        turn = Rotation.from_euler("xyz", rpy).as_matrix()
        tensor = np.diag(values[:3])
        tensor[[0, 0, 1], [1, 2, 2]] = tensor[[1, 2, 2], [0, 0, 1]] = values[3:]
        result[name] = Inertial(mass, center, turn @ tensor @ turn.T)
    return result
