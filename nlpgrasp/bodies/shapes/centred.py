"""Base class of bodies in space centred on the origin."""

from __future__ import annotations

from abc import abstractmethod

import numpy as np

from nlpgrasp.bodies.base import Body
from nlpgrasp.common.validation import FloatArray


class CentredBody(Body):
    """A body in space whose bounding box and volume are centred on the origin."""

    @property
    @abstractmethod
    def half_size(self) -> FloatArray:
        """Half the lengths of the bounding box, (3,), metres."""

    @property
    def bounds(self) -> FloatArray:
        """Bounding box, (2, 3): lower corner, upper corner, metres."""
        return np.stack([-self.half_size, self.half_size])

    @property
    def centroid(self) -> FloatArray:
        """Centre of volume, (3,), metres: the origin, also where it is not in the body."""
        return np.zeros(3)
