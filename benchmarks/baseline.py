"""Regression baseline: 60 problems, three seeds of eight starts, compared with results stored in baseline.json.

``baseline`` compares with the stored file, ``baseline:store`` writes it, ``baseline:jaw`` compares one group.
Each solve has its own process. CPU seconds are relative to a fixed piece of work timed in the same run.
"""

import json
import multiprocessing
import os
import sys
import time
from pathlib import Path

import numpy as np

import nlpgrasp as ng
from benchmarks.baseline_problems import baseline_problems

FILE = Path(__file__).with_name("baseline.json")
SEEDS, STARTS = 3, 8
WORSE = 0.98  # ratio to the stored certified bound below which a problem is listed
OWN_STAGES = ("total", "ipopt", "functions")  # stages that are sums or parts of others
DIGITS = 5


def run(part=None):
    stored = None if part == "store" or not FILE.exists() else json.loads(FILE.read_text())
    selected = [(i, group, name) for i, (group, name, problem) in enumerate(baseline_problems()) if problem is not None]
    if part not in (None, "store"):
        selected = [entry for entry in selected if entry[1] == part]
    unit = work_unit()
    jobs = [(i, seed) for i, _, _ in selected for seed in range(SEEDS)]
    os.environ |= {"OMP_NUM_THREADS": "1", "NLPGRASP_CACHE": "off"}
    with multiprocessing.get_context("spawn").Pool(os.cpu_count(), maxtasksperchild=1) as pool:
        results = pool.map(solve_job, jobs, chunksize=1)
    rows = [
        {"group": group, "name": name, "seeds": results[n * SEEDS : (n + 1) * SEEDS]}
        for n, (_, group, name) in enumerate(selected)
    ]
    measured = {"unit": unit, "problems": rows}
    if part == "store":
        FILE.write_text("{" + f'"unit": {unit:.4g}, "problems": [\n' + ",\n".join(map(json.dumps, rows)) + "\n]}\n")
    compare(measured if stored is None else stored, measured)


def work_unit():
    """Return the CPU seconds of a fixed computation, the least of some runs, as a measure of the machine's speed."""
    matrix, seconds = np.random.default_rng(0).normal(size=(60, 60)), np.inf
    for _ in range(5):
        start_time = time.process_time()
        for _ in range(100):
            np.linalg.svd(matrix)
            sum(i * i for i in range(20000))
        seconds = min(seconds, time.process_time() - start_time)
    return seconds


def solve_job(job):
    """Solve the problem of a job (problem index, seed), and return result and cost as JSON data."""
    index, seed = job
    problem = list(baseline_problems())[index][2]
    start_time = time.process_time()
    solution = ng.solve(problem, starts=STARTS, seed=seed, options=ng.SolveOptions(workers=1))
    cpu_seconds = time.process_time() - start_time
    stages = {name: s for name, s in solution.solver["seconds"].items() if name not in OWN_STAGES and s >= 0.001}
    return {
        "status": solution.status.name,
        "lower": rounded(solution.mu.lower if solution.success else 0.0),
        "upper": rounded(solution.mu.upper if solution.success else 0.0),
        "bound": None if solution.bound is None else rounded(solution.bound.upper),
        "cpu": rounded(cpu_seconds, 4),
        "calls": solution.solver["ipopt_calls"],
        "stages": {name: rounded(s, 3) for name, s in stages.items()},
    }


def rounded(value, digits=DIGITS):
    """Return a number rounded to significant digits."""
    return float(f"{value:.{digits}g}")


def compare(stored, measured):
    """Print mu, bound, CPU time and IPOPT calls relative to stored ones by group, and problems that got worse."""
    stored_rows = {row["name"]: row for row in stored["problems"]}
    for row in measured["problems"]:  # seeds that only one of both has are left out
        stored_row = stored_rows.get(row["name"], row)
        count = min(len(stored_row["seeds"]), len(row["seeds"]))
        stored_row["seeds"], row["seeds"] = stored_row["seeds"][:count], row["seeds"][:count]
    speed = measured["unit"] / stored["unit"]
    print(f"the fixed piece of work takes {measured['unit']:.2f} s, before {stored['unit']:.2f} s")
    groups = dict.fromkeys(row["group"] for row in measured["problems"])
    for group in [*groups, "all"]:
        rows = [
            (stored_rows[r["name"]], r)
            for r in measured["problems"]
            if group in (r["group"], "all") and r["name"] in stored_rows
        ]
        pairs = [pair for stored_row, row in rows for pair in zip(stored_row["seeds"], row["seeds"], strict=True)]
        mu = np.array([b["lower"] / a["lower"] if a["lower"] else 1.0 for a, b in pairs])
        seconds = np.array([(a["cpu"], b["cpu"] / speed) for a, b in pairs])
        bounds = [b["bound"] / a["bound"] for a, b in pairs if a["bound"] and b["bound"]]
        calls = np.median([(a["calls"], b["calls"]) for a, b in pairs], axis=0)
        bound_text = f", bound {np.median(bounds):.4f} (most {max(bounds):.4f})" if bounds else ""
        print(
            f"{group}: mu over before, median {np.median(mu):.4f}, least {mu.min():.4f}, below"
            f" {WORSE:g} in {np.sum(mu < WORSE)} of {len(mu)}{bound_text}; CPU {np.median(seconds[:, 0]):.2f} to"
            f" {np.median(seconds[:, 1]):.2f} s, median ratio {np.median(seconds[:, 1] / seconds[:, 0]):.2f}; IPOPT"
            f" {calls[0]:.0f} to {calls[1]:.0f} calls; {format_status_changes(pairs)}"
        )
    rows = [(stored_rows[row["name"]], row) for row in measured["problems"] if row["name"] in stored_rows]
    stored_row, measured_means = (stage_means([pair[i] for pair in rows]) for i in (0, 1))
    for stage in stored_row | measured_means:
        print(
            f"  {stage}: {stored_row.get(stage, 0.0):.2f} to {measured_means.get(stage, 0.0) / speed:.2f} s in the mean"
        )
    for row in measured["problems"]:
        best_values = [max(x["lower"] for x in r["seeds"]) for r in (stored_rows.get(row["name"], row), row)]
        values = [", ".join(f"{x['lower']:.4g}" for x in r["seeds"]) for r in (stored_rows.get(row["name"], row), row)]
        if stored is measured or best_values[1] < WORSE * best_values[0]:
            print(
                f"  {row['name']}: {values[0]}"
                if stored is measured
                else f"  {row['name']}: {values[0]} to {values[1]}"
            )


def stage_means(rows):
    """Return the mean seconds of each stage over all solves."""
    solves = [solve["stages"] for row in rows for solve in row["seeds"]]
    names = dict.fromkeys(name for stages in solves for name in stages)
    return {name: sum(stages.get(name, 0.0) for stages in solves) / len(solves) for name in names}


def format_status_changes(pairs):
    """Return a text that lists the solves whose status changed."""
    changed = [f"{a['status']} to {b['status']}" for a, b in pairs if a["status"] != b["status"]]
    return "; ".join(changed) if changed else "all ended as before"


if __name__ == "__main__":
    run(*sys.argv[1:])
