"""Run all benchmarks, or those named: ``python -m benchmarks ellipsoid meshes``; a part of one: ``best:hits``."""

import sys

from benchmarks import (
    baseline,
    best,
    by_hand,
    calls,
    coupled,
    ellipsoid,
    experiments,
    following,
    grasps,
    hand_simulation,
    hands,
    libraries,
    measures,
    meshes,
    power,
    program,
    report,
    simulation,
    tasks,
)
from nlpgrasp.optimize.processes import single_thread

ALL = {
    "baseline": baseline,
    "calls": calls,
    "ellipsoid": ellipsoid,
    "measures": measures,
    "by_hand": by_hand,
    "meshes": meshes,
    "hands": hands,
    "power": power,
    "best": best,
    "coupled": coupled,
    "grasps": grasps,
    "tasks": tasks,
    "following": following,
    "libraries": libraries,
    "experiments": experiments,
    "program": program,
    "report": report,
    "simulation": simulation,
    "hand_simulation": hand_simulation,
}

for word in sys.argv[1:] or ALL:
    name, *part = word.split(":")
    print(f"\n== {word}: {ALL[name].__doc__.splitlines()[0]}")
    with single_thread():
        ALL[name].run(*part)
