"""Random cells of every kind, and random points in them by independent formulas."""

import casadi as ca
import numpy as np
import trimesh

import nlpgrasp as ng
from nlpgrasp.bodies.chart import Chart
from nlpgrasp.common.spatial import tangents
from nlpgrasp.global_bound.cells.chart_cells import ChartCell, ChartSurface
from nlpgrasp.global_bound.cells.ellipsoid_cells import EllipsoidCell, EllipsoidSurface
from nlpgrasp.global_bound.cells.flat_cells import PolygonCell
from nlpgrasp.global_bound.cells.mesh_cells import ClusterTree, TriangleCluster
from nlpgrasp.global_bound.cells.revolved_cells import RevolvedCell, RevolvedSurface, SectorCell


def polygon_cell(rng):
    normal = rng.standard_normal(3)
    normal /= np.linalg.norm(normal)
    axes = tangents(normal[None])[0]
    angles = np.sort(rng.uniform(0, 2 * np.pi, 5))
    polygon = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    return PolygonCell(rng.standard_normal(3) + polygon @ axes, normal, axes)


def ellipsoid_cell(rng):
    corners = np.diag(rng.choice([-1.0, 1.0], 3))
    axes = rng.uniform(0.5, 2.0, 3) if rng.random() < 0.7 else np.full(3, 1.3)
    cell = EllipsoidCell(corners, EllipsoidSurface(axes))
    for _ in range(rng.integers(0, 8)):
        cell = cell.split()[rng.integers(2)]
    return cell


def sector_cell(rng):
    cell = SectorCell(np.array([0.0, 1.5]), np.array([0.2, 1.0]), 0.7, np.array([0.0, 0.0, -1.0]))
    for _ in range(rng.integers(0, 5)):
        cell = cell.split()[rng.integers(2)]
    return cell


def side_cell(rng):
    cell = RevolvedCell(
        RevolvedSurface(np.array([0.0, rng.uniform(0.3, 2.0)])), np.array([0.0, 1.6]), np.array([-0.5, 1.0])
    )
    for _ in range(rng.integers(0, 6)):
        cell = cell.split()[rng.integers(2)]
    return cell


def torus_cell(rng):
    cell = RevolvedCell(
        RevolvedSurface(np.array([2.0, rng.uniform(0.3, 1.5)])), np.array([0.0, 1.6]), np.array([-1.5, 0.0])
    )
    for _ in range(rng.integers(0, 6)):
        cell = cell.split()[rng.integers(2)]
    return cell


def rough_triangles(rng, subdivisions=3):
    """Return corners and inward normals of the triangles of a rough ball."""
    ball = trimesh.creation.icosphere(subdivisions, 1.3)
    ball.vertices += 0.05 * rng.standard_normal(ball.vertices.shape) * 0.6**subdivisions
    return np.asarray(ball.triangles), -np.asarray(ball.face_normals)


def random_hull(rng):
    """Return the convex hull of random points."""
    return trimesh.convex.convex_hull(rng.standard_normal((14, 3)) * [1.0, 0.7, 0.5])


def bent_bar(rng):
    """Return an L-shaped bar in a random orientation."""
    outline = np.array([[0, 0], [2, 0], [2, 0.5], [0.5, 0.5], [0.5, 1.6], [0, 1.6]]) - [0.7, 0.5]
    caps = np.array([[0, 1, 3], [1, 2, 3], [0, 3, 4], [0, 4, 5]])
    sides = [f for i in range(6) for f in ([i, (i + 1) % 6, i + 6], [(i + 1) % 6, (i + 1) % 6 + 6, i + 6])]
    vertices = np.concatenate([np.column_stack([outline, np.full(6, z)]) for z in (-0.25, 0.25)])
    faces = np.concatenate([caps[:, ::-1], caps + 6, np.array(sides)])
    rotation, _ = np.linalg.qr(rng.standard_normal((3, 3)))
    return trimesh.Trimesh(vertices @ (rotation * np.sign(np.linalg.det(rotation))).T, faces, process=False)


def mesh_cell(rng):
    cell = TriangleCluster(ClusterTree(*rough_triangles(rng), 1.3), 1)
    for _ in range(rng.integers(0, 9)):
        cell = cell.split()[rng.integers(2)]
    return cell


class ChartedTorus(ng.Torus):
    """A torus that states a chart."""

    def charts(self):
        """Return its chart by the angles about the axis and around the tube, with its normals."""
        major, minor = self.major_radius, self.minor_radius

        def normal(u):
            return ca.vertcat(ca.cos(u[1]) * ca.cos(u[0]), ca.cos(u[1]) * ca.sin(u[0]), ca.sin(u[1]))

        def point(u):
            return major * ca.vertcat(ca.cos(u[0]), ca.sin(u[0]), 0.0) + minor * normal(u)

        return (Chart("surface", point, [[0.0, 2.0 * np.pi], [-np.pi, np.pi]], (4, 4), normal),)


class ChartedEllipsoid(ng.Ellipsoid):
    """An ellipsoid that states a chart, with its normals by the gradient of h."""

    def charts(self):
        """Return its chart by longitude and latitude."""
        a = self.half_size

        def point(u):
            return ca.vertcat(
                a[0] * ca.cos(u[0]) * ca.cos(u[1]), a[1] * ca.sin(u[0]) * ca.cos(u[1]), a[2] * ca.sin(u[1])
            )

        return (Chart("surface", point, [[0.0, 2.0 * np.pi], [-0.5 * np.pi, 0.5 * np.pi]], (4, 2)),)


CHARTED = ChartedTorus(2.0, 0.7), ChartedEllipsoid([1.5, 0.6, 0.9])


def chart_cell(rng):
    surface = ChartSurface(CHARTED[rng.integers(2)], 0)
    parts = surface.chart.first_parts()
    cell = ChartCell(surface, parts[rng.integers(len(parts))])
    for _ in range(rng.integers(0, 7)):
        cell = cell.split()[rng.integers(2)]
    return cell


CELLS = {
    "polygon": polygon_cell,
    "ellipsoid": ellipsoid_cell,
    "sector": sector_cell,
    "side": side_cell,
    "torus": torus_cell,
    "mesh": mesh_cell,
    "chart": chart_cell,
}


def points_of(cell, count, rng):
    """Return random points of a cell with inward normals."""
    if isinstance(cell, PolygonCell):
        weights = rng.dirichlet(np.full(len(cell.vertices), 0.5), count)
        return weights @ cell.vertices, np.tile(cell.normal, (count, 1))
    if isinstance(cell, TriangleCluster):
        pieces = rng.choice(cell.clusters.members(cell.node), count)
        weights = rng.dirichlet(np.full(3, 0.5), count)
        return np.sum(weights[:, :, None] * cell.clusters.pieces[pieces], axis=1), cell.clusters.normals[pieces]
    if isinstance(cell, EllipsoidCell):
        u = rng.dirichlet(np.full(len(cell.corners), 0.7), count) @ cell.corners
        points = u / np.linalg.norm(u, axis=1, keepdims=True) * cell.a
        inward = -points / cell.a**2
        return points, inward / np.linalg.norm(inward, axis=1, keepdims=True)
    if isinstance(cell, ChartCell):
        return _points_of_chart(cell, count, rng)
    parameter = rng.uniform(*(cell.radii if isinstance(cell, SectorCell) else cell.along), count)
    phi = rng.uniform(*cell.angles, count)
    radial = np.stack([np.cos(phi), np.sin(phi), np.zeros(count)], axis=1)
    up = np.array([0.0, 0.0, 1.0])
    if isinstance(cell, SectorCell):
        return parameter[:, None] * radial + cell.height * up, np.tile(cell.normal, (count, 1))
    major, minor = cell.radii
    if major == 0.0:
        return minor * radial + parameter[:, None] * up, -radial
    outward = np.cos(parameter)[:, None] * radial + np.sin(parameter)[:, None] * up
    return major * radial + minor * outward, -outward


def _points_of_chart(cell, count, rng):
    """Return random points of a rectangle with inward normals, by formulas of the body."""
    u, v = (rng.uniform(*side, count) for side in cell.sides)
    body, around = cell.surface.body, np.stack([np.cos(u), np.sin(u), np.zeros(count)], axis=1)
    unit = np.cos(v)[:, None] * around + np.sin(v)[:, None] * [0.0, 0.0, 1.0]
    if isinstance(body, ng.Torus):
        return body.major_radius * around + body.minor_radius * unit, -unit
    inward = -unit / body.half_size
    return unit * body.half_size, inward / np.linalg.norm(inward, axis=1, keepdims=True)
