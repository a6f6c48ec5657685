"""Global bound: gap over CPU time, and how often default solves come near the best known grasp.

Parts: ``gaps``, ``meshes``, ``hits``, ``peg``, ``brute``, ``hands``; ``best:hits:0:20`` runs the first 20 problems
of the hit rate.
"""

import time

import numpy as np

import nlpgrasp as ng
from benchmarks import hand_budgets
from benchmarks.best_problems import gap_problems, hit_problem
from benchmarks.outside import MESHES, MISSING, load_mesh
from problems.peg_in_hole import problem as peg
from tests.global_bound.brute_force.cases import Case
from tests.global_bound.brute_force.compare import compare, format_comparison
from tests.global_bound.brute_force.search import BruteForce

TIMES = (1.0, 3.0, 10.0, 30.0, 60.0)
FINE = 0.005  # relative gap at which searches for the best known grasp end
HITS, SEEDS, PEG_SEEDS, MANY = 60, 2, 10, 2000
LOOKED = 4.0  # seconds of wall time of such a search
NEAR, LOW = 0.98, 0.90
OPTIONS = ng.SolveOptions(workers=1, rank="mu")


def run(part=None, first=0, last=HITS):
    parts = {
        "gaps": gaps,
        "meshes": meshes,
        "hits": lambda: hits(range(int(first), int(last))),
        "peg": pegs,
        "brute": brute,
    }
    parts["hands"] = hand_budgets.run
    for name in parts if part is None else (part,):
        parts[name]()


def gap_over_time(problem, seconds, gap):
    """Return the gaps after ``TIMES`` of CPU time, the CPU seconds of the search, and its result."""
    start_time = time.process_time()
    gaps = []

    def watch(upper, mu, nodes):
        elapsed = time.process_time() - start_time
        while len(gaps) < len(TIMES) and elapsed >= TIMES[len(gaps)]:
            gaps.append(_gap(upper, mu.lower))

    best = ng.best_possible(problem, gap, seconds, watch)
    gaps += [_gap(best.upper, best.mu.lower)] * (sum(t <= seconds for t in TIMES) - len(gaps))
    return gaps[: sum(t <= seconds for t in TIMES)], time.process_time() - start_time, best


def _gap(upper, lower):
    """Return the relative gap between an upper and a lower bound."""
    return upper / lower - 1.0 if lower > 0.0 else (0.0 if upper <= 1e-9 else np.inf)


def gaps():
    """Print the gap over CPU time for problems with analytic bodies."""
    print(f"gap after {', '.join(f'{t:g}' for t in TIMES)} s of CPU time, or less where it was closed before")
    missed = 0
    for name, problem, target, seconds in gap_problems():
        values, seconds_spent, search = gap_over_time(problem, seconds, target)
        missed += values[-1] > target
        remark = "" if values[-1] <= target else "  MISSED"
        print(
            f"{name}: {_format_gaps(values)}; {seconds_spent:.1f} s, {search.nodes} nodes, mu {search.mu.lower:.4f}"
            f" (aim {target:.0%} in {seconds:g} s){remark}",
            flush=True,
        )
    print(f"{missed} missed")


def _format_gaps(gaps):
    """Return gaps as text in per cent."""
    return ", ".join(f"{gap:.2%}" for gap in gaps)


def meshes():
    """Print the gap over CPU time for the shared meshes."""
    if not MESHES.is_dir():
        print(f"skipped meshes: {MISSING}")
        return
    for path in sorted(MESHES.glob("*.stl")):
        body = load_mesh(path)
        task = ng.TaskEllipsoid([1, 1, 1, *[body.size] * 3])
        values, _, search = gap_over_time(ng.GraspProblem(body, [ng.FrictionContact(0.6)] * 4, task), 60.0, 0.01)
        print(f"{path.name}: {_format_gaps(values)}; mu {search.mu.lower:.4f} (aim 40 % after 60 s)", flush=True)


def hits(indices):
    """Print the quality of default solves relative to the best known grasp.

    The best known grasp is that of branch and bound, brute force and all solves.
    """
    ratios, without_grasp, seconds = [], 0, []
    for index in indices:
        name, problem = hit_problem(index)
        values, cpu_seconds = solves(problem, range(SEEDS))
        _, _, search = gap_over_time(problem, LOOKED, FINE)
        case = Case(problem, lambda i, b=problem.body: b.face_names, lambda i, p: np.ones(len(p), dtype=bool))
        brute_force = BruteForce(case, np.random.default_rng(index)).certified()[0]
        best_known = max(search.mu.lower, brute_force, *values)
        ratios += [value / best_known if best_known > 0.0 else 1.0 for value in values]
        without_grasp += sum(value <= 0.0 < best_known for value in values)
        seconds.append(cpu_seconds / SEEDS)
        print(
            f"{index} {name}: solves {', '.join(f'{v:.4f}' for v in values)} ({cpu_seconds / SEEDS:.1f} s each); tree"
            f" {search.mu.lower:.4f} of {search.upper:.4f}, brute force {brute_force:.4f}"
            + "".join(f"  {s:.1%}" for s in ratios[-SEEDS:] if s < NEAR),
            flush=True,
        )
    within = np.mean(np.array(ratios) >= NEAR)
    far_below = int(np.sum(np.array(ratios) < LOW)) - without_grasp
    print(
        f"{within:.1%} of {len(ratios)} solves within 2 % of the best known (aim 97 %); {far_below} below 90 % (aim 0);"
    )
    print(
        f"{without_grasp} without a grasp where there is one (aim 0); {np.median(seconds):.1f} s a solve in the median"
    )


def brute():
    """Print the random problems in which brute force exceeds the bound, and how often it comes near the bound."""
    comparisons = [comparison for index in range(MANY) if (comparison := compare(index)) is not None]
    for comparison in comparisons:
        if not comparison.holds:
            print(format_comparison(comparison))
    near = np.mean([comparison.near(0.05) for comparison in comparisons])
    print(f"{len(comparisons)} problems; brute force within 5 % of the bound in {100.0 * near:.0f} % of them")


def solves(problem, seeds):
    """Return the certified mu of default solves for each seed, and their total CPU seconds."""
    start_time = time.process_time()
    solutions = [ng.solve(problem, seed=seed, options=OPTIONS) for seed in seeds]
    return [s.mu.lower if s.success else 0.0 for s in solutions], time.process_time() - start_time


def pegs():
    """Print the quality of default solves of the peg-in-hole problem for each seed."""
    values, cpu_seconds = solves(peg(), range(PEG_SEEDS))
    worst = min(values) / max(values)
    print(
        f"peg in hole, {PEG_SEEDS} seeds: mu {', '.join(f'{v:.4f}' for v in values)};"
        f" {cpu_seconds / PEG_SEEDS:.1f} s each"
    )
    print(f"the least is {worst:.1%} of the best (aim 98 %)")
