"""A block between the pads of a gripper, which several tests look at."""

import nlpgrasp as ng
from tests.once import GRASP, solve_once

PART = ng.Box([0.08, 0.04, 0.06])
GRIPPER = ng.ParallelJaw(
    0.11, pad=(0.02, 0.012), finger=(0.06, 0.012, 0.014), closing_axis="y", tcp=(0.0, 0.001, 0.15), max_force=120.0
)


def held_block():
    """Return the solution of a lift of the block off a table, with three grasps."""
    task = ng.lift([0.0, 0.0, 0.0], 0.5) + ng.disturbance(2.0, 0.02)
    table = ng.Table.under(PART, 0.001)
    problem = ng.GraspProblem(PART, ng.SoftContact(0.6, 0.005), task, hand=GRIPPER, constraints=[table], name="block")
    return solve_once(problem, starts=1, options=GRASP, keep=3)
