"""Kinds defined outside the package work like its own: they are solved, saved, read, verified and exported."""

import importlib
import json
import re
import subprocess
import sys
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from unittest.mock import patch

import casadi as ca
import numpy as np
import pytest

import nlpgrasp as ng
from nlpgrasp.budgets import budget_from_dict, force_budget
from nlpgrasp.budgets.registry import BUDGETS
from nlpgrasp.common import robot_files
from nlpgrasp.common.registry import SOLIDS
from nlpgrasp.common.robot_files import register_robot_format
from nlpgrasp.common.scalar_constraints import Clearance
from nlpgrasp.constraints.registry import CONSTRAINTS
from nlpgrasp.contacts import contact_from_dict
from nlpgrasp.contacts.base import CONTACTS
from nlpgrasp.contacts.cones import RangeContact
from nlpgrasp.contacts.registry import register as register_contact
from nlpgrasp.interop import registry as formats
from nlpgrasp.interop.contacts_csv import contacts_csv
from nlpgrasp.optimize.options import ANALYSES
from nlpgrasp.quality import GraspMeasure, register_measure
from nlpgrasp.quality.measure_table import MEASURES
from nlpgrasp.quality.own_measures import OWN_MEASURES, RESERVED
from nlpgrasp.tasks import task_from_dict
from nlpgrasp.tasks.base import TASKS

FILES = Path(__file__).parent / "solution" / "files"
BOX, BALL = ng.Box([0.08, 0.04, 0.04]), ng.TaskEllipsoid([1, 1, 1, 0.03, 0.03, 0.03])
PAGE = Path(__file__).resolve().parents[1] / "docs" / "own_kinds.md"
MODULE = re.search(r'```python title="own_kinds.py"\n(.*?)```', PAGE.read_text(encoding="utf-8"), re.DOTALL)[1]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder with the file of docs/own_kinds.md."""
    path = tmp_path_factory.mktemp("own")
    (path / "own_kinds.py").write_text(MODULE)
    return path


@pytest.fixture(scope="module", autouse=True)
def kinds(folder):
    """The module of the page, whose kinds are registered, and forgotten again."""
    registries = (SOLIDS, CONSTRAINTS, CONTACTS, BUDGETS, TASKS)
    with ExitStack() as stack:
        for registry in registries:
            stack.enter_context(patch.dict(registry._kinds))
        stack.enter_context(patch.dict(formats._formats))
        stack.enter_context(patch.dict(OWN_MEASURES))
        stack.enter_context(patch.dict(robot_files._formats))
        sys.path.insert(0, str(folder))
        yield importlib.import_module("own_kinds")
        sys.path.remove(str(folder))
        del sys.modules["own_kinds"]


def passed(solution, path):
    """Save, read and verify a solution; return what was read."""
    solution.save(path)
    again = ng.GraspSolution.load(path)
    asked, found = solution.to_dict(), again.to_dict()
    for data in (asked, found):  # a large certificate is in a file beside the one saved, which names it
        data["quality"].get("best_possible", {}).pop("certificate", None)
    assert found == asked
    assert ng.verify(path).passed
    return again


@pytest.fixture(scope="module")
def egg(kinds, folder):
    """The page's own problem, solved and saved."""
    solution = ng.solve(kinds.problem(), starts=2, options=ng.SolveOptions(workers=1))
    return solution, solution.save(folder / "egg.json")


def test_a_body_and_a_limit_from_elsewhere(egg, tmp_path):
    """Contacts are on the surface by its formula in numpy, which the page does not state, and the limit binds."""
    solution, file = egg
    x, y, z = solution.grasp.points.T
    width, height, taper = 0.03, 0.05, 0.4
    wide = width**2 * (1.0 + taper * z / height)
    np.testing.assert_allclose((x**2 + y**2) / wide + z**2 / height**2, 1.0, atol=1e-6)
    slope_z = -(x**2 + y**2) / wide**2 * width**2 * taper / height + 2.0 * z / height**2
    outward = np.column_stack([2.0 * x / wide, 2.0 * y / wide, slope_z])
    outward /= np.linalg.norm(outward, axis=1, keepdims=True)
    np.testing.assert_allclose(solution.grasp.normals, -outward, atol=1e-6)
    assert z[0] + z[1] <= 1e-9
    assert solution.kkt.locally_optimal
    passed(solution, tmp_path / "again.json")
    verification = ng.verify(file)
    assert verification.complete
    assert "by the body's own functions" in str(verification)
    assert "1 row recomputed" in str(verification)


@pytest.mark.parametrize(
    ("edit", "check"),
    [
        (lambda d: d["problem"]["body"].update(taper=0.39), "surface"),
        (lambda d: d["grasp"]["contacts"][1]["position"].__setitem__(0, -0.0263), "surface"),
        (lambda d: d["problem"]["body"].update(height=0.0495), "normals"),
        (lambda d: d["problem"]["constraints"][0].update(height=-0.01), "constraint 0, middle below"),
        (lambda d: d["constraints"][0].update(value=-0.02), "constraint 0, middle below"),
        (lambda d: d["problem"]["body"].pop("taper"), "surface"),
    ],
)
def test_edits_of_a_file_with_kinds_from_elsewhere_are_seen(edit, check, egg, tmp_path):
    data = json.loads(egg[1].read_text())
    edit(data)
    (tmp_path / "edited.json").write_text(json.dumps(data))
    assert check in [c.name for c in ng.verify(tmp_path / "edited.json").checks if c.failed]


def test_a_measure_from_elsewhere(egg, tmp_path):
    """Of the three contacts' distances the least, in solution, file, print, page, table and verification."""
    solution = ng.analyse(egg[0], "least distance")
    points = solution.grasp.points
    least = min(np.linalg.norm(points[i] - points[j]) for i, j in ((0, 1), (0, 2), (1, 2)))
    assert [(m.name, m.unit) for m in solution.measures] == [("least distance", "m")]
    assert solution.measures[0].value == pytest.approx(least)
    assert ng.analyse(solution, "least distance").measures == solution.measures
    assert f"  least distance {least:.4g} m" in str(solution).splitlines()
    assert passed(solution, tmp_path / "measured.json").measures == solution.measures
    solution.show(tmp_path / "page.html")
    assert "Least distance" in (tmp_path / "page.html").read_text(encoding="utf-8")
    grasp = solution.grasp
    stack = ng.GraspStack(points[None], grasp.normals[None], grasp.contacts, grasp.torque_origin)
    table = ng.measure(stack, measures=["least distance", "isotropy"])
    assert float(table["least distance"][0]) == pytest.approx(least)


@pytest.mark.parametrize(
    ("edit", "message"),
    [
        (lambda m: m.update(value=0.05), "stated 0.05 m, recomputed 0.0"),
        (lambda m: m.update(unit="mm"), " mm, recomputed 0.0"),
        (lambda m: m.update(name="another"), "not made: nothing recomputes a measure of that name"),
    ],
)
def test_a_measure_that_is_edited_is_seen(edit, message, egg, tmp_path):
    file = ng.analyse(egg[0], "least distance").save(tmp_path / "measured.json")
    data = json.loads(file.read_text())
    edit(data["quality"]["measures"][0])
    file.write_text(json.dumps(data))
    checks = {c.name: c for c in ng.verify(file).checks}
    check = checks[data["quality"]["measures"][0]["name"]]
    assert message in check.detail
    assert not check.passed


def test_what_a_measure_may_be():
    assert set(RESERVED) == {*MEASURES, *ANALYSES}
    for measure in (GraspMeasure("least distance", "mm", len), *(GraspMeasure(n, "m", len) for n in ("", "friction"))):
        with pytest.raises(ng.InputError, match=r"GraspMeasure\.name: got .*, expected another name"):
            register_measure(measure)
    with pytest.raises(ng.InputError, match="register_measure: got 5, expected a GraspMeasure"):
        register_measure(5)
    grasp = ng.Grasp([[0, 0, 1.0]], [[0, 0, -1.0]], ng.PointContact())
    for value in ("much", None, float("nan")):
        with pytest.raises(ng.InputError, match="expected a finite number from its function"):
            GraspMeasure("odd", "", lambda *_, value=value: value).value(grasp, None, force_budget("l2"))


@pytest.mark.slow
def test_a_hand_of_a_robot_file_from_elsewhere(kinds, tmp_path):
    """Solved, verified from file and robot file, and held in MuJoCo."""
    robot = tmp_path / "my.jaws"
    robot.write_text(json.dumps({"opening": 0.12, "width": 0.016, "force": 50}))
    hand = ng.URDFHand.load(robot, ["left", "right"])
    lift = ng.lift([0.0, 0.0, 0.0], 0.2)
    problem = ng.GraspProblem(ng.Box([0.05, 0.04, 0.06]), ng.SoftContact(0.7, 0.01), lift, hand=hand)
    found = ng.solve(problem, starts=1, options=ng.SolveOptions(workers=1))
    verification = ng.verify(found.save(tmp_path / "held.json"))
    assert verification.passed
    assert verification.complete
    assert ng.simulate_hand(found, robot, wrenches=4).held
    robot.write_text(json.dumps({"opening": 0.10, "width": 0.016, "force": 50}))
    assert not ng.verify(tmp_path / "held.json").complete  # another file than the one that was read


@pytest.mark.parametrize("ending", ["jaws", ".urdf", ".my.xml", ".old.jaws"])
def test_endings_of_robot_files(kinds, ending):
    with pytest.raises(ng.InputError, match="expected an ending with a dot that no other format has"):
        register_robot_format(ending, lambda path: "")
    register_robot_format(".jaws", kinds.jaws)


def test_an_experiment_on_a_body_from_elsewhere(kinds, tmp_path):
    """Its variations run in workers, which import the file by name."""
    base, lower = kinds.problem(), [kinds.MiddleBelow(-0.01)]
    experiment = ng.Experiment(base, {"free": {"constraints": []}, "low": {"constraints": lower}}, seeds=[0], starts=1)
    result = ng.run_experiment(experiment, tmp_path / "runs", workers=2)
    free, low = (result.solution(name).mu.lower for name in ("free", "low"))
    assert 0.0 < low < free * 1.02


def test_the_command_line_imports_a_file_before_any_command(folder, tmp_path):
    (tmp_path / "broken.py").write_text("x = 1\nraise ValueError('no')\n")

    def run(*arguments):
        command = [sys.executable, "-m", "nlpgrasp", *map(str, arguments)]
        return subprocess.run(command, capture_output=True, text=True, timeout=120, cwd=tmp_path)

    assert (
        "by the body's own functions"
        in run("verify", folder / "egg.json", f"--with-module={folder}/own_kinds.py").stdout
    )
    assert "faces, the faces that are touched" in " ".join(
        run("--with-module", folder / "own_kinds.py", "export", "--help").stdout.replace("│", " ").split()
    )
    for file, message in (
        ("none.py", "--with-module: got none.py, expected a Python file that exists"),
        ("broken.py", "--with-module broken.py: got ValueError: no (line 2), expected a file that runs"),
    ):
        done = run("verify", folder / "egg.json", "--with-module", file)
        assert (done.returncode, done.stderr) == (2, f"nlpgrasp: {message}\n")


def test_without_their_file_the_rest_is_verified(egg):
    with patch.dict(SOLIDS._kinds), patch.dict(CONSTRAINTS._kinds):
        del SOLIDS._kinds["egg"], CONSTRAINTS._kinds["middle below"]
        verification = ng.verify(egg[1])
    assert verification.passed
    assert not verification.complete
    assert "nothing recomputes a body of type 'egg'" in verification.verdict


def test_a_limit_of_clearances_is_not_said_to_be_recomputed(egg, kinds):
    clearance = Clearance("middle", None, None, 0.0)
    with patch.object(kinds.MiddleBelow, "rows", lambda self, placement: [clearance]):
        checks = {c.name: c for c in ng.verify(egg[1]).checks}
    check = checks["constraint 0, middle below"]
    assert not check.made
    assert check.detail == "not made: a constraint of type 'middle below' keeps clearances of the hand"


def test_a_body_from_elsewhere_is_bounded_over_all_placements(egg, kinds, tmp_path):
    """By its charts; the bound is recomputed from the file, and one that is too low is seen."""
    solution, file = egg
    assert solution.mu.lower <= solution.bound.upper < 2.0 * solution.mu.lower
    assert "bound, leaves" in [check.name for check in ng.verify(file).checks if check.made and check.passed]
    bound = ng.best_possible(kinds.problem(), time_limit=1.0)
    path = bound.save(tmp_path / "bound.json")
    assert ng.verify(path).passed
    data = json.loads(path.read_text())
    data["upper"] *= 0.9
    path.write_text(json.dumps(data))
    assert "upper" in [check.name for check in ng.verify(path).checks if check.failed]


def test_a_bound_by_charts_goes_over_edges_and_says_so(kinds, tmp_path):
    """The margin from sharp edges is left out, in the bound and in its verification."""
    bound = ng.best_possible(replace(kinds.problem(), edge_margin=1e-3), time_limit=0.5)
    assert "the edge margin" in bound.dropped
    assert ng.verify(bound.save(tmp_path / "bound.json")).passed


@pytest.mark.parametrize(
    ("chart", "message"),
    [
        (
            lambda c: {"rectangle": [[0.0, 0.0], [0.0, 1.0]]},
            r"Chart\.rectangle: got .*a least value below the greatest",
        ),
        (lambda c: {"divisions": (0, 4)}, r"Chart\.divisions: got \[0\.0, 4\.0\], expected two whole numbers"),
        (lambda c: {"point": lambda u: u}, r"Chart\.point: got shape \(2, 1\), expected a column of three metres"),
        (
            lambda c: {"point": lambda u: c.point(u) + 1e-9 * ca.erf(u[0])},
            r"Egg\.charts: got operation \d+ of CasADi \(rates\), expected operations with bounds",
        ),
    ],
)
def test_a_chart_that_states_too_little_is_said(chart, message, kinds):
    (whole,) = kinds.Egg(0.03, 0.05, 0.4).charts()
    stated = patch.object(kinds.Egg, "charts", lambda self: (replace(whole, **chart(whole)),))
    with stated, pytest.raises(ng.InputError, match=message):
        ng.best_possible(kinds.problem(), time_limit=0.5)


def test_a_body_without_charts_has_no_bound_over_all_placements(kinds):
    with patch.object(kinds.Egg, "charts", lambda self: ()):
        with pytest.raises(ng.InputError, match=r"best_possible\.body: got egg, expected a body of flat faces"):
            ng.best_possible(kinds.problem(), time_limit=1.0)
        solution = ng.solve(kinds.problem(), starts=1, options=ng.SolveOptions(workers=1))
        assert solution.success
        assert solution.bound is None


@pytest.mark.slow
def test_a_contact_model_from_elsewhere(kinds, tmp_path):
    found = ng.solve(
        ng.GraspProblem(BOX, [kinds.Gecko(0.5)] * 3, BALL), starts=1, seed=0, options=ng.SolveOptions(workers=1)
    )
    again = passed(found, tmp_path / "gecko.json")
    assert again.grasp.contacts == (kinds.Gecko(0.5),) * 3
    plain = ng.Grasp(again.grasp.points, again.grasp.normals, ng.FrictionContact(0.5), again.grasp.torque_origin)
    assert ng.mu(plain, BALL).lower == pytest.approx(found.mu.lower, rel=0.02)
    table = contacts_csv(again).splitlines()
    assert [line.split(",")[-3:] for line in table[1:]] == [["gecko", "", ""]] * 3


def test_a_contact_model_says_what_it_lacks(kinds):
    contact = kinds.Gecko(0.5)
    assert contact.with_friction(0.9) == kinds.Gecko(0.45)
    with pytest.raises(ng.InputError, match="point, friction or soft contacts in a friction pyramid"):
        ng.ferrari_canny(ng.Grasp([[0, 0, 1.0]], [[0, 0, -1.0]], contact))


@pytest.mark.parametrize("base", [RangeContact, ng.PointContact.__mro__[2]])
def test_a_contact_model_states_its_friction_coefficients(base, kinds):
    entries = {name: value for name, value in vars(kinds.Gecko).items() if name not in ("coefficients", "__dict__")}
    silent = type("Silent", (base,), {**entries, "kind": "test silent"})
    for use in (register_contact, silent):
        with pytest.raises(ng.InputError, match=r"Silent\.coefficients: .*friction coefficients by name"):
            use(silent)


@pytest.mark.parametrize(
    ("coefficients", "words"),
    [
        (
            property(lambda self: {"mu": 0.5}),
            r"coefficients: got .*mu.*, expected numbers by name of its fields",
        ),
        (property(lambda self: {"friction": "much"}), r"coefficients\['friction'\]: got"),
        (property(lambda self: None), r"coefficients: got None, expected numbers by name of its fields"),
        (lambda self: {"friction": 0.5}, r"coefficients: .*a property with the friction coefficients"),
    ],
)
def test_friction_coefficients_are_numbers_of_the_models_fields(coefficients, words):
    odd = type("Odd", (ng.FrictionContact,), {"kind": "test odd", "coefficients": coefficients})
    with pytest.raises(ng.InputError, match=words):
        odd(0.5).with_friction(0.9)


@pytest.mark.slow
def test_a_budget_from_elsewhere(kinds, tmp_path):
    found = ng.solve(
        ng.GraspProblem(BOX, [ng.FrictionContact(0.5)] * 3, BALL, force_budget=kinds.Weighed(2.0)), starts=2
    )
    again = passed(found, tmp_path / "weighed.json")
    assert budget_from_dict(again.problem["force_budget"]) == kinds.Weighed(2.0)
    shared = ng.mu(again.grasp, BALL, force_budget="shared")
    assert found.mu.lower <= shared.upper
    assert ng.mu(again.grasp, BALL, force_budget=kinds.Weighed(1.0)).lower == pytest.approx(shared.lower, rel=0.02)
    used = ng.finger_forces(again.grasp, found.mu.lower * BALL.axes, force_budget=kinds.Weighed(2.0)).used
    assert np.all(used <= 1.0 + 1e-6)


@pytest.mark.slow
def test_a_task_from_elsewhere(kinds, tmp_path):
    task = kinds.Pair([0, 0, 1.0, 0, 0, 0.01])
    problem = ng.GraspProblem(BOX, [ng.FrictionContact(0.5)] * 3, task)
    found = ng.solve(problem, starts=1, options=ng.SolveOptions(workers=1))
    again = passed(found, tmp_path / "pair.json")
    assert task_from_dict(again.problem["task"]).to_dict()["type"] == "pair"
    assert task_from_dict((task + BALL).to_dict()).tasks[0] == task


@pytest.mark.parametrize(
    ("read", "kind"),
    [
        (lambda: contact_from_dict({"model": "test unheard of"}), "point, friction, soft, line, plane, bilateral, "),
        (lambda: task_from_dict({"type": "test unheard of"}), "ellipsoid, polytope, set, sum, pair"),
        (lambda: force_budget("test unheard of"), "l2, per_finger, shared, per_finger_size, hand_torques, or"),
    ],
)
def test_kinds_that_nobody_registered_are_refused(read, kind):
    with pytest.raises(ng.InputError, match=f"got test unheard of, expected (one of )?{kind}"):
        read()


def test_a_name_stands_for_one_kind(kinds):
    class Other(kinds.Gecko):
        kind = "friction"

    with pytest.raises(ng.InputError, match="another name: that one is FrictionContact's"):
        register_contact(Other)
    assert CONTACTS.find("friction") is ng.FrictionContact
    assert register_contact(kinds.Gecko) is kinds.Gecko


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            lambda d: d["grasp"]["contacts"][1].update(model="glue"),
            r"contacts\.1\.model: got 'glue' is not one of",
        ),
        (lambda d: d["problem"].update(force_budget="glue"), r"problem\.force_budget: got 'glue' is not valid"),
        (lambda d: d["problem"].update(force_budget={"type": "glue"}), r"problem\.force_budget: got {'type': 'glue'}"),
        (lambda d: d["problem"].update(task={"type": "glue"}), r"problem\.task: got {'type': 'glue'} is not valid"),
    ],
)
def test_unknown_kinds_in_a_file_are_named(change, message, tmp_path, solved):
    data = json.loads(solved.read_text())
    change(data)
    changed = tmp_path / "changed.json"
    changed.write_text(json.dumps(data))
    with pytest.raises(ng.InputError, match=f"{message}.*, expected what schema 1 says"):
        ng.GraspSolution.load(changed)


@pytest.fixture(scope="module")
def solved(tmp_path_factory):
    problem = ng.GraspProblem(BOX, [ng.FrictionContact(0.5)] * 3, BALL)
    options = ng.SolveOptions(workers=1, global_bound=False)
    return ng.solve(problem, starts=1, options=options).save(tmp_path_factory.mktemp("solved") / "friction.json")


# A format to export to and a format to read from, in a module of somebody else's.

TOY_FORMAT = """
import nlpgrasp as ng
from nlpgrasp.budgets import force_budget
from nlpgrasp.interop import ExportFormat, ReadFormat, ReadGrasp, register, register_reader

def lines(solution, options):
    return "".join(f"{face} {p[0]:g}\\n" for face, p in zip(solution.faces, solution.grasp.points))

def grasps(path, options):
    models = [ng.FrictionContact(options.friction)] * 2
    grasp = ng.Grasp([[-1, 0], [1, 0]], [[1, 0], [-1, 0]], models, torque_origin=[0, 0])
    yield ReadGrasp(path.stem, grasp, None, force_budget("l2"))

register(ExportFormat("faces", ".faces", "faces with their first coordinate", lines))
register_reader(ReadFormat((".faces",), ("friction",), grasps))
"""


@pytest.fixture
def toy(tmp_path):
    """Run the command line in a process that has imported the module."""
    (tmp_path / "toy_format.py").write_text(TOY_FORMAT)
    code = "import toy_format; from nlpgrasp.cli.main import main; main()"

    def run(*arguments):
        command = [sys.executable, "-c", code, *map(str, arguments)]
        return subprocess.run(command, capture_output=True, text=True, timeout=120, cwd=tmp_path)

    return run


def test_a_toy_format_writes_a_file_from_the_command_line(toy, tmp_path):
    (tmp_path / "box.json").write_text((FILES / "box.json").read_text())
    done = toy("export", "box.json", "--to", "faces")
    assert done.returncode == 0, done.stderr
    assert done.stdout == "written to box.faces\n"
    assert len((tmp_path / "box.faces").read_text().splitlines()) == 3


@pytest.mark.slow
def test_the_command_line_lists_a_toy_format(toy):
    done = toy("export", "--help")
    assert "faces, faces with their first coordinate" in " ".join(done.stdout.replace("│", " ").split())
    done = toy("export", FILES / "box.json", "--to", "nothing")
    assert done.returncode == 2
    assert "--to: got nothing, expected one of csv, " in done.stderr
    assert done.stderr.endswith(", faces\n")


@pytest.mark.slow
def test_a_toy_format_needs_a_grasp_unless_it_says_otherwise(toy):
    done = toy("export", FILES / "none.json", "--to", "faces", "--out", "x.faces")
    assert done.returncode == 2
    assert done.stderr == "nlpgrasp: solution: got no grasp, expected a solution with a grasp\n"


@pytest.mark.slow
def test_files_of_a_toy_format_are_read(toy, tmp_path):
    (tmp_path / "contacts.faces").write_text("")
    done = toy("quality", "contacts.faces", "--friction", "0.5")
    assert done.stdout.startswith("contacts: 2 contacts, force budget l2\n"), done.stderr
    assert "force-closed" in done.stdout
    done = toy("quality", "contacts.faces", "--task", "box.json")
    assert done.returncode == 2
    assert done.stderr == "nlpgrasp: box.json: got no file of that name, expected a solution file that exists\n"
