"""README's example: a box on a table, to be held by four round fingertips."""

from __future__ import annotations

import nlpgrasp as ng

STARTS = 4


def problem() -> ng.GraspProblem:
    """Return the problem that the script in README states."""
    return ng.GraspProblem(
        body=ng.Box([0.08, 0.04, 0.04]),
        contacts=[ng.FrictionContact(0.6)] * 4,
        hand=ng.Fingertips(4, radius=0.008),
        task=ng.TaskEllipsoid([5, 5, 10, 0.2, 0.2, 0.2]),
        constraints=[ng.Table(-0.02, clearance=0.01)],
    )
