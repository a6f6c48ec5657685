"""Random solves over all bodies: edge margins, contacts on the surface, fingertip clearance."""

import numpy as np
import pytest
import trimesh

import nlpgrasp as ng
from nlpgrasp.verify.mesh_body import MeshSurface
from nlpgrasp.verify.registry import BODIES
from nlpgrasp.verify.sources import SourceFolders
from nlpgrasp.verify.surface_geometry import TriangleSurface

QUICK = ng.SolveOptions(workers=1)
L_SHAPE = [[0, 0], [0.08, 0], [0.08, 0.03], [0.03, 0.03], [0.03, 0.08], [0, 0.08]]


def _mesh(rng):
    """Return a part with an inner corner."""
    size = rng.uniform(0.9, 1.1, 3)
    parts = [trimesh.creation.box([0.08, 0.03, 0.03] * size), trimesh.creation.box([0.03, 0.08, 0.03] * size)]
    parts[1].apply_translation([0.02, 0.02, 0.0])
    return ng.Mesh(trimesh.util.concatenate(parts), resolution=24)


KINDS = {
    "box": lambda rng: ng.Box(rng.uniform(0.02, 0.09, 3)),
    "cylinder": lambda rng: ng.Cylinder(rng.uniform(0.01, 0.04), rng.uniform(0.03, 0.12)),
    "prism": lambda rng: ng.Prism(_convex(rng), rng.uniform(0.02, 0.08)),
    "polygon": lambda rng: ng.Polygon(L_SHAPE if rng.random() < 0.5 else _convex(rng)),
    "torus": lambda rng: ng.Torus(rng.uniform(0.025, 0.04), rng.uniform(0.008, 0.02)),
    "ellipsoid": lambda rng: ng.Ellipsoid(rng.uniform(0.02, 0.06, 3)),
    "mesh": _mesh,
}


def _convex(rng):
    angles = np.sort(rng.uniform(0, 2 * np.pi, 3) * 0.25 + 2 * np.pi * np.arange(3) / 3)
    return np.stack([np.cos(angles), np.sin(angles)], axis=1) * rng.uniform(0.02, 0.04, 2)


def random_problem(number):
    """Return problem ``number``: a third with the default margin, half with round fingertips."""
    rng = np.random.default_rng([19, number])
    body = KINDS[list(KINDS)[number % len(KINDS)]](rng)
    count = int(rng.integers(3, 5))
    shortest = float(np.min(np.ptp(body.bounds, axis=0)))
    margin = None if number % 3 == 0 else float(rng.uniform(0.0, 0.12)) * shortest
    hand = ng.Fingertips(count, radius=float(rng.uniform(0.1, 0.3)) * shortest) if rng.random() < 0.5 else None
    axes = rng.uniform(0.5, 1.0, 6 if body.space == 3 else 3) * np.array(
        [1.0] * body.space + [body.size] * (3 if body.space == 3 else 1)
    )
    friction = ng.FrictionContact(float(rng.uniform(0.4, 0.9)))
    return ng.GraspProblem(body, [friction] * count, ng.TaskEllipsoid(axes), hand=hand, edge_margin=margin)


def other_surface(body):
    """Return a body as the numbers that ``verify`` has of it."""
    if isinstance(body, ng.Mesh):
        return MeshSurface(TriangleSurface(np.asarray(body.mesh.vertices), np.asarray(body.mesh.faces)))
    data = body.to_dict()
    return BODIES.of(data)(data, SourceFolders.of_file(None, []))


def faults(number):
    """Return what is wrong with contacts of a random problem, by the code of ``verify``, and whether it was solved."""
    problem = random_problem(number)
    solution = ng.solve(problem, starts=1, options=QUICK)
    if solution.grasp is None:
        return [], False
    size, grasp, surface = problem.body.size, solution.grasp, other_surface(problem.body)
    radii = [0.0] * len(grasp) if problem.hand is None else problem.hand.tip_radii
    wrong = []
    for i, (face, p, n) in enumerate(zip(solution.faces, grasp.points, grasp.normals, strict=True)):
        if surface.edge_distance(face, p) < problem.margin - 2e-5 * size:
            wrong.append(f"{number}: contact {i} is near an edge")
        just = surface.distance(np.stack([p - 1e-3 * size * n, p + 1e-3 * size * n]))
        if not just[0] > 0.0 > just[1]:
            wrong.append(f"{number}: contact {i} is buried or in the air, {just}")
        hollow = not isinstance(
            problem.body, ng.Ellipsoid
        )  # nothing outside cuts what is convex; its distance is a bound
        if hollow and radii[i] > 0.0 and surface.distance((p - radii[i] * n)[None])[0] < 0.989 * radii[i]:
            wrong.append(f"{number}: fingertip {i} cuts the body")
    return wrong, True


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:the mesh. the smooth surface")
@pytest.mark.parametrize("number", range(2 * len(KINDS)))
def test_contacts_are_where_a_finger_can_be(number):
    assert faults(number) == ([], True)
