"""Hands beside an obstacle that is a mesh: solved, its clearance kept by the links, and verified from the file."""

import pytest
import trimesh

import nlpgrasp as ng
from tests.hands.urdf import four_finger_hand


@pytest.mark.slow
@pytest.mark.parametrize("place", [0.04, 0.055])
def test_links_keep_their_clearance_from_a_wall(tmp_path, place):
    wall = ng.Mesh(trimesh.creation.box([0.2, 0.02, 0.2]))
    wall_file = tmp_path / "wall.stl"
    wall.mesh.export(wall_file)
    obstacle = ng.Obstacle(ng.Mesh.load(wall_file, unit="m"), 0.003, position=[0.0, place, 0.0], name="wall")
    task = ng.TaskEllipsoid([1.0, 1.0, 1.0, 0.05, 0.05, 0.05])
    body, hand = ng.Box([0.08, 0.04, 0.04]), four_finger_hand(clearance=2e-3)
    problem = ng.GraspProblem(body, ng.FrictionContact(0.7), task, hand=hand, constraints=[obstacle])
    solution = ng.solve(problem, 2, options=ng.SolveOptions(workers=1, global_bound=False))
    assert solution.status is ng.Status.SOLVED
    rows = [row for row in solution.constraints if row.name.startswith("wall, ") and not row.fingers]
    assert {row.name for row in rows} == {f"wall, {link}" for link, shapes in hand.robot.shapes.items() if shapes}
    assert min(row.value for row in rows) > 0.003 - 1e-6
    assert {row.lower for row in rows} == {0.003}
    solution.save(tmp_path / "grasp.json")
    checks = ng.verify(tmp_path / "grasp.json").checks
    assert not [check for check in checks if check.made and not check.passed]
