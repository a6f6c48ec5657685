"""Starts of a 16-joint hand on the shared meshes: time by stage, quality, and penetration of links."""

import numpy as np

import nlpgrasp as ng
from benchmarks.outside import MESHES, MISSING, load_mesh
from benchmarks.starts import run_starts, stage_medians
from tests.hands.urdf import four_finger_hand

STARTS = 20


def run():
    hand = four_finger_hand()
    if MESHES.is_dir():
        for path in sorted(MESHES.glob("*.stl")):
            _mesh(path, hand)
    else:
        print(f"skipped meshes: {MISSING}")


def _report(problem):
    """Run starts of a problem, print their times, and return their results."""
    results, seconds = run_starts(problem, STARTS)
    solved = np.array([r.solved for r in results])
    first_grasp = np.array([r.record.seconds["propose"] + r.record.seconds["first program"] for r in results])
    stages = ", ".join(f"{n} {s:.2f}" for n, s in stage_medians(results).items())
    print(f"  {solved.mean():.0%} of {STARTS} starts certified above 0")
    print(f"  seconds: median {np.median(seconds):.2f}, most {seconds.max():.2f}; {stages}")
    print(
        f"  seconds to the first force-closed grasp: median {np.median(first_grasp):.2f}, most {first_grasp.max():.2f}"
    )
    return results


def _mesh(path, hand):
    """Print quality and penetration of starts on one mesh."""
    body = load_mesh(path)
    task = ng.TaskEllipsoid([1, 1, 1, *[body.size] * 3])
    print(f"{path.name}:")
    results = _report(ng.GraspProblem(body, ng.FrictionContact(0.7), task, hand=hand))
    solved = [r for r in results if r.solved]
    deepest = max(_penetration(body, hand, r.on_body.candidate.hand) for r in solved)
    lower = np.median([r.record.mu.lower for r in solved])
    angle = np.degrees(np.median([r.on_body.surface.angles.max() for r in solved]))
    print(f"  certified mu: median {lower:.3f}; normals off the smooth ones by at most (median) {angle:.0f} degrees")
    print(f"  deepest link in the mesh, all solved starts: {1e3 * deepest:.3f} mm (aim 0.5)")


def _penetration(body, hand, values):
    """Return the largest penetration between collision shapes and mesh, metres, at the vertices of both."""
    poses = np.asarray(hand.tree.link_function(values["joints"]).full())
    q = ng.hands.kinematics.rotation_matrix(values["palm_quaternion"])
    rotation = np.array([[float(q[i, j]) for j in range(3)] for i in range(3)])
    deepest = 0.0
    for i, link in enumerate(hand.tree.used_links):
        pose = poses[:, 4 * i : 4 * i + 4]
        for shape in hand.robot.shapes.get(link, ()):
            surface = shape.mesh.vertices @ pose[:3, :3].T + pose[:3, 3]
            candidate = surface @ rotation.T + values["palm_position"]
            deepest = max(deepest, -float(np.min(body.signed_distance(candidate))))
            local = (body.mesh.vertices - values["palm_position"]) @ rotation
            in_link = (local - pose[:3, 3]) @ pose[:3, :3]
            deepest = max(deepest, float(np.max(shape.depth(in_link))))
    return deepest
