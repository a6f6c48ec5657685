"""Validation of angles in radians, with hints at degrees."""

import numpy as np
import pytest

import nlpgrasp as ng


@pytest.mark.parametrize("degrees", [5, 30, 45, 90, 180, 360])
def test_degrees_are_named_with_what_they_are_in_radians(degrees):
    expected = rf"^Approach\.angle: got {degrees}\.0, expected radians, at most pi: {degrees} degrees are "
    with pytest.raises(ng.InputError, match=expected + f"{np.deg2rad(degrees):.4g}".replace(".", r"\.") + "$"):
        ng.Approach([0, 0, -1], degrees)


def test_an_angle_that_is_only_too_large_is_not_called_degrees():
    with pytest.raises(ng.InputError, match=r"expected radians, at most pi$"):
        ng.Approach([0, 0, -1], 3.5)
    assert ng.Approach([0, 0, -1], np.pi).angle == np.pi


def test_jaws_and_ellipsoid_tips():
    with pytest.raises(ng.InputError, match=r"^ParallelJaw\.tilt: .* less than a right angle: 15 degrees are 0\.2618$"):
        ng.ParallelJaw(0.1, tilt=15)
    with pytest.raises(ng.InputError, match=r"^EllipsoidTip\.angle: .*: 60 degrees are 1\.047$"):
        ng.EllipsoidTip([0.01] * 3, angle=60.0)


@pytest.mark.parametrize(
    ("make", "field"),
    [
        (lambda: ng.ParallelJaw(80), "ParallelJaw.opening"),
        (lambda: ng.Fingertips(3, 8), "Fingertips.radius"),
        (lambda: ng.Fingertips(3, spread=50), "Fingertips.spread"),
        (lambda: ng.Fingertips(3, reach=120), "Fingertips.reach"),
    ],
)
def test_millimetres_of_hands_are_named(make, field):
    with pytest.raises(
        ng.InputError, match=rf"^{field}: got \d+ m, expected metres, at most 10?: (\d+) mm are 0\.\d+$"
    ):
        make()
