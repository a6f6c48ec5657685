"""Import of contact tables: warnings on missing data, refusal of outward normals."""

import subprocess
import sys
import warnings

import numpy as np
import pytest

import nlpgrasp as ng
from nlpgrasp.common import user_warnings as once
from nlpgrasp.interop import contacts_csv, read_contacts_csv

HEAD = "p_x,p_y,p_z,n_x,n_y,n_z"
POINTS = np.array([[0.04, 0.0, 0.0], [-0.04, 0.0, 0.0], [0.0, 0.02, 0.0]])
INWARD = np.array([[-1.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
BOX = ng.Box([0.08, 0.04, 0.04])
TASK = ng.TaskEllipsoid([1.0] * 6)


def table(path, normals=INWARD, head=HEAD, ends=("", "", "")):
    rows = [",".join(map(repr, [*p.tolist(), *n.tolist()])) + e for p, n, e in zip(POINTS, normals, ends, strict=True)]
    path.write_text("\n".join([head, *rows]) + "\n")
    return path


@pytest.fixture
def strict():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        yield


def test_no_friction_is_said_to_be_none(tmp_path):
    with pytest.warns(UserWarning, match="no friction stated: taken to be frictionless") as warnings_shown:
        grasp = read_contacts_csv(table(tmp_path / "a.csv"))
    assert [m.kind for m in grasp.contacts] == ["point"] * 3
    (warning,) = warnings_shown
    assert str(warning.message).endswith(
        "a.csv: no friction stated: taken to be frictionless; friction=0.5 (--friction 0.5) states another"
    )
    assert warning.filename == __file__


def test_rows_without_friction_are_named(tmp_path):
    path = table(tmp_path / "a.csv", head=f"{HEAD},friction", ends=(",0.5", ",", ","))
    with pytest.warns(UserWarning, match="no friction stated in rows 3, 4: taken to be frictionless"):
        assert [m.kind for m in read_contacts_csv(path).contacts] == ["friction", "point", "point"]


@pytest.mark.usefixtures("strict")
def test_what_is_stated_is_not_doubted(tmp_path):
    read_contacts_csv(table(tmp_path / "a.csv"), friction=0.5)
    read_contacts_csv(table(tmp_path / "b.csv"), friction=0.0)
    read_contacts_csv(table(tmp_path / "c.csv", head=f"{HEAD},model", ends=(",point",) * 3))
    read_contacts_csv(table(tmp_path / "d.csv", head=f"{HEAD},friction", ends=(",0.5",) * 3), body=BOX)
    unknown_faces = ng.GraspSolution(ng.Status.SOLVED, "x", {}, ng.Grasp(POINTS, INWARD, ng.PointContact()), ("a",) * 3)
    (tmp_path / "e.csv").write_text(contacts_csv(unknown_faces), newline="")
    read_contacts_csv(tmp_path / "e.csv")


def test_much_friction_is_warned_of(tmp_path, monkeypatch):
    monkeypatch.setattr(once, "_issued", set())
    with pytest.warns(UserWarning, match=r"a\.csv: contact 0, friction: 60 is above 2") as warnings_shown:
        read_contacts_csv(table(tmp_path / "a.csv"), friction=60.0)
    assert warnings_shown[0].filename == __file__


@pytest.mark.parametrize("turned", [0, 1, 2])
@pytest.mark.parametrize("off", [0.0, 0.002, -0.002])
def test_a_normal_out_of_a_known_body_is_refused(turned, off, tmp_path, monkeypatch):
    monkeypatch.setattr(f"{__name__}.POINTS", POINTS + off * INWARD)
    normals = INWARD.copy()
    normals[turned] *= -1.0
    expected = rf"row {turned + 2}: got a normal that points out of the body, expected normals into the body"
    with pytest.raises(ng.InputError, match=expected):
        read_contacts_csv(table(tmp_path / "a.csv", normals), 0.5, BOX)
    read_contacts_csv(table(tmp_path / "b.csv"), 0.5, BOX)


@pytest.mark.parametrize(
    "body", [ng.Ellipsoid([0.04, 0.02, 0.03]), ng.Cylinder(0.04, 0.1), ng.Superquadric([0.04, 0.02, 0.02], [0.5, 0.5])]
)
def test_normals_of_other_bodies(body, tmp_path):
    with pytest.raises(ng.InputError, match="row 2: got a normal that points out of the body"):
        read_contacts_csv(table(tmp_path / "a.csv", -INWARD), 0.5, body)
    read_contacts_csv(table(tmp_path / "b.csv"), 0.5, body)


def test_without_a_body_normals_that_all_point_away_are_warned_of(tmp_path):
    with pytest.warns(
        UserWarning, match=r"a\.csv: all normals point away from the middle of the contacts"
    ) as warnings_shown:
        read_contacts_csv(table(tmp_path / "a.csv", -INWARD), 0.5)
    assert [s.filename for s in warnings_shown] == [__file__]


@pytest.mark.usefixtures("strict")
def test_some_normals_may_point_away(tmp_path):
    read_contacts_csv(table(tmp_path / "a.csv", INWARD * [[1.0], [1.0], [-1.0]]), 0.5)


@pytest.mark.slow
def test_the_command_line_knows_the_body_of_the_task(tmp_path):
    problem = ng.GraspProblem(BOX, [ng.FrictionContact(0.5)] * 3, TASK)
    grasp = ng.Grasp(POINTS, INWARD, problem.models, problem.origin)
    faces, bounds = ("+x", "-x", "+y"), ng.Bounds(0.0, 1.0)
    ng.GraspSolution(ng.Status.SOLVED, "x", problem.to_dict(), grasp, faces, bounds).save(tmp_path / "g.json")
    table(tmp_path / "out.csv", -INWARD)
    table(tmp_path / "in.csv")

    def call(name):
        words = [sys.executable, "-m", "nlpgrasp", "quality", name, "--task", "g.json"]
        return subprocess.run(words, cwd=tmp_path, capture_output=True, text=True)

    result = call("out.csv")
    assert result.returncode == 2
    assert "out.csv: row 2: got a normal that points out of the body" in result.stderr
    result = call("in.csv")
    assert result.returncode == 0
    (line,) = result.stderr.splitlines()
    assert line.startswith("nlpgrasp: in.csv: no friction stated: taken to be frictionless")
