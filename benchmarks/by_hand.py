"""Against what one would write by hand, from the same screened starts: SLSQP, and random directions.

(a) scipy's SLSQP on mu sampled in 200 random directions, with its own finite differences. (b) the same vertex
program, and the support program, with as many random directions as there are E6 roots.
"""

import time

import numpy as np

import nlpgrasp as ng
from benchmarks.peers import by_slsqp
from benchmarks.peers.cases import Case
from benchmarks.peers.random_search import Placement
from nlpgrasp.common.deadline import Deadline
from nlpgrasp.nlp import CompiledProgram, optimal_grasp_program
from nlpgrasp.optimize.candidate import GraspCandidate
from nlpgrasp.optimize.compiled_problem import CompiledProblem, candidate_of, pack_variables
from nlpgrasp.optimize.propose import propose
from nlpgrasp.optimize.start import run_start
from nlpgrasp.quality.ratio_minimisation import random_directions

AXES = np.array([2.0, 1.0, 1.0])
TASK = ng.TaskEllipsoid([1.0] * 6)
CONTACTS = [ng.FrictionContact(0.5)] * 4
FACES = ("surface",) * 4
STARTS = 4
BODY = ng.Ellipsoid(AXES)
CASE = Case("ellipsoid", lambda: BODY, 4, (1.0, 1.0, 1.0, *[1.0 / BODY.size] * 3))  # the same task


def slsqp(points, rng):
    """Return what SLSQP makes of placements on the ellipsoid, put back onto it, and what it believes."""
    normals = -points / AXES**2
    start = Placement(points, normals / np.linalg.norm(normals, axis=1, keepdims=True), FACES)
    p, believed = by_slsqp.candidate(CASE, start, rng)
    return p / np.linalg.norm(p / AXES, axis=1, keepdims=True), believed


def random_program(bench, compiled, points, rng, transcription):
    u = random_directions(72, 6, rng)
    start = pack_variables(bench, compiled.program, GraspCandidate(FACES, points))
    start[compiled.program.block("beta").range] = 0.1
    parameters = u.ravel() if transcription == "vertex" else np.concatenate([u.ravel(), np.ones(72)])
    found = compiled.solve(start, parameters)
    return candidate_of(bench, compiled.program, FACES, found.z).points, found.objective / bench.scaling.beta


def certified(bench, points):
    return ng.mu(bench.grasp(GraspCandidate(FACES, points)), TASK, 0.02)


def run():
    problem = ng.GraspProblem(BODY, CONTACTS, TASK)
    bench = CompiledProblem(problem, ng.SolveOptions(workers=1))
    run_start(bench, STARTS, 0, Deadline())
    programs = {
        "vertex": CompiledProgram(optimal_grasp_program(problem, "vertex", 72), {"tol": 1e-4, "max_iter": 300}),
        "support": CompiledProgram(optimal_grasp_program(problem, "support", 72), {"tol": 1e-4, "max_iter": 300}),
    }
    rows = {"nlpgrasp": [], "SLSQP": [], "vertex, random": [], "support, random": []}
    for index in range(STARTS):
        result = run_start(bench, index, 0, Deadline())
        seconds = sum(v for k, v in result.record.seconds.items() if k != "certificate")
        rows["nlpgrasp"].append((result.record.mu.lower, seconds, result.record.mu.upper))
        points = propose(bench, np.random.default_rng([0, index]))[0].points
        for name, method in {
            "SLSQP": lambda p, r: slsqp(p, r),
            "vertex, random": lambda p, r: random_program(bench, programs["vertex"], p, r, "vertex"),
            "support, random": lambda p, r: random_program(bench, programs["support"], p, r, "support"),
        }.items():
            begun = time.perf_counter()
            found, believed = method(points, np.random.default_rng(index))
            seconds = time.perf_counter() - begun
            rows[name].append((certified(bench, found).lower, seconds, believed))
    ours = np.array(rows["nlpgrasp"])
    print(f"{'':16} certified mu of each start          median   believed   seconds   mu / ours   time / ours")
    for name, values in rows.items():
        mu, seconds, believed = np.array(values).T
        ratio, slower = np.median(mu) / np.median(ours[:, 0]), np.median(seconds) / np.median(ours[:, 1])
        shown = " ".join(f"{m:.3f}" for m in mu)
        medians = f"{np.median(mu):.3f} {np.median(believed):10.3f} {np.median(seconds):9.2f}"
        print(f"{name:16} {shown:35} {medians} {ratio:11.2f} {slower:13.2f}")
