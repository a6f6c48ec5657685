"""Runs on a Dask cluster: a scheduler and two worker processes."""

import os
import re
import signal
import subprocess
import sys
from pathlib import Path

import psutil
import pytest

import nlpgrasp as ng
from nlpgrasp.errors import InputError
from tests.experiments.small import experiment

ROOT = Path(__file__).resolve().parents[2]
ENVIRONMENT = {**os.environ, "PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": "1"}


@pytest.fixture
def cluster(tmp_path):
    """Yield the scheduler's address and the process ids of its two workers (each under a nanny)."""
    python = [sys.executable, "-m"]
    quiet = ["--no-dashboard", "--host", "127.0.0.1"]
    settings = {"env": ENVIRONMENT, "cwd": tmp_path, "stderr": subprocess.PIPE, "text": True}
    scheduler = subprocess.Popen([*python, "distributed.cli.dask_scheduler", "--port", "0", *quiet], **settings)
    nannies = []
    try:
        address = next(m[1] for line in scheduler.stderr if (m := re.search(r"(tcp://127\.0\.0\.1:\d+)", line)))
        for _ in range(2):
            nanny = [*python, "distributed.cli.dask_worker", address, "--nthreads", "1", *quiet]
            nannies.append(subprocess.Popen(nanny, **{**settings, "stderr": subprocess.DEVNULL}))
        yield address, nannies
    finally:
        for process in [*nannies, scheduler]:
            for child in psutil.Process(process.pid).children(recursive=True):
                child.kill()
            process.kill()
            process.wait()
        scheduler.stderr.close()


def worker_of(nanny):
    """Return the process id of the worker that a nanny watches: its child that uses most memory."""
    return max(psutil.Process(nanny.pid).children(recursive=True), key=lambda p: p.memory_info().rss).pid


@pytest.mark.slow
def test_a_cluster_gives_the_same_and_survives_a_killed_worker(cluster, tmp_path):
    address, nannies = cluster
    plan = experiment(seeds=range(10))
    records = []

    def progress(record):
        records.append(record)
        if len(records) == 3:
            os.kill(worker_of(nannies[0]), signal.SIGKILL)

    result = ng.run_experiment(plan, tmp_path / "out", scheduler=address, progress=progress)
    assert result.complete
    assert len(records) == 20
    local = ng.run_experiment(plan, tmp_path / "local", workers=2)
    for solve in local.solves:
        local_solution, cluster_solution = (r.solution(solve.variation, solve.seed) for r in (local, result))
        assert local_solution.grasp.points.tolist() == cluster_solution.grasp.points.tolist()
        assert local_solution.mu.lower == cluster_solution.mu.lower


@pytest.mark.slow
def test_a_failing_and_a_crashing_solve_cost_only_themselves(cluster, tmp_path):
    def crash():
        os.kill(os.getpid(), signal.SIGKILL)

    plan = experiment({"crash": crash, "broken": lambda: 1 / 0, "fine": {}}, seeds=[0])
    result = ng.run_experiment(plan, tmp_path / "out", scheduler=cluster[0])
    failures = {s.variation: s.failure for s in result.failures}
    assert set(failures) == {"crash", "broken"}
    assert "KilledWorker" in failures["crash"]
    assert failures["broken"] == "ZeroDivisionError: division by zero"
    assert result["fine"].mu.lower > 0.3


@pytest.mark.slow
@pytest.mark.parametrize("address", ["nowhere", "tcp://127.0.0.1", "127.0.0.1:1"])
def test_a_scheduler_that_does_not_answer_is_refused_before_anything_runs(address, tmp_path, monkeypatch):
    import nlpgrasp.experiments.experiment_run as module

    monkeypatch.setattr(module, "CONNECT_SECONDS", 1)
    with pytest.raises(InputError, match="the address of a running Dask scheduler"):
        ng.run_experiment(experiment(), tmp_path / "out", scheduler=address)
    assert not (tmp_path / "out").exists()


def test_workers_and_a_scheduler_contradict_each_other(tmp_path):
    with pytest.raises(InputError, match="the cluster has its own"):
        ng.run_experiment(experiment(), tmp_path / "out", scheduler="127.0.0.1:1", workers=2)


@pytest.mark.slow
def test_a_scheduler_that_goes_away_ends_the_run_and_is_listed(cluster, tmp_path):
    address, _ = cluster
    records = []

    def progress(record):
        records.append(record)
        if len(records) == 3:
            port = int(address.rsplit(":", 1)[1])
            listening = (c for c in psutil.net_connections() if c.status == "LISTEN" and c.laddr.port == port)
            os.kill(next(listening).pid, signal.SIGKILL)

    result = ng.run_experiment(experiment(seeds=range(30)), tmp_path / "out", scheduler=address, progress=progress)
    assert 3 <= sum(s.done for s in result.solves) < 60
    assert "the cluster" in result.notes[-1]
    assert "go on with --resume" in result.notes[-1]
