"""MuJoCo trials of a parallel gripper's grasps of five parts: held by the force to set, and lost at half of it.

``gripper_simulation:PART`` is one part, ``gripper_simulation:PART:pads`` with the pads as contacts in place of soft
ones, ``gripper_simulation:all:pads`` all, ``gripper_simulation:all:soft:40`` with disturbances of 40 N instead of 2 N.
Last come the grippers of ``ng.hands.jaws`` on a block, two also by robot files (``gripper_simulation:presets`` alone).

The gripper's pads, fingers and palm are boxes at the pose and opening of ``ng.robot_poses``. The pads slide along the
stated closing axis, coupled by the drive, and press with a constant force. The part is free, made of exact convex
pieces, and pulled by gravity; the rest of each wrench of the task pushes it. It is held if no contact slips by 2 mm and
it turns by less than 3 degrees within a second, the limits of ``nlpgrasp simulate``. Seven wrenches are tried: the
hardest, and those with the largest forces along the axes of the part. Columns: the kept grasps with a free way in; the
certified least force of the answer; how many grasps are held with the exported force (with its margin), with the least
force, and lost at half of that; the largest distance of a pad from the part or its contact, error of the distance with
the pad opened by a millimetre, depth of finger or palm in the part, angle of a contact's normal to the closing axis.
"""

import time
from dataclasses import dataclass
from xml.etree.ElementTree import Element, SubElement

import mujoco
import numpy as np

import nlpgrasp as ng
from benchmarks import gripper_files
from benchmarks.gripper import KEEP, MASS, PARTS, PUSH, SOFT, problem_of, solve
from benchmarks.gripper_files import OPENED, least_distance
from benchmarks.gripper_pieces import box, pieces_of
from nlpgrasp.hands.presets import JAWS
from nlpgrasp.quality import finger_forces, mu
from nlpgrasp.simulation.fingertip_model import MAX_SLIP, MAX_TURN
from nlpgrasp.simulation.fingertip_scene import DENSITY, format_numbers, solid_mass, xml_text
from nlpgrasp.simulation.scene_object import object_mass
from nlpgrasp.simulation.simulation_input import EARTH
from nlpgrasp.solution.trajectory import require_jaws

STEP, SECONDS = 5e-4, 1.0  # seconds: time step, and length of a trial
GRIP, RISE = 0.05, 0.25  # seconds: of gripping alone, and in which gravity and the push then grow
CHECKS = 20  # steps between looks at the motion
PAD_MASS, PAD_DAMPING, PAD_THICKNESS = 0.2, 20.0, 5e-3  # kg, N s / m, m
CONTACT = {"solref": f"{4 * STEP} 1", "solimp": "0.99 0.999 0.0001"}
SOLVER = {"cone": "elliptic", "impratio": "20", "noslip_iterations": "10", "noslip_tolerance": "1e-8"}
FREE = {"contype": "0", "conaffinity": "0"}  # touches nothing
MARK = 1e-4  # metres: radius of the spheres that stand for the contacts
FRICTION = 0.5  # of the pads
AXES = np.concatenate([np.eye(3, 6), -np.eye(3, 6)])  # directions of the pushes beside the hardest wrench
BLOCK, KEPT = (0.03, 0.04, 0.08), 5  # metres; grasps of each preset


class GripperModel:
    """MuJoCo model of a part between the pads of a parallel gripper, with fingers and palm that touch nothing.

    Parameters
    ----------
    solution : GraspSolution
        Of a grasp by an ``ng.ParallelJaw`` with pads and fingers.
    pieces : list of (n, 3) arrays
        Corners of the part's convex pieces, metres.
    friction : float
        Coulomb coefficient of the pads.
    """

    def __init__(self, solution, pieces, friction):
        self.gripper = require_jaws(solution, "a grasp by parallel jaws")
        self.poses, self.grasp = ng.robot_poses(solution)[0], solution.require_grasp()
        closing = self.poses.grasp.matrix[:3, :3] @ self.gripper.axes[:, 0]
        self.points = self.grasp.points[np.argsort(self.grasp.points @ closing)]  # of jaw 0, of jaw 1
        self.pieces = [f"piece_{i}" for i in range(len(pieces))]
        self.links = ["bar_0", "bar_1"]
        kilograms = object_mass(solution, None).kilograms
        self.mass = solid_mass(solution.require_drawing().body, DENSITY).scaled(kilograms)
        self.model = mujoco.MjModel.from_xml_string(self._scene(pieces, friction))
        self.data = mujoco.MjData(self.model)

    def _scene(self, pieces, friction):
        """Return the scene as MJCF text; the world's frame is the part's."""
        root = Element("mujoco", model="gripper")
        SubElement(root, "option", timestep=f"{STEP:g}", integrator="implicitfast", **SOLVER)
        asset, world = SubElement(root, "asset"), SubElement(root, "worldbody")
        surface = {"friction": f"{friction:.9g} 0 0", "condim": "3", **CONTACT}
        part = SubElement(world, "body", name="part")
        SubElement(part, "freejoint")
        inertia = self.mass.inertia[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]
        SubElement(
            part,
            "inertial",
            pos=format_numbers(self.mass.center),
            mass=f"{self.mass.mass:.9g}",
            fullinertia=format_numbers(inertia),
        )
        for name, corners in zip(self.pieces, pieces, strict=True):
            SubElement(asset, "mesh", name=name, vertex=format_numbers(corners.ravel()))
            SubElement(part, "geom", {"name": name, "type": "mesh", "mesh": name, **surface})
        for i, point in enumerate(self.points):
            mark = {"name": f"contact_{i}", "type": "sphere", "size": f"{MARK:g}", "pos": format_numbers(point)}
            SubElement(part, "geom", {**mark, **FREE})
        self._add_gripper(world, surface)
        equality = SubElement(root, "equality")  # the drive moves both jaws alike
        SubElement(equality, "joint", joint1="jaw_0", joint2="jaw_1", **CONTACT)
        actuator = SubElement(root, "actuator")
        for i in range(2):
            SubElement(actuator, "motor", joint=f"jaw_{i}")
        return xml_text(root)

    def _add_gripper(self, world, surface):
        """Add palm, fingers and pads at the exported pose, in a frame with closing, transverse and approach axes."""
        gripper, tool = self.gripper, self.poses.grasp
        matrix = np.zeros(4)
        mujoco.mju_mat2Quat(matrix, (tool.matrix[:3, :3] @ gripper.axes).ravel())
        frame = {"pos": format_numbers(tool.position), "quat": format_numbers(matrix)}
        hand = SubElement(world, "body", name="gripper", **frame)
        solids = gripper.solids(self.poses.opening, self.poses.opening, 0.0)

        def add(body, name, corners, attributes):
            size, middle = 0.5 * (corners[1] - corners[0]), 0.5 * (corners[0] + corners[1])
            geom = {"name": name, "type": "box", "size": format_numbers(size), "pos": format_numbers(middle)}
            SubElement(body, "geom", {**geom, **attributes})

        if solids.palm and np.all(solids.palm[0][1] > solids.palm[0][0]):
            add(hand, "palm", solids.palm[0], FREE)
            self.links.append("palm")
        half_length, half_width = 0.5 * gripper.pad[0], 0.5 * gripper.pad[1]
        for i, (sign, finger) in enumerate(zip((-1.0, 1.0), solids.closed_fingers, strict=True)):
            body = SubElement(hand, "body", name=f"finger_{i}", gravcomp="1")
            SubElement(
                *(body, "joint"),
                name=f"jaw_{i}",
                type="slide",
                axis=format_numbers([-sign, 0.0, 0.0]),
                damping=f"{PAD_DAMPING:g}",
            )
            SubElement(body, "inertial", pos="0 0 0", mass=f"{PAD_MASS:g}", diaginertia="1e-4 1e-4 1e-4")
            ends = np.sort(sign * (0.5 * self.poses.opening + np.array([0.0, PAD_THICKNESS])))
            pad = np.array([[ends[0], -half_width, -half_length], [ends[1], half_width, half_length]])
            add(body, f"pad_{i}", pad, surface)
            add(body, f"bar_{i}", finger, FREE)

    def motion(self, force, wrench):
        """Return slip, metres, and turn, radians, within a second; it ends where the part is lost.

        Parameters
        ----------
        force : float
            Normal force of each jaw, newtons.
        wrench : (6,) array
            That the pads have to exert, about the grasp's torque origin; the part's weight is included.
        """
        model, data, part = self.model, self.data, self.model.body("part").id
        mujoco.mj_resetData(model, data)
        arm = self.grasp.torque_origin - self.mass.center
        weight = np.array([0.0, 0.0, EARTH * self.mass.mass])
        push = -(wrench[:3] - weight)
        moment = -wrench[3:] + np.cross(arm, -wrench[:3])  # about the centre of mass, where the weight has none
        slip = turn = 0.0
        for step in range(round(SECONDS / STEP)):
            share = min(max((step * STEP - GRIP) / RISE, 0.0), 1.0)
            data.ctrl[:] = force * min(step * STEP / GRIP, 1.0)
            model.opt.gravity[:] = [0.0, 0.0, -EARTH * share]
            data.xfrc_applied[part] = share * np.concatenate([push, moment])
            mujoco.mj_step(model, data)
            if step % CHECKS == CHECKS - 1:
                slip, turn = self._moved()
                if slip >= MAX_SLIP or turn >= MAX_TURN:
                    break
        return slip, turn

    def _moved(self):
        """Return the largest motion of a contact against its pad, metres, and the part's rotation, radians."""
        rotation, vector = np.array(self.data.body("part").xmat).reshape(3, 3), np.zeros(3)
        mujoco.mju_quat2Vel(vector, self.data.body("part").xquat, 1.0)
        jaws = np.array([self.data.body(f"finger_{i}").xpos for i in range(2)]) - self.poses.grasp.position
        moved = self.points @ rotation.T + self.data.body("part").xpos - self.points - jaws
        return float(np.max(np.linalg.norm(moved, axis=1))), float(np.linalg.norm(vector))

    def holds(self, force, wrenches):
        """Return whether the pads hold all of some wrenches with a force."""
        for wrench in wrenches:
            slip, turn = self.motion(force, wrench)
            if slip >= MAX_SLIP or turn >= MAX_TURN:
                return False
        return True

    def distance(self, name, others):
        """Return the least signed distance of a geom from others, metres."""
        return least_distance(
            self.model, self.data, *([self.model.geom(g).id for g in geoms] for geoms in ([name], others))
        )

    def check_pose(self):
        """Return the distances of pads, fingers and palm at the exported pose, with the pads closed and opened."""
        mujoco.mj_resetData(self.model, self.data)
        mujoco.mj_kinematics(self.model, self.data)
        pads = [self.distance(f"pad_{i}", self.pieces) for i in range(2)]
        contacts = [self.distance(f"pad_{i}", [f"contact_{i}"]) + MARK for i in range(2)]
        depth = max(-min(self.distance(name, self.pieces) for name in self.links), 0.0)
        self.data.qpos[-2:] = -OPENED
        mujoco.mj_kinematics(self.model, self.data)
        gaps = [self.distance(f"pad_{i}", [f"contact_{i}"]) + MARK for i in range(2)]
        cosines = np.abs(self.grasp.normals @ self.data.joint("jaw_0").xaxis)
        return PoseCheck(
            pad=float(np.max(np.abs([*pads, *contacts]))),
            opened=float(np.max(np.abs(np.subtract(gaps, contacts) - OPENED))),
            depth=depth,
            tilt=float(np.max(np.arccos(np.minimum(cosines, 1.0)))),
        )


@dataclass(frozen=True)
class PoseCheck:
    """Distances at an exported pose, by MuJoCo.

    Parameters
    ----------
    pad : float
        Largest distance of a pad from the part and from its contact, metres.
    opened : float
        Largest error of the growth of a pad's distance from its contact, as it opens by a millimetre, metres.
    depth : float
        Of the deepest finger or the palm in the part, metres.
    tilt : float
        Largest angle between the closing axis and a contact's normal, radians.
    """

    pad: float
    opened: float
    depth: float
    tilt: float


def hard_wrenches(solution):
    """Return wrenches (7, 6) of the task: the hardest first, and those with the largest forces along the axes."""
    grasp, task = solution.require_grasp(), solution.task
    worst = mu(grasp, task, 0.01, force_budget="shared").worst_direction
    wrenches = task.support(np.concatenate([worst[None], AXES]))[1]
    used = finger_forces(grasp, wrenches, force_budget="shared").used
    return wrenches[np.argsort(-used)]


def run(part="all", contacts="soft", push=PUSH):
    columns = "grasps  force N  held with margin  held  lost at half  pads off mm  opened off mm  depth mm  tilt mrad"
    print(f"{'':20} {columns}  CPU s")
    counts = np.zeros(4, int)
    for name in PARTS if part == "all" else [part] if part in PARTS else []:
        problem = problem_of(name, contacts, float(push))
        solution, pieces = solve(problem, KEEP), pieces_of(name)
        counts += row(problem.name, solution, pieces)
    for name in JAWS if part in ("all", "presets") else []:
        solution, pieces = solve(block_between(name), KEPT), [box(BLOCK, np.zeros(3))]
        counts += row(name, solution, pieces)
        if name in gripper_files.FILES and solution.success:
            gripper_files.report(name, solution, pieces)
    print("{} grasps: {} held with margin, {} held, {} lost at half".format(*counts.tolist()))


def block_between(name):
    """Return the problem of lifting a block with a preset gripper, on soft contacts."""
    part = ng.Box(BLOCK)
    task = ng.lift([0.0, 0.0, 0.0], MASS) + ng.disturbance(PUSH, 0.02)
    table, jaws = ng.Table.under(part, 0.001), ng.hands.jaws(name)
    return ng.GraspProblem(part, SOFT, task, hand=jaws, constraints=[table], force_budget="shared", name=name)


def row(name, solution, pieces):
    """Print a row on the trials of a solution's grasps, and return the numbers of grasps, of held and of lost, (4,)."""
    start_time = time.process_time()
    answers = [solution.with_answer(grasp) for grasp in solution.grasps] if solution.success else []
    free = [answer for answer in answers if ng.robot_poses(answer)[0].is_free]
    if not free:
        print(f"{name:20} none of {len(answers)} grasps has a free way in", flush=True)
        return np.zeros(4, int)
    outcomes, checks = [], []
    for answer in free:
        model, wrenches = GripperModel(answer, pieces, FRICTION), hard_wrenches(answer)
        checks.append(model.check_pose())
        forces = model.poses.force, answer.grip_force, 0.5 * answer.grip_force
        outcomes.append([model.holds(force, wrenches) for force in forces])
    held = np.array(outcomes)
    counts = np.array([len(held), held[:, 0].sum(), held[:, 1].sum(), (~held[:, 2]).sum()])
    pad, opened, depth, tilt = 1e3 * np.max([[c.pad, c.opened, c.depth, c.tilt] for c in checks], axis=0)
    trials = f"{counts[0]:6} {solution.grip_force:8.1f} {counts[1]:17} {counts[2]:5} {counts[3]:13}"
    distances = f"{pad:12.3f} {opened:14.3f} {depth:9.3f} {tilt:10.2f}"
    print(f"{name:20} {trials} {distances} {time.process_time() - start_time:6.0f}", flush=True)
    return counts
