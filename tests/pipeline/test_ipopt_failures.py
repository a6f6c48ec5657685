"""Failures of IPOPT: a linear solver without its library, an option that does not exist."""

import json
import pickle
import subprocess
import sys
from typing import ClassVar

import numpy as np
import pytest

import nlpgrasp as ng
from nlpgrasp.common.deadline import Deadline
from nlpgrasp.optimize import compiled_programs as programs
from nlpgrasp.optimize.candidate import SolverEffort
from nlpgrasp.optimize.compiled_problem import CompiledProblem
from nlpgrasp.optimize.local_convergence import converge_to_optimum
from nlpgrasp.optimize.start import run_start
from nlpgrasp.solution.start_summary import ipopt_lines

SQUARE = ng.Polygon([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
OPTIONS = ng.SolveOptions(workers=1, rtol=0.05, final_rtol=0.05)


def problem():
    return ng.GraspProblem(SQUARE, [ng.FrictionContact(0.5)] * 3, ng.TaskEllipsoid([1.0, 1.0, 0.5]))


class Given(programs.CompiledProgram):
    """Programs of which IPOPT has an option that it cannot follow."""

    option: ClassVar = {"linear_solver": "ma57", "hsllib": "/no/such/library.so"}

    def __init__(self, program, ipopt):
        super().__init__(program, {**ipopt, **self.option})


class Unknown(Given):
    option: ClassVar = {"no_such_option": 1}


@pytest.fixture(params=[(Given, "Invalid_Option"), (Unknown, "No such IPOPT option: no_such_option")])
def broken(request, monkeypatch):
    kind, status = request.param
    monkeypatch.setattr(programs, "CompiledProgram", kind)
    return status


def test_what_ipopt_returns_without_running_is_the_start(broken):
    compiled = CompiledProblem(problem(), OPTIONS)
    program = compiled.initial_nlp.program
    start = np.full(len(program.bounds[0]), 0.25)
    result = compiled.initial_nlp.solve(start, np.zeros(program.parameters[-1].stop))
    assert not result.ran
    assert not result.success
    assert result.status == broken
    assert result.iterations == 0  # CasADi's count is not set then
    np.testing.assert_array_equal(result.z, start)
    assert not result.multipliers.any()
    assert SolverEffort.of(result) + SolverEffort.of(result) == SolverEffort(0, 2 * result.seconds, 0.0, 2, {broken: 2})


@pytest.mark.slow
def test_a_solve_says_that_ipopt_did_not_run(broken, tmp_path):
    with pytest.warns(UserWarning, match="IPOPT did not run in") as warnings:
        solution = ng.solve(problem(), starts=8, options=OPTIONS)
    assert len([w for w in warnings if "IPOPT" in str(w.message)]) == 1
    calls = solution.solver["ipopt_calls"]
    assert solution.solver["ipopt_failures"] == {broken: calls}
    assert solution.solver["iterations"] == 0
    line = f"IPOPT did not run in {calls} of {calls} calls ({broken}: {calls}); the answer comes from the other steps"
    assert f"  {line}\n" in f"{solution}\n"
    assert solution.success
    file = solution.save(tmp_path / "square.json")
    assert json.loads(file.read_text())["solver"]["ipopt_failures"] == {broken: calls}
    assert line in str(ng.GraspSolution.load(file))


@pytest.mark.slow
def test_a_last_step_states_it_to_the_process_that_collects_starts(broken):
    """What a worker returns is pickled, and its effort with it."""
    compiled = CompiledProblem(problem(), OPTIONS)
    last = converge_to_optimum(compiled, run_start(compiled, 3, 0, Deadline()), Deadline())
    effort = pickle.loads(pickle.dumps(last)).total_effort  # noqa: S301
    assert effort.calls > 0
    assert effort.failures == {broken: effort.calls}


@pytest.mark.slow
def test_a_solve_in_which_ipopt_ran_says_nothing(recwarn):
    solution = ng.solve(problem(), starts=8, options=OPTIONS)
    assert "ipopt_failures" not in solution.solver
    assert "IPOPT" not in str(solution)
    assert not [w for w in recwarn if "IPOPT" in str(w.message)]


def test_calls_that_ran_are_told_apart():
    solver = {"ipopt_calls": 5, "ipopt_failures": {"Invalid_Option": 1, "Internal_Error": 2}}
    message = (
        "IPOPT did not run in 3 of 5 calls (Invalid_Option: 1, Internal_Error: 2); the answer comes from the other "
    )
    assert ipopt_lines(solver) == [f"{message}calls and steps"]
    assert ipopt_lines({"ipopt_calls": 5}) == []


IN_WORKERS = """
import nlpgrasp as ng
from nlpgrasp.optimize import compiled_programs as programs


class Given(programs.CompiledProgram):
    def __init__(self, program, ipopt):
        super().__init__(program, {**ipopt, "linear_solver": "ma57", "hsllib": "/no/such/library.so"})


def unpacked():
    from nlpgrasp.optimize import compiled_programs as programs

    programs.CompiledProgram = Given
    return ng.FrictionContact(0.5)


class Contact(ng.FrictionContact):
    def __reduce__(self):
        return unpacked, ()


body = ng.Polygon([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
problem = ng.GraspProblem(body, [Contact(0.5)] * 3, ng.TaskEllipsoid([1.0, 1.0, 0.5]))
solution = ng.solve(problem, starts=8, options=ng.SolveOptions(workers=2, rtol=0.05, final_rtol=0.05))
print(solution.solver["ipopt_calls"], solution.solver["ipopt_failures"])
"""


@pytest.mark.slow
def test_worker_processes_state_it_too(tmp_path):
    """The programs are spoilt where the problem is unpacked: in the workers alone."""
    script = tmp_path / "workers.py"
    script.write_text(IN_WORKERS)
    process = subprocess.run([sys.executable, str(script)], capture_output=True, text=True, timeout=300, check=True)
    calls, failures = process.stdout.split(maxsplit=1)
    assert int(calls) > 0
    assert failures.strip() == f"{{'Invalid_Option': {calls}}}"
    assert process.stderr.count("UserWarning: IPOPT did not run") == 1
    assert "workers.py:25: UserWarning" in process.stderr  # the line that called solve
