"""Mistakes of a newcomer: each is one sentence that names the field and the cure."""

import os
import subprocess
import sys
import warnings
from pathlib import Path

import numpy as np
import pytest
import trimesh

import nlpgrasp as ng
from nlpgrasp.cli.main import main

BODY, TASK = ng.Box([0.08, 0.06, 0.04]), ng.TaskEllipsoid([5, 5, 10, 0.2, 0.2, 0.2])
THREE = [ng.FrictionContact(0.6)] * 3
AT, INTO = [[0.04, 0, 0], [-0.04, 0, 0]], [[-1, 0, 0], [1, 0, 0]]
ROBOT = """<robot name="r"><link name="palm"/><link name="tip"/><joint name="j" type="revolute"><parent link="palm"/>
<child link="tip"/><axis xyz="0 0 1"/><limit lower="0" upper="1" effort="1" velocity="1"/></joint></robot>"""


def problem(body=BODY, contacts=THREE, task=TASK, **more):
    return ng.GraspProblem(body, contacts, task, **more)


def mesh_in_millimetres(folder, size=1.0):
    path = folder / "part.stl"
    trimesh.creation.box([80.0 * size, 60.0 * size, 40.0 * size]).export(path)
    return path


def written(folder, name, text):
    path = folder / name
    path.write_text(text)
    return path


MISTAKES = {
    "a box in millimetres": (
        lambda f: problem(ng.Box([80, 60, 40])),
        "GraspProblem.body: got a box with a longest side of 80 m",
        'unit="mm" says that they are millimetres',
    ),
    "a mesh in millimetres": (
        lambda f: ng.Mesh.load(mesh_in_millimetres(f)),
        "Mesh.unit: got a longest side of 80 m",
        'unit="mm" says that they are millimetres',
    ),
    "a unit that is spelt out": (
        lambda f: ng.Box([80, 60, 40], unit="millimetres"),
        "Box.unit: got millimetres",
        "one of m, dm, cm, mm, in, ft",
    ),
    "a gripper in millimetres": (
        lambda f: ng.ParallelJaw(80),
        "ParallelJaw.opening: got 80 m",
        "80 mm are 0.08",
    ),
    "a file's name for a body": (
        lambda f: problem("part.stl"),
        "GraspProblem.body: got part.stl",
        'ng.Mesh.load("part.stl", unit="mm")',
    ),
    "trimesh's mesh for a body": (
        lambda f: problem(trimesh.creation.box([0.1, 0.1, 0.1])),
        "GraspProblem.body: got <trimesh",
        "ng.Mesh(mesh",
    ),
    "a list for a task": (
        lambda f: problem(task=[5, 5, 10, 0.2, 0.2, 0.2]),
        "GraspProblem.task: got [5, 5, 10, 0.2, 0.2, 0.2]",
        "ng.TaskEllipsoid(semi_axes)",
    ),
    "a task of three values in space": (
        lambda f: problem(task=ng.TaskEllipsoid([5, 5, 10])),
        "GraspProblem.task: got dimension 3",
        "dimension 6 for this body: f_x, f_y, f_z, m_x, m_y, m_z",
    ),
    "negative axes": (
        lambda f: ng.TaskEllipsoid([5, 5, -10, 0.2, 0.2, 0.2]),
        "TaskEllipsoid.semi_axes: got [5, 5, -10",
        "lengths of at least 0",
    ),
    "friction as text": (
        lambda f: ng.FrictionContact("0.6"),
        "FrictionContact.friction: got '0.6'",
        "a number greater than 0, without quotes",
    ),
    "numbers for contacts": (
        lambda f: problem(contacts=[0.6, 0.6]),
        "GraspProblem.contacts: got [0.6, 0.6]",
        "[ng.FrictionContact(0.6)] * 3",
    ),
    "one contact without a hand": (
        lambda f: problem(contacts=ng.FrictionContact(0.6)),
        "GraspProblem.contacts: got one FrictionContact",
        "hand=ng.Fingertips(3)",
    ),
    "more contacts than fingers": (
        lambda f: problem(hand=ng.ParallelJaw(0.1)),
        "GraspProblem.contacts: got 3 contacts",
        "2, one a fingertip of the hand",
    ),
    "no starts": (lambda f: ng.solve(problem(), starts=0), "starts: got 0", "a whole number from 1"),
    "the class instead of a problem": (
        lambda f: ng.solve(ng.GraspProblem),
        "problem: got <class",
        "ng.GraspProblem(body, contacts, task)",
    ),
    "a script's name instead of a problem": (
        lambda f: ng.solve("part.py"),
        "problem: got part.py",
        "nlpgrasp solve runs scripts",
    ),
    "degrees to pour": (
        lambda f: ng.pour([0, 0, 0.05], 0.3, [1, 0, 0], 45),
        "pour: angle: got 45.0",
        "radians, at most pi: 45 degrees are 0.7854",
    ),
    "degrees of an approach": (
        lambda f: ng.Approach([0, 0, -1], 30),
        "Approach.angle: got 30.0",
        "30 degrees are 0.5236",
    ),
    "a mass as text": (
        lambda f: ng.gravity([0, 0, 0], "300 g"),
        "gravity: mass: got '300 g'",
        "a number greater than 0",
    ),
    "a mass in grams": (lambda f: ng.lift([0, 0, 0], 400), "mass: 400 kg", "if grams were meant, 0.4"),
    "a table through the body": (
        lambda f: problem(constraints=[ng.Table(0.0)]),
        "constraints[0]: the body reaches 20 mm below the table",
        "ng.Table.under(body)",
    ),
    "a link's name with a slip": (
        lambda f: ng.URDFHand.load(written(f, "hand.urdf", ROBOT), {"tpi": 0.01}),
        "URDFHand.fingertips: got tpi",
        "did you mean tip?",
    ),
    "a hand's file that is not there": (
        lambda f: ng.URDFHand.load(f / "hand.urdf", {"tip": 0.01}),
        "URDFHand.path: got",
        "a URDF file that can be read (No such file or directory)",
    ),
    "fingertips that the hand has not": (
        lambda f: ng.URDFHand.load(written(f, "hand.urdf", ROBOT), {"thumb": 0.01}),
        "URDFHand.fingertips: got thumb",
        "links: palm, tip",
    ),
    "headers that say nothing": (
        lambda f: ng.WrenchRecording.read(written(f, "r.csv", "a,b,c,d,e,f\n1,2,3,4,5,6\n")),
        "r.csv: columns: got columns a, b, c, d, e, f",
        "or columns=",
    ),
    "headers without units": (
        lambda f: ng.WrenchRecording.read(written(f, "r.csv", "fx,fy,fz,tx,ty,tz\n1,2,3,4,5,6\n")),
        "r.csv: units: got none in the header",
        'units=("N", "Nm")',
    ),
    "a frame where a file is read": (
        lambda f: ng.WrenchRecording.read(np.eye(6)),
        "path: got array(",
        "ng.WrenchRecording.of takes frames and arrays",
    ),
    "normals that are not unit": (
        lambda f: ng.Grasp(AT, 2.0 * np.array(INTO), ng.FrictionContact(0.6)),
        "Grasp.normals: got length 2 at contact 0",
        "unit vectors",
    ),
    "normals out of the body": (
        lambda f: ng.Grasp(AT, -np.array(INTO), ng.FrictionContact(0.6)),
        "Grasp.normals: all point away from the middle of the contacts",
        "they have to point into the body",
    ),
    "much friction": (
        lambda f: problem(contacts=[ng.FrictionContact(37)] * 3),
        "GraspProblem.contacts[0].friction: 37 is above 2",
        "rubber on dry surfaces has about 1",
    ),
    "a solution that is no JSON": (
        lambda f: ng.GraspSolution.load(written(f, "grasp.json", "box, 3 contacts")),
        "grasp.json: got not valid JSON at line 1",
        "a complete JSON file",
    ),
    "a problem to verify": (
        lambda f: ng.verify(problem()),
        "solution: got a GraspProblem",
        "a GraspSolution, which ng.solve returns and ng.GraspSolution.load reads",
    ),
    "a problem to simulate": (
        lambda f: ng.simulate(problem()),
        "solution: got a GraspProblem",
        "a GraspSolution, which ng.solve returns",
    ),
    "a pose of seven numbers": (
        lambda f: ng.Obstacle(BODY, pose=[0, 0, 0.1, 1, 0, 0, 0]),
        "Obstacle.pose: got 7 numbers, which do not say where the scalar is",
        '"quaternion_wxyz" or "quaternion_xyzw"',
    ),
    "a folder in a folder that is not there": (
        lambda f: ng.solve_many({"a": problem()}, f / "grasps" / "today"),
        "today): got no folder",
        "a folder in one that exists",
    ),
    "tasks in a list": (
        lambda f: problem(task=[TASK, TASK]),
        "GraspProblem.task: got [",
        "tasks add up, such as ng.lift(...) + ng.disturbance(...)",
    ),
    "friction where a radius is asked for": (
        lambda f: problem(contacts=[ng.PlaneContact(0.6)] * 3),
        "GraspProblem.contacts[0].radius: got 0.6 m",
        "no more than the body's longest side, 0.08; friction is friction=...",
    ),
    "a hand's name": (
        lambda f: problem(hand="robotiq_2f85"),
        "GraspProblem.hand: got robotiq_2f85",
        "ng.hands.robotiq_2f85(...)",
    ),
    "jaws that open less than they close": (
        lambda f: ng.ParallelJaw(0.01, closed=0.02),
        "ParallelJaw.opening: got 0.01 m",
        "more than closed, 0.02 m",
    ),
    "a gripper's finger in millimetres": (
        lambda f: ng.ParallelJaw(0.08, finger_length=90),
        "ParallelJaw.finger_length: got 90 m",
        "90 mm are 0.09",
    ),
    "a point in millimetres": (
        lambda f: problem(task=ng.lift([31, 20, 16], 0.8)),
        "task: moments up to ",
        "on a body of 0.108 m: moments are newton-metres, and points metres",
    ),
    "starts in quotes": (lambda f: ng.solve(problem(), starts="2"), "starts: got '2'", "a whole number from 1"),
    "a CAD file": (
        lambda f: ng.Mesh.load(written(f, "part.step", "ISO-10303-21;")),
        "part.step, a CAD file",
        "export an STL",
    ),
    "a part of eight metres": (
        lambda f: ng.Mesh.load(mesh_in_millimetres(f, 0.1)),
        "part.stl: 8 m long",
        'unit="mm" says that its numbers are millimetres',
    ),
    "a solution over a mesh": (
        lambda f: solved().save(mesh_in_millimetres(f)),
        "GraspSolution.save: got ",
        "(a mesh that is there), expected another file name",
    ),
    "options as a dictionary": (
        lambda f: ng.solve(problem(), options={"gap": 0.02}),
        "options: got {'gap': 0.02}",
        "ng.SolveOptions(gap=0.02)",
    ),
}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_a_mistake_is_one_sentence_with_field_and_cure(mistake, tmp_path):
    make, field, cure = MISTAKES[mistake]
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        try:
            make(tmp_path)
        except ng.NlpgraspError as error:
            told = str(error)
        else:
            (warning,) = said
            told = str(warning.message)
            assert warning.filename == __file__  # the user's own line
    assert "\n" not in told
    assert field in told
    assert cure in told.partition(field)[2]


EXTRAS = {
    "kinematics": (
        "adam.casadi",
        lambda f: ng.URDFHand.load(written(f, "hand.urdf", ROBOT), {"tip": 0.01}),
        "URDFHand",
        "hands",
    ),
    "MuJoCo": ("mujoco", lambda f: ng.simulate(solved()), "a simulation", "sim"),
    "matplotlib": (
        "matplotlib",
        lambda f: ng.draw_fit(ng.fit_ellipsoid(np.random.default_rng(0).standard_normal((9, 3))), None, f / "fit.png"),
        "",
        "viz",
    ),
    "Dask": (
        "distributed",
        lambda f: ng.solve_many({"a": problem()}, f / "out", scheduler="tcp://nowhere:1"),
        "a Dask scheduler",
        "cluster",
    ),
}


def solved():
    return ng.GraspSolution.load(Path(__file__).parent / "solution" / "files" / "box.json")


@pytest.mark.parametrize("name", EXTRAS)
def test_a_missing_extra_is_named_before_the_work(name, tmp_path, monkeypatch):
    module, make, what, extra = EXTRAS[name]
    monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(
        ng.NlpgraspError, match=rf'^{what}.* needs the extra "{extra}": pip install "nlpgrasp\[{extra}\]"$'
    ):
        make(tmp_path)
    assert not (tmp_path / "out").exists()


def said_by(monkeypatch, capsys, *words):
    """What a command writes to standard error: one line, of this package."""
    monkeypatch.setattr(warnings, "formatwarning", warnings.formatwarning)  # which the command line changes
    monkeypatch.setattr(sys, "argv", ["nlpgrasp", *map(str, words)])
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 2
    told = capsys.readouterr().err
    assert told.count("\n") == 1
    assert told.startswith("nlpgrasp: ")
    return told


SCRIPT = "raise SystemExit('this script must not run')\n"
COMMANDS = {
    "no script": (["solve", "{}/none.py"], "SCRIPT: got ", "a Python file that exists"),
    "a script without problem()": (
        ["solve", "{}/empty.py"],
        "no function problem()",
        "a script with a function problem()",
    ),
    "a script that returns the class": (["solve", "{}/class.py"], "problem(): got type", "a GraspProblem"),
    "no folder for the answer": (
        ["solve", "{}/script.py", "--out", "{}/no/f.json"],
        "--out: got",
        "a folder that exists",
    ),
    "a folder for the answer": (["solve", "{}/script.py", "--out", "{}"], "--out: got", "expected a file name"),
    "no folder for a bound": (["bound", "{}/script.py", "--out", "{}/no/f.json"], "--out: got", "a folder that exists"),
    "no folder for an experiment": (
        ["experiment", "{}/experiment.py", "--out", "{}/no/dir"],
        "got no folder",
        "that exists",
    ),
    "no folder for a report": (
        ["report", "{}/none.json", "--out", "{}/no/f.html"],
        "--out: got",
        "a folder that exists",
    ),
    "a solution that is a script": (
        ["verify", "{}/script.py"],
        "script.py: got a Python script",
        "a solution file",
    ),
    "a report of a mesh": (
        ["report", "{}/part.stl"],
        "part.stl: got a mesh",
        "a solution file (JSON)",
    ),
    "an answer over the mesh": (
        ["solve", "{}/script.py", "--out", "{}/part.stl"],
        "part.stl (a mesh that is there)",
        "another file name: it would be overwritten",
    ),
    "a mesh to solve": (
        ["solve", "{}/part.stl"],
        "SCRIPT: got ",
        'a Python script with a function problem(), in which ng.Mesh.load("part.stl", unit="mm") is the body',
    ),
}


@pytest.mark.parametrize("name", COMMANDS)
def test_a_mistake_on_the_command_line_is_one_line(name, tmp_path, monkeypatch, capsys):
    words, field, cure = COMMANDS[name]
    written(tmp_path, "script.py", SCRIPT)
    written(tmp_path, "empty.py", "import nlpgrasp\n")
    mesh_in_millimetres(tmp_path)
    written(tmp_path, "class.py", "import nlpgrasp as ng\n\n\ndef problem():\n    return ng.GraspProblem\n")
    written(
        tmp_path,
        "experiment.py",
        "import nlpgrasp as ng\n\n\ndef experiment():\n"
        "    base = ng.GraspProblem(ng.Sphere(0.03), [ng.FrictionContact(0.6)] * 3, ng.TaskEllipsoid([1.0] * 6))\n"
        "    return ng.Experiment(base, {'a': {}}, seeds=[0], starts=1)\n",
    )
    told = said_by(monkeypatch, capsys, *(word.replace("{}", str(tmp_path)) for word in words))
    assert field in told
    assert cure in told


def test_read_only_output_is_refused_before_the_script_runs(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr("os.access", lambda path, mode: mode == os.R_OK)  # root may write anywhere
    script = written(tmp_path, "script.py", SCRIPT)
    told = said_by(monkeypatch, capsys, "solve", script, "--out", tmp_path / "f.json")
    assert "--out: got" in told
    assert "(not writable), expected a file that can be written" in told


def test_pictures_of_a_report_miss_matplotlib_before_the_work(tmp_path, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    told = said_by(monkeypatch, capsys, "report", tmp_path / "none.json", "--png", "--out", tmp_path / "f.html")
    assert 'needs the extra "viz"' in told


@pytest.mark.slow
def test_warnings_of_the_command_line_are_lines_without_source(tmp_path):
    rows = "p_x,p_y,p_z,n_x,n_y,n_z\n0.04,0,0,1,0,0\n-0.04,0,0,-1,0,0\n0,0.04,0,0,1,0\n"
    table = written(tmp_path, "contacts.csv", rows)
    command = [sys.executable, "-m", "nlpgrasp", "quality", str(table), "--friction", "0.5"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60)
    assert done.returncode == 0
    said = f"{table}: all normals point away from the middle of the contacts; they have to point into the body"
    assert done.stderr == f"nlpgrasp: {said}\n"
