"""Pictures of fitted ellipsoids, and refused arguments."""

import pytest
from matplotlib import image

import nlpgrasp as ng
from nlpgrasp.tasks.task_ellipsoid import fit_ellipsoid


@pytest.mark.slow
@pytest.mark.parametrize("d", [3, 6])
def test_a_fit_is_drawn(d, tmp_path, rng):
    wrenches = rng.standard_normal((500, d))
    fit = fit_ellipsoid(wrenches, outliers=0.02)
    path = ng.draw_fit(fit, wrenches, tmp_path / "fit.png")
    pixels = image.imread(path)
    assert min(pixels.shape[:2]) >= 500
    green = (pixels[..., 1] > 0.55) & (pixels[..., 0] < 0.3)  # the ellipsoid's outlines
    red = (pixels[..., 0] > 0.7) & (pixels[..., 1] < 0.3)  # wrenches outside
    assert green.sum() > 500
    assert red.sum() > 10


def test_paths_that_cannot_be_written(tmp_path, rng):
    wrenches = rng.standard_normal((50, 3))
    fit = fit_ellipsoid(wrenches)
    with pytest.raises(ng.InputError, match="a file that can be written"):
        ng.draw_fit(fit, wrenches, tmp_path / "nowhere" / "fit.png")
    with pytest.raises(ng.InputError, match="wrenches"):
        ng.draw_fit(fit, wrenches[:3], tmp_path / "fit.png")
