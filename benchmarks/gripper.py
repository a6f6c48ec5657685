"""Parallel gripper on five parts: force to set, contact area of the pads, clearance, and number of free grasps.

``gripper:PART`` is one part, ``gripper:PART:soft`` with soft contacts in place of the pads, ``gripper:all:soft`` all.
The last number counts what a brute-force sampler finds: pairs of opposite points with a turn, at least 90 % of the pads
on their faces and a free way in, of how many tried.
"""

import time

import numpy as np
import trimesh
from trimesh.boolean import difference, union
from trimesh.creation import annulus, box, cylinder

import nlpgrasp as ng
from nlpgrasp.analysis.jaw_diagnosis import sampled_antipodal_pairs
from nlpgrasp.motion.jaw_clearance import JawClearance
from nlpgrasp.solution.obstructions import jaws_depth

GRIPPER = ng.ParallelJaw(
    stroke=0.11,
    pad=(0.02, 0.012),
    finger=(0.06, 0.012, 0.016),
    palm_size=(0.14, 0.06, 0.08),
    pad_friction=0.5,
    max_force=120.0,
)
SOFT = ng.SoftContact(0.5, 0.004)
KEEP = 20
MASS, PUSH = 0.4, 2.0  # of each part, kilograms; disturbance, newtons
TOOTH_MARGIN = 5e-4  # metres: teeth are narrower than the margin by default, 0.4 of a pad's width
PAIRS, TURNS = 100, 12  # of the brute-force sampler


def moved(shape, *position):
    """Translate a shape in place, and return it."""
    shape.apply_translation(position)
    return shape


def bracket():
    """Return an L-shaped bracket with a wall and a base of 6 mm, and four holes."""
    plates = union([moved(box([60, 40, 6]), 30, 0, 3), moved(box([6, 40, 54]), 3, 0, 33)])
    holes = [moved(cylinder(3.5, 20, sections=24), x, y, 3) for x in (25, 45) for y in (-10, 10)]
    return difference([plates, *holes])


def pipe():
    """Return a pipe of 32 mm with a flange of 60 mm."""
    return union([moved(annulus(12, 16, 80, sections=32), 0, 0, 40), moved(annulus(12, 30, 8, sections=32), 0, 0, 4)])


def gear():
    """Return a gear of 36 teeth, 2.5 mm deep and 20 mm thick."""
    teeth = []
    for i in range(36):
        turn = trimesh.transformations.rotation_matrix(2.0 * np.pi * i / 36, [0, 0, 1])
        teeth.append(moved(box([5, 2.4, 20]), 26, 0, 10).apply_transform(turn))
    return union([moved(annulus(8, 26, 20, sections=72), 0, 0, 10), *teeth])


def profile():
    """Return a U-shaped profile of sheet metal, 2 mm thick."""
    return difference([moved(box([50, 80, 30]), 0, 0, 15), moved(box([46, 90, 30]), 0, 0, 17)])


def handle():
    """Return a T-shaped handle: a round stem below a square bar."""
    return union([moved(cylinder(8, 75, sections=24), 0, 0, 37.5), moved(box([90, 16, 16]), 0, 0, 78)])


PARTS = {"bracket": bracket, "pipe": pipe, "gear": gear, "profile": profile, "handle": handle}


def problem_of(name, contacts, push=PUSH):
    """Return the problem of lifting a part off a table, with disturbances of ``push`` newtons and 20 N mm."""
    shape = PARTS[name]().apply_scale(1e-3)
    shape.apply_translation([0.0, 0.0, -shape.bounds[0, 2]])
    part = ng.Mesh(shape)
    task = ng.lift(part.centroid, MASS) + ng.disturbance(push, 0.02, part.centroid)
    table = ng.Table.under(part, 0.001)
    models = SOFT if contacts == "soft" else ()
    return ng.GraspProblem(
        *(part, models, task),
        hand=GRIPPER,
        constraints=[table],
        force_budget="shared",
        name=f"{name}, {contacts}",
        edge_margin=TOOTH_MARGIN if name == "gear" else None,
    )


def solve(problem, keep):
    """Return the solution of a problem, by one start, with kept grasps."""
    return ng.solve(problem, starts=1, keep=keep, options=ng.SolveOptions(workers=1, global_bound=False))


def sampled(problem):
    """Return how many sampled gripper poses are free with the pads on faces, and how many were tried."""
    clearance = JawClearance(problem.hand, problem.body, problem.constraints)
    pairs = sampled_antipodal_pairs(problem)
    openings = np.linalg.norm(pairs[:, 1] - pairs[:, 0], axis=1)
    pairs = pairs[openings <= problem.hand.opening]
    chosen = pairs[:: -(-len(pairs) // PAIRS)]
    free_count = 0
    for points in chosen:
        directions = problem.hand.approaches(points, clearance.cones, TURNS)
        free_count += len(list(clearance.usable_approaches(points, directions)))
    return free_count, len(chosen) * TURNS


def run(part="all", contacts="pads"):
    for name in PARTS if part == "all" else [part]:
        problem = problem_of(name, contacts)
        start_time = time.process_time()
        solution = solve(problem, KEEP)
        seconds = time.process_time() - start_time
        count, tried = sampled(problem)
        if not solution.success:
            reason = str(solution.why_not or solution.told).splitlines()[0]
            print(f"{problem.name}: {seconds:.0f} CPU s, no grasp: {reason} Sampler {count} of {tried}", flush=True)
            continue
        free_count = sum(not jaws_depth(grasp.hand) for grasp in solution.grasps)
        pad_areas = [min(grasp.hand["pads"]) for grasp in solution.grasps]
        print(
            f"{problem.name}: {seconds:.0f} CPU s, {solution.grip_force:.1f} N"
            f" ({solution.grip.with_margin.upper:.1f} N with margin), pads {100 * pad_areas[0]:.0f} % on the face"
            f" (least {100 * min(pad_areas):.0f} %), clearance {1e3 * solution.hand['approach']['clearance']:.1f} mm,"
            f" {free_count} of {len(solution.grasps)} free, sampler {count} of {tried},"
            f" {'verified' if ng.verify(solution) else 'NOT VERIFIED'}",
            flush=True,
        )
