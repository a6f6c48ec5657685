"""Which forces the contact models allow, written from their definitions alone."""

import clarabel
import numpy as np
from scipy import sparse


def places(contact):
    """Return where friction contacts stand for a line or pad, (N, 3): along normal and tangents, metres."""
    if contact.kind == "line":
        return np.array([[0.0, s * contact.length / 2, 0.0] for s in (1, -1)])
    a, b = contact.extents
    return np.array([[0.0, s * a / 2, t * b / 2] for s in (1, -1) for t in (1, -1)])


def components(contact, points, forces):
    """Return force components (m, n) of forces (m, N, 3) at points (N, 3) or (m, N, 3) of the contact frame."""
    wrench = np.concatenate([forces.sum(axis=1), np.cross(points, forces).sum(axis=1)], axis=1)
    assert np.max(np.abs(np.delete(wrench, contact.axes(3), axis=1)), initial=0.0) < 1e-12
    return wrench[:, contact.axes(3)]


def velocities(contact, z):
    """Return the velocities (m, N, 3) of the points of a body that moves by z, the twist of unit work a component."""
    twist = np.zeros((len(z), 6))
    twist[:, contact.axes(3)] = z
    return twist[:, None, :3] + np.cross(twist[:, None, 3:], places(contact)[None])


def slack(contact, x):
    """Return by how much friction contacts at the points fail to produce x (n,), with clarabel: at most 0 inside.

    The least t for which forces with ``|f_t| <= mu f_n + t`` at all points add up to x.
    """
    points = places(contact)
    count = 3 * len(points)
    unit = np.eye(count).reshape(count, len(points), 3)
    A = np.pad(components(contact, points, unit).T, [(0, 0), (0, 1)])
    rows, cones = [A], [clarabel.ZeroConeT(len(A))]
    for i in range(len(points)):
        M = np.zeros((3, count + 1))
        M[0, 3 * i], M[0, -1], M[1, 3 * i + 1], M[2, 3 * i + 2] = contact.friction, 1.0, 1.0, 1.0
        rows.append(-M)
        cones.append(clarabel.SecondOrderConeT(3))
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = 1e-12
    cost = np.append(np.zeros(count), 1.0)
    rhs = np.concatenate([x, np.zeros(3 * len(points))])
    nothing = sparse.csc_matrix((count + 1, count + 1))
    solver = clarabel.DefaultSolver(nothing, cost, sparse.csc_matrix(np.concatenate(rows)), rhs, cones, settings)
    return solver.solve().x[-1]


def line_inside(contact, x, t):
    """Return whether two ends with ``|f_t| <= mu f_n + t`` produce x (m, 5): no forces there, but what they leave.

    Normal and transverse forces follow from x; the force along the line is shared as it likes.
    """
    half = contact.length / 2
    room = contact.friction * np.stack([x[:, 0] - x[:, 4] / half, x[:, 0] + x[:, 4] / half]) / 2 + t
    across = np.abs(np.stack([x[:, 2] + x[:, 3] / half, x[:, 2] - x[:, 3] / half])) / 2
    left = np.sqrt(np.maximum((room - across) * (room + across), 0.0)).sum(axis=0)
    return np.all(room >= across, axis=0) & (np.abs(x[:, 1]) <= left)


def is_pad(contact):
    """Return whether the force domain is that of friction contacts at several points."""
    return getattr(contact, "model", None) == "coulomb" and contact.friction is not None


def ranges(contact, n):
    """Return the blocks of components and how far normal force lets them go, from the models' definitions."""
    mu, mu_t = getattr(contact, "friction", None), getattr(contact, "torsional_friction", None)
    rough = [((1, 2), mu), ((3,), mu_t)]
    return {
        "point": lambda: [],
        "friction": lambda: [(tuple(range(1, n)), mu)],
        "soft": lambda: rough,
        "line": lambda: [*(rough if mu else []), ((n - 1,), contact.length / 2)],
        "plane": lambda: [
            *(rough if mu else []),
            *(
                [((n - 2, n - 1), contact.radius)]
                if contact.radius
                else [((n - 2,), contact.extents[1] / 2), ((n - 1,), contact.extents[0] / 2)]
            ),
        ],
    }[contact.kind]()


def inside(contact, x, tolerance=0.0):
    """Return whether force components are in the force domain, by its definition in (2.4-1)."""
    if contact.kind == "bilateral":
        return np.ones(x.shape[:-1], dtype=bool)
    if is_pad(contact):
        flat = x.reshape(-1, x.shape[-1])
        if contact.kind == "line":
            return line_inside(contact, flat, tolerance + 1e-10).reshape(x.shape[:-1])
        return np.array([slack(contact, one) <= tolerance + 1e-10 for one in flat]).reshape(x.shape[:-1])
    normal = x[..., 0]
    good = normal >= -tolerance
    if getattr(contact, "model", None) == "elliptic":
        sliding, torsion = np.linalg.norm(x[..., 1:3], axis=-1), np.abs(x[..., 3])
        size = np.hypot(sliding / contact.friction, torsion / contact.torsional_friction)
        return good & (size <= normal + tolerance / contact.torsional_friction)
    for block, most in ranges(contact, x.shape[-1]):
        good &= np.linalg.norm(x[..., list(block)], axis=-1) <= most * normal + tolerance
    return good


def most_work(contact, z):
    """Return the most that a force of unit normal force does along z: no force works where it is not above 0."""
    if contact.kind == "bilateral":
        return np.where(np.linalg.norm(z, axis=-1) > 0.0, np.inf, 0.0)
    if is_pad(contact):
        v = velocities(contact, z.reshape(-1, z.shape[-1]))
        work = v[..., 0] + contact.friction * np.linalg.norm(v[..., 1:], axis=-1)
        return np.max(work, axis=1).reshape(z.shape[:-1])
    if getattr(contact, "model", None) == "elliptic":
        sliding = contact.friction * np.linalg.norm(z[..., 1:3], axis=-1)
        return z[..., 0] + np.hypot(sliding, contact.torsional_friction * z[..., 3])
    parts = [most * np.linalg.norm(z[..., list(block)], axis=-1) for block, most in ranges(contact, z.shape[-1])]
    return z[..., 0] + sum(parts)
