"""Seconds of whole calls in new processes, by stage, beside those of a fixed piece of work.

CPU seconds on one core, one start, four contacts with friction 0.7; eight starts on two cores by the clock. "Cold" is
with an empty cache folder, "again" a second process with the same cache folder, "second" a second call in the same
process with another seed. All modules are compiled to bytecode by an untimed run, as those of an installed package are.
Parts: ``imports``, ``free``, ``hand``, ``command``.
"""

import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from benchmarks.baseline import work_unit
from benchmarks.outside import MESHES as OUTSIDE_MESHES
from benchmarks.outside import MISSING

ROOT = Path(__file__).resolve().parents[1]
MESHES = ("ycb_012_strawberry", "featuretype", "ycb_048_hammer")
GOALS = {  # seconds: cold, and where there are two a second call
    "box": "0.7",
    "ellipsoid": "1.0",
    "mesh": "1.5",
    "ellipsoid, four": "1.5, second 0.8",
    "mesh, four": "2.5, second 1.2",
    "mesh, four, 8 starts": "4.0",
    "mesh, leap": "3.5",
}
WITH_HAND = (
    ("box", "four", 1),
    ("ellipsoid", "four", 1),
    *((name, "four", 1) for name in MESHES),
    ("ycb_012_strawberry", "four", 8),
    ("ycb_012_strawberry", "leap", 1),
)
INSIDE = ("total", "ipopt", "functions")  # stages that are sums or parts of others
REPEATS = 5


def run(part=None):
    parts = {
        "imports": imports,
        "free": lambda bytecode: _solves([(name, "none", 1) for name in ("box", "ellipsoid", *MESHES)], bytecode),
        "hand": lambda bytecode: _solves(WITH_HAND, bytecode),
        "command": command,
    }
    print(f"the fixed piece of work takes {work_unit():.3f} s")
    with tempfile.TemporaryDirectory() as bytecode:
        for name in parts if part is None else (part,):
            parts[name](bytecode)


def imports(bytecode):
    """Print the wall time of importing the package, and of the command line's help."""
    program = str(Path(sys.executable).with_name("nlpgrasp"))
    for arguments, goal in (([sys.executable, "-c", "import nlpgrasp"], 0.35), ([program, "--help"], 0.5)):
        _timed(arguments, bytecode)  # compiles to bytecode
        shown = " ".join([Path(arguments[0]).name, *arguments[1:]])
        print(f"{shown}: {min(_timed(arguments, bytecode) for _ in range(REPEATS)):.2f} s (goal {goal})", flush=True)


def command(bytecode):
    """Print the wall time of a command line solve with two workers."""
    with tempfile.TemporaryDirectory() as folder:
        program = str(Path(sys.executable).with_name("nlpgrasp"))
        arguments = [program, "solve", str(ROOT / "problems" / "screwdriver.py"), "--workers", "2", "--json"]
        arguments += ["--out", f"{folder}/screwdriver.json"]
        _timed(arguments, bytecode)  # compiles to bytecode
        for cache in ("cold", "again"):
            seconds = _timed(arguments, bytecode, f"{folder}/cache")
            print(f"nlpgrasp solve problems/screwdriver.py, 8 starts, two workers, {cache}: {seconds:.1f} s (goal 7)")


def _solves(cases, bytecode):
    """Print the time of first solves, by stage, of cases (body, hand, starts)."""
    if not OUTSIDE_MESHES.is_dir():
        print(f"skipped meshes and hands: {MISSING}")
    for name, *further in cases:
        if name in MESHES:
            if not OUTSIDE_MESHES.is_dir():
                continue
            name = str(OUTSIDE_MESHES / f"{name}.stl")
        arguments = [name, *map(str, further)]
        _call(arguments, bytecode, "off")  # compiles to bytecode
        with tempfile.TemporaryDirectory() as folder:
            cold, again = (_call(arguments, bytecode, folder) for _ in range(2))
        _print_call(arguments, cold, again)


def _print_call(arguments, cold, again):
    """Print the times of a call with an empty cache folder, and of a repeated call."""
    name, hand, starts = arguments
    further = [] if hand == "none" else [hand] + ([f"{starts} starts"] if starts != "1" else [])
    kind = ", ".join([name if name in GOALS else "mesh", *further])
    goal = f" (goal {GOALS[kind]})" if kind in GOALS else ""
    cold_times, repeated_times = cold["took"], again["took"]
    print(f"{', '.join([Path(name).stem, *further])}: mu {cold['mu']:.4f}, {cold['peak']:.0f} MiB")
    seconds = [took["problem"] + took["solve"] for took in (cold_times, repeated_times)]
    print(
        f"  problem and solve, cold {seconds[0]:.2f} s{goal}, again {seconds[1]:.2f} s,"
        f" second {cold_times['second']:.2f} s"
    )
    stages = [f"{stage} {cold_times[stage]:.2f}" for stage in ("import", "names", "body", "hand", "problem")]
    print(f"  {', '.join(stages)}; body again {repeated_times['body']:.2f}")
    stages = {stage: seconds for stage, seconds in cold["stages"].items() if stage not in INSIDE}
    shown = ", ".join(f"{stage} {seconds:.2f}" for stage, seconds in stages.items() if seconds >= 0.005)
    print(
        f"  solve {cold_times['solve']:.2f}: {shown} (together {sum(stages.values()) / cold_times['solve']:.0%})",
        flush=True,
    )


def _call(arguments, bytecode, cache):
    """Run one call in a new process, and return its times by stage."""
    command = [sys.executable, "-m", "benchmarks.one_call", *arguments]
    environment = _environment(bytecode, cache)
    completed = subprocess.run(command, capture_output=True, text=True, check=True, env=environment, cwd=ROOT)
    return json.loads(completed.stdout)


def _timed(arguments, bytecode, cache="off"):
    """Return the wall time of a command."""
    start_time = time.perf_counter()
    subprocess.run(arguments, capture_output=True, check=True, env=_environment(bytecode, cache))
    return time.perf_counter() - start_time


def _environment(bytecode, cache):
    """Return the environment variables of a call: bytecode folder, cache folder and one thread."""
    inherited = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
    return {**inherited, "PYTHONPYCACHEPREFIX": bytecode, "NLPGRASP_CACHE": cache, "OMP_NUM_THREADS": "1"}
