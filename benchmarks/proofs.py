"""Proofs of bounds on mu: how many grasps are proved, why others are not, and whether better bounds are refused.

``python -m benchmarks proofs:campaign:10000`` takes the grasps of seeds 0 to 9999, ``proofs:campaign:100:5000`` those
from 5000 on.
"""

from __future__ import annotations

import re
import resource
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import nlpgrasp as ng
from tests.hands.urdf import three_finger_hand

KINDS = ("random", "symmetric", "coincident", "flat", "far origin", "slippery", "barely closed", "one side")
SHARES = (0.25, 0.15, 0.1, 0.1, 0.15, 0.1, 0.1, 0.05)
BUDGETS = ("l2", "per_finger", "per_finger_size", "shared")
OUTCOMES = ("proved", "wide", "zero", "upper end", "refused", "not written")
NUMBER = re.compile(r"\(-?\d+\)|[-+]?\d+\.?\d*(e[-+]?\d+)?")
EXACT_SHARE, EXACT_RTOL = 0.05, 1.0  # share of grasps of which the exact checker sees a proof too, and its relative gap
BETTER = 1e-7  # relative improvement of a bound that has to be refused
FINE = 1e-5  # relative gap of the certificate that decides whether a better bound is true


@dataclass(frozen=True)
class Case:
    """A grasp, a task and a budget, with the kind of grasp."""

    kind: str
    grasp: ng.Grasp
    task: ng.Task
    budget: object
    rtol: float


def random_contact(rng: np.random.Generator, space: int, friction: float, size: float) -> ng.ContactModel:
    """Return a contact model of any kind; a pad's size is a tenth of the body's."""
    pad, along = 0.1 * size, rng.normal(size=3)
    planar = [
        lambda: ng.FrictionContact(friction),
        lambda: ng.PointContact(),
        lambda: ng.LineContact(pad, friction),
        lambda: ng.LineContact(pad),
    ]
    spatial = [
        lambda: ng.FrictionContact(friction),
        lambda: ng.PointContact(),
        lambda: ng.SoftContact(friction, friction * pad),
        lambda: ng.SoftContact(friction, friction * pad, model="elliptic"),
        lambda: ng.LineContact(pad, friction, direction=along),
        lambda: ng.PlaneContact(pad, friction=friction),
        lambda: ng.PlaneContact(extents=[pad, 0.5 * pad], friction=friction, direction=along),
        lambda: ng.PlaneContact(pad),
        lambda: ng.BilateralContact(ng.FrictionContact(friction)),
    ]
    choices = planar if space == 2 else spatial
    return choices[rng.integers(len(choices))]()


def random_task(rng: np.random.Generator, dimension: int, size: float) -> ng.Task:
    """Return an ellipsoid, a polytope or a sum, round or over six decades, centred or not, full or flat."""
    space = 2 if dimension == 3 else 3
    unit = np.r_[np.ones(space), np.full(dimension - space, size)]
    if rng.random() < 0.3:
        unit = unit * 10.0 ** rng.uniform(-3.0, 3.0, dimension)
    axes = unit * rng.uniform(0.5, 2.0, dimension)
    if rng.random() < 0.2:
        axes = axes * (rng.random(dimension) < 0.6)
        axes[0] = unit[0]
    centre = unit * rng.normal(size=dimension) * 10.0 ** rng.uniform(-2.0, 1.0) if rng.random() < 0.4 else None
    ellipsoid = ng.TaskEllipsoid(axes, center=centre)
    polytope = ng.TaskPolytope(unit * rng.normal(size=(int(rng.integers(1, 9)), dimension)))
    return (ellipsoid, ellipsoid, polytope, ellipsoid + polytope)[rng.integers(4)]


def random_case(seed: int) -> Case:
    """Return the grasp of a seed, its task, budget and relative gap."""
    rng = np.random.default_rng(seed)
    kind = str(rng.choice(KINDS, p=SHARES))
    space = 2 if rng.random() < 0.25 else 3
    count = int(rng.integers(3, 7))
    size = 10.0 ** rng.uniform(-3.0, 1.0)
    directions = rng.normal(size=(count, space))
    directions[:2] = np.eye(space)[0] * [[1.0], [-1.0]] + 0.3 * directions[:2]  # many grasps squeeze
    if kind == "symmetric":
        angles = 2.0 * np.pi * np.arange(count) / count
        corners = np.array([[1.0, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1], [-1, -1, -1], [1, 1, -1]])
        directions = np.stack([np.cos(angles), np.sin(angles)], axis=1) if space == 2 else corners[:count]
    if kind == "one side":
        directions[:, 0] = np.abs(directions[:, 0]) + 1.0
    if kind == "flat" and space == 3:
        directions[:, 2] = 0.0
    if kind == "barely closed":
        directions[:, 0] *= np.sign(directions[:, 0]) * 10.0 ** rng.uniform(-9.0, -1.0)
        directions[0, 0] = -np.linalg.norm(directions[0])
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    radii = np.ones(space) if kind == "symmetric" else rng.uniform(0.3, 1.0, space)
    points, normals = size * radii * directions, -directions / radii
    normals = normals / np.linalg.norm(normals, axis=1, keepdims=True)
    if kind == "coincident":
        points[1], normals[1] = points[0] + 1e-9 * size * rng.normal(size=space), normals[0]
    if kind == "random":
        normals = normals + 0.3 * rng.normal(size=normals.shape)
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    origin = size * rng.normal(size=space) * (10.0 ** rng.uniform(1.0, 5.0) if kind == "far origin" else 0.3)
    friction = 10.0 ** rng.uniform(-10.0, -1.0) if kind == "slippery" else rng.uniform(0.2, 1.2)
    contacts = [ng.FrictionContact(friction)] * count
    if rng.random() < 0.5:
        contacts = [random_contact(rng, space, friction, size) for _ in range(count)]
    grasp = ng.Grasp(points, normals, contacts, origin)
    task = random_task(rng, grasp.dimension, size)
    rtol = float(rng.choice([0.3, 0.3, 0.3, 0.1] if space == 3 else [0.3, 0.1, 0.01]))
    return Case(kind, grasp, task, random_budget(rng, grasp), rtol)


def random_budget(rng: np.random.Generator, grasp: ng.Grasp) -> object:
    """Return a budget by name, or joint torques: of fingers without common joints, or of a three-finger hand."""
    has_bilateral = any(isinstance(contact, ng.BilateralContact) for contact in grasp.contacts)
    choice = rng.random()
    if choice < 0.7 or has_bilateral:
        return "l2" if has_bilateral else str(rng.choice(BUDGETS))
    if choice < 0.85 or len(grasp) != 3 or grasp.space == 2:
        rows = 6 if grasp.space == 3 else 3
        jacobians = [rng.normal(size=(rows, 4)) for _ in range(len(grasp))]
        return ng.JointTorqueLimits(jacobians, 10.0 ** rng.uniform(-1.0, 1.0))
    hand = three_finger_hand()
    joints = {joint.name: float(rng.uniform(0.0, 1.0)) for joint in hand.tree.robot.free_joints}
    pose = {"position": rng.normal(size=3) * 0.1, "quaternion_wxyz": rng.normal(size=4)}
    pose["quaternion_wxyz"] /= np.linalg.norm(pose["quaternion_wxyz"])
    return ng.hand_torque_limits(hand, {"joint_positions": joints, "palm_pose": pose}, grasp.points)


def children_seconds() -> float:
    """Return the processor seconds of all ended child processes."""
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    return usage.ru_utime + usage.ru_stime


def outcome(case: Case, path: Path, data: dict[str, list[float]]) -> tuple[str, str]:
    """Return what came of the proof of a case, one of ``OUTCOMES``, and its bounds or the reason why there is none."""
    start = time.process_time()
    try:
        bounds = ng.write_proof(case.grasp, case.task, path, case.rtol, force_budget=case.budget)
    except ng.InputError as error:
        return "not written", str(error)
    data["s of writing"].append(time.process_time() - start)
    start = children_seconds()
    checked = ng.check_proof(path, "c")
    data["s of checking"].append(children_seconds() - start)
    if not checked:
        return "refused", f"{bounds}: {checked.reason}"
    data["kB"].append(path.stat().st_size / 1e3)
    if checked.lower > 0.0:
        data["mu"].append(checked.lower)
        is_wide = checked.upper > checked.lower * (1.0 + case.rtol)
        return "wide" if is_wide else "proved", f"gap {checked.upper / checked.lower - 1.0:.2g} for {case.rtol:g}"
    if checked.upper == 0.0:
        return "zero", ""
    certified = ng.mu(case.grasp, case.task, case.rtol, force_budget=case.budget)
    text = f"certified {certified}, {certified.limit or certified.trust or 'in real arithmetic'}"
    return "upper end", f"[0, {checked.upper:.3g}]: {text}"


def better_bounds(case: Case, path: Path, rng: np.random.Generator) -> Iterator[str]:
    """Yield for either end of a proved interval whether a better one is refused, and if not whether it is true."""
    checked, data = ng.check_proof(path, "c"), path.read_bytes()
    stated = (checked.lower, checked.upper)
    for end, pair in {
        "lower": (stated[0] * (1.0 + BETTER), stated[1] * (1.0 + BETTER)),
        "upper": (stated[0] * (1.0 - BETTER), stated[1] * (1.0 - BETTER)),
    }.items():
        path.write_bytes(data.replace(_bounds_line(*stated), _bounds_line(*pair)))
        if not ng.check_proof(path, "c"):
            yield f"{end} end refused"
            continue
        fine = ng.mu(case.grasp, case.task, FINE, force_budget=case.budget)
        beta = 1.0 if case.task.paper_beta is None else case.task.paper_beta
        is_true = pair[0] * beta <= fine.upper if end == "lower" else pair[1] * beta >= fine.lower
        yield f"{end} end accepted, {'may be true' if is_true else f'FALSE: {pair} of {fine}'}"
    if rng.random() < EXACT_SHARE:
        ng.write_proof(case.grasp, case.task, path, EXACT_RTOL, force_budget=case.budget)
        answers = [bool(ng.check_proof(path, checker)) for checker in ("c", "python")]
        yield f"checkers {'agree' if answers[0] == answers[1] else 'DIFFER'}"


def campaign(count: int, first: int) -> None:
    """Print proved grasps by kind and budget, reasons of the others, sizes and seconds; Ctrl-C ends it earlier."""
    path = Path(tempfile.mkdtemp()) / "g.proof"
    table: dict[str, Counter[str]] = {}
    reasons, better, faults = Counter(), Counter(), []
    data: dict[str, list[float]] = {"kB": [], "mu": [], "s of writing": [], "s of checking": []}
    done = 0
    try:
        for seed in range(first, first + count):
            case = random_case(seed)
            result, reason = outcome(case, path, data)
            budget = case.budget if isinstance(case.budget, str) else type(case.budget).__name__
            for name in (case.kind, budget, "all"):
                table.setdefault(name, Counter())[result] += 1
            if result not in ("proved", "zero"):
                reasons[f"{result}: {NUMBER.sub('', reason)[:100]}"] += 1
            if result in ("refused", "upper end"):
                faults.append(f"seed {seed}, {case.kind}, {budget}: {result}: {reason}")
            if result in ("proved", "wide"):
                for answer in better_bounds(case, path, np.random.default_rng([seed, 1])):
                    better[answer[:40]] += 1
                    faults += [f"seed {seed}: {answer}"] if "FALSE" in answer or "DIFFER" in answer else []
            done += 1
    except KeyboardInterrupt:
        pass
    print(f"{done} grasps from seed {first}")
    print(f"{'':24}", *(f"{name:>12}" for name in OUTCOMES))
    for name, row in sorted(table.items()):
        print(f"{name:24}", *(f"{row[result]:12}" for result in OUTCOMES))
    print("reasons:", *(f"  {number:6} {text}" for text, number in reasons.most_common()), sep="\n")
    print("bounds better by 1e-7:", *(f"  {number:6} {text}" for text, number in sorted(better.items())), sep="\n")
    for unit, values in data.items():
        if values:
            low, median, most, high = np.quantile(values, [0.0, 0.5, 0.99, 1.0])
            print(f"{unit}: least {low:.3g}, median {median:.3g}, 99 % below {most:.3g}, at most {high:.3g}")
    print(*faults, sep="\n")


def _bounds_line(lower: float, upper: float) -> bytes:
    return f"\nbounds {lower!r} {upper!r}\n".encode()


def run(part: str = "campaign", count: str = "1000", first: str = "0") -> None:
    """Run a part of the benchmark."""
    {"campaign": campaign}[part](int(count), int(first))
