"""Throughput of experiments with one worker, two workers and a Dask cluster; overhead per solve, and memory."""

import re
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import psutil

import nlpgrasp as ng
from problems.pencil import problem

SOLVES, MANY = 64, 500
OPTIONS = ng.SolveOptions()
QUICK = ng.SolveOptions(rounds=2, rtol=0.1, final_rtol=0.05)


def square():
    """Return a small planar problem."""
    body = ng.Polygon([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    return ng.GraspProblem(body, [ng.FrictionContact(0.5)] * 2, ng.TaskEllipsoid([1, 1, 1], [0, 0.5, 0]), name="square")


def run_timed(experiment, **settings):
    """Run an experiment, and return its wall seconds and the sum of its solves' seconds."""
    with tempfile.TemporaryDirectory() as folder:
        start_time = time.perf_counter()
        result = ng.run_experiment(experiment, Path(folder) / "out", **settings)
        seconds = time.perf_counter() - start_time
    if not result.complete:
        raise RuntimeError(str(result))
    return seconds, sum(s.seconds for s in result.solves)


def run():
    sweep = {f"friction {mu}": {"friction": mu} for mu in (0.3, 0.5, 0.7, 0.9)}
    sweep_experiment = ng.Experiment(problem(), sweep, seeds=range(SOLVES // 4), starts=1, options=OPTIONS)
    one_worker, solve_seconds = run_timed(sweep_experiment, workers=1)
    two_workers, _ = run_timed(sweep_experiment, workers=2)
    print(
        f"{SOLVES} solves: {one_worker:.1f} s with one worker, {two_workers:.1f} s with two:"
        f" {one_worker / two_workers:.2f} times (aim 1.8)"
    )
    print(
        f"overhead with one worker: {1e3 * (one_worker - solve_seconds) / SOLVES:.0f} ms a solve,"
        " start of the workers included"
    )
    with tempfile.TemporaryDirectory() as folder:
        dask, _ = cluster(folder, lambda address: run_timed(sweep_experiment, scheduler=address))
    print(f"Dask with two workers: {dask:.1f} s: {one_worker / dask:.2f} times one worker (aim 1.6)")
    small_experiment = ng.Experiment(square(), {"square": {}}, seeds=range(MANY), starts=1, options=QUICK)
    memory, times = [], []

    def watch(record):
        times.append(time.perf_counter())
        if len(times) % 50 == 0:
            memory.append([p.memory_info().rss / 2**20 for p in [psutil.Process(), *workers()]])

    _, solving = run_timed(small_experiment, workers=1, progress=watch)
    overhead = (times[-1] - times[len(times) // 10]) / (len(times) - 1 - len(times) // 10) - solving / MANY
    print(f"{MANY} solves of {1e3 * solving / MANY:.0f} ms: {1e3 * overhead:.0f} ms overhead a solve (aim 50)")
    print(
        "memory of parent and worker, MiB, every 50 solves:", "; ".join(f"{a:.0f} + {max(b):.0f}" for a, *b in memory)
    )


def workers():
    """Return the worker processes of this process."""
    return psutil.Process().children(recursive=True) or [psutil.Process()]


def cluster(folder, function):
    """Start a Dask cluster of two workers, call ``function`` with its address, and return the result."""
    python, quiet = [sys.executable, "-m"], ["--no-dashboard", "--host", "127.0.0.1"]
    settings = {"cwd": Path(__file__).resolve().parents[1], "stderr": subprocess.PIPE, "text": True}
    processes = [subprocess.Popen([*python, "distributed.cli.dask_scheduler", "--port", "0", *quiet], **settings)]
    try:
        address = next(m[1] for line in processes[0].stderr if (m := re.search(r"(tcp://127\.0\.0\.1:\d+)", line)))
        for _ in range(2):
            line = [*python, "distributed.cli.dask_worker", address, "--nthreads", "1", "--no-nanny", *quiet]
            processes.append(subprocess.Popen([*line, "--local-directory", folder], **settings))
        return function(address)
    finally:
        for process in processes:
            process.kill()
            process.communicate()
