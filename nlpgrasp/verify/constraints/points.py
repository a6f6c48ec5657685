"""Numeric constraints on contacts and palm: table, spread, workspace, forbidden region, symmetry, approach."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import combinations

import numpy as np

from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray, number
from nlpgrasp.verify.check import NotMadeError
from nlpgrasp.verify.constraints.regions import corners, inside, unit
from nlpgrasp.verify.hands.free import JawNumbers
from nlpgrasp.verify.placement import StatedPlacement
from nlpgrasp.verify.rows import RowValue


def table(data: Json, placement: StatedPlacement) -> Iterator[RowValue]:
    """Yield the height of the lowest point of every fingertip and link, at least the table's plus the clearance."""
    lower = number("height", data["height"]) + number("clearance", data["clearance"], at_least=0.0)
    for i, (tip, radius) in enumerate(zip(placement.tips, placement.radii, strict=True)):
        yield RowValue(f"table, finger {i}", float(tip[-1]) - radius, lower, scale=placement.size)
    for ball in placement.links:
        height = float(ball.centre[-1]) - ball.radius
        yield RowValue(f"table, {ball.name}", height, lower, scale=placement.size, error=placement.error)


def spread(data: Json, placement: StatedPlacement) -> Iterator[RowValue]:
    """Yield the squared distance of each pair of contacts."""
    least, most = number("min", data["min"], at_least=0.0), data["max"]
    upper = np.inf if most is None else number("max", most) ** 2
    for i, j in combinations(sorted(_fingers(data, placement)), 2):
        squared = float(np.sum((placement.points[i] - placement.points[j]) ** 2))
        yield RowValue(f"spread, fingers {i} and {j}", squared, least**2, upper, placement.size**2)


def workspace(data: Json, placement: StatedPlacement) -> Iterator[RowValue]:
    """Yield the coordinates of contacts or palm in a box, or their depth in another region."""
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
            yield RowValue(f"{name}, {axis}", value, low, high, placement.size)


def forbid(data: Json, placement: StatedPlacement) -> Iterator[RowValue]:
    """Yield each contact's depth in a forbidden region, at most zero; forbidden faces give no constraints."""
    region = data.get("region")
    if region is not None:
        points = {f"forbidden region, finger {i}": point for i, point in enumerate(placement.points)}
        yield from _depths(region, points, placement, -np.inf, 0.0)


def symmetric(data: Json, placement: StatedPlacement) -> Iterator[RowValue]:
    """Yield the difference of mirror image and contact, by coordinate."""
    i, j = (int(f) for f in data["fingers"])
    a, b = placement.points[i], placement.points[j]
    normal = unit("normal", data["normal"], len(a))
    tolerance = number("tolerance", data["tolerance"], above=0.0)
    apart = a - 2.0 * (normal @ a - number("offset", data["offset"])) * normal - b
    for axis, value in zip("xyz", apart.tolist(), strict=False):
        yield RowValue(f"symmetric, fingers {i} and {j}, {axis}", value, -tolerance, tolerance, placement.size)


def approach(data: Json, placement: StatedPlacement) -> Iterator[RowValue]:
    """Yield the cosine of the angle between the palm's direction and the required one.

    For jaws, which may turn about the line between their contacts: the condition that a turn within the angle exists.
    """
    if isinstance(placement.hand, JawNumbers):
        wanted, angle = unit("direction", data["direction"], 3), number("angle", data["angle"])
        if angle < np.pi / 2.0:
            line = placement.points[1] - placement.points[0]
            beyond = float(line @ wanted) ** 2 - float(np.sin(angle)) ** 2 * float(line @ line)
            yield RowValue("approach, palm", beyond, upper=0.0, scale=placement.size**2)
        return
    palm = placement.palm
    if palm.approach is None:
        raise NotMadeError("the file does not record in which direction the palm faces")
    along = float(palm.approach @ unit("direction", data["direction"], 3))
    yield RowValue("approach, palm", along, float(np.cos(number("angle", data["angle"]))), error=palm.error)


def _fingers(data: Json, placement: StatedPlacement) -> Sequence[int]:
    return range(len(placement.points)) if data.get("fingers") is None else [int(i) for i in data["fingers"]]


def _depths(
    region: Json, points: Mapping[str, FloatArray], placement: StatedPlacement, lower: float, upper: float
) -> Iterator[RowValue]:
    """Yield the depths of points in a region; unknown where the region's function is not in the file."""
    unknown = ""
    for name, point in points.items():
        value: float | None = None
        try:
            value = inside(region, point)
        except NotMadeError as reason:
            unknown = str(reason)
        yield RowValue(name, value, lower, upper, placement.size)
    if unknown:
        raise NotMadeError(unknown, every_row=True)
