"""Triangulation of fingertip patches: on the patch, outward, with the area of the patch."""

import numpy as np
import pytest

import nlpgrasp as ng

FINE = 96
FRAME = {"offset": [0.01, -0.02, 0.03], "rpy": [0.3, -0.5, 0.8]}


def areas(tip):
    shape = tip.surface(FINE)
    corners = shape.vertices[shape.faces]
    return corners.mean(axis=1), np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]) / 2.0


@pytest.mark.parametrize(
    ("tip", "area"),
    [
        (ng.SphereTip(0.01, FRAME["offset"]), 4 * np.pi * 0.01**2),
        (ng.EllipsoidTip([0.01, 0.01, 0.01], **FRAME, facing=[0, 1, 0], angle=np.pi / 3), np.pi * 0.01**2),
        (ng.CylinderTip(0.01, [0, 0, 0], [0.03, 0.04, 0]), 2 * np.pi * 0.01 * 0.05),
        (ng.CapsuleTip(0.01, [0, 0, 0], [0.03, 0.04, 0]), 2 * np.pi * 0.01 * (0.05 + 2 * 0.01)),
        (ng.FlatTip([0.02, 0.03], **FRAME), 0.02 * 0.03),
    ],
    ids=["sphere", "ellipsoid", "cylinder", "capsule", "flat"],
)
def test_area_and_direction(tip, area):
    middles, normals = areas(tip)
    assert np.linalg.norm(normals, axis=1).sum() == pytest.approx(area, rel=3e-3)
    assert np.abs(tip.beyond(tip.surface(FINE).vertices)).max() < 1e-9
    outside = tip.beyond(middles + 1e-3 * normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-30))
    solid = np.linalg.norm(normals, axis=1) > 1e-12
    assert np.all(outside[solid] > 5e-4)


def test_a_patch_of_an_ellipsoid_has_the_normals_it_says():
    axes, angle = np.array([0.01, 0.02, 0.005]), 0.7
    tip = ng.EllipsoidTip(axes, facing=[0, 0, 1], angle=angle)
    normals = tip.surface(FINE).vertices / axes**2
    cosines = normals[:, 2] / np.linalg.norm(normals, axis=1)
    assert cosines.min() == pytest.approx(np.cos(angle), abs=1e-9)
