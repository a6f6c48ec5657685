"""Solution files made without solving, with constraint values of the program's own expressions."""

import copy
import json

import mujoco
import numpy as np
import trimesh

import nlpgrasp as ng
from nlpgrasp.optimize.candidate import GraspCandidate
from nlpgrasp.optimize.constraint_values import ConstraintValues
from nlpgrasp.optimize.grasp_on_body import contact_constraints
from nlpgrasp.solution.records import ConstraintReport
from nlpgrasp.verify.recomputation import recompute
from nlpgrasp.verify.sources import SourceFolders
from tests.hands.urdf import link_distances


def problem_of(body, count, **fields):
    """Return a problem with a unit task."""
    d = 6 if body.space == 3 else 3
    return ng.GraspProblem(
        body, [ng.FrictionContact(0.5)] * count, ng.TaskEllipsoid([1.0] * d), **{"edge_margin": 0.0, **fields}
    )


def contacts_on(body, faces, rng):
    """Return random points of faces and the inward normals there."""
    points = np.concatenate([body.sample(face, 1, rng)[:1] for face in faces])
    normals = np.concatenate([-body.evaluate(face, p[None])[2] for face, p in zip(faces, points, strict=True)])
    return points, normals


def stated_file(problem, faces, points, normals, hand=None):
    """Return the JSON data of a solution with these contacts and the values of all constraints.

    Parameters
    ----------
    hand : dict, optional
        The hand's variables, from which it describes its posture in the file.
    """
    variables = hand or {}
    constraints = ConstraintValues(problem)
    batched = {name: np.asarray(v)[None] for name, v in variables.items()}
    values = constraints.values(np.asarray(points)[None], np.asarray(normals)[None], batched)[0]
    reports = [
        ConstraintReport(
            r.name,
            float(v),
            r.lower,
            r.upper,
            0.0,
            bool(min(v - r.lower, r.upper - v) <= 1e-4 * r.scale),
            r.kind,
            r.fingers,
        )
        for r, v in zip(constraints.named, values, strict=True)
    ]
    candidate = GraspCandidate(tuple(faces), np.asarray(points, dtype=float))
    reports += [
        ConstraintReport(
            r.label.name,
            r.value,
            r.lower,
            np.inf,
            0.0,
            r.value - r.lower <= 1e-4 * problem.body.size,
            r.label.kind,
            r.label.fingers,
        )
        for r in contact_constraints(problem, candidate, np.asarray(normals, dtype=float))
    ]
    solution = ng.GraspSolution(
        status=ng.Status.SOLVED,
        name=problem.name,
        problem=problem.to_dict(),
        grasp=ng.Grasp(points, normals, problem.models, problem.origin),
        faces=tuple(faces),
        mu=ng.Bounds(0.1, 0.2),
        constraints=tuple(reports),
        hand=problem.hand.describe(variables) if variables else None,
        solver={"versions": {"trimesh": trimesh.__version__}},
    )
    return json.loads(json.dumps(solution.to_dict()))


def with_link_clearances(data, path, inner_links=()):
    """Return the data of a file with the clearances of a URDF hand's links from spheres and tables, by MuJoCo.

    Parameters
    ----------
    data : dict
        Without them.
    path : Path
        Of the URDF.
    inner_links : sequence of str
        Links that keep the hand's clearance from the body: those that are not rigidly connected to a fingertip's.
    """

    def ball(body):
        return {"type": mujoco.mjtGeom.mjGEOM_SPHERE, "size": [body["radius"], 0.0, 0.0]}

    problem, origin = data["problem"], [0.0, 0.0, 0.0]
    plane = {"type": mujoco.mjtGeom.mjGEOM_PLANE, "size": [1.0, 1.0, 1.0]}
    solids = [("clearance from the body", problem["hand"]["clearance"], ball(problem["body"]), origin)]
    for c in problem["constraints"]:
        if c["type"] == "table":
            solids.append(("table", c["clearance"], plane, [0.0, 0.0, c["height"]]))
        elif c["type"] == "obstacle":
            solids.append((c["name"], c["clearance"], ball(c["body"]), c["position"]))
    rows = [
        {
            "name": f"{kind}, {link}",
            "value": value,
            "bound": [least, None],
            "multiplier": 0.0,
            "active": False,
            "kind": kind,
            "fingers": [],
        }
        for number, (kind, least, geom, position) in enumerate(solids)
        for link, value in link_distances(path, data["hand"], geom, position).items()
        if least > 0.0 and (number or link in inner_links)
    ]
    return {**data, "constraints": [*data["constraints"], *rows]}


def edited(data, change):
    """Return the data after a change."""
    result = copy.deepcopy(data)
    change(result)
    return json.loads(json.dumps(result))


def recomputed_file(data, *folders):
    """Return the checks of surface, constraints and hand, by name."""
    solution = ng.GraspSolution.from_dict(data, "file.json")
    checks = recompute(solution, solution.grasp, SourceFolders.of_file(None, folders))
    return {check.name: check for check in checks}
