"""Grasps, bodies and contacts that several tests use."""

import casadi as ca
import numpy as np

import nlpgrasp as ng

BODIES = {
    "sphere": ng.Sphere(0.03),
    "ellipsoid": ng.Ellipsoid([2.0, 1.0, 1.0]),
    "cylinder": ng.Cylinder(0.5, 2.0),
    "box": ng.Box([1.0, 2.0, 3.0]),
    "prism": ng.Prism([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]], 0.5),
    "superquadric": ng.Superquadric([1.0, 0.5, 0.25], [0.4, 0.8]),
    "torus": ng.Torus(1.0, 0.3),
    "implicit": ng.Implicit(lambda p: ca.sumsqr(p) - 1.0 + 0.2 * p[0] ** 4, [[-1.2] * 3, [1.2] * 3]),
    "polygon": ng.Polygon([[-1.0, -1.0], [1.0, -1.0], [0.3, 0.2], [0.0, 1.0]]),
    "planar_implicit": ng.PlanarImplicit(lambda p: p[0] ** 2 + 2.0 * p[1] ** 2 - 1.0, [[-1.1, -1.0], [1.1, 1.0]]),
}

CONTACTS = {
    "point": ng.PointContact(),
    "friction": ng.FrictionContact(0.5),
    "soft box": ng.SoftContact(0.6, 0.2),
    "soft elliptic": ng.SoftContact(0.6, 0.2, "elliptic"),
    "line": ng.LineContact(0.4, direction=[1.0, 0.3, 0.2]),
    "rough line": ng.LineContact(0.4, friction=0.5, direction=[1.0, 0.3, 0.2], model="box"),
    "disc": ng.PlaneContact(radius=0.2),
    "rough disc": ng.PlaneContact(radius=0.2, friction=0.5, model="box"),
    "rough rectangle": ng.PlaneContact(extents=[0.4, 0.2], friction=0.5, direction=[1.0, 0.3, 0.2], model="box"),
    "bilateral": ng.BilateralContact(ng.FrictionContact(0.5)),
}
PADS = {  # whose force domain is that of friction contacts at several points
    "coulomb line": ng.LineContact(0.4, friction=0.5, direction=[1.0, 0.3, 0.2]),
    "coulomb rectangle": ng.PlaneContact(extents=[0.4, 0.2], friction=0.5, direction=[1.0, 0.3, 0.2]),
}
EVERY = {**CONTACTS, **PADS}


def ellipsoid_grasp(rng, k=4, friction=0.5, axes=(2.0, 1.0, 1.0)):
    """Return k random contacts on an ellipsoid."""
    a = np.array(axes)
    u = rng.standard_normal((k, 3))
    points = a * u / np.linalg.norm(u, axis=1, keepdims=True)
    inward = -points / a**2
    inward /= np.linalg.norm(inward, axis=1, keepdims=True)
    return ng.Grasp(points, inward, ng.FrictionContact(friction))


def closed_ellipsoid_grasp(rng, k=4, friction=0.5):
    """Return random contacts on an ellipsoid that are force-closed by a clear margin."""
    task = ng.TaskEllipsoid([1.0] * 6)
    for _ in range(1000):
        grasp = ellipsoid_grasp(rng, k, friction)
        if ng.mu(grasp, task, rtol=0.5).lower > 0.02:
            return grasp
    raise AssertionError("no force-closed grasp among 1000 random ones")


def random_rotation(rng, size=3):
    q = np.linalg.qr(rng.standard_normal((size, size)))[0]
    return q * np.sign(np.linalg.det(q)) if size % 2 else q @ np.diag([np.sign(np.linalg.det(q)), *[1.0] * (size - 1)])


def square_pair(name):
    """Return contacts of the pairs I to IV of Example 3-10 on a square of side 2."""
    midpoints = {
        "bottom": ([0, -1], [0, 1]),
        "top": ([0, 1], [0, -1]),
        "right": ([1, 0], [-1, 0]),
        "left": ([-1, 0], [1, 0]),
    }
    pairs = {"I": ("bottom", "top"), "II": ("right", "left"), "III": ("bottom", "left"), "IV": ("top", "right")}
    points, normals = zip(*(midpoints[side] for side in pairs[name]), strict=True)
    return points, normals
