"""Random points and projections on faces of bodies, independent of surface cells.

For each face ``draw(count, rng)`` returns random points, concentrated at edges and corners, ``nearest(points)`` nearest
or nearby points of the face, and ``inward(points)`` inward unit normals.
"""

from dataclasses import dataclass

import numpy as np

import nlpgrasp as ng


@dataclass(frozen=True)
class FlatFace:
    """Convex polygon in a plane, or segment."""

    corners: np.ndarray  # (m, space), in order
    normal: np.ndarray

    def draw(self, count, rng):
        concentrated = rng.choice([0.05, 0.3, 1.0], count)
        shares = np.array([rng.dirichlet(np.full(len(self.corners), c)) for c in concentrated])
        return shares @ self.corners

    def nearest(self, points):
        points = points - ((points - self.corners[0]) @ self.normal)[:, None] * self.normal
        begin, end = self.corners, np.roll(self.corners, -1, axis=0)
        if len(self.corners) == 2:
            return _on_segments(points, begin[:1], end[:1])
        across = np.cross(self.normal, end - begin)  # all into the polygon or all out of it
        sides = np.einsum("mes,es->me", points[:, None] - begin, across)
        inside = np.all(sides <= 0.0, axis=1) | np.all(sides >= 0.0, axis=1)
        return np.where(inside[:, None], points, _on_segments(points, begin, end))

    def inward(self, points):
        return np.tile(self.normal, (len(points), 1))


def _on_segments(points, begin, end):
    along = end - begin
    t = np.einsum("mes,es->me", points[:, None] - begin, along) / np.sum(along**2, axis=1)
    projections = begin + np.clip(t, 0.0, 1.0)[..., None] * along
    return projections[np.arange(len(points)), np.argmin(np.linalg.norm(projections - points[:, None], axis=2), axis=1)]


@dataclass(frozen=True)
class EllipsoidSurface:
    """Surface of an ellipsoid, with central projection."""

    a: np.ndarray

    def draw(self, count, rng):
        u = rng.standard_normal((count, 3)) * rng.choice([1.0, 1.0, 0.1], (count, 3))
        return self.nearest(u * self.a)

    def nearest(self, points):
        return points / np.linalg.norm(points / self.a, axis=1, keepdims=True)

    def inward(self, points):
        return _unit(-points / self.a**2)


@dataclass(frozen=True)
class CylinderSide:
    """Side of a cylinder."""

    radius: float
    half: float

    def draw(self, count, rng):
        phi = rng.uniform(-np.pi, np.pi, count)
        z = np.clip(rng.uniform(-1.3, 1.3, count), -1.0, 1.0) * self.half
        return np.stack([self.radius * np.cos(phi), self.radius * np.sin(phi), z], axis=1)

    def nearest(self, points):
        flat = self.radius * _unit(points[:, :2])
        return np.column_stack([flat, np.clip(points[:, 2], -self.half, self.half)])

    def inward(self, points):
        return np.column_stack([-_unit(points[:, :2]), np.zeros(len(points))])


@dataclass(frozen=True)
class CylinderEnd:
    """Top or bottom of a cylinder."""

    radius: float
    z: float

    def draw(self, count, rng):
        phi, r = rng.uniform(-np.pi, np.pi, count), self.radius * np.sqrt(np.minimum(1.0, rng.uniform(0, 1.5, count)))
        return np.stack([r * np.cos(phi), r * np.sin(phi), np.full(count, self.z)], axis=1)

    def nearest(self, points):
        far = np.linalg.norm(points[:, :2], axis=1, keepdims=True)
        flat = points[:, :2] * np.minimum(1.0, self.radius / np.maximum(far, 1e-300))
        return np.column_stack([flat, np.full(len(points), self.z)])

    def inward(self, points):
        return np.tile([0.0, 0.0, -np.sign(self.z)], (len(points), 1))


@dataclass(frozen=True)
class TorusSurface:
    """Surface of a torus."""

    major: float
    minor: float

    def draw(self, count, rng):
        phi, psi = rng.uniform(-np.pi, np.pi, (2, count))
        r = self.major + self.minor * np.cos(psi)
        return np.stack([r * np.cos(phi), r * np.sin(phi), self.minor * np.sin(psi)], axis=1)

    def _middle(self, points):
        return np.column_stack([self.major * _unit(points[:, :2]), np.zeros(len(points))])

    def nearest(self, points):
        middle = self._middle(points)
        return middle + self.minor * _unit(points - middle)

    def inward(self, points):
        return _unit(self._middle(points) - points)


def _unit(v):
    return v / np.maximum(np.linalg.norm(v, axis=1, keepdims=True), 1e-300)


def faces_of(body):
    """Return names and faces of a body; of a mesh one face per triangle, all of the same name."""
    if isinstance(body, ng.Sphere):
        return [("surface", EllipsoidSurface(np.full(3, float(body.radius))))]
    if isinstance(body, ng.Ellipsoid):
        return [("surface", EllipsoidSurface(np.array(body.semi_axes, dtype=float)))]
    if isinstance(body, ng.Torus):
        return [("surface", TorusSurface(body.major_radius, body.minor_radius))]
    if isinstance(body, ng.Cylinder):
        half = body.height / 2.0
        return [
            ("side", CylinderSide(body.radius, half)),
            ("top", CylinderEnd(body.radius, half)),
            ("bottom", CylinderEnd(body.radius, -half)),
        ]
    if isinstance(body, ng.Mesh):
        pairs = zip(body.mesh.triangles, body.mesh.face_normals, strict=True)
        return [("surface", FlatFace(np.asarray(corners), -np.asarray(normal))) for corners, normal in pairs]
    if isinstance(body, ng.Polygon):
        return [
            (f"edge{i}", FlatFace(ends, n)) for i, (ends, n) in enumerate(_edges(np.array(body.vertices, dtype=float)))
        ]
    return _box(body) if isinstance(body, ng.Box) else _prism(body)


def _edges(corners):
    """Return ends and inward normals of a polygon's edges, in order."""
    x, y = corners.T
    orientation = np.sign(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y))
    result = []
    for begin, end in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        along = (end - begin) / np.linalg.norm(end - begin)
        result.append((np.array([begin, end]), orientation * np.array([-along[1], along[0]])))
    return result


def _box(body):
    half, result = np.array(body.extents, dtype=float) / 2.0, []
    for axis in range(3):
        for sign in (1.0, -1.0):
            other_axes = [i for i in range(3) if i != axis]
            corners = np.zeros((4, 3))
            corners[:, axis] = sign * half[axis]
            corners[:, other_axes] = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]]) * half[other_axes]
            result.append((("+" if sign > 0 else "-") + "xyz"[axis], FlatFace(corners, -sign * np.eye(3)[axis])))
    return result


def _prism(body):
    outline, half, result = np.array(body.polygon, dtype=float), body.height / 2.0, []
    for i, (ends, normal) in enumerate(_edges(outline)):
        corners = np.array([[*ends[0], -half], [*ends[1], -half], [*ends[1], half], [*ends[0], half]])
        result.append((f"side{i}", FlatFace(corners, np.append(normal, 0.0))))
    for name, z in (("top", half), ("bottom", -half)):
        corners = np.column_stack([outline, np.full(len(outline), z)])
        result.append((name, FlatFace(corners, np.array([0.0, 0.0, -np.sign(z)]))))
    return result
