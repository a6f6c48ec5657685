"""Bodies restated in numpy: distances at places where formulas divide by zero."""

import numpy as np
import pytest

from nlpgrasp.verify.numeric_bodies import ellipsoid
from nlpgrasp.verify.sources import SourceFolders


def test_the_centre_of_an_ellipsoid_is_inside_it():
    surface = ellipsoid({"semi_axes": [0.03, 0.02, 0.01]}, SourceFolders())
    assert surface.distance(np.zeros((1, 3))) == pytest.approx([-0.01])
