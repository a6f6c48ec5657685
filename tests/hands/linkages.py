"""A gripper of two four-bar fingers, whose pads stay parallel, as MJCF text, and MuJoCo's view of its equalities."""

from pathlib import Path

import mujoco
import numpy as np

FINGER = """
    <body name="{side}_crank" pos="{x} 0 0.01"><joint name="{side}_crank" axis="0 1 0" range="-0.9 0.9"/>
      <geom type="capsule" size="0.004" fromto="0 0 0 0 0 0.05"/>
      <body name="{side}_pad" pos="0 0 0.05"><joint name="{side}_pad" axis="0 1 0" range="-0.9 0.9"/>
        <geom type="box" size="0.004 0.01 0.02" pos="0 0 0.025"/><site name="{side}_end" pos="{out} 0 0"/></body>
    </body>
    <body name="{side}_rocker" pos="{far} 0 0.01"><joint name="{side}_rocker" axis="0 1 0" range="-0.9 0.9"/>
      <geom type="capsule" size="0.004" fromto="0 0 0.01 0 0 0.04"/><site name="{side}_top" pos="0 0 0.05"/></body>"""
CONNECTS = '<connect body1="{0}_pad" body2="{0}_rocker" anchor="{1} 0 0"/>'
SITES = '<connect site1="{0}_end" site2="{0}_top"/>'
TOGETHER = '<joint joint1="left_crank" joint2="right_crank" polycoef="0 -1 0 0 0"/>'
MOTOR = '<actuator><position joint="right_crank" kp="20" forcerange="-5 5"/></actuator>'


def fingers(connect: str = CONNECTS) -> str:
    """Equalities that close both fingers."""
    return connect.format("left", "-0.02") + connect.format("right", "0.02")


def four_bar(equalities: str = fingers() + TOGETHER, more: str = MOTOR, palm: str = "palm") -> str:
    """MJCF text of the gripper."""
    sides = FINGER.format(side="left", x=-0.035, far=-0.055, out=-0.02)
    sides += FINGER.format(side="right", x=0.035, far=0.055, out=0.02)
    inside = f'<geom type="box" size="0.07 0.02 0.01"/>{sides}'
    body = inside if palm == "world" else f'<body name="{palm}">{inside}</body>'
    return (
        f'<mujoco model="four_bar"><compiler angle="radian"/><worldbody>{body}</worldbody>'
        f"<equality>{equalities}</equality>{more}</mujoco>"
    )


def errors(path: Path, positions: dict[str, float]) -> np.ndarray:
    """What MuJoCo's equalities are off, metres and radians, at joint positions."""
    model = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(model)
    for name, value in positions.items():
        data.qpos[model.joint(name).qposadr[0]] = value
    mujoco.mj_forward(model, data)
    return np.asarray(data.efc_pos[: data.ne])
