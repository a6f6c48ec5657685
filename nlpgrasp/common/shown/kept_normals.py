"""Message about given contact normals that differ from the mesh normals."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np


def kept_normals(angles: Mapping[int, float]) -> str:
    """Return the message that lists contacts with deviating normals and their angles in degrees.

    Parameters
    ----------
    angles : mapping
        Angle by contact, radians; at least one.
    """
    each = [f"{np.degrees(angle):.2g}" for angle in angles.values()]
    numbers = [str(i) for i in angles]
    if len(each) == 1:
        return f"the normal stated at contact {numbers[0]} is not the mesh's: it is {each[0]} degrees off"
    listed = f"{', '.join(numbers[:-1])} and {numbers[-1]}"
    off = f"{', '.join(each[:-1])} and {each[-1]}"
    return f"the normals stated at contacts {listed} are not the mesh's: they are {off} degrees off"
