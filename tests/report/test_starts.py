"""Text of the report on starts, limits and forces."""

import re
from dataclasses import replace
from html import unescape
from pathlib import Path

import numpy as np
import pytest

import nlpgrasp as ng
from nlpgrasp.quality import Bounds
from nlpgrasp.report.key_figures import solution_figures
from nlpgrasp.report.solution_sections import constraints
from nlpgrasp.report.start_charts import start_section
from nlpgrasp.report.task_wrenches import choose_wrenches
from nlpgrasp.solution import ConstraintReport
from nlpgrasp.solution.quality_record import GlobalBound, measure_meaning
from nlpgrasp.solution.records import Status

FILES = Path(__file__).parents[1] / "solution" / "files"


def plain(html):
    return unescape(re.sub(r"\s+", " ", re.sub(r"<[^>]+>", " ", html))).replace("\N{NO-BREAK SPACE}", " ")


@pytest.fixture(scope="module")
def box():
    return ng.GraspSolution.load(FILES / "box.json")


def test_the_table_of_starts_says_why_one_found_no_grasp(box):
    lost = replace(
        box.starts[0],
        status=Status.NO_GRASP,
        mu=Bounds(0.02576, 0.02611),
        violation=0.0667,
        message="Maximum_Iterations_Exceeded",
    )
    text = plain(start_section(replace(box, starts=(lost, *box.starts[1:]))))
    assert "no grasp: constraint violation 0.067 (mu 0.0257 to 0.0262)" in text
    assert "stopped at the iteration limit" in text
    assert "Maximum_Iterations" not in text
    assert "2 of 3 starts found a grasp: 1 broke a constraint" in text


def test_equations_are_no_limits(box):
    rows = [
        ConstraintReport("palm quaternion of unit length", 1.0, 1.0, 1.0, 40816.4, True),
        ConstraintReport("on fingertip a, finger 0, x", -2.7e-9, 0.0, 0.0, 71393.5, True, "on fingertip", (0,)),
        ConstraintReport("table, finger 1", 0.002, 0.002, np.inf, -3.5, True, "table", (1,)),
        ConstraintReport("clearance from the body, a/0", 0.0138869, 0.0138836, np.inf, -1.4e9, True),
    ]
    limited = replace(box, constraints=tuple(rows), prices=())
    text = plain(constraints(limited))
    assert "quaternion" not in text
    assert "on fingertip" not in text
    assert "table, finger 1: 0.002, the least allowed; mu changes by −3.5 a unit." in text  # noqa: RUF001
    assert "clearance from the body, a/0: 0.01389, the least allowed." in text  # a price that no mu could pay
    assert len(limited.to_dict()["constraints"]) == 4
    assert "At their limits" not in constraints(replace(limited, constraints=tuple(rows[:2])))


def test_forces_are_those_of_the_task_as_given(box):
    """They balance the task's own wrench, summed up here by forces and arms."""
    chosen, grasp = choose_wrenches(box), box.grasp
    support = box.task.support(box.mu.worst_direction[None])[1][0]
    np.testing.assert_allclose(chosen[0].wrench, support, rtol=1e-12)
    for wrench in chosen:
        arms = grasp.points - grasp.torque_origin
        total = [*wrench.forces.sum(axis=0), *np.cross(arms, wrench.forces).sum(axis=0)]
        np.testing.assert_allclose(total, wrench.wrench, atol=1e-6 * np.linalg.norm(wrench.wrench))
    largest = max(np.linalg.norm(wrench.forces) for wrench in chosen)
    assert largest == pytest.approx(1.0 / box.mu.lower, rel=0.02)


def test_a_bound_that_leaves_out_the_hand_says_so_in_the_same_sentence(box):
    bound = GlobalBound(2.6345 * box.mu.lower, 1, ("the hand (urdf)", "table", "the edge margin"))
    left_out = ", even ignoring the hand (urdf), table and the edge margin"
    line = bound.line(box.mu.lower)
    assert line.startswith("a loose bound on the best possible: mu is at most 0.")
    assert line.endswith(f" anywhere{left_out}")
    (best,) = (fact for fact in solution_figures(replace(box, bound=bound)) if fact.title == "Best possible")
    (sentence,) = best.lines
    assert sentence == f"proved: no placement is above this{left_out}. A loose bound: it says little of this grasp"
    close_line = replace(bound, upper=1.02 * box.mu.lower).line(box.mu.lower, "mu-tilde")
    assert f"no placement is more than 2% better{left_out}: mu-tilde is at most" in close_line
    assert "ignoring" not in replace(bound, dropped=()).line(box.mu.lower)


def test_mu_and_mu_tilde_are_told_apart_in_words(box):
    assert ": 1 N (L2 norm of all finger forces) holds the task scaled by this factor\n" in str(box)
    other = str(replace(box, kind="mu_tilde", bound=GlobalBound(2.0, 1)))
    assert ": 1 N (L2 norm of all finger forces) holds the task, its centre included, scaled by this factor\n" in other
    assert not re.search(r"\bmu\b(?!-tilde)", other)  # one name for one measure


def test_of_torque_limits_there_is_no_unit():
    budget = ng.SharedJointTorqueLimits([np.eye(3)] * 2, 1.0)
    assert measure_meaning("mu", budget) == "the joints' torque limits hold the task scaled by this factor"
