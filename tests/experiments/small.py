"""Small experiment: a planar square, solved in a tenth of a second."""

from pathlib import Path

import nlpgrasp as ng

QUICK = ng.SolveOptions(rounds=2, rtol=0.1, final_rtol=0.05, global_bound=False)
SCRIPT = Path(__file__).with_name("script_small.py")


def base():
    square = ng.Polygon([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    task = ng.TaskEllipsoid([1, 1, 1], center=[0, 0.5, 0])
    return ng.GraspProblem(square, [ng.FrictionContact(0.5)] * 2, task, name="square")


def experiment(variations=None, **settings):
    settings = {"seeds": range(2), "starts": 1, "options": QUICK, **settings}
    return ng.Experiment(
        base(), {"rough": {"friction": 0.8}, "smooth": {}} if variations is None else variations, **settings
    )
