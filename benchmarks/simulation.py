"""MuJoCo trials of all scripts of problems/: held at 0.8 of certified mu, and the load at which the body is lost."""

import time
from pathlib import Path

import numpy as np

import nlpgrasp as ng
from nlpgrasp.cli.problem_script import load_problem

PROBLEMS = Path(__file__).resolve().parents[1] / "problems"


def run():
    print(f"{'':22} held        slip mm  turn deg  less friction  2 mm off  lost at  seconds")
    lost_at, slips, turns = [], [], []
    for script in sorted(PROBLEMS.glob("*.py")):
        solution = ng.solve(load_problem(script), options=ng.SolveOptions())
        start_time = time.perf_counter()
        simulation = ng.simulate(solution)
        seconds = time.perf_counter() - start_time
        full_friction = [t for condition in simulation.conditions[:2] for t in simulation.of(condition)]
        other_conditions = [
            f"{sum(t.held for t in simulation.of(c))} of {len(simulation.of(c))}" for c in simulation.conditions[2:]
        ]
        slip, turn = max(t.slip for t in full_friction), max(t.turn for t in full_friction)
        held_text = f"{sum(t.held for t in full_friction)} of {len(full_friction)}"
        text = f"{1e3 * slip:8.3f} {np.degrees(turn):9.4f}  {other_conditions[0]:>13} {other_conditions[1]:>9}"
        print(f"{script.stem:22} {held_text:10} {text} {simulation.lost_at or np.inf:8.3f} {seconds:8.1f}", flush=True)
        lost_at.append(simulation.lost_at or np.inf)
        slips.append(slip)
        turns.append(turn)
    print(f"most slip {1e3 * max(slips):.3f} mm, most turn {np.degrees(max(turns)):.4f} degrees, ", end="")
    print(f"lost at {min(lost_at):.3f} to {max(lost_at):.3f} of the certified lower bound")
