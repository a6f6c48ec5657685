"""Local runs: resumption, crashes, interruption, full disk."""

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import pytest

import nlpgrasp as ng
from nlpgrasp.errors import InputError
from nlpgrasp.experiments import output_folder
from tests.experiments.small import QUICK, SCRIPT, base, experiment
from tests.quick import first

ROOT = Path(__file__).resolve().parents[2]


def command(*arguments, kind="fine"):
    line = [sys.executable, "-m", "nlpgrasp", "experiment", str(SCRIPT), *map(str, arguments)]
    environment = {**os.environ, "KIND": kind, "PYTHONPATH": str(ROOT), "COLUMNS": "200", "NO_COLOR": "1"}
    return line, environment


def run(*arguments, kind="fine", cwd=None):
    line, environment = command(*arguments, kind=kind)
    return subprocess.run(line, capture_output=True, text=True, env=environment, cwd=cwd, timeout=300)


def events(output):
    return [json.loads(line) for line in output.splitlines()]


def grasps(result):
    return {
        (s.variation, s.seed): result.solution(s.variation, s.seed).grasp.points.tolist()
        for s in result.solves
        if s.done
    }


def test_every_solve_is_a_verified_solution_file(finished):
    files = sorted(p.name for p in (finished.folder / "solves").iterdir())
    assert files == [f"{v}--seed{s}.json" for v in ("rough", "smooth") for s in (0, 1)]
    for file in files:
        assert ng.verify(finished.folder / "solves" / file, rtol=0.1)
    assert finished.complete
    assert finished.success


@pytest.mark.slow
def test_any_number_of_workers_gives_what_solve_gives(finished, tmp_path):
    one_worker = ng.run_experiment(experiment(), tmp_path / "one", workers=1)
    assert grasps(one_worker) == grasps(finished)
    case = experiment().case("rough")
    direct = ng.solve(case.problem, case.starts, 1, case.options)
    assert direct.grasp.points.tolist() == grasps(finished)[("rough", 1)]
    assert direct.mu.lower == finished.solution("rough", 1).mu.lower


@pytest.mark.slow
def test_resume_does_only_what_is_missing(finished, tmp_path):
    folder = tmp_path / "out"
    ng.run_experiment(experiment(seeds=[0]), folder, workers=1)
    times = {p: p.stat().st_mtime_ns for p in (folder / "solves").iterdir()}
    (folder / "solves" / ".nlpgrasp-half.tmp").write_text("half a fi")
    plan = experiment({"rough": {"friction": 0.8}, "smooth": {}, "new": {"friction": 0.6}}, seeds=[0, 1])
    records = []
    result = ng.run_experiment(plan, folder, workers=1, resume=True, progress=records.append)
    assert {(s.variation, s.seed) for s in records[:2]} == {("rough", 0), ("smooth", 0)}
    assert len(records) == 6
    assert {p: p.stat().st_mtime_ns for p in times} == times
    assert result.complete
    assert not list((folder / "solves").glob("*.tmp"))


@pytest.mark.slow
def test_a_file_that_cannot_be_read_is_done_again_and_said(tmp_path):
    folder = tmp_path / "out"
    first = ng.run_experiment(experiment(seeds=[0]), folder, workers=1)
    (folder / "solves" / "rough--seed0.json").write_text("{")
    resumed = ng.run_experiment(experiment(seeds=[0]), folder, resume=True, workers=1)
    assert resumed.complete
    assert "rough, seed 0: not used" in resumed.notes[0]
    assert grasps(resumed) == grasps(first)


def test_a_folder_with_results_needs_resume(finished):
    with pytest.raises(InputError, match="--resume to go on, or another folder"):
        ng.run_experiment(experiment(), finished.folder)


OTHERS = {
    "name": (lambda: experiment(name="another"), "the experiment 'square'"),
    "variation gone": (lambda: experiment({"rough": {"friction": 0.8}}), "a variation 'smooth'"),
    "problem": (
        lambda: experiment({"rough": {"friction": 0.7}, "smooth": {}}),
        r"whose variation 'rough' is another \(problem, contacts\)",
    ),
    "starts": (lambda: experiment(starts=2), r"whose variation 'rough' is another \(starts\)"),
    "seeds": (lambda: experiment(seeds=[1, 2]), "with seed 0"),
}


@pytest.mark.parametrize(("make", "message"), OTHERS.values(), ids=OTHERS.keys())
def test_the_folder_of_another_experiment_is_refused(finished, make, message):
    with pytest.raises(InputError, match=message):
        ng.run_experiment(make(), finished.folder, resume=True)


def test_a_folder_of_other_things_is_refused(tmp_path):
    (tmp_path / "thesis.tex").write_text("years of work")
    with pytest.raises(InputError, match="files that are no experiment's"):
        ng.run_experiment(experiment(), tmp_path)
    with pytest.raises(InputError, match="no folder"):
        ng.run_experiment(experiment(), tmp_path / "a" / "b")
    with pytest.raises(InputError, match="got a file, expected a folder"):
        ng.run_experiment(experiment(), tmp_path / "thesis.tex")


def test_parts_that_cannot_be_sent_are_refused_before_anything_runs(tmp_path):
    import threading

    lock = threading.Lock()
    with pytest.raises(InputError, match="parts that can be sent to other processes"):
        ng.run_experiment(experiment({"locked": lambda: lock and {}}), tmp_path / "out")
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
def test_crashing_and_failing_solves_cost_only_themselves(tmp_path):
    process = run("--out", "out", "--workers", 2, "--json", kind="troubled", cwd=tmp_path)
    assert process.returncode == 1
    assert process.stderr == ""
    last = events(process.stdout)[-1]
    assert {v["variation"]: v["starts"] for v in last["variations"]} == {
        "friction 0.5": [2, 2],
        "friction 0.7": [2, 2],
        "crash": [0, 0],
        "broken": [0, 0],
        "late": [2, 2],
    }
    failures = {(f["variation"], f["seed"]): f["failure"] for f in last["failures"]}
    assert set(failures) == {(v, s) for v in ("crash", "broken") for s in (0, 1)}
    assert failures["crash", 0] == "its process ended, twice (SIGSEGV(-11)): a crash, or out of memory"
    assert failures["broken", 1] == "ZeroDivisionError: division by zero"
    result = ng.ExperimentResult.load(tmp_path / "out")
    assert {(s.variation, s.seed) for s in result.failures} == set(failures)


RAISED = {
    "interrupt": lambda: KeyboardInterrupt(),
    "exit": lambda: SystemExit(3),
    "odd": lambda: GeneratorExit("odd"),
    "empty": lambda: ng.NlpgraspError(),
    "undecodable": lambda: ValueError("file \udcff \x1b[31m\nhere"),
}


@pytest.mark.parametrize("name", first(1, RAISED))
def test_whatever_a_solve_raises_is_its_own_failure(name, tmp_path):
    def broken(make=RAISED[name]):
        raise make()

    plan = experiment({"broken": broken, "fine": {}}, seeds=[0])
    result = ng.run_experiment(plan, tmp_path / "out", workers=1)
    (failure,) = result.failures
    assert failure.variation == "broken"
    assert failure.failure.isprintable()
    assert failure.failure
    assert result["fine"].mu.lower > 0.3
    assert str(ng.ExperimentResult.load(tmp_path / "out")) == str(result)


@pytest.mark.slow
def test_a_function_that_makes_another_problem_than_before_is_not_mixed_in(tmp_path):
    def experiment_with_friction(friction):
        return experiment({"late": lambda: {"friction": friction}}, seeds=[0] if friction == 0.3 else [0, 1])

    first = ng.run_experiment(experiment_with_friction(0.3), tmp_path / "out", workers=1)
    second = ng.run_experiment(experiment_with_friction(0.9), tmp_path / "out", resume=True, workers=1)
    assert second["late"].mu.lower > first["late"].mu.upper
    assert [solve.earlier for solve in second.solves] == [False, False]
    assert "another problem" in second.notes[0]


def test_the_file_of_another_variation_is_not_used(finished, tmp_path):
    folder = tmp_path / "out"
    shutil.copytree(finished.folder, folder)
    shutil.copy(folder / "solves" / "smooth--seed0.json", folder / "solves" / "rough--seed0.json")
    loaded = ng.ExperimentResult.load(folder)
    assert [(s.variation, s.seed) for s in loaded.failures] == [("rough", 0)]
    assert "another problem" in loaded.notes[0]
    resumed = ng.run_experiment(experiment(), folder, resume=True, workers=1)
    assert grasps(resumed) == grasps(finished)


def test_a_run_that_ended_before_its_plan_leaves_a_usable_folder(tmp_path):
    folder = tmp_path / "out"
    (folder / "solves").mkdir(parents=True)
    (folder / ".lock").touch()
    (folder / ".nlpgrasp-x.tmp").touch()
    assert ng.run_experiment(experiment(seeds=[0]), folder, workers=1).complete


@pytest.mark.slow
def test_a_reader_that_goes_away_does_not_end_the_run(tmp_path):
    line, environment = command("--out", "out", "--workers", 1, "--json")
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    process = subprocess.Popen(line, cwd=tmp_path, env=environment, **pipes)
    process.stdout.close()
    process.stderr.read()
    process.stderr.close()
    process.wait()
    assert ng.ExperimentResult.load(tmp_path / "out").complete
    assert (tmp_path / "out" / "report.html").is_file()


@pytest.mark.slow
def test_output_that_is_no_terminal_gets_a_line_a_solve(tmp_path):
    process = run("--out", "out", "--workers", 1, cwd=tmp_path)
    assert process.returncode == 0
    lines = process.stderr.splitlines()
    assert [line.split()[0] for line in lines] == ["1/4", "2/4", "3/4", "4/4"]
    assert "left" in lines[0]
    assert "friction 0.5" in process.stdout


@pytest.mark.parametrize("out", [3, None, b"out", "a\0b", ""])
def test_out_that_is_no_path_is_refused(out):
    with pytest.raises(InputError, match=r"out: got .* expected the path of a folder"):
        ng.run_experiment(experiment(), out)


def test_arguments_are_checked_first(tmp_path):
    for settings, message in [({"resume": "no"}, "resume"), ({"progress": 3}, "progress"), ({"workers": 0}, "workers")]:
        with pytest.raises(InputError, match=message):
            ng.run_experiment(experiment(), tmp_path / "out", **settings)
    with pytest.raises(InputError, match="can be written"):
        ng.run_experiment(experiment(), tmp_path / ("x" * 300))
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
def test_one_worker_survives_a_crash_too(tmp_path):
    def crash():
        os.kill(os.getpid(), signal.SIGKILL)

    result = ng.run_experiment(experiment({"crash": crash, "fine": {}}, seeds=[0]), tmp_path / "out", workers=1)
    assert [s.variation for s in result.failures] == ["crash"]
    assert result["fine"].mu.lower > 0.3


@pytest.mark.slow
def test_kill_9_costs_only_what_was_under_way(tmp_path):
    line, environment = command("--out", "out", "--workers", 2, "--json", kind="long")
    process = subprocess.Popen(line, cwd=tmp_path, env=environment, stdout=subprocess.PIPE, text=True)
    for _ in range(8):
        assert json.loads(process.stdout.readline())["event"] == "solve"
    process.kill()
    process.wait()
    process.stdout.close()
    result = ng.ExperimentResult.load(tmp_path / "out")
    finished_solves = [s for s in result.solves if s.done]
    assert len(finished_solves) >= 8
    assert result.notes == ()
    process = run("--out", "out", "--resume", "--workers", 2, "--json", kind="long", cwd=tmp_path)
    assert process.returncode == 0
    assert len(events(process.stdout)) == 25
    assert events(process.stdout)[-1]["complete"] is True


@pytest.mark.slow
def test_ctrl_c_keeps_what_is_done(tmp_path):
    line, environment = command("--out", "out", "--workers", 2, "--json", kind="long")
    process = subprocess.Popen(
        line,
        cwd=tmp_path,
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    for _ in range(4):
        assert json.loads(process.stdout.readline())["event"] == "solve"
    os.killpg(process.pid, signal.SIGINT)
    begun = time.monotonic()
    out, err = process.communicate(timeout=60)
    assert time.monotonic() - begun < 30.0
    assert process.returncode == 1
    assert err == ""
    last = events(out)[-1]
    assert [note.partition(";")[0] for note in last["notes"]] == ["Interrupted: go on with --resume"]
    assert len([f for f in last["failures"] if f["failure"] == "not done"]) <= 20
    assert (tmp_path / "out" / "table.csv").is_file()


@pytest.mark.slow
def test_a_full_disk_ends_the_run_and_is_listed(tmp_path, monkeypatch):
    import nlpgrasp.common.files

    written = []
    replace = os.replace

    def full(source, target):
        if Path(target).parent.name == "solves":
            written.append(target)
            if len(written) > 2:
                raise OSError(28, "No space left on device")
        replace(source, target)

    monkeypatch.setattr(nlpgrasp.common.files.os, "replace", full)
    result = ng.run_experiment(experiment(seeds=range(4)), tmp_path / "out", workers=1)
    assert sum(s.done for s in result.solves) == 2
    assert "No space left on device" in result.notes[0]
    assert "go on with --resume" in result.notes[0]
    unwritten = [s for s in result.failures if s.failure.startswith("not written")]
    assert len(unwritten) == 1
    monkeypatch.undo()
    assert not list((tmp_path / "out" / "solves").glob("*.tmp"))
    resumed = ng.run_experiment(experiment(seeds=range(4)), tmp_path / "out", resume=True, workers=2)
    assert resumed.complete


@pytest.mark.slow
def test_files_too_large_for_the_system_are_listed(tmp_path):
    line, environment = command("--out", "out", "--workers", "1", "--json")
    limited = ["bash", "-c", 'ulimit -f 4; exec "$@"', "limited", *line]  # the plan fits, solutions of 5 kB do not
    process = subprocess.run(limited, capture_output=True, text=True, env=environment, cwd=tmp_path, timeout=120)
    assert process.returncode == 1, process.stderr
    last = events(process.stdout)[-1]
    assert "File too large" in last["notes"][0]
    assert list((tmp_path / "out" / "solves").iterdir()) == []


@pytest.mark.slow
def test_a_changed_expression_of_the_base_problem_is_solved_anew(tmp_path):
    def one_sided(sign):
        side = ng.Constraint("side", lambda p, n: sign * (p[0][0] + p[1][0]), lower=0.2)
        small = experiment()
        return ng.Experiment(
            replace(small.base, constraints=[side]), small.variations, small.seeds, 1, small.options, "sides"
        )

    def sums(result):
        return [result.solution(s.variation, s.seed).grasp.points[:, 0].sum() for s in result.solves]

    ng.run_experiment(one_sided(1.0), tmp_path / "out", workers=1)
    same = ng.run_experiment(one_sided(1.0), tmp_path / "out", workers=1, resume=True)
    assert all(solve.earlier for solve in same.solves)
    other = ng.run_experiment(one_sided(-1.0), tmp_path / "out", workers=1, resume=True)
    assert not any(solve.earlier for solve in other.solves)
    assert max(sums(other)) < 0.0
    assert len(other.notes) == len(other.solves)
    assert all("solved anew" in note for note in other.notes)


def test_a_folder_whose_plan_cannot_be_written_is_not_locked(tmp_path, monkeypatch):
    def refuse(path, text):
        raise InputError("out", "no space left", "a file that can be written")

    small = experiment()
    plan = output_folder.plan_of(small, dict.fromkeys(small.names, ""))
    folder = output_folder.OutputFolder(tmp_path / "out")
    with monkeypatch.context() as context:
        context.setattr(output_folder, "write_text", refuse)
        with pytest.raises(InputError, match="no space left"):
            folder.open(plan, resume=False)
    second = output_folder.OutputFolder(tmp_path / "out")
    second.open(plan, resume=False)
    second.close()


@pytest.mark.slow
def test_two_runs_do_not_share_a_folder(tmp_path):
    line, environment = command("--out", "out", "--workers", 1, "--json", kind="long")
    process = subprocess.Popen(line, cwd=tmp_path, env=environment, stdout=subprocess.PIPE, text=True)
    try:
        assert json.loads(process.stdout.readline())["event"] == "solve"
        second = run("--out", "out", "--resume", kind="long", cwd=tmp_path)
        assert second.returncode == 2
        assert "in use by another run" in second.stderr
    finally:
        process.kill()
        process.communicate()


@pytest.mark.slow
def test_a_solve_in_a_progress_callback_leaves_the_run_alone(tmp_path):
    inside = []

    def progress(record):
        if not inside:
            inside.append(ng.solve(base(), starts=2, options=replace(QUICK, workers=2)))

    result = ng.run_experiment(experiment(), tmp_path / "out", workers=2, progress=progress)
    assert result.complete
    assert result.notes == ()
    assert inside[0].success


def test_no_grasp_is_a_finding(tmp_path):
    slippery = ng.GraspProblem(base().body, [ng.PointContact()] * 2, base().task, name="slippery")
    result = ng.run_experiment(experiment({"slippery": slippery, "fine": {}}, seeds=[0]), tmp_path / "out", workers=1)
    assert result.complete
    assert result["slippery"].found == "no grasp"
    assert result.ranks() == [2, 1]
    assert result["slippery"].solves[0].status is ng.Status.NO_GRASP
