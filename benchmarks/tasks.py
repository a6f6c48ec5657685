"""Time to fit task ellipsoids to 100,000 wrenches, and to follow a task over 20 steps against cold solves."""

import time

import numpy as np

import nlpgrasp as ng
from problems.filling_cup import filled

COUNT, STEPS, STARTS = 100_000, 20, 8


def run():
    rng = np.random.default_rng(0)
    normal = rng.standard_normal((COUNT, 6))
    sphere = normal / np.linalg.norm(normal, axis=1)[:, None]
    sets = {
        "normal": normal,
        "on a sphere": sphere,
        "in a ball": sphere * rng.uniform(0, 1, (COUNT, 1)) ** (1 / 6),
        "in a box": rng.uniform(-1, 1, (COUNT, 6)),
        "heavy tails": rng.standard_t(2, (COUNT, 6)),
    }
    for name, wrenches in sets.items():
        start_time = time.perf_counter()
        fit = ng.fit_ellipsoid(wrenches)
        seconds = time.perf_counter() - start_time
        local = np.linalg.solve(fit.task.axes.T, (wrenches - fit.task.center).T)
        farthest = float(np.max(np.linalg.norm(local, axis=0)))
        print(f"{name}: {seconds:.2f} s, gap {fit.gap:.1e}, farthest point at {farthest:.12f} (aims 5 s, 1e-6, 1)")
    options = ng.SolveOptions(workers=1)
    parameters = np.linspace(0.15, 1.0, STEPS)
    start_time = time.perf_counter()
    followed = ng.follow_task(filled, parameters, starts=STARTS, options=options)
    followed_seconds = time.perf_counter() - start_time
    start_time = time.perf_counter()
    cold = [ng.solve(filled(parameter), STARTS, options=options) for parameter in parameters]
    time_ratio = followed_seconds / (time.perf_counter() - start_time)
    ratios = [
        step.solution.mu.lower / cold_solution.mu.lower
        for step, cold_solution in zip(followed.steps, cold, strict=True)
    ]
    print(
        f"following {STEPS} steps: {time_ratio:.0%} of the time of cold solves (aim 25 %),"
        f" mu at least {min(ratios):.3f} of theirs (aim 0.99)"
    )
