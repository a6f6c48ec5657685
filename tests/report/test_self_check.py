"""A page's check of its own proof: the checker in JavaScript, and what the page says, run by node."""

import base64
import json
import re
import shutil
import subprocess
from html import unescape
from importlib.resources import files

import numpy as np
import pytest

import nlpgrasp as ng
from nlpgrasp.report import write_report
from tests.once import GRASP, solve_once
from tests.report.test_page import browser, needs_browser  # noqa: F401 (a fixture)

NODE = shutil.which("node")
needs_node = pytest.mark.skipif(NODE is None, reason="needs node")
SCRIPTS = "".join(
    files("nlpgrasp.report").joinpath(f"viewer/{name}.js").read_text(encoding="utf-8")
    for name in ("proof_checker", "self_check")
)
BOX = np.array([[-0.04, 0.016, -0.002], [0.04, 0.016, -0.002], [-0.04, -0.016, -0.002], [0.04, -0.016, -0.002]])
INWARD = np.array([[1.0, 0, 0], [-1, 0, 0], [1, 0, 0], [-1, 0, 0]])
LIFT = ng.TaskEllipsoid([1, 1, 2, 0.02, 0.02, 0.02], center=[0, 0, 3, 0, 0, 0])
WRENCHES = ng.TaskPolytope([[0, 0, 5, 0, 0, 0], [1, 0, 5, 0, 0, 0.1], [0, 1, 3, 0.1, 0, 0], [0, -1, 4, 0, 0.05, 0]])
PAD = ng.PlaneContact(extents=[0.02, 0.01], friction=0.5, direction=[0, 1, 0])
PLANAR = ng.Grasp([[-1, 0], [1, 0.1], [0, 1.0]], [[1, 0], [-1, 0], [0, -1.0]], ng.FrictionContact(0.5))
CASES = {
    "friction": (ng.Grasp(BOX, INWARD, ng.FrictionContact(0.6)), LIFT, "l2"),
    "elliptic torsion": (ng.Grasp(BOX, INWARD, ng.SoftContact(0.6, 0.01, model="elliptic")), WRENCHES, "shared"),
    "pads": (
        ng.Grasp(BOX, INWARD, ng.PlaneContact(extents=[0.02, 0.01], friction=0.5, direction=[0, 1, 0])),
        LIFT,
        "per_finger",
    ),
    "sum": (ng.Grasp(BOX, INWARD, ng.FrictionContact(0.6)), LIFT + WRENCHES, "l2"),
    "planar": (PLANAR, ng.TaskEllipsoid([1, 1, 0.5]), "l2"),
}


def run(script: str, given: object) -> object:
    """Return the value of a JavaScript expression of ``given``, with the page's scripts before it."""
    program = (
        f"{SCRIPTS}\nconst given = JSON.parse(require('fs').readFileSync(0));\nconsole.log(JSON.stringify({script}));"
    )
    done = subprocess.run([NODE, "-e", program], input=json.dumps(given), capture_output=True, text=True, check=True)
    return json.loads(done.stdout)


def outcomes(proofs: list[bytes]) -> list[dict]:
    """Return what the checker in JavaScript says of each proof."""
    script = """given.map((text) => {
        try {
            const { lower, upper } = checkProof(Uint8Array.from(atob(text), (c) => c.charCodeAt(0)));
            return { lower, upper };
        } catch (error) {
            return { reason: error.message };
        }
    })"""
    return run(script, [base64.b64encode(proof).decode() for proof in proofs])


@pytest.fixture(scope="module", params=CASES)
def proof(request, tmp_path_factory):
    grasp, task, budget = CASES[request.param]
    path = tmp_path_factory.mktemp("proof") / "g.proof"
    return ng.write_proof(grasp, task, path, 0.2, force_budget=budget), path.read_bytes()


@needs_node
def test_proofs_hold_and_better_bounds_do_not(proof):
    bounds, data = proof
    stated = f"bounds {bounds.lower!r} {bounds.upper!r}\n".encode()
    better = [(bounds.lower * (1.0 + 1e-9), bounds.upper), (bounds.lower, bounds.upper * (1.0 - 1e-9))]
    edited = [data.replace(stated, f"bounds {lower!r} {upper!r}\n".encode()) for lower, upper in better]
    held, *refused = outcomes([data, *edited])
    assert held == {"lower": bounds.lower, "upper": bounds.upper}
    assert "is not in the half-space of vertices" in refused[0]["reason"]
    assert refused[1] == {"reason": "The upper bound does not follow from its multipliers."}


@needs_node
def test_edited_proofs_have_the_verdict_of_the_other_checkers(proof, tmp_path):
    _, data = proof
    words, start = data.split(), data.find(b"\n", data.find(b"\nlower") + 1) + 1
    rng = np.random.default_rng(0)
    edited = [data[:end] for end in (0, 10, start - 3, start + 5, len(data) - 1)] + [data + b"\0"]
    for new in (b"nan", b"-1", b"0", b"1e308", b"4294967296", b"1.1", b"0.9"):
        for old in rng.choice(words[2:60], 3):
            edited.append(data.replace(b" " + bytes(old) + b" ", b" " + new + b" ", 1))
    size = 8 * int(words[words.index(b"variables") + 1])  # of a vertex
    edited.append(data[:start] + data[start + size :] + data[start : start + size])
    path = tmp_path / "g.proof"
    for outcome, changed in zip(outcomes(edited), edited, strict=True):
        path.write_bytes(changed)
        checked = ng.check_proof(path)
        assert bool(checked) == ("reason" not in outcome), (checked, outcome)


@pytest.fixture(scope="module")
def solution():
    task = ng.TaskEllipsoid([5, 5, 10, 0.2, 0.2, 0.2], center=[0, 0, 3, 0, 0, 0])
    problem = ng.GraspProblem(ng.Box([0.08, 0.04, 0.04]), [ng.SoftContact(0.6, 0.01)] * 3, task, name="box")
    return solve_once(problem, starts=1, options=GRASP)


@pytest.fixture(scope="module")
def page(solution, tmp_path_factory):
    return write_report({"box.json": solution}, tmp_path_factory.mktemp("page") / "box.html")


def said(page: str) -> str:
    """Return what a page's script says of its proof, given the page's text."""
    data = json.loads(re.search(r'<script type="application/json">(.*?)</script>', page)[1])
    origin, unit = re.search(r"moments are about \(([^)]*)\) (m+)\.", page).groups()
    rows = re.findall(r"<tr>" + r"<td>([^<]*)</td>" * 6 + r"</tr>", page[page.index("Inward normal") :])
    shown = {
        "measure": re.search(r'data-measure="([^"]*)"', page)[1],
        "quality": re.search(r'<h3>Quality</h3><p class="value">([^<]*)<', page)[1],
        "task": unescape(re.search(r'<p class="asked">([^<]*)<', page)[1]),
        "origin": origin,
        "unit": unit,
        "contacts": [
            {"position": row[2], "normal": row[3], "coefficients": row[5], "drawn": contact["at"]}
            for row, contact in zip(rows, data["scenes"][0]["contacts"], strict=False)
        ],
    }
    proved = "checkProof(Uint8Array.from(atob(given[0]), (c) => c.charCodeAt(0)))"
    script = f"sentenceOf({{ proved: {proved}, seconds: 0.3 }}, given[1])"
    sentence = run(script, [embedded_proof(page), shown])
    assert sentence["holds"] != sentence["text"].startswith("NOT proved: ")
    return sentence["text"]


def embedded_proof(page: str) -> str:
    return re.search(r'<script type="text/plain">([^<]*)</script>', page)[1]


def test_a_page_has_a_proof_of_its_quality(page, solution, tmp_path):
    path = tmp_path / "box.proof"
    path.write_bytes(base64.b64decode(embedded_proof(page.read_text(encoding="utf-8"))))
    checked = ng.check_proof(path)
    assert checked.lower == pytest.approx(solution.mu.lower, rel=1e-9)
    assert checked.upper == pytest.approx(solution.mu.upper, rel=1e-7)


@needs_node
def test_a_page_says_what_it_has_checked(page, solution):
    sentence = said(page.read_text(encoding="utf-8"))
    ends = re.fullmatch(
        r"This page has checked its own proof: (\S+) ≤ mu-tilde ≤ (\S+) \(0\.3 s, in your browser\), "
        r"for the positions, normals, friction coefficients and task shown\.",
        sentence,
    )
    assert 0.999 * solution.mu.lower < float(ends[1]) <= solution.mu.lower
    assert solution.mu.upper <= float(ends[2]) < 1.001 * solution.mu.upper


EDITS = {  # of a figure, and how the page's sentence begins about it
    "quality": (r'(<h3>Quality</h3><p class="value">)[^<]*', r"\g<1>0.9 to 0.91", "Quality: 0."),
    "position": (r"(Inward normal(?:.*?<td>){3})[^,]*", r"\g<1>17.3", "Position of contact 0: "),
    "normal": (r"(Inward normal(?:.*?<td>){4})[^,]*", r"\g<1>0.3", "Normal of contact 0: "),
    "friction": (r"friction 0\.6", "friction 0.5", "Friction of contact 0: another in the proof, 0.5 on the page"),
    "friction of another's 1": (
        r"friction 0\.6",
        "friction 1.0",
        "Friction of contact 0: another in the proof, 1 on the page",
    ),
    "origin": (r"moments are about \([^,]*", "moments are about (2.0", "Point of moments: 0, "),
    "task": ("±5", "±4", "f_x of the task: -5 to 5 in the proof, -4 to 4 on the page; f_y of the task"),
    "drawing": (r'("at":\[)[^,]*', r"\g<1>0.01", "Drawing of contact 0: "),
}


@needs_node
@pytest.mark.parametrize("name", EDITS)
def test_an_edited_figure_is_noticed(page, name):
    pattern, new, words = EDITS[name]
    edited, count = re.subn(pattern, new, page.read_text(encoding="utf-8"), count=1, flags=re.DOTALL)
    assert count == 1
    assert said(edited).startswith(f"NOT proved: the proof is not of what this page shows. {words}")


def test_a_page_without_a_proof_says_why(tmp_path):
    ball = ng.TaskSet(lambda y: (np.linalg.norm(y, axis=1), y / np.linalg.norm(y, axis=1, keepdims=True)), 6)
    problem = ng.GraspProblem(ng.Box([0.08, 0.04, 0.04]), [ng.FrictionContact(0.6)] * 3, ball)
    solution = ng.solve(problem, starts=1, options=GRASP)
    page = write_report({"box.json": solution}, tmp_path / "box.html").read_text(encoding="utf-8")
    assert "Nothing is proved on this page. Task: got TaskSet" in page
    assert 'type="text/plain"' not in page


@pytest.mark.slow
@needs_browser
def test_a_page_checks_its_proof_when_it_is_opened(browser, page, tmp_path):  # noqa: F811
    from selenium.webdriver.support.ui import WebDriverWait

    edited = tmp_path / "edited.html"
    edited.write_text(page.read_text(encoding="utf-8").replace("friction 0.6", "friction 0.8"), encoding="utf-8")
    for file, kind, words in (
        (page, "asked", "This page has checked its own proof: "),
        (edited, "failed", "NOT proved: "),
    ):
        browser.get(file.as_uri())
        line = WebDriverWait(browser, 60).until(
            lambda b: (
                (found := b.find_element("css selector", ".proof")).text.startswith(("This page", "NOT")) and found
            )
        )
        assert line.text.startswith(words)
        assert kind in line.get_attribute("class").split()
