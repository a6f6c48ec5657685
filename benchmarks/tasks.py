"""Ellipsoids around 100,000 wrenches; a task followed over 20 steps against 20 cold solves."""

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
        begun = time.perf_counter()
        fit = ng.fit_ellipsoid(wrenches)
        seconds = time.perf_counter() - begun
        local = np.linalg.solve(fit.task.axes.T, (wrenches - fit.task.center).T)
        most = float(np.max(np.linalg.norm(local, axis=0)))
        print(f"{name}: {seconds:.2f} s, gap {fit.gap:.1e}, farthest point at {most:.12f} (aims 5 s, 1e-6, 1)")
    options = ng.SolveOptions(workers=1)
    levels = np.linspace(0.15, 1.0, STEPS)
    begun = time.perf_counter()
    followed = ng.follow_task(filled, levels, starts=STARTS, options=options)
    warm = time.perf_counter() - begun
    begun = time.perf_counter()
    cold = [ng.solve(filled(level), STARTS, options=options) for level in levels]
    share = warm / (time.perf_counter() - begun)
    ratios = [step.solution.mu.lower / one.mu.lower for step, one in zip(followed.steps, cold, strict=True)]
    print(
        f"following {STEPS} steps: {share:.0%} of the time of cold solves (aim 25 %), mu at least {min(ratios):.3f} of"
    )
    print("theirs (aim 0.99)")
