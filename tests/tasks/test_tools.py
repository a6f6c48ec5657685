"""Tool tasks: containment of the wrenches they are constructed for."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import nlpgrasp as ng

TIP = np.array([0.0, 0.02, -0.1])
DOWN = np.array([0.0, 0.0, -1.0])


def reach(task, direction):
    """Return the largest and least of a task's wrenches along a direction of wrench space."""
    y = np.array([direction, np.negative(direction)], float)
    values = task.support(y)[0]
    return values[0], -values[1]


def force_at(point, force):
    return np.concatenate([force, np.cross(point, force)])


def inside(task, wrench):
    """Return whether a wrench is in the task: of an ellipsoid by its axes, of others by supports in many directions."""
    if isinstance(task, ng.TaskEllipsoid):
        local = np.linalg.lstsq(task.axes.T, wrench - task.center, rcond=None)[0]
        off = np.linalg.norm(local @ task.axes + task.center - wrench)
        return bool(off <= 1e-9 and np.linalg.norm(local) <= 1.0 + 1e-9)
    y = np.random.default_rng(0).standard_normal((4000, 6)) * [1, 1, 1, 30, 30, 30]
    return bool(np.all(y @ wrench <= task.support(y)[0] + 1e-9))


def test_press():
    task = ng.press(TIP, 2.0 * DOWN, 10.0, sideways=0.2)
    assert reach(task, [0, 0, 1, 0, 0, 0]) == pytest.approx((0.0, -10.0))
    assert reach(task, [1, 0, 0, 0, 0, 0]) == pytest.approx((2.0, -2.0))
    assert inside(task, force_at(TIP, 10.0 * DOWN))
    assert not inside(task, force_at(TIP, 10.5 * DOWN))
    assert not inside(task, force_at(TIP + np.array([0.01, 0, 0]), 5.0 * DOWN))  # at another point


def test_turn():
    assert reach(ng.turn([0, 0, 3], 0.4), [0, 0, 0, 0, 0, 1]) == pytest.approx((0.4, -0.4))
    assert reach(ng.turn([0, 0, 3], 0.4, one_way=True), [0, 0, 0, 0, 0, 1]) == pytest.approx((0.4, 0.0))


def test_cut():
    task = ng.cut(TIP, DOWN, [1.0, 0.0, 1.0], 8.0, sideways=0.1)
    assert reach(task, [0, 0, -1, 0, 0, 0]) == pytest.approx((8.0, 0.0))
    assert reach(task, [1, 0, 0, 0, 0, 0]) == pytest.approx((8.0, -8.0))
    assert reach(task, [0, 1, 0, 0, 0, 0]) == pytest.approx((0.8, -0.8))


def test_write_is_example_3_5():
    """At the lead: torque about the two axes across the pencil, force along it one way."""
    task = ng.write(TIP, [1.0, 0.0, 0.0], 3.0, 0.05).at(TIP)
    assert reach(task, [1, 0, 0, 0, 0, 0]) == pytest.approx((3.0, 0.0))
    for across in ([0, 0, 0, 0, 1, 0], [0, 0, 0, 0, 0, 1]):
        assert reach(task, across) == pytest.approx((0.05, -0.05))
    assert reach(task, [0, 0, 0, 1, 0, 0]) == pytest.approx((0.005, -0.005))


def test_insert():
    task = ng.insert(TIP, DOWN, 20.0, jam=5.0, depth=0.02).at(TIP)
    assert reach(task, [0, 0, -1, 0, 0, 0]) == pytest.approx((20.0, 0.0))
    assert reach(task, [1, 0, 0, 0, 0, 0]) == pytest.approx((5.0, -5.0))
    assert reach(task, [0, 0, 0, 1, 0, 0]) == pytest.approx((0.1, -0.1))


def test_lift_and_gravity():
    task = ng.lift(TIP, 2.0, acceleration=1.0)
    assert reach(task, [0, 0, 1, 0, 0, 0]) == pytest.approx((2 * 10.81, 2 * 8.81))
    any_way = ng.gravity(TIP, 2.0)
    for direction in np.random.default_rng(0).standard_normal((20, 3)):
        unit = direction / np.linalg.norm(direction)
        assert inside(any_way, force_at(TIP, 2.0 * 9.81 * unit))
        assert not inside(any_way, force_at(TIP, 2.1 * 9.81 * unit))


def test_pour_holds_every_tilt():
    """The weight's opposite, in the body's frame, while the body turns about x: and little more than that."""
    task = ng.pour(TIP, 0.5, [1.0, 0.0, 0.0], np.pi / 2)
    for t in np.linspace(0.0, np.pi / 2, 40):
        force = 0.5 * 9.81 * np.array([0.0, np.sin(t), np.cos(t)])
        assert inside(task, force_at(TIP, force))
        assert not inside(task, force_at(TIP, 1.01 * force))
    assert not inside(task, force_at(TIP, 0.5 * 9.81 * np.array([0.0, -np.sin(0.1), np.cos(0.1)])))


@pytest.mark.parametrize("axis", [[1.0, 1.0, 1.0], [0.3, -0.2, 1.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
@pytest.mark.parametrize("angle", [0.5, 1.6, np.pi])
def test_pour_encloses_the_arc_about_any_axis(axis, angle):
    task = ng.pour(TIP, 1.0, axis, angle)
    unit = np.array(axis) / np.linalg.norm(axis)
    y = np.random.default_rng(1).standard_normal((3000, 6)) * [1, 1, 1, 10, 10, 10]
    for t in np.linspace(0.0, angle, 50):
        up = Rotation.from_rotvec(-t * unit).apply([0.0, 0.0, 9.81])
        assert np.all(y @ force_at(TIP, up) <= task.support(y)[0] + 1e-9)


def test_disturbance():
    task = ng.disturbance(3.0, 0.1, TIP)
    assert inside(task, force_at(TIP, [0, 3.0, 0]))
    assert inside(task, np.array([0, 0, 0, 0.1, 0, 0]))
    assert not inside(task, np.array([0, 0, 0, 0.101, 0, 0]))


def test_tools_add_up():
    task = ng.press(TIP, DOWN, 10.0) + ng.turn(DOWN, 0.3) + ng.gravity([0, 0, 0], 0.1)
    assert task.torque_origin.tolist() == [0.0, 0.0, 0.0]
    assert inside(task, force_at(TIP, 10.0 * DOWN) + np.array([0, 0.981, 0, 0, 0, 0.3]))


def test_collisions_are_example_3_4():
    """Pushes along both senses of the axes with likelihoods r_i: semi-axes r_i; one without its opposite: a centre."""
    ratios = {"z": 5.0, "x": 2.0, "y": 1.5}
    events = []
    for axis, r in ratios.items():
        for sign in (1.0, -1.0):
            direction = sign * np.eye(3)["xyz".index(axis)]
            events.append(ng.CollisionEvent([0, 0, 0], direction, r))
    with pytest.warns(UserWarning, match="m_x"):
        task = ng.collision_task(events, force=2.0)
    for axis, r in ratios.items():
        direction = np.eye(6)["xyz".index(axis)]
        assert reach(task, direction) == pytest.approx((2.0 * r, -2.0 * r), rel=1e-5)
    with pytest.warns(UserWarning, match="m_x"):
        one_way = ng.collision_task(events[1:], force=2.0)  # nothing pushes the body up: fingers never press down
    assert reach(one_way, [0, 0, 1, 0, 0, 0])[0] == pytest.approx(10.0, rel=1e-5)
    assert one_way.center[2] > 1.0


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: ng.press(TIP, [0, 0, 0], 1.0), "direction that is not zero"),
        (lambda: ng.press(TIP, DOWN, -1.0), "greater than 0"),
        (lambda: ng.press([0, 0], DOWN, 1.0), "point"),
        (lambda: ng.cut(TIP, DOWN, DOWN, 1.0), "across"),
        (lambda: ng.pour(TIP, 1.0, [1, 0, 0], 4.0), "at most pi"),
        (lambda: ng.disturbance(0.0, 0.0), "greater than zero"),
        (lambda: ng.CollisionEvent(TIP, [0, 0, 0]), "direction"),
        (lambda: ng.CollisionEvent(TIP, DOWN, 0.0), "likelihood"),
        (lambda: ng.collision_task([]), "at least one CollisionEvent"),
        (lambda: ng.collision_task(5), "at least one CollisionEvent"),
        (lambda: ng.turn([0, 0, 1], 1.0, one_way="a"), "True or False"),
        (lambda: ng.lift(TIP, 0.0), "mass"),
    ],
)
def test_bad_input_is_one_sentence(call, message):
    with pytest.raises(ng.InputError, match=message) as caught:
        call()
    assert "\n" not in str(caught.value)
