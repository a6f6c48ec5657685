"""Kinds defined outside the package work like its own: they are solved, saved, read, verified and exported."""

import json
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar
from unittest.mock import patch

import numpy as np
import pytest

import nlpgrasp as ng
from nlpgrasp.budgets import ForceBudget, budget_from_dict, force_budget
from nlpgrasp.budgets.base import ForceSet
from nlpgrasp.budgets.registry import BUDGETS
from nlpgrasp.budgets.registry import register as register_budget
from nlpgrasp.common.scalar_constraints import ScalarConstraint
from nlpgrasp.contacts import contact_from_dict
from nlpgrasp.contacts.base import CONTACTS
from nlpgrasp.contacts.cones import RangeContact
from nlpgrasp.contacts.registry import register as register_contact
from nlpgrasp.interop.contacts_csv import contacts_csv
from nlpgrasp.tasks import TaskPolytope, task_from_dict
from nlpgrasp.tasks.base import TASKS
from nlpgrasp.tasks.registry import register as register_task

FILES = Path(__file__).parent / "solution" / "files"
BOX, BALL = ng.Box([0.08, 0.04, 0.04]), ng.TaskEllipsoid([1, 1, 1, 0.03, 0.03, 0.03])


@dataclass(frozen=True)
class Gecko(RangeContact):
    """A dry adhesive that slides along neither tangent: friction by another name, as a contact of its own."""

    kind: ClassVar[str] = "test gecko"
    grip: float

    @property
    def coefficients(self):
        return {"grip": self.grip}

    def axes(self, space):
        return tuple(range(space))

    def blocks(self, components):
        return ((slice(1, components), self.grip),)

    def variables(self, space):
        return space

    def split(self, x, normal):
        return x, None

    def membership(self, x, normal):
        pressing = normal.T @ x
        return [("grip", (1.0 + self.grip**2) * pressing**2 - x.T @ x), ("unilateral", pressing)]

    def to_dict(self):
        return {"model": self.kind, "grip": self.grip}

    @classmethod
    def from_dict(cls, data):
        return cls(data["grip"])


class WeighedSet(ForceSet):
    """``{x in K : sum_i w_i f_n,i <= 1}``."""

    power: ClassVar[float] = 8.0

    def __init__(self, contacts, space, weights):
        super().__init__(contacts, space)
        self.weights = weights

    def support(self, z):
        parts = [c.extreme(z[:, r]) for c, r in zip(self.contacts, self.ranges, strict=True)]
        values = np.stack([p[0] for p in parts], axis=1) / self.weights
        best, force = np.argmax(values, axis=1), np.zeros_like(z)
        for i, r in enumerate(self.ranges):
            force[best == i, r] = parts[i][1][best == i] / self.weights[i]
        return values[np.arange(len(z)), best], force

    def gauge(self, x):
        return sum(w * x[:, r.start] for w, r in zip(self.weights, self.ranges, strict=True))

    def cones(self):
        row = np.zeros((1, self.size + 1))
        row[0, -1] = 1.0
        row[0, [r.start for r in self.ranges]] = [-w for w in self.weights]
        return [row]


class Weighed(ForceBudget):
    """The fingers share one unit of normal force, which later fingers pay more for."""

    kind: ClassVar[str] = "test weighed"
    by_name: ClassVar[bool] = False

    def __init__(self, growth):
        self.growth = growth

    def weights(self, count):
        return self.growth ** np.arange(count)

    def at(self, frames, contacts):
        return WeighedSet(contacts, frames.shape[1], self.weights(len(contacts)))

    def rows(self, contacts, forces, normals):
        parts = zip(self.weights(len(contacts)), contacts, forces, normals, strict=True)
        return [ScalarConstraint("force budget", sum(w * c.normal_force(x, n) for w, c, x, n in parts), upper=1.0)]

    def to_dict(self):
        return {"type": self.kind, "growth": self.growth}

    @classmethod
    def from_dict(cls, data):
        return cls(data["growth"])


class Pair(TaskPolytope):
    """A wrench and its opposite."""

    kind: ClassVar[str] = "test pair"

    def __init__(self, wrench):
        super().__init__(np.stack([np.asarray(wrench), -np.asarray(wrench)]))

    def to_dict(self):
        return {"type": self.kind, "wrench": self.wrenches[0].tolist()}

    @classmethod
    def from_dict(cls, data):
        return cls(data["wrench"])


@pytest.fixture(scope="module", autouse=True)
def registered():
    """Register the kinds of this module, and forget them again."""
    with patch.dict(CONTACTS._kinds), patch.dict(BUDGETS._kinds), patch.dict(TASKS._kinds):
        register_contact(Gecko)
        register_budget(Weighed)
        register_task(Pair)
        yield


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


@pytest.mark.slow
def test_a_contact_model_from_elsewhere(tmp_path):
    found = ng.solve(ng.GraspProblem(BOX, [Gecko(0.5)] * 3, BALL), starts=1, seed=0, options=ng.SolveOptions(workers=1))
    again = passed(found, tmp_path / "gecko.json")
    assert again.grasp.contacts == (Gecko(0.5),) * 3
    plain = ng.Grasp(again.grasp.points, again.grasp.normals, ng.FrictionContact(0.5), again.grasp.torque_origin)
    assert ng.mu(plain, BALL).lower == pytest.approx(found.mu.lower, rel=0.02)
    table = contacts_csv(again).splitlines()
    assert [line.split(",")[-3:] for line in table[1:]] == [["test gecko", "", ""]] * 3


def test_a_contact_model_says_what_it_lacks():
    contact = Gecko(0.5)
    assert contact.with_friction(0.9) == Gecko(0.45)
    with pytest.raises(ng.InputError, match="point, friction or soft contacts in a friction pyramid"):
        ng.ferrari_canny(ng.Grasp([[0, 0, 1.0]], [[0, 0, -1.0]], contact))


@pytest.mark.parametrize("base", [Gecko.__base__, ng.PointContact.__mro__[2]])
def test_a_contact_model_states_its_friction_coefficients(base):
    entries = {name: value for name, value in vars(Gecko).items() if name not in ("coefficients", "__dict__")}
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
def test_a_budget_from_elsewhere(tmp_path):
    found = ng.solve(ng.GraspProblem(BOX, [ng.FrictionContact(0.5)] * 3, BALL, force_budget=Weighed(2.0)), starts=2)
    again = passed(found, tmp_path / "weighed.json")
    assert budget_from_dict(again.problem["force_budget"]) == Weighed(2.0)
    shared = ng.mu(again.grasp, BALL, force_budget="shared")
    assert found.mu.lower <= shared.upper
    assert ng.mu(again.grasp, BALL, force_budget=Weighed(1.0)).lower == pytest.approx(shared.lower, rel=0.02)
    used = ng.finger_forces(again.grasp, found.mu.lower * BALL.axes, force_budget=Weighed(2.0)).used
    assert np.all(used <= 1.0 + 1e-6)


@pytest.mark.slow
def test_a_task_from_elsewhere(tmp_path):
    task = Pair([0, 0, 1.0, 0, 0, 0.01])
    problem = ng.GraspProblem(BOX, [ng.FrictionContact(0.5)] * 3, task)
    found = ng.solve(problem, starts=1, options=ng.SolveOptions(workers=1))
    again = passed(found, tmp_path / "pair.json")
    assert task_from_dict(again.problem["task"]).to_dict()["type"] == "test pair"
    assert task_from_dict((task + BALL).to_dict()).tasks[0] == task


@pytest.mark.parametrize(
    ("read", "kind"),
    [
        (lambda: contact_from_dict({"model": "test unheard of"}), "point, friction, soft, line, plane, bilateral, "),
        (lambda: task_from_dict({"type": "test unheard of"}), "ellipsoid, polytope, set, sum, test pair"),
        (lambda: force_budget("test unheard of"), "l2, per_finger, shared, per_finger_size, hand_torques, or"),
    ],
)
def test_kinds_that_nobody_registered_are_refused(read, kind):
    with pytest.raises(ng.InputError, match=f"got test unheard of, expected (one of )?{kind}"):
        read()


def test_a_name_stands_for_one_kind():
    class Other(Gecko):
        kind = "friction"

    with pytest.raises(ng.InputError, match="another name: that one is FrictionContact's"):
        register_contact(Other)
    assert CONTACTS.find("friction") is ng.FrictionContact
    assert register_contact(Gecko) is Gecko


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
