"""Checks of a set's rows against each other: starts that are all there, grasps that are distinct, simulation labels."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import chain

import numpy as np
from scipy.optimize import linear_sum_assignment
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation

from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray
from nlpgrasp.hands import URDFHand
from nlpgrasp.optimize.grasp_equivalence import POSE
from nlpgrasp.sets.grasp_rows import FLAGS, GRASP, NOT_SIMULATED, VECTORS, Row
from nlpgrasp.sets.grasp_unit import UNIT
from nlpgrasp.simulation.hand_protocol import HoldTest
from nlpgrasp.simulation.hand_world import STRICT, Motion


def start_faults(units: Mapping[int | None, Sequence[Row]], settings: Json) -> Iterator[str]:
    """Yield sentences on starts of a problem that are missing, repeated or moved, and on rows of another seed.

    Parameters
    ----------
    units : mapping
        Rows of each file of the problem by the number of its unit, in order; None for the file of a finished problem.
    settings : mapping
        Of the set.
    """
    wanted, most, count = int(settings["grasps_per_problem"]), int(settings["starts"]), 0
    for unit, rows in units.items():
        first = 0 if unit is None else UNIT * unit
        end = most if unit is None else min(first + UNIT, most)
        starts = [row["start"] for row in rows]
        count += sum(row["status"] == GRASP for row in rows)
        expected = list(range(first, first + len(rows)))
        if starts != expected:
            missing = sorted({*expected} - {*starts})
            repeated = sorted({start for start in starts if starts.count(start) > 1}, key=str)
            found = f"start {missing[0]} missing" if missing else "starts in another order"
            yield f"start {repeated[0]} repeated, {found}" if repeated else found
        elif len(rows) > end - first or (len(rows) < end - first and count < wanted):
            yield f"{len(rows)} starts with {count} of the {wanted} grasps wanted, and not all {end - first}"
        elif unit is None and (count > wanted or (len(rows) < most and rows and rows[-1]["status"] != GRASP)):
            yield f"{count} of the {wanted} grasps wanted, and starts after the last of them"
    for row in chain.from_iterable(units.values()):
        if row["seed"] != settings["seed"]:
            yield f"start {row['start']} with seed {row['seed']}, not {settings['seed']}"


def label_fault(row: Row, problem: Json) -> str:
    """Return how the labels of a row's simulation contradict each other or its problem; empty if they do not."""
    if row["status"] != GRASP:
        stated = [name for name in (*FLAGS, *VECTORS, "mu_lower", "slip", "turn") if row[name] not in (None, False)]
        return f"{stated[0]} of a start without a grasp" if stated and row["mu_lower"] is None else ""
    if not row["simulated"]:
        is_stated = row["held"] or row["caged"] or row["slip"] is not None or row["turn"] is not None
        if is_stated or not str(row["verdict"]).startswith(NOT_SIMULATED):
            return "an outcome of a simulation that was not run"
        return ""
    if (problem.get("hand") or {}).get("type") != URDFHand.kind or not row["has_squeeze"]:
        return "a simulation of a grasp without a hand with joints that squeezes"
    numbers = row["slip"], row["turn"], row["simulation_cpu_seconds"]
    if not all(isinstance(value, float) and value >= 0.0 for value in numbers) or not row["simulation_cpu_seconds"]:
        return "a simulation without the motion that it found, or its time"
    motion = Motion(float(str(row["slip"])), float(str(row["turn"])))
    is_held, is_caged = bool(row["held"]), bool(row["caged"])
    agrees = row["verdict"] == HoldTest(is_held, is_caged, motion).verdict and (is_held or not is_caged)
    return "" if agrees and is_held == motion.within(STRICT) else "a verdict that its motion contradicts"


def repeated_grasps(rows: Sequence[Row], problem: Json, distinct: float) -> Iterator[tuple[int, int]]:
    """Yield pairs of rows, the earlier first, whose grasps are not distinct.

    Contacts of equal models can be matched within ``distinct`` over the size of the contacts' bounding box, which is at
    most the body's, and palms are no farther apart than that. Symmetries are not considered.
    """
    contacts = problem["contacts"]
    if len(rows) < 2:
        return
    points = np.array([row["contact_points"] for row in rows], dtype=float).reshape(len(rows), len(contacts), -1)
    limit = 0.5 * distinct * float(np.linalg.norm(np.ptp(points.reshape(-1, points.shape[2]), axis=0)))
    mismatch = np.array([[0.0 if a == b else np.inf for b in contacts] for a in contacts])
    for i, j in sorted(KDTree(points.mean(axis=1)).query_pairs(limit + 1e-12)):
        within = np.linalg.norm(points[i][:, None] - points[j][None], axis=2) + mismatch <= limit
        matched = within[linear_sum_assignment(~within)].all()
        if matched and not _palms_apart(rows[i], rows[j], limit):
            yield i, j


def _palms_apart(a: Row, b: Row, limit: float) -> bool:
    """Return whether the palm poses of two grasps are distinct."""
    if not a["has_pose"]:
        return False
    p, q = (np.array(row["grasp_qpos"], dtype=float)[:7] for row in (a, b))
    turn = (_rotation(p) * _rotation(q).inv()).magnitude()
    return bool(np.linalg.norm(p[:3] - q[:3]) > limit or turn > POSE)


def _rotation(qpos: FloatArray) -> Rotation:
    return Rotation.from_quat(qpos[3:], scalar_first=True)
