"""Run all benchmarks, or those named: ``python -m tests.benchmarks ellipsoid meshes``."""

import sys

from nlpgrasp.solve.workers.one_thread import one_thread
from tests.benchmarks import (
    by_hand,
    ellipsoid,
    experiments,
    following,
    hands,
    libraries,
    measures,
    meshes,
    power,
    report,
    simulation,
    tasks,
)

ALL = {
    "ellipsoid": ellipsoid,
    "measures": measures,
    "by_hand": by_hand,
    "meshes": meshes,
    "hands": hands,
    "power": power,
    "tasks": tasks,
    "following": following,
    "libraries": libraries,
    "experiments": experiments,
    "report": report,
    "simulation": simulation,
}

for name in sys.argv[1:] or ALL:
    print(f"\n== {name}: {ALL[name].__doc__.splitlines()[0]}")
    with one_thread():
        ALL[name].run()
