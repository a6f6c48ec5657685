"""Depths of a hand's links in the body and in each other, by dense samples and libigl alone.

    python -m benchmarks.link_depths problem.py solution.json ...

Independent of the search: no distance of ``nlpgrasp.motion`` is used. Samples of each link, 0.8 mm apart, are measured
in the body's triangles and in the other links' shapes, and samples of the body in the links' shapes: in the grasp, and
along the way in at postures a millimetre apart.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from itertools import combinations, pairwise

import igl
import numpy as np
import trimesh

import nlpgrasp as ng
from nlpgrasp.bodies.mesh.display_triangles import triangles
from nlpgrasp.cli.problem_script import load_problem
from nlpgrasp.common.validation import FloatArray, IntArray
from nlpgrasp.hands import URDFHand
from nlpgrasp.hands.base import Values

SPACING = 8e-4  # metres between samples
STEP = 1e-3  # metres that a link moves between two postures


class LinkDepths:
    """Depths of points of one surface below another."""

    def __init__(self, hand: URDFHand, body: ng.Body) -> None:
        self.hand, robot = hand, hand.robot
        shapes = [(link, shape.mesh) for link, shapes in robot.shapes.items() for shape in shapes]
        self.links = [link for link, _ in shapes]
        self.surfaces = [(np.asarray(m.vertices, float), np.asarray(m.faces, np.int64)) for _, m in shapes]
        self.samples = [_dense(*surface) for surface in self.surfaces]
        self.body = _body_surface(body)
        self.body_samples = _dense(*self.body)
        groups = robot.rigid_groups
        self.pairs = [
            (i, j)
            for i, j in combinations(range(len(shapes)), 2)
            if groups[self.links[i]] != groups[self.links[j]] and not robot.adjacent(self.links[i], self.links[j])
        ]
        postures = hand.tree.random_joints(20, np.random.default_rng(0))
        meeting = [self.in_each_other(_at_origin(joints)) for joints in postures] if hand.self_collision else []
        always = {pair for pair in {key for found in meeting for key in found} if sum(pair in f for f in meeting) >= 18}
        self.pairs = [(i, j) for i, j in self.pairs if (self.links[i], self.links[j]) not in always]

    def in_body(self, values: Values) -> tuple[float, str]:
        """Return the depth of the deepest link in the body, metres, and the link."""
        poses, best = self.hand.tree.body_poses(values), (0.0, "")
        for link, surface, samples in zip(self.links, self.surfaces, self.samples, strict=True):
            pose = poses[link]
            moved = samples @ pose[:3, :3].T + pose[:3, 3]
            depth = max(_depth(moved, *self.body), _depth((self.body_samples - pose[:3, 3]) @ pose[:3, :3], *surface))
            best = max(best, (depth, link))
        return best

    def in_each_other(self, values: Values) -> dict[tuple[str, str], float]:
        """Return the depths of links in each other, metres, by pair."""
        poses, result = self.hand.tree.body_poses(values), dict[tuple[str, str], float]()
        for i, j in self.pairs if self.hand.self_collision else ():
            pose = np.linalg.inv(poses[self.links[j]]) @ poses[self.links[i]]
            depth = _depth(self.samples[i] @ pose[:3, :3].T + pose[:3, 3], *self.surfaces[j])
            depth = max(depth, _depth((self.samples[j] - pose[:3, 3]) @ pose[:3, :3], *self.surfaces[i]))
            if depth > 5e-5:
                key = self.links[i], self.links[j]
                result[key] = max(depth, result.get(key, 0.0))
        return result

    def on_way(self, keyframes: Sequence[Values], step: float = STEP) -> tuple[float, float]:
        """Return the largest depths in the body and in each other along straight ways between keyframes, metres."""
        in_body, in_links = 0.0, 0.0
        for start, end in pairwise(keyframes):
            poses = [self.hand.tree.body_poses(values) for values in (start, end)]
            far = max(float(np.linalg.norm(poses[1][link][:3, 3] - poses[0][link][:3, 3])) for link in self.links)
            for share in np.linspace(0.0, 1.0, max(int(far / step), 1) + 1):
                values = {name: start[name] + share * (end[name] - start[name]) for name in start}
                in_body = max(in_body, self.in_body(values)[0])
                in_links = max(in_links, *self.in_each_other(values).values(), 0.0)
        return in_body, in_links


def keyframes_of(solution: ng.GraspSolution, hand: URDFHand) -> list[Values]:
    """Return the hand's variables in the keyframes up to the grasp."""
    before = [phase for phase in solution.phases if phase.name in ("approach", "pregrasp", "grasp")]
    return [hand.values_of(phase.to_dict()) for phase in before]


def _at_origin(joints: FloatArray) -> Values:
    return {"palm_position": np.zeros(3), "palm_quaternion": np.array([1.0, 0.0, 0.0, 0.0]), "joints": joints}


def _body_surface(body: ng.Body) -> tuple[FloatArray, IntArray]:
    if isinstance(body, ng.Mesh):
        return np.asarray(body.mesh.vertices, float), np.asarray(body.mesh.faces, np.int64)
    surface = body.triangles()
    vertices, faces = triangles(body, 20_000) if surface is None else surface
    return np.asarray(vertices, float), np.asarray(faces, np.int64)


def _dense(vertices: FloatArray, faces: IntArray) -> FloatArray:
    """Return the vertices, and samples all over a surface."""
    mesh = trimesh.Trimesh(vertices, faces, process=False)
    points, _ = trimesh.sample.sample_surface(mesh, min(int(mesh.area / SPACING**2), 60_000), seed=0)
    return np.concatenate([vertices, np.asarray(points)])


def _depth(points: FloatArray, vertices: FloatArray, faces: IntArray) -> float:
    """Return how deep the deepest of some points is within a surface, metres."""
    inside = np.all((points > vertices.min(axis=0)) & (points < vertices.max(axis=0)), axis=1)
    near = np.ascontiguousarray(points[inside])
    if not len(near):
        return 0.0
    within = near[np.abs(igl.fast_winding_number(vertices, faces, near)) > 0.5]
    if not len(within):
        return 0.0
    return float(np.sqrt(np.max(igl.point_mesh_squared_distance(within, vertices, faces)[0])))


def main(script: str, *paths: str) -> None:
    """Print the depths of solutions, files, of the problem that a script's ``problem()`` makes."""
    problem = load_problem(script)
    if not isinstance(problem.hand, URDFHand):
        raise SystemExit(f"{script}: expected a problem with a URDFHand")
    depths = LinkDepths(problem.hand, problem.body)
    for path in paths:
        solution = ng.GraspSolution.load(path)
        values = problem.hand.values_of(solution.hand or {})
        in_body, link = depths.in_body(values)
        in_links = max(depths.in_each_other(values).values(), default=0.0)
        way = depths.on_way(keyframes_of(solution, problem.hand))
        print(
            f"{path}: in the body {1e3 * in_body:.2f} mm {link}, in each other {1e3 * in_links:.2f} mm; "
            f"on the way {1e3 * way[0]:.2f} and {1e3 * way[1]:.2f} mm"
        )


if __name__ == "__main__":
    main(*sys.argv[1:])
