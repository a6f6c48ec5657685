"""Whole calls, cold, in processes of their own: what a user waits for, and where the time goes.

One core, one start, four contacts with friction 0.7. "Cold" is with an empty cache folder, "again" a second process
with what the first one left there, "second" a second call in the same process with another seed. Parts: ``imports``,
``free``, ``hand``, ``command``.
"""

import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from benchmarks.outside import MESHES as OUTSIDE_MESHES
from benchmarks.outside import MISSING

ROOT = Path(__file__).resolve().parents[1]
MESHES = ("ycb_012_strawberry", "featuretype", "ycb_048_hammer")
GOALS = {"box": 0.7, "ellipsoid": 1.0, "mesh": 1.5, "ellipsoid, hand": 2.0, "mesh, hand": 3.5}
INSIDE = ("total", "ipopt", "functions")  # of the stages, those that are sums or parts of others
REPEATS = 5


def run(part=None):
    parts = {"imports": imports, "free": lambda: _solves(False), "hand": lambda: _solves(True), "command": command}
    for name in parts if part is None else (part,):
        parts[name]()


def imports():
    program = str(Path(sys.executable).with_name("nlpgrasp"))
    for words, goal in (([sys.executable, "-c", "import nlpgrasp"], 0.35), ([program, "--help"], 0.5)):
        shown = " ".join([Path(words[0]).name, *words[1:]])
        print(f"{shown}: {min(_timed(words) for _ in range(REPEATS)):.2f} s (goal {goal})", flush=True)


def command():
    """The command line, with two workers."""
    with tempfile.TemporaryDirectory() as folder:
        program = str(Path(sys.executable).with_name("nlpgrasp"))
        words = [program, "solve", str(ROOT / "problems" / "screwdriver.py"), "--workers", "2", "--json"]
        for cache in ("cold", "again"):
            seconds = _timed([*words, "--out", f"{folder}/screwdriver.json"], f"{folder}/cache")
            print(f"nlpgrasp solve problems/screwdriver.py, 8 starts, two workers, {cache}: {seconds:.1f} s (goal 7)")


def _solves(with_hand):
    names = ["box", "ellipsoid"]
    if OUTSIDE_MESHES.is_dir():
        names += [str(OUTSIDE_MESHES / f"{name}.stl") for name in MESHES]
    else:
        print(f"skipped meshes: {MISSING}")
    for name in names:
        with tempfile.TemporaryDirectory() as folder:
            cold, again = _call(name, with_hand, folder), _call(name, with_hand, folder)
        kind = (name if name in GOALS else "mesh") + (", hand" if with_hand else "")
        goal = f" (goal {GOALS[kind]})" if kind in GOALS else ""
        one, other = cold["took"], again["took"]
        print(f"{Path(name).stem}{', hand' if with_hand else ''}: mu {cold['mu']:.4f}, {cold['peak']:.0f} MiB")
        first, warm = one["problem"] + one["solve"], other["problem"] + other["solve"]
        print(f"  problem and solve, cold {first:.2f} s{goal}, again {warm:.2f} s, second {one['second']:.2f} s")
        stages = [f"{stage} {one[stage]:.2f}" for stage in ("import", "names", "body", "hand", "problem")]
        print(f"  {', '.join(stages)}; body again {other['body']:.2f}")
        stages = {stage: seconds for stage, seconds in cold["stages"].items() if stage not in INSIDE}
        shown = ", ".join(f"{stage} {seconds:.2f}" for stage, seconds in stages.items() if seconds >= 0.005)
        print(f"  solve {one['solve']:.2f}: {shown} (together {sum(stages.values()) / one['solve']:.0%})", flush=True)


def _call(name, with_hand, cache):
    """Return the times of one call in a process of its own."""
    words = [sys.executable, "-m", "benchmarks.one_call", name, *(["hand"] if with_hand else [])]
    done = subprocess.run(words, capture_output=True, text=True, check=True, env=_environment(cache), cwd=ROOT)
    return json.loads(done.stdout)


def _timed(words, cache="off"):
    """Return the wall time of a command."""
    begun = time.perf_counter()
    subprocess.run(words, capture_output=True, check=True, env=_environment(cache))
    return time.perf_counter() - begun


def _environment(cache):
    return {**os.environ, "NLPGRASP_CACHE": cache, "OMP_NUM_THREADS": "1"}
