"""The stated grip force in MuJoCo: pads as boxes on coupled slides hold the task's wrenches, and lose them at half."""

import mujoco
import numpy as np
import pytest

import nlpgrasp as ng
from nlpgrasp.quality.least_grip import least_grip

HALF, FRICTION, MASS = 0.02, 0.5, 0.4  # metres: half a cube; the pads' friction; kilograms
PAD = (0.02, 0.012)  # metres: length along z, width along y
SECONDS, HELD, LOST = 1.0, 1e-3, 5e-3  # metres: motion that counts as held, and as lost

SCENE = """
<mujoco>
  <option timestep="0.0005" gravity="0 0 0" cone="elliptic" impratio="20" noslip_iterations="10"/>
  <worldbody>
    <body name="part">
      <freejoint/>
      <geom type="box" size="{half} {half} {half}" mass="{mass}" friction="{friction} 0 0" condim="3"
            solref="0.002 1" solimp="0.99 0.999 0.0001"/>
    </body>
    <body name="left" pos="{left} 0 0">
      <joint name="left" type="slide" axis="1 0 0" damping="20"/>
      <geom type="box" size="0.005 {width} {length}" mass="0.2" friction="{friction} 0 0" condim="3"
            solref="0.002 1" solimp="0.99 0.999 0.0001"/>
    </body>
    <body name="right" pos="{right} 0 0">
      <joint name="right" type="slide" axis="-1 0 0" damping="20"/>
      <geom type="box" size="0.005 {width} {length}" mass="0.2" friction="{friction} 0 0" condim="3"
            solref="0.002 1" solimp="0.99 0.999 0.0001"/>
    </body>
  </worldbody>
  <equality><joint joint1="left" joint2="right" solref="0.002 1" solimp="0.99 0.999 0.0001"/></equality>
  <actuator><motor joint="left" gear="1"/><motor joint="right" gear="1"/></actuator>
</mujoco>
"""


def motion(force, wrench):
    """Return how far the part moves while the jaws press with a force and a wrench is exerted, metres.

    Parameters
    ----------
    wrench : (6,) array
        That the pads exert: its opposite acts on the part.
    """
    text = SCENE.format(
        half=HALF,
        mass=MASS,
        friction=FRICTION,
        left=-HALF - 0.005,
        right=HALF + 0.005,
        width=PAD[1] / 2,
        length=PAD[0] / 2,
    )
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    data.ctrl[:] = force
    steps = round(SECONDS / model.opt.timestep)
    for step in range(steps):
        data.xfrc_applied[1] = -np.asarray(wrench) * min(1.0, 4.0 * step / steps)  # after a quarter in full
        mujoco.mj_step(model, data)
    turn = 2.0 * np.arccos(min(abs(float(data.qpos[3])), 1.0))
    return float(np.linalg.norm(data.qpos[:3])) + HALF * turn


@pytest.mark.slow
@pytest.mark.parametrize("at", [(0.0, 0.0), (0.004, -0.006)])
def test_the_stated_force_holds_and_half_of_it_does_not(at):
    """Weight, and pushes of 10 N from all sides, on a cube; the pads in its middle or beside it.

    Beside it the corners of the pads share a moment. That some friction forces balance it is necessary; those that the
    simulation finds let the part creep by 0.3 to 2 mm at 1.05 times the least force, and by less than a third of a
    millimetre with a safety factor of 1.2.
    """
    model = ng.PlaneContact(extents=PAD, friction=FRICTION, direction=(0.0, 0.0, 1.0))
    points = np.array([[-HALF, *at], [HALF, *at]])
    grasp = ng.Grasp(points, [[1, 0, 0], [-1, 0, 0]], [model] * 2, [0.0, 0.0, 0.0])
    weight = np.array([0.0, 0.0, 9.81 * MASS, 0.0, 0.0, 0.0])
    pushes = [weight + 10.0 * np.concatenate([d, np.zeros(3)]) for d in (*np.eye(3), *-np.eye(3))]
    task = ng.TaskPolytope(pushes)
    force = least_grip(grasp, task).upper
    shift = np.array([0.0, *at])  # the part is displaced instead of the pads

    def about_pads(w):
        return np.concatenate([w[:3], w[3:] - np.cross(shift, w[:3])])

    margin = 1.2 if any(at) else 1.0
    assert max(motion(margin * force, about_pads(w)) for w in pushes) <= HELD
    assert max(motion(0.5 * force, about_pads(w)) for w in pushes) >= LOST
