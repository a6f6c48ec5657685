"""Twists of motions (Section 2.1) against differences of poses, exponentials of a screw, and scipy's rotations."""

import numpy as np
import pytest
from scipy.linalg import expm, logm
from scipy.spatial.transform import Rotation

import nlpgrasp as ng

T = np.linspace(0.0, 2.0, 81)
SCREW = np.array([0.1, -0.2, 0.05, 0.3, 0.8, -0.5])  # v, w: metres a second, radians a second
START = np.eye(4)
START[:3, :3] = Rotation.from_rotvec([0.2, -0.4, 0.3]).as_matrix()
START[:3, 3] = [0.3, -0.1, 0.2]


def hat(twist):
    """Return the (4, 4) matrix of a twist (v, w)."""
    result = np.zeros((4, 4))
    result[:3, 3] = twist[:3]
    result[:3, :3] = [
        [0, -twist[5], twist[4]],
        [twist[5], 0, -twist[3]],
        [-twist[4], twist[3], 0],
    ]
    return result


def vee(matrix):
    """Return the twist (v, w) of a (4, 4) matrix."""
    return np.array([*matrix[:3, 3], matrix[2, 1], matrix[0, 2], matrix[1, 0]])


def wavy():
    """Return a motion that turns and moves unevenly, and its poses at any times, in closed form."""

    def poses(t):
        t = np.atleast_1d(t)
        angles = np.stack([0.9 * np.sin(1.3 * t), 0.7 * np.cos(t) - 0.2, 1.2 * t], axis=1)
        result = np.tile(np.eye(4), (len(t), 1, 1))
        result[:, :3, :3] = Rotation.from_euler("ZYX", angles).as_matrix()
        result[:, :3, 3] = np.stack([np.sin(t), 0.3 * t**2, np.cos(2.0 * t)], axis=1)
        return result, angles

    return ng.RigidMotion.of_poses(np.linspace(0.0, 2.0, 401), poses(np.linspace(0.0, 2.0, 401))[0]), poses


def test_a_screw_has_a_constant_twist():
    """g(t) = exp(t xi^) g(0): the spatial twist is xi, and the body twist that of g(0)^-1 xi^ g(0)."""
    motion = ng.RigidMotion.of_poses(T, [expm(t * hat(SCREW)) @ START for t in T])
    np.testing.assert_allclose(motion.spatial_twists()[3:-3], np.tile(SCREW, (75, 1)), atol=2e-6)
    body = vee(np.linalg.inv(START) @ hat(SCREW) @ START)
    np.testing.assert_allclose(motion.body_twists()[3:-3], np.tile(body, (75, 1)), atol=2e-6)


def test_twists_are_differences_of_poses():
    """g^-1 g' and g' g^-1, by the logarithm of the step between two poses near each other."""
    motion, poses = wavy()
    times, h = np.linspace(0.1, 1.9, 13), 1e-4
    earlier, current, following = (poses(times + s)[0] for s in (-h, 0.0, h))
    body = [vee(logm(np.linalg.inv(a) @ b).real) / (2 * h) for a, b in zip(earlier, following, strict=True)]
    spatial = [vee(logm(b @ np.linalg.inv(a)).real) / (2 * h) for a, b in zip(earlier, following, strict=True)]
    np.testing.assert_allclose(motion.body_twists(times), body, atol=1e-4)
    np.testing.assert_allclose(motion.spatial_twists(times), spatial, atol=1e-4)
    np.testing.assert_allclose(motion.poses(times), current, atol=1e-7)
    moving = (following[:, :3, 3] - earlier[:, :3, 3]) / (2 * h)
    turning = np.einsum("mij,mj->mi", current[:, :3, :3], np.array(body)[:, 3:])
    np.testing.assert_allclose(motion.twists(times), np.concatenate([moving, turning], axis=1), atol=1e-4)


def test_all_twists_are_the_same_where_the_frames_coincide():
    """At the paper's m, (2.1-1), and nowhere else."""
    motion = ng.RigidMotion.of_poses(T - 1.0, [expm((t - 1.0) * hat(SCREW)) for t in T])
    twists = [f([0.0])[0] for f in (motion.twists, motion.body_twists, motion.spatial_twists)]
    for twist in twists:
        np.testing.assert_allclose(twist, SCREW, atol=1e-6)
    elsewhere = [f([0.9])[0] for f in (motion.twists, motion.spatial_twists)]
    assert np.linalg.norm(elsewhere[0] - elsewhere[1]) > 0.1


def test_power_does_not_depend_on_the_frame():
    """(2.1-4): a force on the body does the work of its point's velocity, whichever twist it is paired with."""
    motion, poses = wavy()
    times, h = np.array([0.3, 1.1, 1.7]), 1e-5
    p, f = np.array([0.2, -0.3, 0.1]), np.array([1.0, 2.0, -0.5])  # of the body frame
    points = np.array([pose @ [*p, 1.0] for pose in poses(times)[0]])[:, :3]
    speed = (poses(times + h)[0] - poses(times - h)[0])[:, :3] @ [*p, 1.0] / (2 * h)
    world = poses(times)[0][:, :3, :3] @ f
    power = np.sum(speed * world, axis=1)
    body = np.array([*f, *np.cross(p, f)])
    np.testing.assert_allclose(motion.body_twists(times) @ body, power, atol=1e-4)
    about_inertial_origin = np.concatenate([world, np.cross(points, world)], axis=1)
    np.testing.assert_allclose(np.sum(motion.spatial_twists(times) * about_inertial_origin, axis=1), power, atol=1e-4)
    arm = points - poses(times)[0][:, :3, 3]
    about_body_origin = np.concatenate([world, np.cross(arm, world)], axis=1)
    np.testing.assert_allclose(np.sum(motion.twists(times) * about_body_origin, axis=1), power, atol=1e-4)


def test_euler_angles_and_their_rates():
    motion, poses = wavy()
    times, h = np.linspace(0.1, 1.9, 10), 1e-5
    angles = poses(times)[1]
    rates = (poses(times + h)[1] - poses(times - h)[1]) / (2 * h)
    np.testing.assert_allclose(motion.euler_angles(times), angles, atol=1e-6)
    np.testing.assert_allclose(motion.euler_rates(times), rates, atol=1e-4)
    np.testing.assert_allclose(ng.angular_velocity(angles, rates), motion.body_twists(times)[:, 3:], atol=1e-4)


def test_the_equations_after_2_1_2_are_along_the_bodys_axes():
    """By differences of scipy's rotations: R^T R' is what they give, R' R^T only where all angles are zero."""
    rng, h = np.random.default_rng(0), 1e-6
    angles, rates = rng.uniform(-1.4, 1.4, (20, 3)), rng.standard_normal((20, 3))
    following, earlier = (Rotation.from_euler("ZYX", angles + s * h * rates) for s in (1.0, -1.0))
    velocity = ng.angular_velocity(angles, rates)
    np.testing.assert_allclose(velocity, (earlier.inv() * following).as_rotvec() / (2 * h), atol=1e-8)
    inertial = (following * earlier.inv()).as_rotvec() / (2 * h)
    assert np.min(np.linalg.norm(inertial - velocity, axis=1)) > 0.01
    np.testing.assert_allclose(ng.angular_velocity([[0, 0, 0]], [[1.0, 2.0, 3.0]]), [[3.0, 2.0, 1.0]])


def test_no_coordinates_are_global():
    turns = Rotation.from_euler("ZYX", np.outer(np.linspace(0, 1, 5), [0.0, np.pi, 0.0]))
    motion = ng.RigidMotion(np.arange(5.0), np.zeros((5, 3)), turns.as_quat(scalar_first=True))
    np.testing.assert_allclose(motion.body_twists(), np.tile([0, 0, 0, 0, np.pi / 4, 0], (5, 1)), atol=1e-12)
    with pytest.raises(ng.InputError, match=r"at: got 2 s, with theta_2 at 90 degrees, expected times at which Euler"):
        motion.euler_rates()


POSES = np.tile(np.eye(4), (5, 1, 1))
MIRROR = np.diag([1.0, 1.0, -1.0, 1.0])
STILL = np.tile([1.0, 0.0, 0.0, 0.0], (5, 1))


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (
            lambda: ng.RigidMotion([0, 1, 1, 2, 3], np.zeros((5, 3)), STILL),
            r"times: got 1 s after 1 s at row 2, .*incr",
        ),
        (lambda: ng.RigidMotion([0, 1, 2, 1.5, 3], np.zeros((5, 3)), STILL), r"times: got 1.5 s after 2 s at row 3"),
        (lambda: ng.RigidMotion([0, 1, 2], np.zeros((3, 3)), STILL[:3]), "times: got 3 poses, expected at least 4"),
        (lambda: ng.RigidMotion(np.arange(5), np.zeros((5, 3)), 2 * STILL), "quaternions: got length 2 at row 0"),
        (lambda: ng.RigidMotion(np.arange(5), np.zeros((4, 3)), STILL), r"positions: got shape \(4, 3\)"),
        (lambda: ng.RigidMotion.of_poses(np.arange(5), [*POSES[:3], MIRROR, POSES[0]]), r"poses\[3\]: got .*rotation"),
        (lambda: ng.RigidMotion.of_poses(np.arange(5), 2 * POSES), r"poses\[0\]: got .* a rigid transform, \(4, 4\)"),
        (lambda: ng.RigidMotion.of_poses([0, 1], POSES[:2]), "poses: got 2 poses, expected at least 4"),
        (lambda: ng.RigidMotion.of_poses([0, 1, 1, 2, 3], POSES), "times: got 1 s after 1 s at row 2"),
        (
            lambda: ng.RigidMotion(np.arange(5), np.zeros((5, 3)), STILL).twists([4.5]),
            "at: got 4.5 s, expected times fr",
        ),
        (lambda: ng.angular_velocity(np.zeros((2, 3)), np.zeros((3, 3))), r"rates: got shape \(3, 3\)"),
    ],
)
def test_motions_that_make_no_sense_are_refused(make, message):
    with pytest.raises(ng.InputError, match=message):
        make()
