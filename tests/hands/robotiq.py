"""URDF of the Robotiq 2F-85 with the joints of the ROS-Industrial description and the meshes of robosuite."""

import math

from tests.hands.robots import GRIPPERS, model

MESHES = f"{GRIPPERS}/meshes/robotiq_85_gripper"
BASE, SMALL, PAD = "robotiq_arg2f_base_link", '<sphere radius="0.002"/>', '<box size="0.022 0.00635 0.0375"/>'


def robotiq_2f85(path, meshes=False):
    """Write the gripper's URDF; its pads are boxes, its other links small spheres, or meshes or else a skip."""
    text, turned = _link(BASE, _mesh(f"{BASE}.stl", 1.0) if meshes else SMALL), f"0 0 {math.pi}"
    for side, y, rpy in (("left", -1.0, turned), ("right", 1.0, "0 0 0")):
        outer, inner, knuckle = (f"{side}_{part}" for part in ("outer_finger", "inner_finger", "inner_knuckle"))
        driver = ("finger_joint", None) if side == "left" else ("right_outer_knuckle_joint", 1)
        rest = [
            (*driver, BASE, f"{side}_outer_knuckle", f"0 {0.0306011 * y} 0.054904", rpy, "revolute"),
            (f"{outer}_joint", None, f"{side}_outer_knuckle", outer, "0 0.0315 -0.0041", "0 0 0", "fixed"),
            (f"{inner}_joint", -1, outer, inner, "0 0.0061 0.0471", "0 0 0", "revolute"),
            (f"{inner}_pad_joint", None, inner, f"{inner}_pad", "0 -0.0220203446692936 0.03242", "0 0 0", "fixed"),
            (f"{knuckle}_joint", 1, BASE, knuckle, f"0 {0.0127 * y} 0.06142", rpy, "revolute"),
        ]
        for name, mimic, parent, link, xyz, turn, kind in rest:
            shape = SMALL
            if link.endswith("pad"):
                shape = PAD
            elif meshes:
                shape = _mesh(f"robotiq_arg2f_85_{link.removeprefix(f'{side}_')}.stl", 0.001)
            follow = "" if mimic is None else f'<mimic joint="finger_joint" multiplier="{mimic}"/>'
            text += (
                f'{_link(link, shape)}<joint name="{name}" type="{kind}"><parent link="{parent}"/>'
                f'<child link="{link}"/><origin xyz="{xyz}" rpy="{turn}"/><axis xyz="1 0 0"/>'
                f'<limit lower="0" upper="0.81" effort="1000"/>{follow}</joint>'
            )
    path.write_text(f"<robot name='r'>{text}</robot>")
    return path


def _mesh(name, scale):
    return f'<mesh filename="{model(f"{MESHES}/{name}").resolve()}" scale="{scale} {scale} {scale}"/>'


def _link(name, shape):
    return f'<link name="{name}"><collision><geometry>{shape}</geometry></collision></link>'
