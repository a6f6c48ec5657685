"""Contact paths over a body's surface: shortest paths, their refinement, transfer of a finger along them.

A shortest path in a graph of surface samples gives the first stations (``SurfaceGraph``). ``ContactPath`` refines them;
``FingerTransfer`` adds lifting off and setting down.

Between two stations the contact moves on the chord. On a surface with radius of curvature rho, a chord of length h is
off the surface by at most ``h^2 / (8 rho)``. Instead of estimating rho, the chord's middle is projected onto the
surface; chords whose middle is off by more than a share of the tolerance, or over which the normal turns by more than
``MAX_TURN``, are halved, which quarters the error. At an edge between two faces the contact stops, and its normal
turns from one face's to the other's: the fingertip rolls over the edge.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import cKDTree

from nlpgrasp.bodies import Body
from nlpgrasp.common.validation import FloatArray

MAX_TURN = np.radians(10.0)  # largest turn of the normal over a chord
ROUNDING = 1e-12  # of cosines
SAME_POINT = 1e-9  # share of the body's size within which two stations are at one point
LEVELS = 8  # largest number of halvings of a chord
MIDDLE_SHARE = 0.25  # share of the tolerance allowed at a chord's middle
NEWTON_STEPS = 20  # largest number of Newton steps to the point of an edge
SLIDING, LIFTING_OFF, LIFTED, SETTING_DOWN = "sliding", "lifting off", "lifted", "setting down"  # phases
SAMPLES, NEIGHBOURS = 3000, 14  # samples in the graph, in all; edges from each
LARGEST_GAP = 0.3  # share of a graph edge's length: largest distance of its middle from the surface


@dataclass(frozen=True)
class PathStation:
    """Point of a contact path: position, inward unit normal and face."""

    point: FloatArray
    normal: FloatArray
    face: str


class SurfaceGraph:
    """Graph of surface samples, with edges between neighbours that stay near the surface.

    Parameters
    ----------
    body : Body
    """

    def __init__(self, body: Body) -> None:
        rng = np.random.default_rng(0)
        count = max(SAMPLES // len(body.faces), 60)
        samples = {name: body.sample(name, count, rng) for name in body.face_names}
        self.points = np.concatenate(list(samples.values()))
        self.normals = np.concatenate([-body.evaluate(name, p)[2] for name, p in samples.items()])
        self.faces = np.repeat(list(samples), [len(p) for p in samples.values()])
        self._tree: Any = cKDTree(self.points)
        neighbours: Any = self._tree.query(self.points, NEIGHBOURS + 1)
        starts = np.repeat(np.arange(len(self.points)), NEIGHBOURS)
        lengths, ends = (result[:, 1:].ravel() for result in neighbours)
        middle = (self.points[starts] + self.points[ends]) / 2.0
        offsets = np.abs(body.distances(middle)[0][:, 0])
        is_near = offsets <= LARGEST_GAP * lengths
        shape = (len(self.points), len(self.points))
        self._edges: Any = sparse.csr_matrix((lengths[is_near], (starts[is_near], ends[is_near])), shape)

    def distances(self, start: FloatArray, ends: FloatArray) -> FloatArray:
        """Return the lengths of the shortest paths from a point to others, (m,), metres; inf without a path."""
        lengths = dijkstra(self._edges, False, self._nearest(start))
        return np.asarray(lengths[self._tree.query(ends)[1]])

    def stations(self, start: PathStation, end: PathStation) -> list[PathStation]:
        """Return the shortest path between two stations as a list of stations, both included."""
        indices = self._nodes(start.point, end.point)[1:-1]
        return [start, *(PathStation(self.points[i], self.normals[i], str(self.faces[i])) for i in indices), end]

    def _nodes(self, start: FloatArray, end: FloatArray) -> list[int]:
        """Return the indices of the sample points on the shortest path between two points."""
        a, b = self._nearest(start), self._nearest(end)
        _, predecessors = dijkstra(self._edges, False, a, True)
        nodes = [b]
        while nodes[-1] != a and predecessors[nodes[-1]] >= 0:
            nodes.append(int(predecessors[nodes[-1]]))
        return nodes[::-1] if len(nodes) > 1 else [a, b]

    def _nearest(self, p: FloatArray) -> Any:
        return self._tree.query(p)[1]


class ContactPath:
    """Path of a contact over a body's surface, refined to a tolerance.

    Parameters
    ----------
    body : Body
    stations : sequence of PathStation
        At least two: the first and the last are the contacts themselves.
    arm : float
        Path length per radian of the normal, metres: the fingertip's radius plus its lift.
    tolerance : float
        Metres.
    most_turn : float
        Largest turn of the normal over a chord, radians.

    Attributes
    ----------
    points, normals : (m, space) arrays
    steps : (m,) array
        Path length up to each station, metres, rotations of the normal included.
    lengths : (m,) array
        Arc length on the surface alone.
    """

    def __init__(
        self,
        body: Body,
        stations: Sequence[PathStation],
        arm: float,
        tolerance: float,
        most_turn: float = MAX_TURN,
    ) -> None:
        refined = _refine_stations(body, _add_edge_stations(body, stations), MIDDLE_SHARE * tolerance, most_turn)
        self.body, self.stations, self.most_turn = body, refined, most_turn
        self.points = np.array([s.point for s in refined])
        self.normals = np.array([s.normal for s in refined])
        chords = np.linalg.norm(np.diff(self.points, axis=0), axis=1)
        cosines = np.clip(np.sum(self.normals[1:] * self.normals[:-1], axis=1), -1.0, 1.0)
        self.lengths = np.concatenate([[0.0], np.cumsum(chords)])
        self.steps = np.concatenate([[0.0], np.cumsum(chords + arm * np.arccos(cosines))])

    @property
    def total(self) -> float:
        """Length of the whole path, metres, to which rotations of the normal add ``arm`` per radian."""
        return float(self.steps[-1])

    @property
    def edges(self) -> FloatArray:
        """Path lengths, metres, at which the contact reaches an edge, and at which it has rolled over the edge."""
        rolls = np.concatenate([[False], (np.diff(self.lengths) == 0.0) & (np.diff(self.steps) > 0.0), [False]])
        return np.asarray(self.steps[rolls[1:] != rolls[:-1]])

    def deviations(self) -> FloatArray:
        """Return the deviations of the surface from the chords, (m - 1, 2): of points, metres, and of unit normals.

        They are twice the deviations of the chord's middle from the surface there. They are infinite where a chord
        leads from one face to another, and where the normal turns too far over it although it has been halved most
        often, as at a cusp.
        """
        pairs = list(itertools.pairwise(self.stations))
        middles = _middle_stations(self.body, pairs)
        means = np.array([a.normal + b.normal for a, b in pairs])
        means /= np.maximum(np.linalg.norm(means, axis=1, keepdims=True), 1e-12)
        off_point = np.linalg.norm(
            np.array([m.point for m in middles]) - (self.points[1:] + self.points[:-1]) / 2, axis=1
        )
        off_normal = np.linalg.norm(np.array([m.normal for m in middles]) - means, axis=1)
        result = 2.0 * np.column_stack([off_point, off_normal])
        rolls = np.linalg.norm(np.diff(self.points, axis=0), axis=1) <= SAME_POINT * self.body.size
        result[rolls] = 0.0
        cosines = np.sum(self.normals[1:] * self.normals[:-1], axis=1)
        is_unknown = np.array([a.face != b.face for a, b in pairs]) | ~(cosines >= np.cos(self.most_turn) - ROUNDING)
        result[~rolls & is_unknown] = np.inf
        return result

    def at(self, path_length: float) -> tuple[FloatArray, FloatArray, float]:
        """Return point, inward unit normal and arc length on the surface at a given path length."""
        i = int(np.clip(np.searchsorted(self.steps, path_length, side="right") - 1, 0, len(self.steps) - 2))
        span = self.steps[i + 1] - self.steps[i]
        fraction = float(np.clip((path_length - self.steps[i]) / span, 0.0, 1.0)) if span > 0.0 else 1.0
        p, n, length = (
            (1.0 - fraction) * a[i] + fraction * a[i + 1] for a in (self.points, self.normals, self.lengths)
        )
        return p, n / np.linalg.norm(n), float(length)


@dataclass(frozen=True)
class FingerTransfer:
    """Transfer of a finger to a new contact: lifting off, moving over the surface, setting down.

    Parameters
    ----------
    path : ContactPath
    lift : float
        Height of the fingertip above the surface, metres; 0 for sliding.
    """

    path: ContactPath
    lift: float

    @property
    def total(self) -> float:
        """Total path length, metres, lifting and setting down included."""
        return self.path.total + 2.0 * self.lift

    @property
    def phase_changes(self) -> tuple[float, ...]:
        """Path lengths, metres, at which the phase changes."""
        changes = (self.lift, self.lift + self.path.total) if self.lift else ()
        return (*changes, self.total)

    def at(self, path_length: float) -> TargetContact:
        """Return the target contact at a given path length, metres."""
        length = self.path.total
        point, normal, along = self.path.at(min(max(path_length - self.lift, 0.0), length))
        if not self.lift:
            return TargetContact(point, normal, along, SLIDING)
        height = max(min(path_length, self.lift, self.total - path_length), 0.0)
        phase = LIFTING_OFF if path_length < self.lift else SETTING_DOWN if path_length > self.lift + length else LIFTED
        return TargetContact(point - height * normal, normal, along, phase, height)


@dataclass(frozen=True)
class TargetContact:
    """Target contact of a fingertip at one point of its path.

    Parameters
    ----------
    point, normal : (space,) array
        Metres, body frame, and inward unit normal; for a lifted fingertip, the point is above the surface.
    along : float
        Arc length on the surface up to here, metres.
    phase : {"sliding", "lifting off", "lifted", "setting down"}
    height : float
        Height above the surface, metres.
    """

    point: FloatArray
    normal: FloatArray
    along: float
    phase: str
    height: float = 0.0


def _add_edge_stations(body: Body, stations: Sequence[PathStation]) -> list[PathStation]:
    """Return the stations with two more at each crossed edge: one with the normal of each face."""
    result = [stations[0]]
    for a, b in itertools.pairwise(stations):
        if a.face != b.face:
            result += _edge_point(body, a, b)
        result.append(b)
    return result


def _edge_point(body: Body, a: PathStation, b: PathStation) -> list[PathStation]:
    """Return the stations where a path crosses the edge of two faces, one per face; an empty list on failure."""
    p, distance = (a.point + b.point) / 2.0, float(np.linalg.norm(a.point - b.point))
    start = p
    for _ in range(NEWTON_STEPS):
        h, normals = _face_distances(body, (a.face, b.face), p)
        step = np.linalg.lstsq(normals, h, rcond=1e-6)[0]
        p = p - step
        if np.linalg.norm(step) < 1e-12 * body.size:
            break
    h, normals = _face_distances(body, (a.face, b.face), p)
    if np.max(np.abs(h)) > 1e-6 * body.size or np.linalg.norm(p - start) > 2.0 * distance:
        return []
    return [PathStation(p, -n, s.face) for n, s in zip(normals, (a, b), strict=True)]


def _face_distances(body: Body, faces: Sequence[str], p: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the first-order distance of a point from each face, and each face's outward normal."""
    evaluations = [body.evaluate(face, p[None]) for face in faces]
    distances = [h[0] / max(slope[0], 1e-12) for h, slope, _, _ in evaluations]
    return np.array(distances), np.array([normal[0] for _, _, normal, _ in evaluations])


def _refine_stations(body: Body, stations: list[PathStation], tolerance: float, most_turn: float) -> list[PathStation]:
    """Return the stations with others inserted, until chords are near the surface and normals turn little."""
    is_fine = [False] * (len(stations) - 1)
    for _ in range(LEVELS):
        coarse = [i for i, fine in enumerate(is_fine) if not fine]
        if not coarse:
            break
        middles = _middle_stations(body, [(stations[i], stations[i + 1]) for i in coarse])
        refined, flags = [stations[0]], []
        for i, fine in enumerate(is_fine):
            a, b = stations[i], stations[i + 1]
            if not fine:
                middle = middles[coarse.index(i)]
                offset = float(np.linalg.norm(middle.point - (a.point + b.point) / 2.0))
                turn = float(np.arccos(np.clip(a.normal @ b.normal, -1.0, 1.0)))
                fine = offset <= tolerance and turn <= most_turn
                if not fine:
                    refined.append(middle)
                    flags.append(False)
            flags.append(fine)
            refined.append(b)
        stations, is_fine = refined, flags
    return stations


def _middle_stations(body: Body, pairs: Sequence[tuple[PathStation, PathStation]]) -> list[PathStation]:
    """Return a station half way between each pair, on the surface or on an edge."""
    middles = np.array([(a.point + b.point) / 2.0 for a, b in pairs])
    lengths = np.array([np.linalg.norm(a.point - b.point) for a, b in pairs])
    normals = np.array([a.normal + b.normal for a, b in pairs])
    normals /= np.maximum(np.linalg.norm(normals, axis=1), 1e-12)[:, None]
    faces = [a.face for a, _ in pairs]
    on_one_face = np.array([a.face == b.face for a, b in pairs]) & (lengths > SAME_POINT * body.size)
    for face in set(faces):
        indices = np.flatnonzero(on_one_face & np.array([f == face for f in faces]))
        if len(indices):
            middles[indices] = body.snap(face, middles[indices])
            normals[indices] = -body.evaluate(face, middles[indices])[2]
    return [PathStation(p, n, face) for p, n, face in zip(middles, normals, faces, strict=True)]
