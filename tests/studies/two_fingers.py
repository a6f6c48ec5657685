"""Two-finger hand with three joints each and spherical links, with independent numpy kinematics."""

import numpy as np
from scipy.optimize import root

import nlpgrasp as ng

BASES = {"a": (0.0, 0.05), "b": (0.0, -0.05)}  # x and y of the fingers' first joints, palm frame
LENGTHS = (0.02, 0.04, 0.04)  # from joint to joint and to the fingertip
TIP = 0.006
DOWN = np.array([0.0, 1.0, 0.0, 0.0])  # the palm's z axis points down
PALM_BALL = 0.012


def urdf(ball=0.004, lower=(-1.0, -1.5, -2.5), upper=(1.0, 1.5, 2.5)):
    """The hand's description: a turn to the side, about x, and two bends about y."""
    links = [f'<link name="palm">{_ball(PALM_BALL)}</link>']
    for name, (x, y) in BASES.items():
        before, origin = "palm", f"{x} {y} 0"
        for i, axis in enumerate(("1 0 0", "0 1 0", "0 1 0")):
            link = f"{name}{i}"
            links.append(
                f'<link name="{link}">{_ball(ball, LENGTHS[i] / 2.0)}</link>'
                f'<joint name="{link}_joint" type="revolute"><parent link="{before}"/><child link="{link}"/>'
                f'<origin xyz="{origin}"/><axis xyz="{axis}"/>'
                f'<limit lower="{lower[i]}" upper="{upper[i]}" effort="1" velocity="1"/></joint>'
            )
            before, origin = link, f"0 0 {LENGTHS[i]}"
        links.append(
            f'<link name="{name}_tip">{_ball(TIP)}</link>'
            f'<joint name="{name}_end" type="fixed"><parent link="{before}"/><child link="{name}_tip"/>'
            f'<origin xyz="{origin}"/></joint>'
        )
    return f'<robot name="two">{"".join(links)}</robot>'


def _ball(radius, height=0.0):
    return f'<collision><origin xyz="0 0 {height}"/><geometry><sphere radius="{radius}"/></geometry></collision>'


def two_fingers(folder, **options):
    path = folder / "two.urdf"
    path.write_text(urdf(**options))
    return ng.URDFHand.load(path, {"a_tip": TIP, "b_tip": TIP})


def chain(name, q):
    """Centres of a finger's balls, (4, 3), palm frame: three links, then the tip."""
    place, turn = np.array([*BASES[name], 0.0]), np.eye(3)
    points = []
    for i, angle in enumerate(q):
        c, s = np.cos(angle), np.sin(angle)
        turn = turn @ np.array([[[1, 0, 0], [0, c, -s], [0, s, c]], [[c, 0, s], [0, 1, 0], [-s, 0, c]]][min(i, 1)])
        points.append(place + turn @ [0.0, 0.0, LENGTHS[i] / 2.0])
        place = place + turn @ [0.0, 0.0, LENGTHS[i]]
    return np.array([*points, place])


def in_body(points, position):
    """Points of a palm that looks down, in the body's frame."""
    return points * [1.0, -1.0, -1.0] + position


def inverse(name, target, position, start):
    """The joints nearest to others that put a fingertip's centre at a point of the body's frame."""
    solution = root(lambda q: 1e3 * (in_body(chain(name, q), position)[-1] - target), start, tol=1e-13)
    assert np.linalg.norm(solution.fun) < 1e-7, target
    return solution.x


def box_distance(points, half):
    """The distance of points outside a box from it, the least coordinate's inside."""
    beyond = np.abs(points) - half
    return np.linalg.norm(np.maximum(beyond, 0.0), axis=-1) + np.minimum(np.max(beyond, axis=-1), 0.0)
