"""Numeric constraints: values recomputed from the contacts and the hand in a file."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import combinations, count, takewhile

import numpy as np
from scipy.spatial.transform import Rotation

from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray, array, number
from nlpgrasp.errors import InputError
from nlpgrasp.verify.check import NotCheckedError
from nlpgrasp.verify.numeric_hands import NumericJaws
from nlpgrasp.verify.stated_placement import ConstraintValue, StatedPlacement

UNIT = 1e-9  # tolerance of the length of unit vectors


def table(data: Json, placement: StatedPlacement) -> Iterator[ConstraintValue]:
    """Yield the table constraints: height of the lowest point of every fingertip."""
    lower = number("height", data["height"]) + number("clearance", data["clearance"], at_least=0.0)
    for i, (tip, radius) in enumerate(zip(placement.tips, placement.radii, strict=True)):
        yield ConstraintValue(f"table, finger {i}", float(tip[-1]) - radius, lower, scale=placement.size)


def spread(data: Json, placement: StatedPlacement) -> Iterator[ConstraintValue]:
    """Yield the constraints on the squared distance of each pair of contacts."""
    least, most = number("min", data["min"], at_least=0.0), data["max"]
    upper = np.inf if most is None else number("max", most) ** 2
    for i, j in combinations(sorted(_fingers(data, placement)), 2):
        squared = float(np.sum((placement.points[i] - placement.points[j]) ** 2))
        yield ConstraintValue(f"spread, fingers {i} and {j}", squared, least**2, upper, placement.size**2)


def workspace(data: Json, placement: StatedPlacement) -> Iterator[ConstraintValue]:
    """Yield the constraints that keep contacts or palm in a region.

    In a box their coordinates are limited, in other regions their depth.
    """
    if data["palm"]:
        points = {"workspace, palm": placement.palm.position}
    else:
        points = {f"workspace, finger {i}": placement.points[i] for i in _fingers(data, placement)}
    if data["region"]["type"] != "box_region":
        yield from _depths(data["region"], points, placement, 0.0, np.inf)
        return
    lower, upper = (corner.tolist() for corner in corners(data["region"]))
    for name, point in points.items():
        for axis, value, low, high in zip("xyz", point.tolist(), lower, upper, strict=False):
            yield ConstraintValue(f"{name}, {axis}", value, low, high, placement.size)


def forbid(data: Json, placement: StatedPlacement) -> Iterator[ConstraintValue]:
    """Yield the constraints that keep contacts out of a forbidden region; a forbidden face gives none."""
    region = data.get("region")
    if region is not None:
        points = {f"forbidden region, finger {i}": point for i, point in enumerate(placement.points)}
        yield from _depths(region, points, placement, -np.inf, 0.0)


def _depths(
    region: Json, points: Mapping[str, FloatArray], placement: StatedPlacement, lower: float, upper: float
) -> Iterator[ConstraintValue]:
    """Yield the constraints on the depth of each point in a region.

    The depth is unknown if the region's function is not in the file.
    """
    unknown_reason = ""
    for name, point in points.items():
        value: float | None = None
        try:
            value = region_depth(region, point)
        except NotCheckedError as reason:
            unknown_reason = str(reason)
        yield ConstraintValue(name, value, lower, upper, placement.size)
    if unknown_reason:
        raise NotCheckedError(unknown_reason, every_row=True)


def symmetric(data: Json, placement: StatedPlacement) -> Iterator[ConstraintValue]:
    """Yield the constraints on the difference between one contact's mirror image and another contact, by coordinate."""
    i, j = (int(f) for f in data["fingers"])
    a, b = placement.points[i], placement.points[j]
    normal = unit("normal", data["normal"], len(a))
    tolerance = number("tolerance", data["tolerance"], above=0.0)
    difference = a - 2.0 * (normal @ a - number("offset", data["offset"])) * normal - b
    for axis, value in zip("xyz", difference.tolist(), strict=False):
        yield ConstraintValue(f"symmetric, fingers {i} and {j}, {axis}", value, -tolerance, tolerance, placement.size)


def approach(data: Json, placement: StatedPlacement) -> Iterator[ConstraintValue]:
    """Yield the constraint on the angle between the palm's direction and the required one.

    Jaws may turn about the line between their contacts.
    """
    if isinstance(placement.hand, NumericJaws):
        direction, angle = unit("direction", data["direction"], 3), number("angle", data["angle"])
        if angle < np.pi / 2.0:
            line = placement.points[1] - placement.points[0]
            excess = float(line @ direction) ** 2 - float(np.sin(angle)) ** 2 * float(line @ line)
            yield ConstraintValue("approach, palm", excess, upper=0.0, scale=placement.size**2)
        return
    palm = placement.palm
    if palm.approach is None:
        raise NotCheckedError("the file does not record in which direction the palm faces")
    cosine = float(palm.approach @ unit("direction", data["direction"], 3))
    yield ConstraintValue("approach, palm", cosine, float(np.cos(number("angle", data["angle"]))), error=palm.error)


def obstacle(data: Json, placement: StatedPlacement) -> Iterator[ConstraintValue]:
    """Yield the constraints on the distance of every fingertip from an obstacle.

    For a mesh, the solver uses a spline through distances on a grid, and a lower bound far away: the stated value may
    be smaller there, and may exceed the distance to the mesh itself by half a cell.
    """
    surface = placement.surface_of(data["body"])
    clearance, name = number("clearance", data["clearance"], at_least=0.0), str(data["name"])
    for i, (tip, radius) in enumerate(zip(placement.tips, placement.radii, strict=True)):
        value, label = float(surface.distance(to_obstacle_frame(data, tip)[None])[0]), f"{name}, finger {i}"
        error, is_rough = surface.rough, surface.rough > 0.0
        yield ConstraintValue(
            label, value, radius + clearance, scale=placement.size, error=error, stated_below=is_rough
        )


def to_obstacle_frame(data: Json, points: FloatArray) -> FloatArray:
    """Return a point (space,), or points (m, space), of the body's frame in the obstacle's frame."""
    point = points
    if data["position"] is not None:
        point = point - array("position", data["position"], point.shape[-1:])
    return point if data["quaternion_wxyz"] is None else np.asarray(_orientation(data).inv().apply(point))


def to_body_frame(data: Json, points: FloatArray) -> FloatArray:
    """Return points (m, space) of the obstacle's frame in the held body's frame."""
    rotated = points if data["quaternion_wxyz"] is None else np.asarray(_orientation(data).apply(points))
    return rotated if data["position"] is None else rotated + array("position", data["position"], points.shape[-1:])


def _orientation(data: Json) -> Rotation:
    """Return the obstacle's orientation in the held body's frame."""
    return Rotation.from_quat(unit("quaternion_wxyz", data["quaternion_wxyz"], 4), scalar_first=True)


def expression(data: Json, placement: StatedPlacement) -> Iterator[ConstraintValue]:
    """Yield the limits of an expression, with unknown values, and then raise ``NotCheckedError``.

    The expression's function is not in the file.

    Several limits fix the number of scalar constraints; one limit holds for all, whose number is not in the file.
    """
    name, lower, upper = str(data["name"]), list(data["lower"]), list(data["upper"])
    elements = max(len(lower), len(upper))
    numbered = list(takewhile(placement.stated.__contains__, (f"{name}[{i}]" for i in count())))
    if elements > 1:
        labels = [f"{name}[{i}]" for i in range(elements)]
    elif numbered and name in placement.stated:
        raise NotCheckedError(f"the file does not say which rows are those of which {name!r}")
    else:
        labels = numbered or [name] * (name in placement.stated)
    for i, label in enumerate(labels):
        low, high = (ends[i] if len(ends) > 1 else ends[0] for ends in (lower, upper))
        yield ConstraintValue(
            label, None, -np.inf if low is None else float(low), np.inf if high is None else float(high)
        )
    if not labels:
        raise NotCheckedError(f"the file states no row of {name!r}")
    text = f"the expression {name!r} stays in the script that made it; its limits are the problem's"
    raise NotCheckedError(text, every_row=True)


def _fingers(data: Json, placement: StatedPlacement) -> Sequence[int]:
    """Return the indices of the contacts that a constraint applies to."""
    return range(len(placement.points)) if data.get("fingers") is None else [int(i) for i in data["fingers"]]


def region_depth(region: Json, point: FloatArray) -> float:
    """Return the depth of a point (space,) in a region, metres, negative outside.

    In a box, it is the distance to the nearest side.

    Raises
    ------
    NotCheckedError
        On a region given by a script's function: the file contains its text alone.
    """
    if region["type"] == "half_space":
        normal = unit("normal", region["normal"], len(point))
        return float(normal @ point) - number("offset", region["offset"])
    if region["type"] == "box_region":
        lower, upper = corners(region)
        return float(np.min(np.minimum(point - lower, upper - point)))
    raise NotCheckedError(f"a region of type {region['type']!r} stays in the script that made it")


def corners(region: Json) -> tuple[FloatArray, FloatArray]:
    """Return the lower and upper corner of a box region, (space,) each."""
    return array("lower", region["lower"], (None,)), array("upper", region["upper"], (None,))


def unit(field: str, value: object, space: int) -> FloatArray:
    """Return a unit vector (space,) of a file, validated to have length 1."""
    vector = array(field, value, (space,))
    if not abs(float(np.linalg.norm(vector)) - 1.0) <= UNIT:
        raise InputError(field, value, "a vector of length 1")
    return vector
