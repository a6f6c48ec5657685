"""Random recordings of wrenches by kind, n of them at a time t from 0 to 1."""

import numpy as np

ALONG = np.array([1.0, 0.5, 0.0, 0.2, 0.0, 1.0])


def ball(rng, n):
    g = rng.standard_normal((n, 6))
    return g / np.linalg.norm(g, axis=1)[:, None] * rng.uniform(0, 1, (n, 1)) ** (1 / 6)


CLOUDS = {
    "normal": lambda rng, n, t: rng.standard_normal((n, 6)),
    "in an ellipsoid": lambda rng, n, t: ball(rng, n) @ np.triu(np.ones((6, 6))),
    "heavy tails": lambda rng, n, t: rng.standard_t(2, (n, 6)),
    "flat": lambda rng, n, t: ball(rng, n) * [1, 1, 0, 1, 0, 0],
    "drifting": lambda rng, n, t: ball(rng, n) + 8.0 * t * ALONG,
    "turning": lambda rng, n, t: ball(rng, n) + 4.0 * np.array([np.cos(3 * t), np.sin(3 * t), 0, 0, 0, t]),
}
