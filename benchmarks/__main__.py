"""Command line of the benchmarks: ``python -m benchmarks [NAME[:PART] ...]``; without names all are run."""

import sys

from benchmarks import (
    along,
    baseline,
    best,
    by_hand,
    calls,
    coupled,
    ellipsoid,
    experiments,
    fault_injection,
    following,
    fuzz_files,
    grasps,
    gripper,
    gripper_simulation,
    hand_simulation,
    hand_zoo,
    hands,
    libraries,
    measures,
    meshes,
    objectives,
    power,
    program,
    proof_lies,
    proofs,
    report,
    sets,
    simulation,
    tables,
    tasks,
    thin,
)
from nlpgrasp.optimize.processes import single_thread

BENCHMARKS = {
    "baseline": baseline,
    "calls": calls,
    "ellipsoid": ellipsoid,
    "measures": measures,
    "by_hand": by_hand,
    "meshes": meshes,
    "hands": hands,
    "hand_zoo": hand_zoo,
    "power": power,
    "objectives": objectives,
    "best": best,
    "coupled": coupled,
    "grasps": grasps,
    "gripper": gripper,
    "gripper_simulation": gripper_simulation,
    "tables": tables,
    "sets": sets,
    "tasks": tasks,
    "thin": thin,
    "following": following,
    "fuzz_files": fuzz_files,
    "fault_injection": fault_injection,
    "along": along,
    "libraries": libraries,
    "experiments": experiments,
    "program": program,
    "proof_lies": proof_lies,
    "proofs": proofs,
    "report": report,
    "simulation": simulation,
    "hand_simulation": hand_simulation,
}

for argument in sys.argv[1:] or BENCHMARKS:
    name, *part = argument.split(":")
    print(f"\n== {argument}: {BENCHMARKS[name].__doc__.splitlines()[0]}")
    with single_thread():
        BENCHMARKS[name].run(*part)
