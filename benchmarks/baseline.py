"""The baseline: 60 problems, three seeds of eight starts, each in its own process; beside what baseline.json stores.

``baseline`` compares with the stored file, ``baseline:store`` writes it, ``baseline:jaw`` compares one group.
Seconds are of CPU, over those of a fixed piece of work that is timed in the same run.
"""

import json
import multiprocessing
import os
import time
from pathlib import Path

import numpy as np

import nlpgrasp as ng
from benchmarks.baseline_problems import baseline_problems

FILE = Path(__file__).with_name("baseline.json")
SEEDS, STARTS = 3, 8
WORSE = 0.98  # of the stored certified bound: below, a problem is named
OWN_STAGES = ("total", "ipopt", "functions")  # sums or parts of others
DIGITS = 5


def run(part=None):
    before = None if part == "store" or not FILE.exists() else json.loads(FILE.read_text())
    chosen = [(i, group, name) for i, (group, name, problem) in enumerate(baseline_problems()) if problem is not None]
    if part not in (None, "store"):
        chosen = [each for each in chosen if each[1] == part]
    unit = work_unit()
    asked = [(i, seed) for i, _, _ in chosen for seed in range(SEEDS)]
    os.environ |= {"OMP_NUM_THREADS": "1", "NLPGRASP_CACHE": "off"}
    with multiprocessing.get_context("spawn").Pool(os.cpu_count(), maxtasksperchild=1) as pool:
        found = pool.map(solved, asked, chunksize=1)
    rows = [
        {"group": group, "name": name, "seeds": found[n * SEEDS : (n + 1) * SEEDS]}
        for n, (_, group, name) in enumerate(chosen)
    ]
    now = {"unit": unit, "problems": rows}
    if part == "store":
        FILE.write_text("{" + f'"unit": {unit:.4g}, "problems": [\n' + ",\n".join(map(json.dumps, rows)) + "\n]}\n")
    compare(now if before is None else before, now)


def work_unit():
    """Return the least CPU seconds of a fixed piece of work."""
    matrix, least = np.random.default_rng(0).normal(size=(60, 60)), np.inf
    for _ in range(5):
        begun = time.process_time()
        for _ in range(100):
            np.linalg.svd(matrix)
            sum(i * i for i in range(20000))
        least = min(least, time.process_time() - begun)
    return least


def solved(asked):
    """Return what a default solve of problem ``number`` with a seed found and cost, as JSON data."""
    number, seed = asked
    problem = list(baseline_problems())[number][2]
    begun = time.process_time()
    solution = ng.solve(problem, starts=STARTS, seed=seed, options=ng.SolveOptions(workers=1))
    spent = time.process_time() - begun
    stages = {name: s for name, s in solution.solver["seconds"].items() if name not in OWN_STAGES and s >= 0.001}
    return {
        "status": solution.status.name,
        "lower": rounded(solution.mu.lower if solution.success else 0.0),
        "upper": rounded(solution.mu.upper if solution.success else 0.0),
        "bound": None if solution.bound is None else rounded(solution.bound.upper),
        "cpu": rounded(spent, 4),
        "calls": solution.solver["ipopt_calls"],
        "stages": {name: rounded(s, 3) for name, s in stages.items()},
    }


def rounded(value, digits=DIGITS):
    """Return a number with so many significant digits."""
    return float(f"{value:.{digits}g}")


def compare(before, now):
    """Print mu, gap, CPU time and IPOPT's calls beside those before, by group; the stages; the problems that lost."""
    old = {row["name"]: row for row in before["problems"]}
    speed = now["unit"] / before["unit"]
    print(f"the fixed piece of work takes {now['unit']:.2f} s, before {before['unit']:.2f} s")
    groups = dict.fromkeys(row["group"] for row in now["problems"])
    for group in [*groups, "all"]:
        rows = [(old[r["name"]], r) for r in now["problems"] if group in (r["group"], "all") and r["name"] in old]
        pairs = [pair for was, row in rows for pair in zip(was["seeds"], row["seeds"], strict=True)]
        mu = np.array([b["lower"] / a["lower"] if a["lower"] else 1.0 for a, b in pairs])
        seconds = np.array([(a["cpu"], b["cpu"] / speed) for a, b in pairs])
        bounds = [b["bound"] / a["bound"] for a, b in pairs if a["bound"] and b["bound"]]
        calls = np.median([(a["calls"], b["calls"]) for a, b in pairs], axis=0)
        shown = f", bound {np.median(bounds):.4f} (most {max(bounds):.4f})" if bounds else ""
        print(
            f"{group}: mu over before, median {np.median(mu):.4f}, least {mu.min():.4f}, below"
            f" {WORSE:g} in {np.sum(mu < WORSE)} of {len(mu)}{shown}; CPU {np.median(seconds[:, 0]):.2f} to"
            f" {np.median(seconds[:, 1]):.2f} s, median ratio {np.median(seconds[:, 1] / seconds[:, 0]):.2f}; IPOPT"
            f" {calls[0]:.0f} to {calls[1]:.0f} calls; {ends(pairs)}"
        )
    rows = [(old[row["name"]], row) for row in now["problems"] if row["name"] in old]
    was, is_now = (stage_means([pair[i] for pair in rows]) for i in (0, 1))
    for stage in was | is_now:
        print(f"  {stage}: {was.get(stage, 0.0):.2f} to {is_now.get(stage, 0.0) / speed:.2f} s in the mean")
    for row in now["problems"]:
        best = [max(x["lower"] for x in r["seeds"]) for r in (old.get(row["name"], row), row)]
        each = [", ".join(f"{x['lower']:.4g}" for x in r["seeds"]) for r in (old.get(row["name"], row), row)]
        if before is now or best[1] < WORSE * best[0]:
            print(f"  {row['name']}: {each[0]}" if before is now else f"  {row['name']}: {each[0]} to {each[1]}")


def stage_means(rows):
    """Return the seconds of each stage in the mean over all solves of some problems."""
    solves = [solve["stages"] for row in rows for solve in row["seeds"]]
    names = dict.fromkeys(name for stages in solves for name in stages)
    return {name: sum(stages.get(name, 0.0) for stages in solves) / len(solves) for name in names}


def ends(pairs):
    """Return how solves ended where that changed, in words."""
    changed = [f"{a['status']} to {b['status']}" for a, b in pairs if a["status"] != b["status"]]
    return "; ".join(changed) if changed else "all ended as before"
