"""MuJoCo trials of grasps of four preset hands on six bodies, squeezed by the joints.

``hand_simulation:shadow,panda:box`` takes these hands and bodies alone. The hands' files are those of the tests
(``make robots``). A missing grasp counts as lost. Fingers press with 1 N, with 2 N, and as the file's squeeze does, for
all of the task. The object is loaded with 0.8 of the task, or of the part that the squeeze is hard enough for. The
targets are for the last.
"""

import time
from dataclasses import dataclass
from pathlib import Path
from tempfile import mkdtemp

import numpy as np
import trimesh

import nlpgrasp as ng
from benchmarks.outside import MESHES, hands_and_bodies
from nlpgrasp.simulation.hand_outcome import AS_SOLVED
from nlpgrasp.simulation.hand_protocol import DISPLACED, DRAWS
from tests.hands.robotiq import robotiq_2f85
from tests.hands.robots import SHADOW, model, robot

HANDS = {
    "shadow": (ng.hands.shadow, lambda: model(SHADOW)),
    "robotiq_2f85": (ng.hands.robotiq_2f85, lambda: robotiq_2f85(Path(mkdtemp()) / "robotiq_2f85.urdf", meshes=True)),
    "allegro": (ng.hands.allegro, lambda: robot("allegro_hand_description/urdf/allegro_right_hand.urdf")),
    "panda": (ng.hands.panda, lambda: robot("panda_description/urdf/panda.urdf")),
}
MESH = "strawberry"
BODIES = {
    "box": lambda: ng.Box([0.06, 0.05, 0.09]),
    "cylinder": lambda: ng.Cylinder(0.025, 0.1),
    "ellipsoid": lambda: ng.Ellipsoid([0.04, 0.03, 0.03]),
    "sphere": lambda: ng.Sphere(0.035),
    "capsule": lambda: ng.Mesh(trimesh.creation.capsule(height=0.05, radius=0.025, count=[24, 24])),
    MESH: lambda: ng.Mesh.load(MESHES / "ycb_012_strawberry.stl"),
}
STARTS, TASK = 4, ng.TaskEllipsoid([1.0, 1.0, 1.0, 0.02, 0.02, 0.02])
TORSION = 5e-3  # metres: torsional friction of flat pads
ROUGH, SMOOTH = 0.6, 0.3  # friction
SQUEEZES, WRENCHES = (1.0, 2.0), 5  # newtons; wrenches beside the hardest
MASS = 0.1  # kilograms
OPTIONS = ng.SolveOptions(global_bound=False, workers=1)
TARGETS = {"friction 0.6": 0.95, "friction 0.3": 0.85, "off by 5 mm, 5 deg": 0.85}
STILL = "0.5 mm, 0.5 deg"  # target median motion of the object by the squeeze


@dataclass
class Count:
    """Counts of closings and trials, and of those in which the object was held."""

    closed: int = 0
    held: int = 0
    trials: int = 0
    strict: int = 0

    def add(self, simulation, condition):
        """Add the trials of a condition, and return the number of trials held as text.

        Trials of a missing simulation count as lost.
        """
        closings = DRAWS if condition == DISPLACED else 1
        trial_count = (WRENCHES + 1) * closings + (condition == AS_SOLVED)  # lifted as solved alone
        is_strict = (
            np.zeros(trial_count, bool)
            if simulation is None
            else np.array([t.strict for t in simulation.of(condition)])
        )
        self.closed, self.held = (
            self.closed + closings,
            self.held + int(is_strict.reshape(closings, -1).all(axis=1).sum()),
        )
        self.trials, self.strict = self.trials + trial_count, self.strict + int(is_strict.sum())
        return "none" if simulation is None else f"{is_strict.sum()}/{trial_count}"

    def __str__(self):
        trials = f"{self.strict} of {self.trials} trials, {self.strict / max(self.trials, 1):.1%}"
        return f"{self.held:3} of {self.closed:3} closings, {self.held / max(self.closed, 1):6.1%}; {trials}"


def run(hands=None, bodies=None):
    columns = "".join(f"{name:>7}" for name in (*(f"{force:g} N" for force in SQUEEZES), "file", "0.3", "off"))
    print("trials held strictly: friction 0.6, squeezes; solved and pressed at 0.3; off by 5 mm, 5 degrees at 0.6")
    print(f"{'':22}{columns}  squeezes of the file, N  control  moved by the squeeze  seconds")
    counts = {name: Count() for name in (*TARGETS, *(f"squeeze of {force:g} N" for force in SQUEEZES))}
    moved = []
    for label, path, make, body in hands_and_bodies(HANDS, BODIES, hands, bodies, MESH):
        _row(label, path, make(path), body, counts, moved)
    for name, count in counts.items():
        aim = f" (aim {TARGETS[name]:.0%} of closings)" if name in TARGETS else ""
        print(f"{name:20} {count}{aim}")
    if moved:
        slip, turn = np.median([[m.slip, m.turn] for m in moved], axis=0)
        print(f"moved by the squeeze in the median: {1e3 * slip:.3f} mm, {np.degrees(turn):.3f} deg (aim {STILL})")


def _row(name, path, hand, body, counts, moved):
    """Solve and simulate one hand and body, add the trials to the counts, and print a row."""
    start_time = time.perf_counter()
    rough, smooth = (_solved(name, hand, body, friction) for friction in (ROUGH, SMOOTH))
    cells = [counts[f"squeeze of {force:g} N"].add(_press(rough, path, force), AS_SOLVED) for force in SQUEEZES]
    forces_stated = [None if s.squeeze is None else s.squeeze.normal_force for s in (rough, smooth)]
    rough_simulation, smooth_simulation = (_press(s, path, None) for s in (rough, smooth))
    cells.append(counts["friction 0.6"].add(rough_simulation, AS_SOLVED))
    cells.append(counts["friction 0.3"].add(smooth_simulation, AS_SOLVED))
    cells.append(counts["off by 5 mm, 5 deg"].add(rough_simulation, DISPLACED))
    control, movement = "", "none"
    if rough_simulation is not None:
        moved.append(rough_simulation.squeezed)
        control, movement = "lost" if rough_simulation.control_lost else "held", str(rough_simulation.squeezed)
    forces = ", ".join("-" if force is None else f"{force:.1f}" for force in forces_stated)
    row = f"{''.join(f'{cell:>7}' for cell in cells)}  {forces:17}  {control:7}  {movement:20}"
    print(f"{name:22}{row}  {time.perf_counter() - start_time:.0f}", flush=True)


def _solved(name, hand, body, friction):
    """Return the solution for a hand, a body and a friction coefficient."""
    contact = ng.SoftContact(friction, TORSION) if hand.count == 2 else ng.FrictionContact(friction)
    return ng.solve(ng.GraspProblem(body, contact, TASK, hand=hand, name=name), starts=STARTS, options=OPTIONS)


def _press(solution, path, force):
    """Simulate a grasp, or return ``None`` without a squeeze."""
    if solution.squeeze is None:
        return None
    return ng.simulate_hand(solution, path, ng.HandSceneOptions(mass=MASS, normal_force=force), wrenches=WRENCHES)
