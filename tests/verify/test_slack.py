"""Independence of the tolerances from unverified data of a file."""

import pytest

import nlpgrasp as ng
from tests.hands.urdf import FOLDER
from tests.verify import honest
from tests.verify.edits import a_little, contact, failures, put, row, together
from tests.verify.stated import edited, problem_of, recomputed_file, stated_file

LARGER = {
    "surface": put(contact(0, "position"), [0.0401, 0.004, 0.01]),
    "constraint 0, table": row("table, finger 1", "value", a_little),
    "constraint 1, spread": row("spread, fingers 0 and 2", "value", a_little),
    "constraint 6, obstacle": row("post, finger 0", "value", a_little),
    "hand": row("reach, finger 0", "value", a_little),
}


@pytest.mark.parametrize("where", LARGER)
def test_a_body_that_is_larger_where_nothing_touches_it(where):
    taller = put(("problem", "body", "extents", 2), 1e6)
    assert where in failures(edited(honest.box(), together(taller, LARGER[where])))


def test_a_box_around_a_function_that_is_larger():
    body = ng.Implicit(lambda p: p[0] ** 2 + p[1] ** 2 + p[2] ** 2 - 0.04**2, [[-0.05] * 3, [0.05] * 3])
    problem = problem_of(body, 2, constraints=[ng.Table(-0.05)])
    points, normals = [[0.04, 0.0, 0.0], [-0.04, 0.0, 0.0]], [[-1.0, 0.0, 0.0], [1.0, 0.0, 0.0]]
    data = stated_file(problem, ["surface"] * 2, points, normals)
    larger = put(("problem", "body", "bounds"), [[-1e6] * 3, [1e6] * 3])
    assert failures(edited(data, larger)) == []
    lie = together(larger, row("table, finger 1", "value", a_little))
    assert failures(edited(data, lie)) == ["constraint 0, table"]


@pytest.mark.usefixtures("without_link_checks")
@pytest.mark.parametrize(
    ("where", "name", "excess"),
    [
        ("hand", "on fingertip finger_1_tip, finger 0, x", 1e-4),
        ("links", "table, finger_1_tip", 4e-4),
        ("links", "clearance from the body, finger_1_proximal", 4e-4),
    ],
)
def test_a_fingertip_far_off_its_link_lends_no_slack_to_others(where, name, excess):
    """The error bound of a quaternion within its tolerance grows with the hand, as far as its frames reach."""
    lie = together(
        put(("problem", "hand", "fingertips", 1, "offset", 0), 1e6),
        row("palm quaternion of unit length", "value", 1.0 + 9e-6),
        row(name, "value", lambda v: v + excess),
    )
    assert f"{name}: stated" in recomputed_file(edited(honest.clear_fingers(), lie), FOLDER)[where].detail


@pytest.mark.filterwarnings("ignore:constraints.0.. height")
def test_a_limit_that_is_large_lends_no_slack():
    """A stated value past its limit is a lie, however large the limit."""
    body = ng.Box([0.08, 0.04, 0.06])
    points, normals = [[0.04, 0.0, 0.0], [-0.04, 0.0, 0.0]], [[-1.0, 0.0, 0.0], [1.0, 0.0, 0.0]]
    data = stated_file(problem_of(body, 2, constraints=[ng.Table(-1000.0)]), ["+x", "-x"], points, normals)
    assert failures(edited(data, row("table, finger 0", "value", -1000.05))) == ["constraint 0, table", "constraints"]
