"""``ng.solve``: quality, status, constraints, seeds, time limit, progress, arguments."""

import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from threadpoolctl import threadpool_info

import nlpgrasp as ng
from nlpgrasp.optimize.compiled_problem import CompiledProblem
from nlpgrasp.optimize.processes import single_thread
from nlpgrasp.pipeline.multistart import progress_callback
from nlpgrasp.solution.records import UNKNOWN, StartRecord, Status

BALL = ng.TaskEllipsoid([1.0] * 6)


def ellipsoid(k=4, contact=None, **fields):
    return ng.GraspProblem(ng.Ellipsoid([2.0, 1.0, 1.0]), [contact or ng.FrictionContact(0.5)] * k, BALL, **fields)


def square():
    body = ng.Polygon([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    return ng.GraspProblem(body, [ng.FrictionContact(0.5)] * 2, ng.TaskEllipsoid([1.0] * 3, center=[0, 0.5, 0]))


@pytest.fixture(scope="module")
def four_fingers():
    return ng.solve(ellipsoid(), starts=4, options=ng.SolveOptions(workers=2))


@pytest.mark.slow
def test_ellipsoid_with_four_fingers_beats_the_best_known(four_fingers):
    """Best known before: 0.7309, by the exchange with forces in the program."""
    assert four_fingers.status is ng.Status.SOLVED
    assert four_fingers.mu.upper > 0.7309
    assert four_fingers.mu.lower >= 0.7255
    assert four_fingers.mu.gap <= 0.0101
    assert all(start.mu.lower > 0.69 for start in four_fingers.starts)


@pytest.mark.slow
def test_ellipsoid_with_three_fingers():
    solution = ng.solve(ellipsoid(3), starts=4, options=ng.SolveOptions(workers=1, global_bound=False))
    assert solution.mu.upper > 0.4869
    assert solution.mu.lower >= 0.4825


@pytest.mark.slow
def test_contacts_are_on_the_body_with_its_normals(four_fingers):
    grasp = four_fingers.grasp
    np.testing.assert_allclose(np.sum((grasp.points / [2.0, 1.0, 1.0]) ** 2, axis=1), 1.0, atol=1e-12)
    inward = -grasp.points / np.array([4.0, 1.0, 1.0])
    inward /= np.linalg.norm(inward, axis=1, keepdims=True)
    np.testing.assert_allclose(grasp.normals, inward, atol=1e-12)


@pytest.mark.slow
def test_forces_produce_the_task_scaled_by_the_certified_quality(four_fingers):
    grasp = four_fingers.grasp
    assert len(four_fingers.forces) == 12
    for wrench, forces in four_fingers.forces:
        assert np.linalg.norm(wrench) == pytest.approx(four_fingers.mu.lower)
        total = np.concatenate([forces.sum(axis=0), np.cross(grasp.points, forces).sum(axis=0)])
        np.testing.assert_allclose(total, wrench, atol=1e-8)
        assert np.linalg.norm(forces) <= 1.0 + 1e-8


@pytest.mark.slow
def test_the_answer_does_not_depend_on_the_number_of_workers():
    problem = ellipsoid(3)
    one, two = (
        ng.solve(problem, starts=2, options=ng.SolveOptions(workers=w, rtol=0.1, final_rtol=0.05)) for w in (1, 2)
    )
    np.testing.assert_array_equal(one.grasp.G, two.grasp.G)
    assert one.mu == two.mu
    assert [(s.mu, s.iterations) for s in one.starts] == [(s.mu, s.iterations) for s in two.starts]


@pytest.mark.slow
def test_another_seed_is_another_search():
    options = ng.SolveOptions(workers=1, rounds=0, rtol=0.5, final_rtol=0.5, global_bound=False)
    a, b = (ng.solve(ellipsoid(), starts=1, seed=s, options=options) for s in (0, 1))
    assert not np.array_equal(a.grasp.points, b.grasp.points)


@pytest.mark.slow
def test_one_start_leads_to_the_best_grasp_of_an_ellipsoid():
    options = ng.SolveOptions(workers=1, rtol=0.05, final_rtol=0.05, global_bound=False)
    solution = ng.solve(ellipsoid(), starts=1, options=options)
    assert ng.mu(solution.grasp, solution.task, 1e-4).upper == pytest.approx(0.73193, rel=1e-4)


@pytest.mark.slow
def test_elliptic_torsion_goes_through_the_exchange_with_forces():
    options = ng.SolveOptions(workers=1, rounds=4, rtol=0.1, final_rtol=0.1)
    solution = ng.solve(ellipsoid(3, ng.SoftContact(0.5, 0.3, "elliptic")), starts=1, options=options)
    assert solution.mu.lower > 0.49
    assert ng.verify(solution)


@pytest.mark.slow
def test_constraints_hold_and_are_reported():
    problem = ellipsoid(
        constraints=[
            ng.Table(-0.3),
            ng.Forbid(ng.HalfSpace([1.0, 0.0, 0.0], 1.0)),
            ng.Spread(0.4, 2.5),
            ng.Constraint("level", lambda p, n: p[0][2] - p[1][2], 0.0, 0.0),
        ]
    )
    options = ng.SolveOptions(rtol=0.05, workers=1, global_bound=False)
    solution = ng.solve(problem, starts=2, options=options)
    p = solution.grasp.points
    assert np.min(p[:, 2]) >= -0.3 - 1e-4
    assert np.max(p[:, 0]) <= 1.0 + 1e-4
    distances = [np.linalg.norm(p[i] - p[j]) for i in range(4) for j in range(i)]
    assert min(distances) >= 0.4 - 1e-4
    assert max(distances) <= 2.5 + 1e-4
    assert p[0, 2] == pytest.approx(p[1, 2], abs=1e-4)
    level = next(c for c in solution.constraints if c.name == "level")
    assert level.active
    tight = [c for c in solution.constraints if c.name.startswith("table") and c.active]
    assert all(c.multiplier <= 1e-6 for c in tight)  # a higher table never helps
    assert ng.verify(solution)


@pytest.mark.slow
def test_reach_keeps_the_fingertips_together():
    problem = ellipsoid(3, hand=ng.Fingertips(3, radius=0.1, reach=1.1))
    options = ng.SolveOptions(workers=1, rtol=0.1, final_rtol=0.1, global_bound=False)
    solution = ng.solve(problem, starts=1, options=options)
    tips = solution.grasp.points - 0.1 * solution.grasp.normals
    palm = np.array(solution.hand["palm"])
    assert np.max(np.linalg.norm(tips - palm, axis=1)) <= 1.1 + 1e-3


@pytest.mark.slow
def test_no_grasp_is_a_result_not_an_exception():
    """Two frictional points never resist every wrench in space."""
    options = ng.SolveOptions(workers=1, global_bound=False)
    solution = ng.solve(ellipsoid(2), starts=1, options=options)
    assert solution.status is ng.Status.NO_GRASP
    assert not solution.success
    assert solution.starts[0].mu.upper == 0.0
    with pytest.raises(ng.NoGraspError, match="No grasp found") as caught:
        ng.solve(ellipsoid(2), starts=1, options=options, throw=True)
    assert caught.value.solution.status is ng.Status.NO_GRASP


def test_planar_face_assignments_are_enumerated():
    options = ng.SolveOptions(workers=1, global_bound=False)
    solution = ng.solve(square(), starts=2, options=options)
    assert sorted(solution.faces) == ["edge0", "edge2"]
    assert solution.mu.upper == pytest.approx(0.37993, abs=1e-4)


@pytest.mark.parametrize(("seconds", "workers"), [(1.5, 1), pytest.param(4.0, 2, marks=pytest.mark.slow)])
def test_time_limit_is_honoured_and_keeps_the_best(seconds, workers):
    begun = time.monotonic()
    options = ng.SolveOptions(time_limit=seconds, workers=workers)
    solution = ng.solve(square(), starts=2000, options=options)
    assert solution.status is ng.Status.TIME_LIMIT
    assert solution.mu.lower > 0.3
    assert time.monotonic() - begun < seconds + 15.0  # the grace of running certificates, on a busy machine


def test_progress_sees_every_start():
    records = []
    options = ng.SolveOptions(workers=1, rounds=0, rtol=0.5, final_rtol=0.5, global_bound=False)
    note = lambda record, best: records.append((record.index, best.lower))  # noqa: E731
    ng.solve(square(), starts=2, options=options, progress=note)
    assert [index for index, _ in records] == [0, 1]
    assert records[1][1] >= records[0][1] > 0.0


def test_progress_writes_a_line_a_start_where_it_is_asked_for(capsys):
    options = ng.SolveOptions(workers=1, rounds=0, rtol=0.5, final_rtol=0.5, global_bound=False)
    ng.solve(square(), starts=1, options=options)
    assert capsys.readouterr() == ("", "")
    ng.solve(square(), starts=2, options=options, progress=True)
    out, err = capsys.readouterr()
    assert out == ""
    line = r"start {} of 2: mu-tilde in \[0\.\d+, 0\.\d+\]; best \[0\.\d+, 0\.\d+\]; \d+\.\d s\n"
    assert re.fullmatch(line.format(1) + line.format(2), err)
    with pytest.raises(ng.InputError, match=r"^progress: got yes, expected True for a line a start, or"):
        ng.solve(ellipsoid(), progress="yes")


def test_a_start_without_a_grasp_is_told_in_words(capsys):
    progress_callback(True, 3)(StartRecord(0, Status.LOCALLY_INFEASIBLE), UNKNOWN)
    assert re.fullmatch(r"start 1 of 3: constraints not kept; no grasp yet; 0\.\d s\n", capsys.readouterr().err)


SCRIPT = """
import nlpgrasp as ng
unit = 1.0
problem = ng.GraspProblem(
    ng.Implicit(lambda p: p[0] ** 2 / 4 + p[1] ** 2 + p[2] ** 2 - unit, [[-2.1, -1.1, -1.1], [2.1, 1.1, 1.1]]),
    [ng.FrictionContact(0.5)] * 4,
    ng.TaskEllipsoid([1.0] * 6),
)
options = ng.SolveOptions(workers=2, rounds=0, rtol=0.5, final_rtol=0.5)
print("mu", ng.solve(problem, starts=2, options=options).mu.lower > 0.1)
"""


@pytest.mark.slow
def test_a_script_without_a_main_guard_may_use_workers(tmp_path):
    path = tmp_path / "script.py"
    path.write_text(SCRIPT)
    process = subprocess.run([sys.executable, str(path)], capture_output=True, text=True, timeout=120)
    assert (process.returncode, process.stdout) == (0, "mu True\n"), process.stderr


@pytest.mark.slow
@pytest.mark.parametrize("workers", [1, 2])
def test_interrupt_keeps_the_best_grasp_so_far(tmp_path, workers):
    script = tmp_path / "script.py"
    script.write_text(
        "import nlpgrasp as ng\n"
        "fingers = [ng.FrictionContact(0.5)] * 4\n"
        "problem = ng.GraspProblem(ng.Ellipsoid([2, 1, 1]), fingers, ng.TaskEllipsoid([1.0] * 6))\n"
        f"options = ng.SolveOptions(workers={workers}, rtol=0.2, final_rtol=0.2)\n"
        "say = lambda record, best: print('start', flush=True)\n"
        "solution = ng.solve(problem, starts=500, options=options, progress=say)\n"
        "print(solution.status.name, solution.mu.lower > 0.3)\n"
    )
    process = subprocess.Popen([sys.executable, str(script)], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    assert process.stdout.readline() == "start\n"
    os.kill(process.pid, signal.SIGINT)
    out, err = process.communicate(timeout=120)
    assert out.splitlines()[-1] == "INTERRUPTED True", err
    assert "Traceback" not in err


def test_workbench_directions_for_a_flat_task():
    task = ng.TaskEllipsoid([1.0, 1.0, 0.0, 1.0, 0.0, 0.0])
    compiled = CompiledProblem(ng.GraspProblem(ng.Sphere(1.0), [ng.FrictionContact(0.5)] * 3, task), ng.SolveOptions())
    w = compiled.task_samples.wrenches(np.random.default_rng(0))
    assert len(w) == compiled.task_samples.count
    assert np.all(w[:, [2, 4, 5]] == 0.0)
    np.testing.assert_allclose(np.linalg.norm(w, axis=1), 1.0)


@pytest.mark.slow
def test_a_flat_task_without_torque(capfd):
    """Smooth fingers on a sphere: no torque is asked for and none can be exerted; more equations than unknowns."""
    problem = ng.GraspProblem(ng.Sphere(0.03), [ng.PointContact()] * 4, ng.TaskEllipsoid([1, 1, 1, 0, 0, 0]))
    options = ng.SolveOptions(workers=1, global_bound=False)
    solution = ng.solve(problem, starts=2, options=options)
    assert solution.mu.upper == pytest.approx(1 / np.sqrt(3.0), rel=1e-4)  # the best there is
    assert all(start.mu.upper == pytest.approx(1 / np.sqrt(3.0), rel=1e-4) for start in solution.starts)
    assert "overconstrained" not in capfd.readouterr().err


THREADS = """
import nlpgrasp as ng
task = ng.TaskEllipsoid([2.0, 2.0, 2.0, 0.05, 0.05, 0.05])
problem = ng.GraspProblem(ng.Box([0.08, 0.05, 0.05]), [ng.FrictionContact(0.6)] * 3, task)
print([start.mu for start in ng.solve(problem, starts=2, options=ng.SolveOptions(workers=1)).starts])
"""


@pytest.mark.slow
def test_the_answer_does_not_depend_on_the_number_of_threads():
    """IPOPT's own OpenBLAS is limited like numpy's: the same bits whatever the environment says."""
    answers = set()
    for threads in ("1", "2", "4"):
        environment = {**os.environ, "OMP_NUM_THREADS": threads, "OPENBLAS_NUM_THREADS": threads}
        command = [sys.executable, "-c", THREADS]
        process = subprocess.run(command, capture_output=True, text=True, timeout=120, env=environment)
        assert process.returncode == 0, process.stderr
        answers.add(process.stdout)
    assert len(answers) == 1


def test_every_library_computes_on_one_thread():
    with single_thread():
        limited = {Path(found["filepath"]).name: found["num_threads"] for found in threadpool_info()}
    assert any(name.startswith("libcasadi") for name in limited)
    assert set(limited.values()) == {1}


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: ng.solve("problem"), "a GraspProblem"),
        (lambda: ng.solve(ellipsoid(), starts=0), "starts"),
        (lambda: ng.solve(ellipsoid(), seed=-1), "seed"),
        (lambda: ng.SolveOptions(rounds=-1), "rounds"),
        (lambda: ng.SolveOptions(rtol=0.0), "rtol"),
        (lambda: ng.SolveOptions(time_limit=-1.0), "time_limit"),
        (lambda: ng.SolveOptions(workers=0), "workers"),
    ],
)
def test_bad_options_are_refused(call, message):
    with pytest.raises(ng.InputError, match=message):
        call()
