"""Wall time of whole calls in new processes, by stage.

One core, one start, four contacts with friction 0.7. "Cold" is with an empty cache folder, "again" a second process
with the same cache folder, "second" a second call in the same process with another seed. All modules are compiled to
bytecode by an untimed run, as those of an installed package are. Parts: ``imports``, ``free``, ``hand``, ``command``.
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
GOALS = {"box": 0.7, "ellipsoid": 1.0, "mesh": 1.5, "ellipsoid, hand": 2.0, "mesh, hand": 3.5}  # seconds
INSIDE = ("total", "ipopt", "functions")  # stages that are sums or parts of others
REPEATS = 5


def run(part=None):
    parts = {
        "imports": imports,
        "free": lambda bytecode: _solves(False, bytecode),
        "hand": lambda bytecode: _solves(True, bytecode),
        "command": command,
    }
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


def _solves(with_hand, bytecode):
    """Print the wall time of first solves of a box, an ellipsoid and meshes, by stage."""
    names = ["box", "ellipsoid"]
    if OUTSIDE_MESHES.is_dir():
        names += [str(OUTSIDE_MESHES / f"{name}.stl") for name in MESHES]
    else:
        print(f"skipped meshes: {MISSING}")
    for name in names:
        _call(name, with_hand, bytecode, "off")  # compiles to bytecode
        with tempfile.TemporaryDirectory() as folder:
            cold, again = (_call(name, with_hand, bytecode, folder) for _ in range(2))
        _print_call(name, with_hand, cold, again)


def _print_call(name, with_hand, cold, again):
    """Print the times of a call with an empty cache folder, and of a repeated call."""
    kind = (name if name in GOALS else "mesh") + (", hand" if with_hand else "")
    goal = f" (goal {GOALS[kind]})" if kind in GOALS else ""
    cold_times, repeated_times = cold["took"], again["took"]
    print(f"{Path(name).stem}{', hand' if with_hand else ''}: mu {cold['mu']:.4f}, {cold['peak']:.0f} MiB")
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


def _call(name, with_hand, bytecode, cache):
    """Run one call in a new process, and return its times by stage."""
    arguments = [sys.executable, "-m", "benchmarks.one_call", name, *(["hand"] if with_hand else [])]
    environment = _environment(bytecode, cache)
    completed = subprocess.run(arguments, capture_output=True, text=True, check=True, env=environment, cwd=ROOT)
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
