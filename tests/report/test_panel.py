"""Key figures beside the scene: certified quality, robustness, effort, global bound."""

import html
import math
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import nlpgrasp as ng
from nlpgrasp.report.key_figures import gauge, gauge_text, remaining_fraction, solution_figures, verdict
from nlpgrasp.report.solution_page import friction_section
from nlpgrasp.report.solution_sections import contacts
from nlpgrasp.solution.analysis_records import CriticalFriction, ForceAtFriction, Robustness
from nlpgrasp.solution.quality_record import GlobalBound

FILES = Path(__file__).parents[1] / "solution" / "files"


@pytest.fixture(scope="module")
def box():
    solution = ng.GraspSolution.load(FILES / "box.json")
    mu = ng.Bounds(0.36, 0.37)
    return replace(solution, mu=mu, bound=GlobalBound(0.4, 10), robust=robustness(solution, 0.27))


def robustness(solution, lower):
    grasp = solution.grasp
    return Robustness(0.001, 0.1, ng.Bounds(lower, 0.37 / 0.36 * lower), grasp.points, grasp.normals)


def spans(html):
    """Left end and width of every part of the gauge's track, in shares of the axis."""
    parts = re.findall(r'<b class="(\w+)" style="left:([\d.]+)%;width:([\d.]+)%">', html)
    return {kind: (float(a) / 100.0, float(w) / 100.0) for kind, a, w in parts}


def test_the_gauge_is_an_axis_from_zero(box):
    parts, end = spans(gauge(box)), 1.08 * 0.4
    assert parts["sure"] == pytest.approx((0.0, 0.27 / end), abs=1e-4)
    assert parts["lost"] == pytest.approx((0.27 / end, 0.09 / end), abs=1e-4)
    assert parts["between"] == pytest.approx((0.36 / end, 0.01 / end), abs=1e-4)
    assert parts["room"] == pytest.approx((0.37 / end, 0.03 / end), abs=1e-4)
    assert parts["best"][0] == pytest.approx(0.4 / end, abs=1e-4)
    assert gauge_text(box) == (
        "mu is certified between 0.36 and 0.37; 75\N{NO-BREAK SPACE}% of it is left when contacts are off, "
        "in the worst case found; the best possible is 0.4 at most"
    )


def test_several_gauges_share_an_axis(box):
    assert spans(gauge(box, 1.0))["between"] == pytest.approx((0.36, 0.01))


def test_a_best_possible_far_away_does_not_crush_the_gauge(box):
    far = spans(gauge(replace(box, bound=GlobalBound(40.0, 1))))
    assert far["between"][0] == pytest.approx(0.36 / (1.08 * 0.37), abs=1e-4)
    assert "best" not in far
    unbounded = spans(gauge(replace(box, bound=None)))
    assert "room" not in unbounded


@pytest.mark.parametrize(("lower", "fragile"), [(0.0719, True), (0.0721, False), (0.0, True)])
def test_less_than_a_fifth_left_is_fragile(box, lower, fragile):
    solution = replace(box, robust=robustness(box, lower))
    assert remaining_fraction(solution) == pytest.approx(lower / 0.36)
    assert solution.is_fragile is fragile
    assert verdict(solution) == (("Fragile", "bad") if fragile else ("Solved", ""))
    assert ("gauge fragile" in gauge(solution)) is fragile
    tones = {fact.title: fact.tone for fact in solution_figures(solution)}
    assert tones["What is left"] == ("bad" if fragile else "weak")


def test_what_the_task_takes_is_rounded_up(box):
    takes = next(fact for fact in solution_figures(box) if fact.title == "What the task takes")
    assert takes.value == "2.78 N"  # 1 / 0.36 = 2.777...
    assert "squares" in takes.lines[0]


def test_the_friction_needed_is_a_figure_and_a_curve_with_a_ring_at_the_contacts(box):
    curve = tuple(ForceAtFriction(f, ng.Bounds(0.98 / f, 1.0 / f)) for f in (0.3, 0.4, 1.0))
    found = replace(box, friction=CriticalFriction(ng.Bounds(0.2676, 0.2714), curve))
    figure = next(figure for figure in solution_figures(found) if figure.title == "Friction needed")
    assert figure.value == "0.272"
    assert figure.lines == (f"T{found.friction_line()[1:]}",)
    assert "held above friction 0.272 and is lost below 0.267, with forces of any size" in found.friction_line()
    section = friction_section(found)
    assert html.escape(found.friction_line()[1:].partition(";")[0]) in section
    assert (section.count('class="dot"'), section.count('class="answer"')) == (3, 1)
    assert section.count('class="limit"') == 1
    assert friction_section(box) == ""
    lost = replace(box, friction=CriticalFriction())
    assert "is lost with every friction up to 10" in friction_section(lost)
    assert next(f for f in solution_figures(lost) if f.title == "Friction needed").tone == "bad"


def test_the_gap_is_rounded_up(box):
    best = next(fact for fact in solution_figures(box) if fact.title == "Best possible")
    assert best.value == "0.4"
    assert best.lines == ("proved: no placement is more than 12 % better",)  # 11.1


def test_without_a_grasp_the_verdict_comes_first(box):
    none = ng.GraspSolution.load(FILES / "none.json")
    first = solution_figures(none)[0]
    assert (first.title, first.value, first.tone) == ("Status", "No grasp found", "bad")
    assert gauge(none) == ""
    assert remaining_fraction(none) is None


def test_nothing_is_minus_zero_or_infinite(box):
    shaky = replace(box, mu=ng.Bounds(0.0, 1e-12, np.eye(6)[0]), robust=None)
    for solution in (box, shaky, replace(box, bound=GlobalBound(math.inf, 1))):
        text = "".join(fact.html() for fact in solution_figures(solution))
        plain_text = re.sub(r"<[^>]*>", " ", text)
        assert not re.search(r"[-\N{MINUS SIGN}]0(?![.\d])", plain_text)
        assert not re.search(r"\b(inf|nan|e-\d)", plain_text)
        assert not re.search(r"\d\.\d{5,}", plain_text)


def test_contacts_are_in_millimetres_with_their_zeros(box):
    grasp = box.grasp
    points = np.zeros((len(grasp), 3))
    points[:2] = [[0.04, -0.0199999, -1e-17], [-0.04, 0.02, 0.0]]
    moved = ng.Grasp(points, grasp.normals, grasp.contacts, grasp.torque_origin, grasp.tangents)
    html = contacts(replace(box, grasp=moved))
    minus = "\N{MINUS SIGN}"
    assert f"<td>40.0, {minus}20.0, 0.0</td>" in html
    assert f"<td>{minus}40.0, 20.0, 0.0</td>" in html
    assert "Position, mm" in html
