"""All scripts of problems/ in MuJoCo: what they hold at 0.8 of certified mu, and where the hardest wrench is lost."""

import time
from pathlib import Path

import numpy as np

import nlpgrasp as ng
from nlpgrasp.cli.problem_script import load_problem

PROBLEMS = Path(__file__).resolve().parents[1] / "problems"


def run():
    print(f"{'':22} held        slip mm  turn deg  less friction  2 mm off  lost at  seconds")
    lost, slips, turns = [], [], []
    for script in sorted(PROBLEMS.glob("*.py")):
        solution = ng.solve(load_problem(script), options=ng.SolveOptions())
        begun = time.perf_counter()
        found = ng.simulate(solution)
        seconds = time.perf_counter() - begun
        sure = [t for condition in found.conditions[:2] for t in found.of(condition)]
        other = [f"{sum(t.held for t in found.of(c))} of {len(found.of(c))}" for c in found.conditions[2:]]
        slip, turn = max(t.slip for t in sure), max(t.turn for t in sure)
        held = f"{sum(t.held for t in sure)} of {len(sure)}"
        shown = f"{1e3 * slip:8.3f} {np.degrees(turn):9.4f}  {other[0]:>13} {other[1]:>9}"
        print(f"{script.stem:22} {held:10} {shown} {found.lost_at or np.inf:8.3f} {seconds:8.1f}", flush=True)
        lost.append(found.lost_at or np.inf)
        slips.append(slip)
        turns.append(turn)
    print(f"most slip {1e3 * max(slips):.3f} mm, most turn {np.degrees(max(turns)):.4f} degrees, ", end="")
    print(f"lost at {min(lost):.3f} to {max(lost):.3f} of the certified lower bound")
