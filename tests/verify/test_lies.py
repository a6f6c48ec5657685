"""Detection of false statements by the check that recomputes them."""

import numpy as np
import pytest

import nlpgrasp as ng
from nlpgrasp.verify.check import Check, Verification
from nlpgrasp.verify.registry import BODIES
from nlpgrasp.verify.sources import SourceFolders
from tests.hands.urdf import FOLDER
from tests.verify import honest
from tests.verify.edits import a_little, asked, contact, drop, failures, put, repeat, row, turned
from tests.verify.stated import contacts_on, edited, problem_of, recomputed_file, stated_file


def farther(clearance):
    """Return an edit that states a greater clearance of the hand, and every link beyond it."""

    def change(data):
        data["problem"]["hand"]["clearance"] = clearance
        for stated in data["constraints"]:
            if stated["name"].startswith("clearance from the body, "):
                stated.update(value=max(stated["value"], clearance + 1e-3), bound=[clearance, None])

    return change


BOX = {
    "the body is larger": (put(("problem", "body", "extents", 0), 0.5), "surface"),
    "the body is a little larger": (put(("problem", "body", "extents", 0), 0.0801), "surface"),
    "the body is a sphere": (put(("problem", "body"), {"type": "sphere", "radius": 0.04}), "surface"),
    "a body inside out": (put(("problem", "body", "extents"), lambda e: [-v for v in e]), "surface"),
    "another face": (put(contact(0, "face"), "+y"), "surface"),
    "a face there is not": (put(contact(0, "face"), "lid"), "surface"),
    "a forbidden face": (put(contact(2, "face"), "-z"), "faces"),
    "a contact off its face": (put(contact(0, "position"), [0.0401, 0.004, 0.01]), "surface"),
    "a contact past the edge": (put(contact(2, "position"), [0.0, 0.02, -0.0301]), "surface"),
    "a contact moved along its face": (put(contact(2, "position"), [0.0001, 0.02, -0.01]), "constraint 1, spread"),
    "a normal outwards": (turned(2, [0.0, 1.0, 0.0]), "normals"),
    "a normal turned": (turned(2, [1e-4, -np.sqrt(1.0 - 1e-8), 0.0]), "normals"),
    "a stated height": (row("table, finger 1", "value", a_little), "constraint 0, table"),
    "a stated bound": (row("table, finger 1", "bound", [-0.06, None]), "constraint 0, table"),
    "no bound": (row("table, finger 1", "bound", [None, None]), "constraint 0, table"),
    "a row active far from its limits": (row("table, finger 1", "active", True), "constraint 0, table"),
    "a multiplier of a row that is not active": (row("table, finger 1", "multiplier", 0.3), "constraint 0, table"),
    "a row that is left out": (drop("table, finger 2"), "constraint 0, table"),
    "the table's height": (put(asked(0, "height"), -0.051), "constraint 0, table"),
    "the table's clearance": (put(asked(0, "clearance"), 0.0), "constraint 0, table"),
    "the table as high as it was kept": (put(asked(0, "height"), 0.0), "constraint 0, table"),
    "the table gone": (put(("problem", "constraints"), lambda c: c[1:]), "constraints"),
    "a least distance": (put(asked(1, "min"), 0.005), "constraint 1, spread"),
    "a greatest distance": (put(asked(1, "max"), None), "constraint 1, spread"),
    "a stated distance": (row("spread, fingers 0 and 2", "value", a_little), "constraint 1, spread"),
    "a distance left out": (drop("spread, fingers 0 and 2"), "constraint 1, spread"),
    "a forbidden region": (put(asked(3, "region", "offset"), 0.04), "constraint 3, forbid"),
    "a region's direction": (put(asked(3, "region", "normal"), [0.0, 1.0, 0.0]), "constraint 3, forbid"),
    "a region's longer normal": (put(asked(3, "region", "normal"), [0.0, 0.0, 2.0]), "constraint 3, forbid"),
    "a mirror's longer normal": (put(asked(5, "normal"), [1.0 + 1e-6, 0.0, 0.0]), "constraint 5, symmetric"),
    "a distance whose square overflows": (put(asked(1, "max"), 1e200), "constraint 1, spread"),
    "faces forbidden afterwards": (put(asked(2, "faces"), ["+x"]), "faces"),
    "a workspace": (put(asked(4, "region", "upper", 0), 0.05), "constraint 4, workspace"),
    "fingers of a workspace": (put(asked(4, "fingers"), [0, 2]), "constraint 4, workspace"),
    "a mirror plane": (put(asked(5, "offset"), 0.001), "constraint 5, symmetric"),
    "a mirror's tolerance": (put(asked(5, "tolerance"), 1e-2), "constraint 5, symmetric"),
    "an obstacle moved": (put(asked(6, "position", 1), -0.07), "constraint 6, obstacle"),
    "an obstacle grown": (put(asked(6, "body", "radius"), 0.03), "constraint 6, obstacle"),
    "an obstacle's name": (put(asked(6, "name"), "pole"), "constraint 6, obstacle"),
    "limits of an expression": (put(asked(7, "upper"), [0.1]), "constraint 7, expression"),
    "a value of an expression": (row("level", "value", 0.1), "constraint 7, expression"),
    "smaller fingertips": (put(("problem", "hand", "radius"), 0.007), "hand"),
    "a farther reach": (put(("problem", "hand", "reach"), 0.1), "hand"),
    "fingertips farther apart": (put(("problem", "hand", "spread", 1), 0.3), "hand"),
    "the palm elsewhere": (put(("hand", "palm", 2), a_little), "hand"),
    "no palm": (put(("hand",), {}), "hand"),
    "a stated reach": (row("reach, finger 0", "value", a_little), "hand"),
    "a row of the hand left out": (drop("reach, finger 0"), "hand"),
    "nonsense for a radius": (put(("problem", "hand", "radius"), "small"), "problem"),
    "a thousand million fingertips": (put(("problem", "hand", "count"), 10**9), "problem"),
    "nonsense for a height": (put(asked(0, "height"), "low"), "constraint 0, table"),
}
JAWS = {
    "a face the model may not use": (put(("problem", "contacts", 0, "faces"), ["top"]), "faces"),
    "a wider body": (put(("problem", "body", "radius"), 0.031), "surface"),
    "a shorter body": (put(("problem", "body", "height"), 0.01), "surface"),
    "jaws that open less": (put(("problem", "hand", "opening"), 0.05), "hand"),
    "jaws that tilt more": (put(("problem", "hand", "tilt"), 0.1), "hand"),
    "a stated opening": (row("opening of the jaws", "value", a_little), "hand"),
    "a contact around the cylinder": (
        put(contact(0, "position"), [0.03 * np.cos(0.01), 0.03 * np.sin(0.01), 0.01]),
        "normals",
    ),
}
BLOCK = {
    "another unit": (put(("problem", "body", "unit"), "ft"), "surface"),
    "a unit there is not": (put(("problem", "body", "unit"), "parsec"), "surface"),
    "another digest and another unit": (
        put(("problem", "body"), lambda b: {**b, "sha256": "0" * 64, "unit": "ft"}),
        "mesh file",
    ),
    "another digest": (put(("problem", "body", "sha256"), "0" * 64), "mesh file"),
    "a contact off the mesh": (put(contact(0, "position"), [0.0255, 0.00254, 0.00508]), "surface"),
    "a contact past the mesh": (put(contact(0, "position"), [0.0254, 0.00254, 0.0508]), "surface"),
    "the normal of another triangle": (turned(0, [0.0, -1.0, 0.0]), "normals"),
    "a normal between two": (turned(0, [-0.6, -0.8, 0.0]), "normals"),
    "a face there is not": (put(contact(0, "face"), "top"), "surface"),
    "a stated height": (row("table, finger 0", "value", a_little), "constraint 0, table"),
}
FINGERS = {
    "a joint": (
        put(("hand", "joint_positions"), lambda j: {**j, next(iter(j)): next(iter(j.values())) + 1e-3}),
        "hand",
    ),
    "a joint past its limit": (put(("hand", "joint_positions"), lambda j: dict.fromkeys(j, 4.0)), "joints"),
    "a joint left out": (put(("hand", "joint_positions"), lambda j: dict(list(j.items())[1:])), "hand"),
    "the order of the fingertips": (put(("hand", "fingertips"), lambda f: f[::-1]), "joints"),
    "a pregrasp past the joints' limits": (
        put(("hand",), lambda h: {**h, "pregrasp": {**h, "joint_positions": dict.fromkeys(h["joint_positions"], 4.0)}}),
        "joints",
    ),
    "a pregrasp's longer quaternion": (
        put(
            ("hand",),
            lambda h: {
                **h,
                "pregrasp": {**h, "palm_pose": {**h["palm_pose"], "quaternion_wxyz": [2.0, 0.0, 0.0, 0.0]}},
            },
        ),
        "joints",
    ),
    "the palm's position": (put(("hand", "palm_pose", "position", 0), a_little), "hand"),
    "the palm's orientation": (
        put(("hand", "palm_pose", "quaternion_wxyz"), lambda q: np.roll(q, 1).tolist()),
        "hand",
    ),
    "a quaternion that is longer": (
        put(("hand", "palm_pose", "quaternion_wxyz"), lambda q: [1.01 * v for v in q]),
        "hand",
    ),
    "a fingertip's radius": (put(("problem", "hand", "fingertips", 0, "radius"), 0.011), "hand"),
    "a fingertip's place": (put(("problem", "hand", "fingertips", 0, "offset", 0), 0.001), "hand"),
    "a fingertip on another link": (put(("problem", "hand", "fingertips", 0, "link"), "finger_2_tip"), "hand"),
    "a body that is larger": (put(("problem", "body", "radius"), a_little), "surface"),
    "a clearance of which nothing is stated": (put(("problem", "hand", "clearance"), 0.001), "links"),
    "the table's height": (put(asked(0, "height"), 0.0), "constraint 0, table"),
    "the palm's direction": (put(("problem", "hand", "approach"), [1.0, 0.0, 0.0]), "constraint 1, approach"),
    "a longer direction of approach": (put(asked(1, "direction"), [0.0, 0.0, 2.0]), "constraint 1, approach"),
    "a fingertip without length": (
        put(
            ("problem", "hand", "fingertips", 0),
            lambda t: {"type": "cylinder", "link": t["link"], "radius": 0.01, "start": [0.0] * 3, "end": [0.0] * 3},
        ),
        "hand",
    ),
    "a longer direction of the palm": (
        put(("problem", "hand", "approach"), lambda a: [2.0 * v for v in a]),
        "constraint 1, approach",
    ),
    "a quaternion that is a little longer": (
        put(("hand", "palm_pose", "quaternion_wxyz"), lambda q: [(1.0 + 1e-6) * v for v in q]),
        "hand",
    ),
    "the length of the program's quaternion": (row("palm quaternion of unit length", "value", 1.0001), "hand"),
    "the cone of approach": (put(asked(1, "angle"), 1.0), "constraint 1, approach"),
}
PALM, PROXIMAL = "clearance from the body, palm", "clearance from the body, finger_1_proximal"
ABOVE_TABLE, FROM_POST = "table, finger_2_tip", "post, finger_3_proximal"
CLEAR_LINKS = {
    "a link farther from the body": (row(PROXIMAL, "value", lambda v: v + 1e-3), "links"),
    "a link beyond the farthest distance": (row(PALM, "value", 0.06), "links"),
    "a link left out": (drop(PROXIMAL), "links"),
    "a link's lower limit": (row(PROXIMAL, "bound", [1e-3, None]), "links"),
    "a hand with a greater clearance": (put(("problem", "hand", "clearance"), 3e-3), "links"),
    "a greater clearance everywhere": (farther(0.032), "links"),
    "a hand without clearance": (put(("problem", "hand", "clearance"), 0.0), "constraints"),
    "a link below its limit": (row(PROXIMAL, "value", 1.9e-3), "constraints"),
    "a link with a fingertip": (repeat(PROXIMAL, "clearance from the body, finger_1_distal"), "constraints"),
    "a link twice": (repeat(PROXIMAL, PROXIMAL), "constraints"),
    "a part of a link": (repeat(PROXIMAL, f"{PROXIMAL}/0"), "constraints"),
    "a link farther above the table": (row(ABOVE_TABLE, "value", lambda v: v + 1e-3), "links"),
    "a link above the table left out": (drop(ABOVE_TABLE), "links"),
    "a link's lower limit above the table": (row(ABOVE_TABLE, "bound", [2e-3, None]), "links"),
    "a greater clearance above the table": (put(asked(0, "clearance"), 4e-3), "links"),
    "a table nearer to the links": (put(asked(0, "height"), -0.04), "links"),
    "a link twice above the table": (repeat(ABOVE_TABLE, ABOVE_TABLE), "constraints"),
    "a link farther from an obstacle": (row(FROM_POST, "value", lambda v: v + 1e-3), "links"),
    "a link beside an obstacle left out": (drop(FROM_POST), "links"),
    "a link's lower limit from an obstacle": (row(FROM_POST, "bound", [2e-3, None]), "links"),
    "an obstacle nearer to the links": (put(asked(1, "position", 1), -0.065), "links"),
    "an obstacle without clearance": (put(asked(1, "clearance"), 0.0), "constraints"),
    "a link of no hand beside an obstacle": (repeat(FROM_POST, "post, finger_4_proximal"), "constraints"),
}


@pytest.mark.parametrize("name", BOX)
def test_lies_about_a_box(name):
    change, where = BOX[name]
    assert where in failures(edited(honest.box(), change))


@pytest.mark.parametrize("name", JAWS)
def test_lies_about_jaws(name):
    change, where = JAWS[name]
    assert where in failures(edited(honest.jaws(), change))


@pytest.fixture(scope="module")
def block(tmp_path_factory):
    folder = tmp_path_factory.mktemp("block")
    return honest.block(folder), folder


@pytest.mark.parametrize("name", BLOCK)
def test_lies_about_a_mesh(name, block):
    data, folder = block
    change, where = BLOCK[name]
    assert where in failures(edited(data, change), folder)


@pytest.mark.usefixtures("without_link_checks")
@pytest.mark.parametrize("name", FINGERS)
def test_lies_about_a_posed_hand(name):
    change, where = FINGERS[name]
    assert where in failures(edited(honest.fingers(), change), FOLDER)


@pytest.mark.usefixtures("without_link_checks")
@pytest.mark.parametrize("name", CLEAR_LINKS)
def test_lies_about_links_that_keep_a_clearance(name):
    change, where = CLEAR_LINKS[name]
    assert where in failures(edited(honest.clear_fingers(), change), FOLDER)


@pytest.mark.usefixtures("without_link_checks")
def test_a_link_may_be_stated_nearer_or_farther_within_a_measurement():
    # by MuJoCo 0.03096, 0.01388 and 0.01294
    for name, values in {PROXIMAL: (2.1e-3, 0.0311), ABOVE_TABLE: (3.1e-3, 0.014), FROM_POST: (3.1e-3, 0.0131)}.items():
        for value in values:
            assert failures(edited(honest.clear_fingers(), row(name, "value", value)), FOLDER) == []


@pytest.mark.parametrize(
    "body",
    [
        {"type": "polygon", "vertices": [[0.0, 0.0], [0.0, 1.0], [1.0, 0.0]]},
        {"type": "polygon", "vertices": [[0.0, 0.0], [1.0, 0.0], [2.0, 0.0]]},
        {"type": "prism", "polygon": [[0.0, 0.0], [0.0, 1.0], [1.0, 0.0]], "height": 1.0},
        {"type": "polygon", "vertices": [[0.0, 0.0], [2.0, 2.0], [2.0, 0.0], [0.0, 3.0]]},
        {"type": "prism", "polygon": [[0.0, 0.0], [2.0, 2.0], [2.0, 0.0], [0.0, 3.0]], "height": 1.0},
        {"type": "torus", "major_radius": 0.1, "minor_radius": 0.1},
        {"type": "ellipsoid", "semi_axes": [1.0, -1.0, 1.0]},
        {"type": "superquadric", "semi_axes": [1.0, 0.0, 1.0], "exponents": [1.0, 1.0]},
        {"type": "superquadric", "semi_axes": [1.0, 1.0, 1.0], "exponents": [-1.0, 1.0]},
    ],
)
def test_bodies_that_are_none_have_no_numbers(body):
    with pytest.raises(ng.InputError, match=r"above zero|counter-clockwise|do not cross|less than"):
        BODIES.of(body)(body, SourceFolders(()))


def test_the_honest_files_pass_and_everything_is_made_but_the_expression(block):
    checks = recomputed_file(honest.box())
    assert [n for n, c in checks.items() if not c.passed] == ["constraint 7, expression"]
    assert not checks["constraint 7, expression"].made
    for data, *folders in ((honest.jaws(),), block, (honest.fingers(), FOLDER), (honest.clear_fingers(), FOLDER)):
        assert {n: str(c) for n, c in recomputed_file(data, *folders).items() if not c.passed} == {}


@pytest.mark.usefixtures("without_link_checks")
def test_a_row_that_a_longer_quaternion_explains_is_no_lie():
    """The program's quaternion had a length within its tolerance; the file states it at length 1."""
    data = honest.fingers()
    exact = recomputed_file(data, FOLDER)["links"]
    assert exact.passed

    def lengthen(d):
        row("palm quaternion of unit length", "value", 1.0 + 8e-6)(d)
        row("on fingertip finger_1_tip, finger 0, x", "value", lambda v: v + 3e-7)(d)

    assert failures(edited(data, lengthen), FOLDER) == []

    def only_the_row(d):
        row("on fingertip finger_1_tip, finger 0, x", "value", lambda v: v + 3e-7)(d)

    assert failures(edited(data, only_the_row), FOLDER) == ["hand"]


def test_a_row_that_a_large_body_leaves_within_its_promise_is_no_lie():
    """Limits are kept to a share of the body's size: here 7.2e-6 m of the 1.2 m of a long box, past 1e-6 m."""
    body = ng.Box([1.2, 0.4, 0.4])
    problem = problem_of(body, 2, constraints=[ng.Table(0.0, clearance=0.0)])
    normals = [[-1.0, 0.0, 0.0], [1.0, 0.0, 0.0]]

    def lowest(z):
        return failures(stated_file(problem, ["+x", "-x"], [[0.6, 0.0, -z], [-0.6, 0.0, 0.01]], normals))

    assert lowest(6e-6) == []
    assert lowest(3e-5) == ["constraint 0, table", "constraints"]


def test_a_check_that_was_not_made_neither_passes_nor_fails():
    check = Check.not_made("surface", "part.stl is not there")
    assert (check.made, check.passed, check.failed) == (False, False, False)
    assert str(check) == "--   surface: not made: part.stl is not there"
    good, bad = Check("interval", True, "fine"), Check("interval", False, "empty")
    assert Verification((good, check), None)
    assert Verification((good, check), None).not_made == (check,)
    assert not Verification((check, bad), None)
    assert str(Verification((good, bad), None)) == (
        "ok   interval: fine\nFAIL interval: empty\nNOT verified: 1 of 2 checks failed (interval)"
    )


def test_regions_of_a_script_have_limits_alone(rng):
    """Two constraints may give rows of one name: each meets its own, in the order of the problem."""
    constraints = [
        ng.Forbid(lambda p: p[2] - 0.05),
        ng.Forbid(lambda p: p[2] - 0.07),
        ng.Workspace(lambda p: p[2] + 0.05),
    ]
    body = ng.Box([0.08, 0.04, 0.06])
    problem = problem_of(body, 2, constraints=constraints)
    data = stated_file(problem, ["+x", "-x"], *contacts_on(body, ["+x", "-x"], rng))
    checks = recomputed_file(data)
    names = ["constraint 0, forbid", "constraint 1, forbid", "constraint 2, workspace"]
    assert [n for n, c in checks.items() if not c.made] == names
    assert not any(c.failed for c in checks.values())
    bound = edited(data, row("forbidden region, finger 0", "bound", [None, 0.01]))
    assert failures(bound) == ["constraint 0, forbid"]
    value = edited(data, row("workspace, finger 1", "value", -0.01))
    assert failures(value) == ["constraint 2, workspace", "constraints"]
    assert failures(edited(data, drop("workspace, finger 1"))) == ["constraint 2, workspace"]


def expressions(*constraints):
    """Return a file of these, none of which can be recomputed."""
    problem = problem_of(ng.Box([0.08, 0.04, 0.06]), 2, constraints=constraints)
    points, normals = [[0.04, 0.0, 0.0], [-0.04, 0.0, 0.0]], [[-1.0, 0.0, 0.0], [1.0, 0.0, 0.0]]
    return stated_file(problem, ["+x", "-x"], points, normals)


def test_limits_of_an_expression_say_how_many_rows_there_are():
    data = expressions(ng.Constraint("low", lambda p, n: p[0], [-1.0] * 3, 1.0))
    assert failures(data) == []
    assert failures(edited(data, drop("low[2]"))) == ["constraint 0, expression"]
    assert failures(edited(data, drop("low[0]"))) == ["constraint 0, expression"]


def test_two_expressions_of_one_name():
    """Several limits tell which rows are whose; one does not."""
    three = ng.Constraint("low", lambda p, n: p[0], [-1.0] * 3, 1.0)
    one = ng.Constraint("low", lambda p, n: p[0][2], -2.0, 1.0)
    for data in (expressions(three, one), expressions(three, three), expressions(one, one)):
        assert failures(data) == []
    data = expressions(one, three)
    assert failures(data) == []
    assert "constraint 1, expression" in failures(edited(data, drop("low[2]")))
    assert failures(expressions(one, ng.Constraint("low", lambda p, n: p[0], -1.0, 1.0))) == []


def test_a_row_on_its_limit_is_active():
    body = ng.Box([0.08, 0.04, 0.06])
    points, normals = [[0.04, 0.0, 0.0], [-0.04, 0.0, 0.01]], [[-1.0, 0.0, 0.0], [1.0, 0.0, 0.0]]
    data = stated_file(problem_of(body, 2, constraints=[ng.Table(0.0, clearance=0.0)]), ["+x", "-x"], points, normals)
    assert failures(data) == []
    assert failures(edited(data, row("table, finger 0", "active", False))) == ["constraint 0, table"]
