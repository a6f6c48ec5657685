"""Comparison with hand-written solvers from the same starts: SLSQP, and programs with random directions.

(a) scipy's SLSQP on mu sampled in 200 random directions, with finite differences. (b) The vertex and the support
program with 72 random directions instead of the roots of E6.
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
    """Return the contacts of an SLSQP solve, projected onto the ellipsoid, and the solver's estimate of mu."""
    normals = -points / AXES**2
    start = Placement(points, normals / np.linalg.norm(normals, axis=1, keepdims=True), FACES)
    p, believed = by_slsqp.candidate(CASE, start, rng)
    return p / np.linalg.norm(p / AXES, axis=1, keepdims=True), believed


def random_program(compiled, program, points, rng, transcription):
    """Return the contacts of a program with random directions, and the program's estimate of mu."""
    directions = random_directions(72, 6, rng)
    start = pack_variables(compiled, program.program, GraspCandidate(FACES, points))
    start[program.program.block("beta").range] = 0.1
    parameters = directions.ravel() if transcription == "vertex" else np.concatenate([directions.ravel(), np.ones(72)])
    result = program.solve(start, parameters)
    return candidate_of(compiled, program.program, FACES, result.z).points, result.objective / compiled.scaling.beta


def certified(compiled, points):
    """Return certified bounds on mu of a grasp with given contact points."""
    return ng.mu(compiled.grasp(GraspCandidate(FACES, points)), TASK, 0.02)


def run():
    problem = ng.GraspProblem(BODY, CONTACTS, TASK)
    compiled = CompiledProblem(problem, ng.SolveOptions(workers=1))
    run_start(compiled, STARTS, 0, Deadline())
    programs = {
        "vertex": CompiledProgram(optimal_grasp_program(problem, "vertex", 72), {"tol": 1e-4, "max_iter": 300}),
        "support": CompiledProgram(optimal_grasp_program(problem, "support", 72), {"tol": 1e-4, "max_iter": 300}),
    }
    results = {"nlpgrasp": [], "SLSQP": [], "vertex, random": [], "support, random": []}
    for index in range(STARTS):
        result = run_start(compiled, index, 0, Deadline())
        seconds = sum(v for k, v in result.record.seconds.items() if k != "certificate")
        results["nlpgrasp"].append((result.record.mu.lower, seconds, result.record.mu.upper))
        points = propose(compiled, np.random.default_rng([0, index]))[0].points
        for name, method in {
            "SLSQP": lambda p, r: slsqp(p, r),
            "vertex, random": lambda p, r: random_program(compiled, programs["vertex"], p, r, "vertex"),
            "support, random": lambda p, r: random_program(compiled, programs["support"], p, r, "support"),
        }.items():
            start_time = time.perf_counter()
            candidate, believed = method(points, np.random.default_rng(index))
            seconds = time.perf_counter() - start_time
            results[name].append((certified(compiled, candidate).lower, seconds, believed))
    reference = np.array(results["nlpgrasp"])
    print(f"{'':16} certified mu of each start          median   believed   seconds   mu / ours   time / ours")
    for name, values in results.items():
        mu, seconds, believed = np.array(values).T
        ratio, time_ratio = np.median(mu) / np.median(reference[:, 0]), np.median(seconds) / np.median(reference[:, 1])
        values_text = " ".join(f"{m:.3f}" for m in mu)
        medians = f"{np.median(mu):.3f} {np.median(believed):10.3f} {np.median(seconds):9.2f}"
        print(f"{name:16} {values_text:35} {medians} {ratio:11.2f} {time_ratio:13.2f}")
