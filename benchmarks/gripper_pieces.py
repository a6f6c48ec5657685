"""Exact convex pieces of the parts of the benchmark ``gripper``: MuJoCo collides a mesh as its convex hull."""

import numpy as np


def box(size, position):
    """Return the corners (8, 3) of a box of given size and middle."""
    signs = np.array(np.meshgrid([-0.5, 0.5], [-0.5, 0.5], [-0.5, 0.5])).reshape(3, 8).T
    return signs * size + np.asarray(position, dtype=float)


def polygon(radius, count):
    """Return the corners (count, 2) of a regular polygon, the first on the x axis."""
    angles = 2.0 * np.pi * np.arange(count) / count
    return radius * np.stack([np.cos(angles), np.sin(angles)], axis=1)


def ring(inner, outer, low, high):
    """Return prisms (8, 3) between two polygons of as many corners, from one height to another."""
    quads = np.stack([inner, np.roll(inner, -1, axis=0), np.roll(outer, -1, axis=0), outer], axis=1)
    return [np.concatenate([np.column_stack([quad, np.full(4, z)]) for z in (low, high)]) for quad in quads]


def bracket():
    """Return the pieces of the bracket: the wall, the base beside its holes, and rings of prisms around these."""
    pieces = [box([6, 40, 54], [3, 0, 33]), box([15, 40, 6], [7.5, 0, 3]), box([5, 40, 6], [57.5, 0, 3])]
    hole = polygon(3.5, 24)
    square = 10.0 * hole / np.max(np.abs(hole), axis=1, keepdims=True)
    for position in ((x, y) for x in (25, 45) for y in (-10, 10)):
        pieces += ring(hole + position, square + position, 0, 6)
    return pieces


def pipe():
    """Return the pieces of the pipe and its flange."""
    bore = polygon(12, 32)
    return [*ring(bore, polygon(16, 32), 0, 80), *ring(bore, polygon(30, 32), 0, 8)]


def gear():
    """Return the pieces of the gear: a ring, and a box a tooth."""
    teeth = []
    for angle in 2.0 * np.pi * np.arange(36) / 36:
        turn = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
        teeth.append(box([5, 2.4, 20], [26, 0, 10]) @ turn.T)
    return [*ring(polygon(8, 72), polygon(26, 72), 0, 20), *teeth]


def profile():
    """Return the pieces of the profile: a floor and two walls."""
    walls = [box([2, 80, 28], [x, 0, 16]) for x in (-24, 24)]
    return [box([50, 80, 2], [0, 0, 1]), *walls]


def handle():
    """Return the pieces of the handle: stem and bar."""
    stem = np.concatenate([np.column_stack([polygon(8, 24), np.full(24, z)]) for z in (0, 75)])
    return [stem, box([90, 16, 16], [0, 0, 78])]


PIECES = {"bracket": bracket, "pipe": pipe, "gear": gear, "profile": profile, "handle": handle}


def pieces_of(name):
    """Return the convex pieces of a part, corners (n, 3) in metres, standing on z = 0."""
    pieces = [1e-3 * piece for piece in PIECES[name]()]
    lowest = min(float(piece[:, 2].min()) for piece in pieces)
    return [piece - [0.0, 0.0, lowest] for piece in pieces]
