"""Candidates of parallel jaws, compared with all pairs of a grid of contacts."""

import numpy as np
import pytest
import trimesh

import nlpgrasp as ng
from nlpgrasp.optimize.compiled_problem import FEASIBLE, CompiledProblem
from nlpgrasp.optimize.projection import fix_to_triangles
from nlpgrasp.optimize.propose import propose

LONG, WIDE, WALL, HIGH = 0.08, 0.04, 0.008, 0.06  # an angle, metres: a base plate, and a wall along its left end
CLEAR = 0.002  # above the table


@pytest.fixture(scope="module")
def angle():
    """The mesh: its outline in the plane y = 0 and again at y = WIDE."""
    outline = [[0, 0], [WALL, 0], [LONG, 0], [LONG, WALL], [WALL, WALL], [WALL, HIGH], [0, HIGH], [0, WALL]]
    front = np.array([[x, 0, z] for x, z in outline])
    n = len(front)
    caps = [[0, 1, 4], [0, 4, 7], [1, 2, 3], [1, 3, 4], [7, 4, 5], [7, 5, 6]]
    sides = [t for i in range(n) for j in [(i + 1) % n] for t in ([i, n + j, j], [i, n + i, n + j])]
    faces = [*caps, *([n + a, n + c, n + b] for a, b, c in caps), *sides]
    return ng.Mesh(trimesh.Trimesh(np.concatenate([front, front + np.array([0, WIDE, 0])]), faces))


def problem(body, friction=0.6):
    task = ng.lift(body.centroid, mass=0.8) + ng.turn([0, 0, 1], 0.5)
    jaws = ng.ParallelJaw(opening=0.085)
    table = ng.Table.under(body, clearance=CLEAR)
    return ng.GraspProblem(body, [ng.SoftContact(friction, 0.009)] * 2, task, hand=jaws, constraints=[table])


def best_of_a_grid(case, step=0.002):
    """The best mu of pairs straight across the angle: through the wall, along the base, and from side to side."""
    pairs, normals, off = [], [], case.margin
    edge = lambda low, high: np.arange(low + off, high - off + 1e-9, step)  # noqa: E731
    for y in edge(0.0, WIDE):
        for z in edge(max(WALL, CLEAR), HIGH):
            pairs.append([[0, y, z], [WALL, y, z]])
        for z in edge(CLEAR - off, WALL):
            pairs.append([[0, y, z], [LONG, y, z]])
    normals += [[[1, 0, 0], [-1, 0, 0]]] * len(pairs)
    sides = [(x, z) for x in edge(0.0, LONG) for z in edge(CLEAR - off, WALL)]
    sides += [(x, z) for x in edge(0.0, WALL) for z in edge(WALL, HIGH)]
    pairs += [[[x, 0, z], [x, WIDE, z]] for x, z in sides]
    normals += [[[0, 1, 0], [0, -1, 0]]] * len(sides)
    stack = ng.GraspStack(np.array(pairs, float), np.array(normals, float), case.models, case.origin)
    bounds = ng.screen(stack, case.task)
    best = int(np.argmax(bounds))
    grasp = ng.Grasp(pairs[best], normals[best], case.models, case.origin)
    return ng.mu_tilde(grasp, case.task).lower


@pytest.mark.slow
def test_candidates_are_on_the_mesh_and_keep_the_constraints(angle):
    compiled = CompiledProblem(problem(angle), ng.SolveOptions(workers=1))
    candidates = propose(compiled, np.random.default_rng(0))
    assert len(candidates) > 1
    for candidate in candidates:
        on_faces, projected = fix_to_triangles(compiled, candidate)
        assert np.max(angle.closest(candidate.points)[2]) <= 1e-9
        assert on_faces.violation(projected) <= FEASIBLE
        assert np.min(candidate.points[:, 2]) >= CLEAR - 1e-6


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(2))
def test_two_starts_come_to_the_best_of_a_grid(angle, seed):
    """A start that draws at random ends at the thin wall, with an eighth of it."""
    case = problem(angle)
    solution = ng.solve(case, 2, seed, ng.SolveOptions(workers=1, global_bound=False))
    assert solution.mu.upper >= 0.95 * best_of_a_grid(case)


@pytest.mark.slow
def test_without_a_pair_that_fits_there_is_no_grasp(angle):
    jaws = ng.ParallelJaw(opening=0.005)  # the wall is 8 mm
    case = ng.GraspProblem(angle, [ng.SoftContact(0.6, 0.009)] * 2, problem(angle).task, hand=jaws)
    solution = ng.solve(case, 1, options=ng.SolveOptions(workers=1, global_bound=False))
    assert not solution.success


@pytest.mark.slow
def test_pairs_to_which_the_way_is_blocked_come_last():
    """A box that is best held by its y sides, where walls leave no room for fingers."""
    task = ng.lift([0, 0, 0], mass=0.2) + ng.disturbance(0.5, 0.01)
    walls = [ng.Obstacle(ng.Box([0.2, 0.02, 0.3]), position=[0.0, side * 0.045, 0.0]) for side in (1, -1)]
    jaw = ng.ParallelJaw(0.08, finger_length=0.08, finger_thickness=0.01)
    contacts = [ng.SoftContact(0.6, 0.005)] * 2
    case = ng.GraspProblem(ng.Box([0.04, 0.06, 0.1]), contacts, task, hand=jaw, constraints=walls)
    compiled = CompiledProblem(case, ng.SolveOptions(workers=1))
    free = [compiled.hand_functions.has_free_approach(p.points) for p in propose(compiled, np.random.default_rng(0))]
    assert True in free
    assert free == sorted(free, reverse=True)
