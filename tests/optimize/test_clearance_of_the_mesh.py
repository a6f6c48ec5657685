"""Final step on a mesh: clearance of links from the mesh itself, not only from its smoothed surface."""

import numpy as np
import pytest
import trimesh

import nlpgrasp as ng
from nlpgrasp.optimize.compiled_problem import CompiledProblem
from tests.hands.urdf import four_finger_hand

STEP = "on the program"


def problem():
    body = ng.Mesh(trimesh.creation.capsule(height=0.05, radius=0.02, count=[16, 16]))
    task = ng.TaskEllipsoid([1.0, 1.0, 1.0, 0.04, 0.04, 0.04])
    return ng.GraspProblem(body, ng.FrictionContact(0.7), task, hand=four_finger_hand(clearance=0.002))


@pytest.mark.slow
def test_more_clearance_moves_the_limits_of_these_rows_alone():
    compiled = CompiledProblem(problem(), ng.SolveOptions(workers=1))
    rows = compiled.rows.clearances
    more = np.zeros(len(compiled.rows.named))
    more[rows[3]] = 1e-3
    programs = [b.cutting_planes.functions.program for b in (compiled, compiled.with_clearance(more))]
    low, high = (np.array([program.limits[end] for program in programs]) for end in (0, 1))
    changed = np.flatnonzero(low[1] != low[0])
    assert changed.tolist() == [programs[0].placement.start + rows[3]]
    scale = compiled.rows.named[rows[3]].scale
    assert low[1, changed[0]] - low[0, changed[0]] == pytest.approx(1e-3 / scale)
    np.testing.assert_array_equal(high[1], high[0])


@pytest.mark.slow
def test_the_end_keeps_clearances_of_the_mesh():
    solution = ng.solve(problem(), 1, 0, ng.SolveOptions(workers=1, global_bound=False))
    assert STEP in solution.winner.message, solution.kkt.reason
    own = [row for row in solution.constraints if row.kind == "clearance from the body"]
    assert own
    assert min(row.value - row.lower for row in own) >= -1e-4 * problem().body.size
