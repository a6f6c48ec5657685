"""Poses of a gripper at sampled pairs: the direction of its pads, and why it does not hold a part."""

import re

import numpy as np
import pytest
import trimesh

import nlpgrasp as ng
from nlpgrasp.analysis.jaw_diagnosis import jaw_reasons, sampled_antipodal_pairs, with_usable_pads
from nlpgrasp.motion.jaw_clearance import JawClearance

BLOCK = ng.Box([0.06, 0.04, 0.03])
TASK = ng.lift([0.0, 0.0, 0.0], 0.5) + ng.disturbance(1.0, 0.01)


def problem(part=BLOCK, table=0.001, **sizes):
    gripper = ng.ParallelJaw(
        **{"stroke": 0.11, "pad": (0.02, 0.012), "finger": (0.06, 0.012, 0.014), "max_force": 120.0, **sizes}
    )
    tables = [ng.Table.under(part, table)]
    return ng.GraspProblem(part, ng.SoftContact(0.6, 0.005), TASK, hand=gripper, constraints=tables)


def test_pairs_are_straight_across_the_part():
    pairs = sampled_antipodal_pairs(problem())
    openings = np.linalg.norm(pairs[:, 1] - pairs[:, 0], axis=1)
    assert len(pairs) > 1900
    assert np.unique(openings.round(6)).tolist() == [0.03, 0.04, 0.06]


def test_pairs_of_a_tube_are_across_its_wall_and_across_its_bore():
    tube = ng.Mesh(trimesh.creation.annulus(0.012, 0.016, 0.08, sections=32))
    pairs = sampled_antipodal_pairs(problem(tube))
    openings = np.unique(np.linalg.norm(pairs[:, 1] - pairs[:, 0], axis=1).round(3))
    assert openings.tolist() == [0.004, 0.032, 0.08]


@pytest.mark.parametrize("stroke", [0.045, 0.11])
def test_a_part_that_fits_has_no_reason(stroke):
    assert jaw_reasons(problem(stroke=stroke, finger=(0.06, 0.004, 0.014), pad=(0.012, 0.01), table=0.0)) == ()


def test_a_stroke_smaller_than_the_part_names_the_least_opening():
    assert jaw_reasons(problem(stroke=0.025)) == (
        "The part needs an opening of at least 30 mm, and the jaws open to 25 mm.",
    )
    (reason,) = jaw_reasons(problem(ng.Sphere(0.06)))
    assert reason.startswith("The part needs an opening of at least 119 mm")  # of its triangles


@pytest.mark.slow
def test_a_pad_larger_than_every_face_names_the_share_that_finds_room():
    """On the largest face, 60 x 40 mm, 40 of the pad's 45 mm."""
    assert jaw_reasons(problem(pad=(0.05, 0.045))) == (
        "No face has room for a pad of 50 x 45 mm: at most 89 % of it is on one.",
    )


@pytest.mark.slow
def test_a_part_that_fits_only_with_the_table_lowered():
    """A plate of 8 mm: a finger below it is 12 mm thick, opens by 2 mm, and keeps a millimetre off the table."""
    plate = ng.Box([0.06, 0.04, 0.008])
    assert jaw_reasons(problem(plate)) == (
        "The gripper fits only with the table 15 mm lower, or with the part raised by as much.",
    )
    lower = problem(plate)
    lowered = ng.GraspProblem(
        plate, lower.models, TASK, hand=lower.hand, constraints=[ng.Table(-0.004 - 0.0151, clearance=0.001)]
    )
    assert jaw_reasons(lowered) == ()


@pytest.mark.slow
def test_what_lowering_the_table_takes_is_said_where_other_poses_are_less_deep_in_body_and_table():
    """The jaws fit over a disc's flat sides: the palm runs into the rim, or the finger below into the table."""
    disc = ng.Cylinder(0.05, 0.03)
    on_table = problem(disc, stroke=0.04, finger=(0.015, 0.012, 0.014), palm_size=(0.1, 0.1, 0.1))
    (reason,) = jaw_reasons(on_table)
    lower = float(re.fullmatch(r"The gripper fits only with the table (\S+) mm lower, or .*", reason)[1])
    for more, reasons in ((0.2, 0), (-0.5, 1)):
        table = ng.Table(-0.015 - 1e-3 * (lower + more), clearance=0.001)
        moved = ng.GraspProblem(disc, on_table.models, TASK, hand=on_table.hand, constraints=[table])
        assert len(jaw_reasons(moved)) == reasons


@pytest.mark.slow
def test_a_disc_that_fingers_are_too_short_for():
    disc = ng.Cylinder(0.05, 0.03)
    (reason,) = jaw_reasons(
        problem(disc, stroke=0.04, pad=(0.001, 0.012), finger=(0.0005, 0.012, 0.014), palm_size=(0.1, 0.1, 0.1))
    )
    assert reason.startswith("In every sampled pose with the pads on faces the gripper runs into the body")


@pytest.mark.slow
def test_the_answer_of_a_solve_says_it():
    options = ng.SolveOptions(workers=1, rounds=3, global_bound=False)
    solution = ng.solve(problem(stroke=0.025), starts=1, options=options)
    assert solution.status is ng.Status.LOCALLY_INFEASIBLE
    assert str(solution.why_not) == "The part needs an opening of at least 30 mm, and the jaws open to 25 mm."
    assert str(solution.why_not) in str(solution)


def test_no_reason_without_jaws():
    free = ng.GraspProblem(BLOCK, [ng.FrictionContact(0.5)] * 3, TASK)
    assert jaw_reasons(free) == ()


def t_handle():
    """Return a square bar of 16 mm on a stem: no face beside the bar is as high as a pad of 20 mm is long."""
    bar, stem = trimesh.creation.box([0.09, 0.016, 0.016]), trimesh.creation.box([0.012, 0.012, 0.07])
    return ng.Mesh(trimesh.boolean.union([bar.apply_translation([0.0, 0.0, 0.043]), stem]))


def test_pads_that_no_grasp_from_above_has_on_faces_are_turned_to_a_usable_approach():
    handle = t_handle()
    gripper = ng.ParallelJaw(stroke=0.11, pad=(0.02, 0.012), finger=(0.06, 0.012, 0.014))
    task = ng.lift(handle.centroid, 0.5)
    default = ng.GraspProblem(handle, task=task, hand=gripper, constraints=[ng.Table.under(handle, 0.001)])
    with pytest.warns(UserWarning, match=r"the pads are along the approach \[-?1, 0, 0\] instead"):
        turned = with_usable_pads(default)
    clearance = JawClearance(gripper, handle, turned.constraints, turned.models)
    pairs = sampled_antipodal_pairs(turned)
    across = np.abs(pairs[:, 1] - pairs[:, 0])
    pairs = pairs[(across[:, 1] > 0.0159) & (across[:, 0] < 1e-6)][:100]
    shares = [clearance.pad_shares(p, clearance.directions(p, turned.models)).min() for p in pairs]
    assert max(shares) == pytest.approx(1.0)
    stated = ng.Approach([0, 0, -1], 0.1)
    kept = ng.GraspProblem(handle, task=task, hand=gripper, constraints=[*default.constraints, stated])
    assert with_usable_pads(kept) is kept
    assert with_usable_pads(turned) is turned


def test_pads_that_a_grasp_from_above_has_on_faces_stay():
    gripper = ng.ParallelJaw(stroke=0.11, pad=(0.02, 0.012), finger=(0.06, 0.012, 0.014))
    default = ng.GraspProblem(BLOCK, task=TASK, hand=gripper, constraints=[ng.Table.under(BLOCK, 0.001)])
    assert with_usable_pads(default) is default


def test_pads_that_have_room_above_and_below_alone_lie_across_and_the_table_is_named():
    """The only faces of a thin plate with room for pads are horizontal; the lower one is on the table."""
    plate = ng.Mesh(trimesh.creation.box([0.06, 0.06, 0.006]))
    gripper = ng.ParallelJaw(stroke=0.085, pad=(0.03, 0.02), finger=(0.06, 0.03, 0.03))
    table = ng.Table.under(plate, 0.001)
    default = ng.GraspProblem(plate, task=TASK, hand=gripper, constraints=[table], force_budget="shared")
    with pytest.warns(UserWarning, match="the pads are along the approach"):
        turned = with_usable_pads(default)
    assert abs(turned.models[0].direction[2]) < 1e-9
    (reason,) = jaw_reasons(turned)
    assert re.search(r"^The gripper fits only with the table [0-9.]+ mm lower", reason)


def test_pads_along_the_normal_of_every_face_are_refused():
    pad = ng.PlaneContact(extents=(0.02, 0.012), friction=0.5, direction=(0.0, 0.0, 1.0), faces=("+z", "-z"))
    problem = ng.GraspProblem(BLOCK, [pad, pad], TASK)
    with pytest.raises(ng.InputError, match=r"their direction: got \[0, 0, 1\], the normal of \+z, -z, expected a dir"):
        ng.solve(problem, starts=1, options=ng.SolveOptions(workers=1, global_bound=False))


QUICK = ng.SolveOptions(workers=1, global_bound=False)


@pytest.mark.slow
@pytest.mark.parametrize(("part", "pad"), [(ng.Box([0.03] * 3), (0.0375, 0.022)), (BLOCK, (0.08, 0.012))])
def test_a_part_smaller_than_the_pad_is_held_by_what_of_the_pad_is_on_it(part, pad):
    """The contacts are rectangles of the pad on the face, and the force is enough for that of the whole overlap."""
    gripper = ng.ParallelJaw(stroke=0.11, pad=pad, finger=(0.06, 0.012, pad[1] + 0.002))
    task = ng.lift(part.centroid, 0.1) + ng.disturbance(0.5, 0.01, part.centroid)
    with pytest.warns(UserWarning, match=r"whole pads, [0-9.]+ x [0-9.]+ mm, on faces; the contacts are [0-9.]+ x"):
        solution = ng.solve(ng.GraspProblem(part, task=task, hand=gripper), starts=1, options=QUICK)
    grasp, overlaps = solution.grasp, []
    for point, normal, (first, second), model in zip(
        grasp.points, grasp.normals, grasp.tangents, grasp.contacts, strict=True
    ):
        assert all(side <= whole for side, whole in zip(model.extents, pad, strict=True))
        others = np.abs(normal) < 0.5
        assert overhang(part, point, first, second, model.extents, others) < 0.11
        overlaps += [(corner, normal) for corner in overlap(part, point, first, second, pad, others)]
    points, normals = map(np.array, zip(*overlaps, strict=True))
    whole = ng.mu(ng.Grasp(points, normals, ng.FrictionContact(0.5), grasp.torque_origin), task, force_budget="shared")
    assert 0.5 / whole.upper <= solution.grip_force <= 1.4 * 0.5 / whole.lower
    assert ng.verify(solution).passed, [str(c) for c in ng.verify(solution).checks if c.failed]


def sides(part, point, first, second, extents, others):
    """Return the lower and upper corner of a rectangle about a contact along the part's axes, and the part's halves."""
    reach = 0.5 * (np.abs(first) * extents[0] + np.abs(second) * extents[1])
    return (point - reach)[others], (point + reach)[others], 0.5 * np.asarray(part.extents)[others]


def overhang(part, *rectangle):
    """Return the share of a rectangle that is beyond its face of a box."""
    low, high, half = sides(part, *rectangle)
    return 1.0 - np.prod(np.minimum(high, half) - np.maximum(low, -half)) / np.prod(high - low)


def overlap(part, point, *rectangle):
    """Return the four corners (4, 3) of what of a rectangle is on its face of a box."""
    low, high, half = sides(part, point, *rectangle)
    others, corners = rectangle[-1], np.tile(point, (4, 1))
    (a, c), (b, d) = np.maximum(low, -half), np.minimum(high, half)
    corners[:, others] = [[a, c], [a, d], [b, c], [b, d]]
    return corners


@pytest.mark.slow
def test_a_force_is_stated_only_for_a_contact_that_exists():
    """Of a pad of 37.5 x 22 mm, less than half is on a bar of 26 mm radius: there the contact is a line."""
    bar, gripper = ng.Cylinder(0.026, 0.2), ng.hands.jaws("2f-85")
    task = ng.lift(bar.centroid, 0.1) + ng.disturbance(0.5, 0.01, bar.centroid)
    solution = ng.solve(ng.GraspProblem(bar, task=task, hand=gripper), starts=1, options=QUICK)
    assert max(solution.hand["pads"]) < 0.5
    assert solution.grip_force is None or not np.isfinite(solution.grip_force)
    assert re.search(r"no grip force is stated: 4\d % of a plane or line contact is on the face", solution.grip_line())
    assert ng.verify(solution).passed, [str(c) for c in ng.verify(solution).checks if c.failed]
    force = {"lower": 2.0, "upper": 2.01}
    for lie in ({}, {"pads": [0.95, 0.95]}):
        data = solution.to_dict()
        grip = {key: value for key, value in data["hand"]["grip"].items() if key != "pad_share"}
        data["hand"] = {**data["hand"], **lie, "grip": {**grip, "force": force, "with_margin": force}}
        failed = {check.name for check in ng.verify(ng.GraspSolution.from_dict(data)).checks if not check.passed}
        assert failed & {"grip force", "pads"}


ALONG, ACROSS = (0.0, 0.0, 1.0), (1.0, 1.0, 0.0)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("contact", "gripper", "is_held"),
    [
        (ng.PlaneContact(extents=(0.0375, 0.022), friction=0.5, direction=ALONG), ng.ParallelJaw(0.11), False),
        (ng.LineContact(0.0375, friction=0.5, direction=ACROSS), ng.ParallelJaw(0.11), False),
        (ng.LineContact(0.0375, friction=0.5, direction=ACROSS), ng.hands.jaws("2f-85"), False),
        (ng.PlaneContact(radius=0.018, friction=0.5), ng.hands.jaws("2f-85"), False),
        (ng.LineContact(0.0375, friction=0.5, direction=ALONG), ng.hands.jaws("2f-85"), True),
    ],
)
def test_plane_and_line_contacts_exist_whatever_the_gripper_states(contact, gripper, is_held):
    """On a bar of 26 mm radius only a line along it does; the share is measured without pads or fingers too."""
    bar = ng.Cylinder(0.026, 0.2)
    task = ng.lift(bar.centroid, 0.1) + ng.disturbance(0.5, 0.01, bar.centroid)
    solution = ng.solve(ng.GraspProblem(bar, [contact] * 2, task, hand=gripper), starts=1, options=QUICK)
    assert (min(solution.hand["pads"]) > 0.99) == is_held == bool(np.isfinite(solution.grip_force))
    assert is_held == ("plane or line contact is on the face" not in solution.told)
    verification = ng.verify(solution)
    assert verification.passed
    assert is_held == ("the quality too is of the whole contact" not in verification.verdict)
    data = solution.to_dict()
    data["hand"] = {**data["hand"], "pads": [0.5, 0.5] if is_held else [1.0, 1.0]}
    assert not ng.verify(ng.GraspSolution.from_dict(data)).passed


@pytest.mark.slow
def test_contacts_of_other_hands_are_said_not_to_be_checked_on_their_faces():
    """Without a gripper nothing says whether a pad is on its face: on a ball it is not."""
    ball = ng.Sphere(0.03)
    task = ng.disturbance(0.5, 0.01, ball.centroid)
    for contact, is_said in ((ng.PlaneContact(radius=0.01, friction=0.5), True), (ng.SoftContact(0.5, 0.005), False)):
        solution = ng.solve(ng.GraspProblem(ball, [contact] * 3, task), starts=1, options=QUICK)
        assert solution.success
        for text in (solution.told, ng.verify(solution).verdict):
            assert ("not checked that plane and line contacts are whole" in text) == is_said


@pytest.mark.slow
def test_a_pad_is_not_the_reason_where_a_torque_is():
    """Two hard contacts exert no torque about the line between them, on whatever faces the pads are."""
    part = ng.Box([0.03] * 3)
    task = ng.lift(part.centroid, 0.1) + ng.disturbance(0.5, 0.01, part.centroid)
    gripper = ng.hands.jaws("2f-85")
    for contact, is_held in ((ng.FrictionContact(0.5), False), (ng.SoftContact(0.5, 0.005), True)):
        solution = ng.solve(ng.GraspProblem(part, [contact] * 2, task, hand=gripper), starts=1, options=QUICK)
        assert solution.success == is_held
        if not is_held:
            assert "a torque about" in str(solution.why_not)
            assert "pad" not in str(solution.why_not)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("part", "contacts", "pad", "words"),
    [
        (
            BLOCK,
            [ng.SoftContact(0.5, 0.005)] * 2,
            (0.05, 0.045),
            "no face has room for a pad of 50 x 45 mm: at most 89 % of it is on one",
        ),
        (ng.Box([0.06, 0.04, 0.006]), (), (0.02, 0.012), "the gripper fits only with the table [0-9.]+ mm lower"),
    ],
)
def test_an_answer_that_cannot_be_used_says_why_no_other_can(part, contacts, pad, words):
    gripper = ng.ParallelJaw(stroke=0.11, pad=pad, finger=(0.06, 0.012, pad[1]), palm_size=(0.14, 0.06, 0.08))
    tables = [ng.Table.under(part, 0.001)]
    problem = ng.GraspProblem(part, contacts, TASK, hand=gripper, constraints=tables, force_budget="shared")
    solution = ng.solve(problem, starts=1, options=ng.SolveOptions(workers=1, global_bound=False))
    assert re.search(words, solution.told)
    assert ng.verify(solution).passed, [str(c) for c in ng.verify(solution).checks if c.failed]
    read = ng.GraspSolution.from_dict(solution.to_dict())
    assert read.told == solution.told


@pytest.mark.slow
def test_kept_grasps_of_a_bar_from_its_side_are_free_before_blocked_ones():
    handle = t_handle()
    gripper = ng.ParallelJaw(stroke=0.11, pad=(0.02, 0.012), finger=(0.06, 0.012, 0.014), palm_size=(0.14, 0.06, 0.08))
    problem = ng.GraspProblem(
        handle,
        task=ng.lift(handle.centroid, 0.5),
        hand=gripper,
        constraints=[ng.Table.under(handle, 0.001)],
        force_budget="shared",
    )
    with pytest.warns(UserWarning, match="instead, as by ng.Approach"):
        solution = ng.solve(problem, starts=2, keep=4, options=ng.SolveOptions(workers=1, global_bound=False))
    assert [grasp.has_free_way for grasp in solution.grasps] == [True] * 4
    assert ng.verify(solution).passed, [str(c) for c in ng.verify(solution).checks if c.failed]
