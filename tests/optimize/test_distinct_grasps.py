"""Distinct grasps of one solve: certificates, order, files, exports, verification of edited files."""

import csv
import io
import json
from dataclasses import replace
from itertools import combinations, permutations, product

import numpy as np
import pytest

import nlpgrasp as ng
from nlpgrasp.interop import read_contacts_csv
from nlpgrasp.interop.base import ReadOptions
from nlpgrasp.interop.registry import format_named, reader_of
from nlpgrasp.solution.solution import GraspSolution
from tests.once import solve_once
from tests.quick import every
from tests.verify.edits import put
from tests.verify.stated import edited

TASK = ng.TaskEllipsoid([1.0, 1.0, 1.0, 0.03, 0.03, 0.03])
STARTS, KEEP, DISTINCT = 2, 5, 0.2
OPTIONS = ng.SolveOptions(workers=1, global_bound=False, analyses=("prices", "delta"))


@pytest.fixture(scope="module")
def problem():
    return ng.GraspProblem(ng.Box([0.08, 0.05, 0.03]), [ng.FrictionContact(0.6)] * 4, TASK, name="box")


@pytest.fixture(scope="module")
def solution(problem):
    return solve_once(problem, STARTS, OPTIONS, keep=KEEP, distinct=DISTINCT)


@pytest.fixture(scope="module")
def data(solution):
    return json.loads(json.dumps(solution.to_dict()))


def test_as_many_are_kept_as_asked_for_and_the_first_is_the_answer(solution):
    assert len(solution.grasps) == KEEP
    first = solution.grasps[0]
    assert first.grasp is solution.grasp
    assert (first.faces, first.mu.lower, first.robust) == (solution.faces, solution.mu.lower, solution.robust)
    assert first.start == solution.best_start


def test_each_is_certified_sound_ones_first(solution):
    others = solution.grasps[1:]
    assert [f.is_fragile for f in others] == sorted(f.is_fragile for f in others)
    for fragile in (False, True):
        lower = [f.mu.lower for f in others if f.is_fragile is fragile]
        assert lower == sorted(lower, reverse=True)
    best = max(grasp.mu.lower for grasp in solution.grasps)
    for grasp in solution.grasps:
        again = ng.mu(grasp.grasp, TASK, seed=5)
        assert grasp.mu.lower <= again.upper
        assert again.lower <= grasp.mu.upper
        assert grasp.robust.mu.lower <= grasp.mu.upper
        assert grasp.needed.budget.upper == pytest.approx(1.0 / grasp.mu.lower)
        assert grasp.start is not None or grasp.mu.lower >= 0.5 * best


def test_they_are_apart_in_every_order_and_mirror(solution, problem):
    mirrors = [np.diag(signs) for signs in product((1.0, -1.0), repeat=3)]
    for a, b in combinations(solution.grasps, 2):
        p, q = a.grasp.points, b.grasp.points
        for R, order in product(mirrors, permutations(range(4))):
            assert np.max(np.linalg.norm(p @ R - q[list(order)], axis=1)) > DISTINCT * problem.body.size


@pytest.mark.slow
def test_a_solve_that_keeps_one_finds_the_same_answer(solution, problem):
    single = ng.solve(problem, starts=STARTS, options=OPTIONS)
    assert len(single.grasps) == 1
    assert "grasps" not in single.to_dict()
    assert np.array_equal(single.grasp.points, solution.grasp.points)


@pytest.mark.slow
def test_a_file_holds_all_of_them(solution, data, tmp_path):
    path = solution.save(tmp_path / "many.json")
    assert GraspSolution.load(path).to_dict() == data
    assert path.stat().st_size < 2e6 / 20 * KEEP
    assert ng.verify(path)


@pytest.mark.slow
def test_a_task_of_another_scale_round_trips():
    task = ng.TaskEllipsoid.from_quadratic(np.eye(3), np.zeros(3), 2.0)
    square = ng.GraspProblem(ng.Polygon([[-1, -1], [1, -1], [1, 1], [-1, 1]]), [ng.FrictionContact(0.5)] * 2, task)
    solution = ng.solve(square, starts=2, options=ng.SolveOptions(workers=1), keep=3)
    stated = json.loads(json.dumps(solution.to_dict()))
    assert task.paper_beta != 1.0
    assert GraspSolution.from_dict(stated).to_dict() == stated
    assert ng.verify(GraspSolution.from_dict(stated))


@pytest.mark.slow
def test_a_file_with_fewer_passes(data):
    assert ng.verify(GraspSolution.from_dict({**data, "grasps": data["grasps"][:3]}))


def grasp_path(i, *keys):
    return ["grasps", i, *keys]


EDITS = {
    "the first": put(grasp_path(0, "quality", "mu", "lower"), lambda v: 0.99 * v),
    "position along the face": put(grasp_path(1, "grasp", "contacts", 0, "position"), lambda p: [v + 1e-3 for v in p]),
    "friction": put(grasp_path(2, "grasp", "contacts", 1, "friction"), 0.9),
    "face": put(grasp_path(1, "grasp", "contacts", 0, "face"), "lid"),
    "mu": put(grasp_path(2, "quality", "mu", "lower"), lambda v: 1.05 * v),
    "what is left": put(grasp_path(1, "quality", "robust", "share"), 0.9),
    "forces": put(grasp_path(1, "forces", 0, "forces", 0), [1.0, 2.0, 3.0]),
    "forces needed": put(grasp_path(2, "quality", "forces_needed", "total"), 1.0),
    "twice the same": lambda d: d["grasps"].__setitem__(2, d["grasps"][1]),
    "an edge margin": put(grasp_path(2, "constraints", 0, "value"), 0.005),
    "another start": put(grasp_path(1, "start"), 99),
    "fewer were asked for": put(["solver", "keep"], 2),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", every(4, EDITS))
def test_an_edit_of_a_grasp_kept_is_seen(name, data):
    first_three = {**data, "grasps": data["grasps"][:3]}
    changed = edited(first_three, EDITS[name])
    assert changed != first_three
    try:
        assert not ng.verify(GraspSolution.from_dict(changed))
    except ng.InputError as error:
        assert "grasps" in str(error)  # noqa: PT017


def test_one_is_selected_as_a_solution_of_its_own(solution):
    top = solution.grasps[3]
    chosen = solution.select(lambda grasp: grasp.mu.upper <= top.mu.upper)
    assert chosen.grasp is not solution.grasp
    assert chosen.mu.upper <= top.mu.upper
    assert len(chosen.grasps) == 1
    assert chosen.best_start == chosen.grasps[0].start
    assert ng.verify(chosen)
    analysed = ng.analyse(chosen, "delta")
    assert analysed.delta.lower > 0.0


def test_the_answer_selected_keeps_all_that_is_known_of_it(solution):
    chosen = solution.select(lambda grasp: True)
    assert (chosen.delta, chosen.prices, chosen.others) == (solution.delta, solution.prices, ())


def fails(grasp):
    raise RuntimeError("the arm is not connected")


@pytest.mark.parametrize(
    ("accepts", "message"),
    [
        (lambda grasp: False, "select: got a function that is true for none of 5 grasps"),
        (fails, "select, at grasps[0]: got RuntimeError: the arm is not connected"),
        (lambda grasp: None, "select, at grasps[0]: got None, expected True or False"),
        (lambda grasp: 1, "select, at grasps[0]: got 1, expected True or False"),
        ("reachable", "select: got reachable, expected a function"),
    ],
)
def test_a_select_that_cannot_be_used_says_so(solution, accepts, message):
    with pytest.raises(ng.InputError) as caught:
        solution.select(accepts)
    assert str(caught.value).startswith(message)


@pytest.mark.parametrize("keep", [0, -1, 2.5, True, "all"])
def test_keep_is_a_number_of_grasps(problem, keep):
    with pytest.raises(ng.InputError, match=r"keep: got .*, expected a whole number from 1"):
        ng.solve(problem, keep=keep)


@pytest.mark.parametrize("distinct", [0.0, -0.1, 1.5, "far"])
def test_distinct_is_a_share(problem, distinct):
    with pytest.raises(ng.InputError, match="distinct"):
        ng.solve(problem, keep=2, distinct=distinct)


def test_the_table_in_print_names_each(solution):
    lines = str(solution).splitlines()
    start = next(i for i, line in enumerate(lines) if "5 grasps kept" in line)
    assert len(lines[start + 1 :]) == KEEP
    assert ", ".join(solution.grasps[-1].faces) in lines[-1]


def test_fewer_than_were_asked_for_are_counted(solution):
    incomplete = replace(solution, solver={**solution.solver, "keep": 50})
    message = f"{len(solution.grasps)} of the 50 grasps asked for: more starts, or a smaller distinct, may find others"
    assert message in str(incomplete)
    assert "asked for" not in str(solution)


def test_a_contact_table_has_all_of_them(solution):
    rows = list(csv.DictReader(io.StringIO(format_named("csv").export(solution).decode())))
    assert len(rows) == 4 * KEEP
    assert [row["grasp"] for row in rows[::4]] == [str(i) for i in range(KEEP)]
    assert float(rows[-1]["p_x"]) == solution.grasps[-1].grasp.points[-1, 0]


def test_a_table_of_several_is_read_grasp_by_grasp(solution, tmp_path):
    path = tmp_path / "contacts.csv"
    path.write_bytes(format_named("csv").export(solution))
    read = list(reader_of(path).read(path, ReadOptions()))
    assert [item.name for item in read] == [str(i) for i in range(KEEP)]
    assert all(np.array_equal(r.grasp.points, f.grasp.points) for r, f in zip(read, solution.grasps, strict=True))
    with pytest.raises(ng.InputError, match="got 5 grasps, expected one"):
        read_contacts_csv(path)


def test_files_of_kinds_that_nobody_knows_are_refused(data):
    from nlpgrasp.solution.file import parse

    with pytest.raises(ng.InputError, match=r"grasps.1.grasp.contacts.0.model"):
        parse(json.dumps(edited(data, put(grasp_path(1, "grasp", "contacts", 0, "model"), "magnet"))), "F.json")
