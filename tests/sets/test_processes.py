"""Sets made by processes: kill -9 at random times, several writers, dying workers, a cluster, a hand in simulation."""

import os
import shutil
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import nlpgrasp as ng
from nlpgrasp.errors import InputError
from nlpgrasp.sets import make_set as module
from nlpgrasp.sets.grasp_rows import NOT_REQUESTED
from tests.experiments import test_cluster
from tests.experiments.small import QUICK
from tests.hands.urdf import FOUR, four_finger_hand
from tests.sets.small import labels, run_here, square, squares

ROOT = Path(__file__).resolve().parents[2]
SCRIPT = Path(__file__).with_name("script_squares.py")
ENVIRONMENT = {**os.environ, "PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": "1"}
SETTINGS = {"options": QUICK, "simulate": False, "starts": 16}
KILLS = 5
cluster = test_cluster.cluster  # a fixture
pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def uninterrupted(tmp_path_factory):
    """The set of the script, made in this process."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(module, "run_local", run_here)
        return ng.make_set(squares(), 6, tmp_path_factory.mktemp("set") / "out", **SETTINGS)


def begin(out):
    """Begin the script in a process of its own."""
    command = [sys.executable, str(SCRIPT), str(out)]
    return subprocess.Popen(command, env=ENVIRONMENT, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)


def finish(process):
    """Wait for the script, and return its exit code."""
    process.communicate()
    return process.returncode


def test_a_run_that_is_killed_at_random_times_ends_with_the_same_rows(uninterrupted, tmp_path):
    rng, out, finished = np.random.default_rng(0), tmp_path / "out", set()
    for _ in range(KILLS):
        process = begin(out)
        for _ in range(rng.integers(3)):
            process.stdout.readline()
        time.sleep(rng.uniform(0.0, 4.0))
        process.kill()
        process.wait()
        process.stdout.close()
        if (out / "set.json").exists():
            cut = ng.open_set(out)  # a warning of a damaged file is an error
            assert all(ng.verify(solution) for solution in cut)
            now = {(row["problem"], row["start"]) for row in cut.frame(failures=True).to_dict("records")}
            assert finished <= now
            finished = now
    assert finish(begin(out)) == 0
    assert labels(ng.open_set(out)) == labels(uninterrupted)
    assert sorted(p.name for p in (out / "rows").iterdir()) == ["rough.parquet", "smooth.parquet"]


def test_two_processes_write_one_set(uninterrupted, tmp_path):
    writers = [begin(tmp_path / "out") for _ in range(2)]
    assert [finish(writer) for writer in writers] == [0, 0]
    assert labels(ng.open_set(tmp_path / "out")) == labels(uninterrupted)


def deadly(parent):
    """Return a square, in its parent alone: workers die."""

    def make():
        if os.getpid() != parent:
            os.kill(os.getpid(), signal.SIGKILL)
        return square(0.6)

    return make


def test_a_worker_that_dies_twice_costs_its_units_alone(tmp_path):
    problems = {"deadly": deadly(os.getpid()), "rough": square(0.8)}
    result = ng.make_set(problems, 2, tmp_path / "out", **{**SETTINGS, "starts": 4}, workers=2)
    rows = result.frame(failures=True)
    lost = rows[rows["problem"] == "deadly"]
    assert set(lost["status"]) == {"failed"}
    assert lost["reason"].str.contains("its process ended, twice").all()
    undisturbed = ng.make_set({"rough": problems["rough"]}, 2, tmp_path / "alone", **{**SETTINGS, "starts": 4})
    assert list(rows[rows["problem"] == "rough"]["status"]) == list(undisturbed.frame(failures=True)["status"])


def test_a_cluster_gives_the_same_and_survives_a_killed_worker(cluster, uninterrupted, tmp_path):
    address, nannies = cluster
    reports = []

    def progress(report):
        reports.append(report)
        if len(reports) == 2:
            os.kill(test_cluster.worker_of(nannies[0]), signal.SIGKILL)

    result = ng.make_set(squares(), 6, tmp_path / "out", **SETTINGS, scheduler=address, progress=progress)
    assert labels(result) == labels(uninterrupted)


@pytest.fixture(scope="module")
def grasps(tmp_path_factory):
    """A simulated set of a hand with 16 joints."""
    body, task = ng.Ellipsoid([0.04, 0.03, 0.03]), ng.TaskEllipsoid([1.0, 1.0, 1.0, 0.02, 0.02, 0.02])
    problem = ng.GraspProblem(body, ng.FrictionContact(0.6), task, hand=four_finger_hand(), name="ellipsoid")
    out = tmp_path_factory.mktemp("hand") / "out"
    with pytest.raises(InputError, match=r"simulate: got True, and four_finger_hand\.urdf is not found"):
        ng.make_set([problem], 12, out)
    return ng.make_set([problem], 12, out, folders=[FOUR.parent], workers=2)


def test_a_set_of_a_hand_is_simulated_and_small(grasps):
    frame = grasps.frame()
    assert len(frame) == 12
    assert frame["simulated"].all()
    assert set(frame["verdict"]) <= {"held by the squeeze", "caged", "lost"}
    assert (frame["held"] == (frame["verdict"] != "lost")).all()
    assert (frame["caged"] == (frame["verdict"] == "caged")).all()
    assert frame["held"].sum() > 8
    assert all(len(row) == 7 + 16 for row in frame["squeeze_qpos"])
    assert frame["lift_qpos"].map(lambda row: row[2]).gt(frame["grasp_qpos"].map(lambda row: row[2])).all()
    size = sum(file.stat().st_size for file in grasps.path.rglob("*") if file.is_file())
    assert (size - grasps.path.joinpath("problems", "ellipsoid.json").stat().st_size) / len(grasps) < 8000


def test_a_set_of_a_hand_is_verified(grasps):
    some = [grasps.solution(i) for i in (0, 7)]
    assert all(ng.verify(solution, folders=[FOUR.parent]).complete for solution in some)
    outcome = grasps.verify(workers=2)
    assert outcome.passed
    assert outcome.partly_verified == 12
    assert outcome.missing == ("four_finger_hand.urdf",)
    assert str(outcome).startswith("partly verified")


def test_grasps_that_were_not_simulated_are_simulated_later(grasps, tmp_path):
    folder = shutil.copytree(grasps.path, tmp_path / "out")
    source, entries = (
        grasps._files[0],
        {"verdict": NOT_REQUESTED} | dict.fromkeys(("simulated", "held", "caged"), False),
    )
    copied = replace(source, file=folder / "rows" / source.file.name)
    copied.change_rows({row: entries | dict.fromkeys(("slip", "turn")) for _, row in grasps._grasp_rows[:2]})
    assert ng.open_set(folder).frame()["simulated"].tolist() == [False] * 2 + [True] * 10
    assert labels(ng.open_set(folder).simulate([FOUR.parent], workers=1)) == labels(grasps)


def test_a_set_of_a_hand_is_exported(grasps, tmp_path):
    with np.load(grasps.export(tmp_path / "npz")[0]) as arrays:
        assert arrays["grasp_qpos"].shape == (12, 23)
        masks = {"squeeze_qpos": "has_squeeze", "lift_qpos": "has_lift", "slip": "simulated", "link_depth": "has_depth"}
        for name, mask in (masks | {"friction_needed": "has_squeeze"}).items():
            assert (np.isnan(arrays[name].reshape(12, -1)).any(axis=1) == ~arrays[mask]).all()
        assert (arrays["way_in_free"] == (arrays["way_in"] == "")).all()
        assert arrays["held"].tolist() == grasps.frame()["held"].tolist()
    records = grasps.export(tmp_path / "records", "dexgraspbench")
    assert len(records) == 12
