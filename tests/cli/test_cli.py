"""Command line: each command once in a process of its own, its variants in this one."""

import contextlib
import io
import json
import os
import re
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path
from unittest import mock

import pytest

import nlpgrasp as ng
from nlpgrasp.cli.main import main
from nlpgrasp.cli.simulate_command import picture_of
from tests.images import panels_drawn, size
from tests.quick import first
from tests.verify import honest

SMALL = """
import nlpgrasp as ng

def problem():
    square = ng.Polygon([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    task = ng.TaskEllipsoid([1, 1, 1], center=[0, 0.5, 0])
    return ng.GraspProblem(square, [ng.FrictionContact(0.5)] * 2, task, name="square")
"""


def run(*arguments, cwd, timeout=120):
    """Run a command in a process of its own."""
    command = [sys.executable, "-m", "nlpgrasp", *map(str, arguments)]
    environment = {**os.environ, "COLUMNS": "200", "NO_COLOR": "1"}
    return subprocess.run(command, capture_output=True, text=True, cwd=cwd, timeout=timeout, env=environment)


def run_here(*arguments, cwd):
    """Run a command in this process, which spares it the imports; what comes back is as from ``run``."""
    line = ["nlpgrasp", *map(str, arguments)]
    out, err = io.StringIO(), io.StringIO()
    with contextlib.ExitStack() as stack:
        stack.enter_context(mock.patch.object(sys, "argv", line))
        stack.enter_context(mock.patch.dict(os.environ, {"COLUMNS": "200", "NO_COLOR": "1"}))
        stack.enter_context(contextlib.chdir(cwd))
        stack.enter_context(contextlib.redirect_stdout(out))
        stack.enter_context(contextlib.redirect_stderr(err))
        ended = stack.enter_context(pytest.raises(SystemExit))
        main()
    return subprocess.CompletedProcess(line, ended.value.code, out.getvalue(), err.getvalue())


def refused(result):
    """Assert one line on stderr, exit code 2, no traceback; return the line."""
    assert result.returncode == 2, result
    lines = result.stderr.strip().splitlines()
    assert len(lines) == 1, result.stderr
    assert lines[0].startswith("nlpgrasp: ")
    return lines[0]


@pytest.fixture
def script(tmp_path):
    path = tmp_path / "square.py"
    path.write_text(SMALL)
    return path


@pytest.fixture(scope="module")
def solved(tmp_path_factory):
    folder = tmp_path_factory.mktemp("solved")
    (folder / "square.py").write_text(SMALL)
    result = run("solve", "square.py", "--starts", 2, "--workers", 1, cwd=folder)
    assert result.returncode == 0, result.stderr
    return folder, result


def test_solve_writes_a_file_and_says_what_it_found(solved):
    folder, result = solved
    assert "mu-tilde certified in [0.37" in result.stdout
    assert "written to square.json" in result.stdout
    assert json.loads((folder / "square.json").read_text())["status"] == "solved"


@pytest.mark.parametrize("run_command", first(1, [run_here, run]), ids=["here", "own process"])
def test_verify_agrees(solved, run_command):
    folder, _ = solved
    result = run_command("verify", "square.json", cwd=folder)
    assert result.returncode == 0
    assert re.search(r"^verified: \d+ checks passed$", result.stdout.splitlines()[-1])


def test_a_proof_is_written_beside_the_result_and_verified(solved, script, tmp_path):
    result = run_here("solve", script, "--starts", 1, "--quick", "--proof", "--out", "f.json", cwd=tmp_path)
    assert re.search(r"^  mu_tilde proved in \[0\.37\d*, .*\]; written to f\.proof$", result.stdout.splitlines()[-1])
    assert "ok   proof: f.proof (found beside the file): " in run_here("verify", "f.json", cwd=tmp_path).stdout
    folder, _ = solved
    result = run_here("verify", "square.json", "--proof", tmp_path / "f.proof", "--json", cwd=folder)
    check = next(check for check in json.loads(result.stdout)["checks"] if check["name"] == "proof")
    assert check["detail"].startswith("f.proof")


def test_verify_of_a_wrong_claim_is_exit_code_1(solved):
    folder, _ = solved
    data = json.loads((folder / "square.json").read_text())
    data["quality"]["mu"] |= {"lower": 5.0, "upper": 6.0}
    (folder / "wrong.json").write_text(json.dumps(data))
    result = run_here("verify", "wrong.json", cwd=folder)
    assert result.returncode == 1
    assert "NOT verified" in result.stdout


def test_verify_looks_for_meshes_where_it_is_told(tmp_path):
    shelf = tmp_path / "shelf"
    shelf.mkdir()
    solution = ng.GraspSolution.from_dict(honest.block(shelf))
    solution.save(tmp_path / "block.json")

    def surface(*more):
        result = run_here("verify", "block.json", "--rtol", 0.5, "--json", *more, cwd=tmp_path)
        return next(c for c in json.loads(result.stdout)["checks"] if c["name"] == "surface")

    assert surface()["made"] is False
    assert surface("--folder", "shelf") | {"detail": ""} == {
        "name": "surface",
        "passed": True,
        "detail": "",
        "made": True,
    }


def test_verify_without_the_mesh_is_partly_verified_and_strictly_not(tmp_path):
    shelf = tmp_path / "shelf"
    shelf.mkdir()
    solution = ng.GraspSolution.from_dict(honest.block(shelf))
    replace(solution, mu=ng.verify(solution, 0.5).mu).save(tmp_path / "block.json")
    for more, code in (((), 0), (("--strict",), 1)):
        result = run_here("verify", "block.json", "--rtol", 0.5, *more, cwd=tmp_path)
        assert result.returncode == code
        message = (
            r"partly verified: \d+ checks passed, \d+ could not be made \(block\.stl not found; give its folder with "
        )
        assert re.match(rf"{message}--folder", result.stdout.splitlines()[-1])
    data = json.loads(run_here("verify", "block.json", "--rtol", 0.5, "--json", cwd=tmp_path).stdout)
    assert (data["passed"], data["complete"], data["missing"]) == (True, False, ["block.stl"])


def test_verify_strictly_passes_where_every_check_was_made(solved):
    folder, _ = solved
    assert run_here("verify", "square.json", "--strict", cwd=folder).returncode == 0


def test_pictures_of_a_hand_have_a_name_of_their_own():
    names = {picture_of(Path("a/mug.json"), hand).name for hand in (None, Path("tri.urdf"))}
    assert names == {"mug-simulation.png", "mug-simulation-hand.png"}


@pytest.mark.slow
def test_quality_prints_both_measures(solved):
    folder, _ = solved
    result = run("quality", "square.json", "--torque-scale", 1.0, cwd=folder)
    assert result.returncode == 0
    assert "mu_tilde certified in [0.37" in result.stdout
    assert "delta    certified in [0.4" in result.stdout


@pytest.mark.slow
def test_report_writes_a_page_or_pictures(solved):
    folder, _ = solved
    result = run("report", "square.json", cwd=folder)
    assert result.stdout == "written to square.html\n", result.stderr
    assert "mu-tilde is certified between 0.37" in (folder / "square.html").read_text()
    result = run_here("report", "square.json", "--png", "--out", "pictures.html", cwd=folder)
    grasp, *charts = result.stdout.splitlines()
    assert re.fullmatch(r"written to pictures-grasp\.png \((the page's scene, drawn by|a drawing, as) .*\)", grasp)
    assert charts == [f"written to pictures-{name}.png" for name in ("wrenches", "convergence")]
    assert size(folder / "pictures-wrenches.png") == (1508, 351)
    assert min(panels_drawn(folder / "pictures-wrenches.png", 4)) > 0.05


@pytest.mark.slow
def test_exports_and_tables_of_contacts(solved):
    folder, _ = solved
    for ran, kind, name in ((run_here, "csv", "square.csv"), (run, "glb", "square.glb")):
        result = ran("export", "square.json", "--to", kind, cwd=folder)
        assert result.stdout == f"written to {name}\n", result.stderr
    assert (folder / "square.glb").read_bytes()[:4] == b"glTF"
    result = run_here("quality", "square.csv", "--task", "square.json", cwd=folder)
    assert "mu_tilde certified in [0.37" in result.stdout, result.stderr
    result = run_here("quality", "square.csv", cwd=folder)
    assert "needs a task" in result.stdout
    assert "force-closed" in result.stdout
    assert "this one states its own" in refused(run_here("quality", "square.json", "--friction", "0.5", cwd=folder))
    assert "ng.URDFHand" in refused(run_here("export", "square.json", "--to", "isaac_grasp", cwd=folder))
    message = refused(run_here("export", "square.json", "--to", "mujoco", cwd=folder))
    assert "--to: got mujoco, expected one of csv, glb, isaac_grasp, mjcf, moveit" in message
    assert message.endswith("; did you mean mjcf?")
    for option in ("--object", "--gripper", "--joint"):
        message = refused(run_here("export", "square.json", "--to", "csv", option, "x", cwd=folder))
        assert f"{option}: got x, expected isaac_grasp, moveit" in message


def test_json_lines(script, tmp_path):
    result = run_here("solve", script, "--starts", 2, "--workers", 1, "--json", cwd=tmp_path)
    lines = [json.loads(line) for line in result.stdout.splitlines()]
    events = [line["event"] for line in lines]
    assert events == ["start", "start", *["analysis"] * 7, "done"]
    analyses = ["prices", "robustness", "delta", "nu", "friction", "drawing", "energy to drop"]
    assert [line["name"] for line in lines[2:-1]] == analyses
    assert lines[-1]["mu"][0] >= 0.376
    assert lines[-1]["file"] == "square.json"
    assert result.stderr == ""
    result = run_here("verify", "square.json", "--json", cwd=tmp_path)
    assert json.loads(result.stdout)["passed"] is True


@pytest.mark.slow
def test_a_quick_solve_is_without_analyses(script, tmp_path):
    run_here("solve", script, "--quick", "--starts", 1, "--out", tmp_path / "quick.json", cwd=tmp_path)
    quick = ng.GraspSolution.load(tmp_path / "quick.json")
    assert quick.success
    assert (quick.nu, quick.drawing) == (None, None)
    copy = tmp_path / "copy.json"
    copy.write_bytes((tmp_path / "quick.json").read_bytes())
    result = run_here("quality", "quick.json", "--json", cwd=tmp_path)
    measures = json.loads(result.stdout)
    assert measures["nu_value"] > 0.0
    assert measures["critical_friction"] == ng.GraspSolution.load(tmp_path / "quick.json").friction.to_dict()
    assert result.stderr.startswith("added to quick.json: ")
    assert "delta, nu, critical friction" in result.stderr
    completed = ng.GraspSolution.load(tmp_path / "quick.json")
    assert completed.nu is not None
    assert completed.drawing is not None
    result = run_here("quality", "quick.json", cwd=tmp_path)
    assert result.stderr == ""
    assert f"  friction {completed.friction_line()}\n" in result.stdout
    before = copy.read_bytes()
    result = run_here("report", "copy.json", cwd=tmp_path)
    assert result.stdout == "written to copy.html\n"
    assert result.stderr.startswith("computed, and not added to copy.json: ")
    assert copy.read_bytes() == before
    assert "Computed for this page: " in (tmp_path / "copy.html").read_text(encoding="utf-8")
    result = run_here("report", "copy.json", "--save", cwd=tmp_path)
    assert result.stderr.startswith("added to copy.json: ")
    assert ng.GraspSolution.load(copy).drawing.body.faces.tolist() == completed.drawing.body.faces.tolist()


@pytest.mark.slow
def test_analyses_come_after_the_grasp(script, tmp_path):
    result = run_here(
        "solve", script, "--with", "nu,drawing", "--starts", 1, "--out", tmp_path / "f.json", cwd=tmp_path
    )
    lines = result.stdout.splitlines()
    written = next(i for i, line in enumerate(lines) if line.startswith("  written to"))
    assert [line.split()[0] for line in lines[written + 1 :]] == ["nu"]
    solution = ng.GraspSolution.load(tmp_path / "f.json")
    assert solution.nu is not None
    assert solution.drawing is not None
    assert solution.delta is None


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (
            ["--with", "nu,price"],
            '--with: got price, expected "prices", "robustness", "delta", "nu", "friction", "phases", "drawing"',
        ),
        (["--with", "phases"], "--with: got phases, expected no phases without a hand that has links"),
        (["--with", "nu", "--quick"], "--quick: got --with nu beside it, expected one of the two"),
    ],
)
def test_analyses_that_cannot_be_are_refused_before_the_solve(script, tmp_path, words, message):
    result = run_here("solve", script, *words, cwd=tmp_path)
    assert result.returncode == 2
    assert message in result.stderr
    assert result.stdout == ""


def test_no_grasp_is_exit_code_1_and_spares_the_old_file(tmp_path):
    hopeless = SMALL.replace("FrictionContact(0.5)", "PointContact()")
    (tmp_path / "hopeless.py").write_text(hopeless)
    (tmp_path / "hopeless.json").write_text("earlier result")
    result = run_here("solve", "hopeless.py", "--starts", 1, "--workers", 1, cwd=tmp_path)
    assert result.returncode == 1
    assert "No grasp found" in result.stdout
    assert (tmp_path / "hopeless.json").read_text() == "earlier result"


BAD_SCRIPTS = {
    "no problem": ("x = 1", "no function problem()"),
    "no problem, seen before it runs": ("import time\ntime.sleep(1e6)", "no function problem()"),
    "a variable": (
        "import nlpgrasp as ng\nproblem = ng.GraspProblem()\n1 / 0",
        "a variable problem, no function: write it as def problem(): return ng.GraspProblem(...)",
    ),
    "syntax": ("def problem(:", "line 1"),
    "fails": ("problem = 1 / 0", "ZeroDivisionError: division by zero (line 1)"),
    "exits": ("import sys\nsys.exit(0)\nfrom os import *", "SystemExit"),
    "wrong type": ("def problem():\n    return 3", "problem(): got int, expected a GraspProblem"),
    "import": ("import there_is_no_such_module\nproblem = int", "there_is_no_such_module"),
    "friction": (SMALL.replace("0.5)] * 2", "0.0)] * 2"), "FrictionContact.friction: got 0.0, expected"),
    "zero size": (SMALL.replace("[1, 1], [-1, 1]", "[1, -1.0], [-1, -1]"), "Polygon.vertices"),
    "zero task": (SMALL.replace("[1, 1, 1], center", "[0, 0, 0], center"), "TaskEllipsoid.semi_axes"),
    "no face": (
        SMALL.replace("name=", 'constraints=[ng.Forbid(["edge0", "edge1", "edge2", "edge3"])], name='),
        "no face left for contact 0",
    ),
}


@pytest.mark.parametrize(("text", "message"), BAD_SCRIPTS.values(), ids=BAD_SCRIPTS.keys())
def test_bad_scripts_are_one_line_and_write_nothing(tmp_path, text, message):
    (tmp_path / "bad.py").write_text(text)
    (tmp_path / "bad.json").write_text("earlier result")
    line = refused(run_here("solve", "bad.py", cwd=tmp_path))
    assert message in line
    assert (tmp_path / "bad.json").read_text() == "earlier result"


EXPERIMENTS = {
    "twins": ('{"a": {}, "b": {}, "a": {}}', "two entries named 'a'"),
    "pairs": ('[("a", {}), ("a", {})]', "two variations named 'a'"),
    "field": ('{"a": {"frction": 1}}', "a field that does not exist"),
    "other dictionaries": ('{"a": {}} if {"x": 1, "x": 2} else {}', "a new or empty folder"),
}


@pytest.mark.parametrize(("variations", "message"), EXPERIMENTS.values(), ids=EXPERIMENTS.keys())
def test_bad_experiments_are_one_line_and_write_nothing(tmp_path, variations, message):
    text = f"{SMALL}\ndef experiment():\n    return ng.Experiment(problem(), {variations}, starts=1)\n"
    (tmp_path / "bad.py").write_text(text)
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "mine.txt").write_text("mine")
    assert message in refused(run_here("experiment", "bad.py", "--out", "out", cwd=tmp_path))
    assert [p.name for p in (tmp_path / "out").iterdir()] == ["mine.txt"]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["experiment", "square.py", "--out", "x"], "no function experiment()"),
        (["experiment", "square.py"], "Missing option '--out'"),
        (["report", "none.json"], "a solution file that exists"),
        (["report"], "Missing argument"),
        (["export", "square.py", "--to", "csv"], "got a Python script"),
        (["report", "none.json", "--out", "none/x.html"], "a file in a folder that exists"),
        (["solve", "none.py"], "a Python file that exists"),
        (["solve", "square.py", "--starts", "0"], "--starts"),
        (["solve", "square.py", "--seed", "-1"], "--seed"),
        (["solve", "square.py", "--workers", "0"], "workers"),
        (["solve", "square.py", "--time-limit", "0"], "time_limit"),
        (["solve", "square.py", "--out", "none/x.json"], "a file in a folder that exists"),
        (["solve", "square.py", "--out", "."], "a file name"),
        (["solve", "square.py", "--out", "square.py"], "itself"),
        (["solve", "square.py", "--starts", "many"], "--starts"),
        (["solve"], "Missing argument"),
        (["resolve"], "No such command"),
        (["verify", "none.json"], "a solution file or a bound file that exists"),
        (["quality", "square.py"], "got the ending .py, expected one of .json"),
        (["verify", "square.json", "--rtol", "-1"], "rtol: got -1.0, expected a number greater than 0"),
        (["report", "square.json", "--folder", "x"], "No such option: --folder; `nlpgrasp report --help` lists those"),
    ],
)
def test_wrong_use_is_one_line(script, tmp_path, arguments, message):
    assert message in refused(run_here(*arguments, cwd=tmp_path))


@pytest.mark.slow
def test_wrong_use_in_a_process_of_its_own(tmp_path):
    assert "a Python file that exists" in refused(run("solve", "none.py", cwd=tmp_path))


def test_help_and_version(tmp_path):
    result = run("--help", cwd=tmp_path)
    assert result.returncode == 0
    assert all(command in result.stdout for command in ("solve", "quality", "verify"))
    assert run_here("--version", cwd=tmp_path).stdout.startswith("nlpgrasp 0.")


@pytest.mark.slow
def test_a_script_may_import_its_neighbours_and_change_folder(tmp_path):
    (tmp_path / "scripts").mkdir()
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "scripts" / "neighbour.py").write_text("def level(p, n):\n    return p[0][1] + p[1][1]\n")
    text = SMALL.replace(
        "import nlpgrasp as ng", "import os\nimport neighbour\nimport nlpgrasp as ng\nos.chdir('elsewhere')"
    )
    text = text.replace("name=", "constraints=[ng.Constraint('level', neighbour.level, -1, 1)], name=")
    (tmp_path / "scripts" / "square.py").write_text(text)
    result = run("solve", "scripts/square.py", "--starts", 2, "--workers", 2, "--out", "found.json", cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    assert (tmp_path / "found.json").is_file()


@pytest.mark.slow
@pytest.mark.parametrize("workers", first(1, [2, 1]))
def test_interrupt_writes_the_best_grasp(tmp_path, workers):
    (tmp_path / "square.py").write_text(SMALL)
    command = [
        sys.executable,
        "-m",
        "nlpgrasp",
        "solve",
        "square.py",
        "--starts",
        "5000",
        "--json",
        "--workers",
        str(workers),
    ]
    process = subprocess.Popen(
        command, cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True
    )
    for _ in range(3):
        assert json.loads(process.stdout.readline())["event"] == "start"
    time.sleep(0.1)
    os.killpg(process.pid, signal.SIGINT)  # as a terminal does: to the whole group
    out, err = process.communicate(timeout=120)
    assert process.returncode == 0, err
    assert json.loads(out.splitlines()[-1])["status"] == "interrupted"
    assert json.loads((tmp_path / "square.json").read_text())["quality"]["mu"]["lower"] > 0.3
    assert "Traceback" not in err


@pytest.mark.slow
def test_many_grasps_are_kept_printed_and_exported(tmp_path):
    (tmp_path / "square.py").write_text(SMALL)
    result = run_here("solve", "square.py", "--starts", "2", "--workers", "1", "--keep", "3", cwd=tmp_path)
    assert "3 grasps kept, best first" in result.stdout
    assert len(json.loads((tmp_path / "square.json").read_text())["grasps"]) == 3
    assert run_here("verify", "square.json", cwd=tmp_path).returncode == 0
    run_here("export", "square.json", "--to", "csv", cwd=tmp_path)
    assert len((tmp_path / "square.csv").read_text().splitlines()) == 1 + 3 * 2
    table = run_here("quality", "square.csv", "--task", "square.json", cwd=tmp_path)
    assert [line.split(",")[0] for line in table.stdout.splitlines()] == ["id", "0", "1", "2"]
    line = refused(run_here("solve", "square.py", "--keep", "0", cwd=tmp_path))
    assert line == "nlpgrasp: --keep: got 0, expected a whole number from 1 to 10000"
