"""Bounds on mu by the checker alone: from a proof file, of this claim or another one, or a proof made anew."""

import json
from dataclasses import replace

import numpy as np
import pytest

import nlpgrasp as ng
from nlpgrasp.verify import proved_bounds
from tests.verify import honest
from tests.verify.edits import contact, put, together
from tests.verify.stated import edited

CORNERS = ([[0.04, 0.016, 0.0], [-0.04, 0.016, 0.0], [0.0, -0.02, 0.01]], [[-1, 0, 0], [1, 0, 0], [0, 1, 0]])


def checks_of(path, **options):
    """Return the checks of a file by name."""
    return {check.name: check for check in ng.verify(path, **options).checks}


def failed(checks):
    return [name for name, check in checks.items() if check.failed]


@pytest.fixture
def solution():
    """A planar solution."""
    return ng.GraspSolution.from_dict(honest.planar(), "planar.json")


@pytest.fixture
def saved(solution, tmp_path):
    """The file of a planar solution, with its proof beside it."""
    return solution.save(tmp_path / "planar.json", proof=True)


def rewritten(file, change):
    """Write an edited copy of a solution file in place of it."""
    file.write_text(json.dumps(edited(json.loads(file.read_text()), change)))
    return file


def forbid_certificates(monkeypatch):
    """Make every certificate of mu, and every new proof, an error."""
    for name in ("mu", "prove"):
        monkeypatch.setattr(proved_bounds, name, lambda *arguments, **options: pytest.fail("a certificate"))


def test_with_a_proof_the_checker_alone_confirms_the_interval(saved, solution, monkeypatch):
    forbid_certificates(monkeypatch)
    rewritten(saved, put(("quality", "robust"), None))  # whose displaced grasp would have a proof of its own
    proof = ng.check_proof(saved.with_suffix(".proof"))
    assert proof.lower >= solution.mu.lower
    claim = "contacts, forces and task are those of the grasp"
    beside, given = checks_of(saved), checks_of(saved, proof=saved.with_suffix(".proof"))
    assert beside["proof"].detail == f"planar.proof (found beside the file): {claim}; {proof}"
    assert given["proof"].detail == f"planar.proof: {claim}; {proof}"
    for checks in (beside, given):
        assert checks["proof"].passed
        assert checks["certified quality"].passed
        assert (
            checks["certified quality"].detail == f"stated {solution.mu}, proved {ng.Bounds(proof.lower, proof.upper)}"
        )
    content = saved.with_suffix(".proof").read_bytes()
    assert ng.verify(ng.GraspSolution.load(saved), proof=content).mu.lower == proof.lower


def test_without_a_proof_one_is_made_and_checked(solution):
    checks = {check.name: check for check in ng.verify(solution).checks}
    assert "proof" not in checks
    for name in ("certified quality", "robustness"):
        assert checks[name].passed
        assert ", proved [" in checks[name].detail


LIES = {
    "a contact moved": (put(contact(1, "position"), lambda p: [p[0], p[1] + 1e-9]), "the position of contact 1"),
    "a normal turned": (
        put(contact(0, "normal"), lambda n: [n[0] * np.cos(1e-6) - n[1] * np.sin(1e-6), n[1] + n[0] * np.sin(1e-6)]),
        "the frame of contact 0",
    ),
    "more friction": (put(contact(2, "friction"), 0.51), "the friction or the force budget"),
    "another budget": (put(("problem", "force_budget"), "shared"), "the friction or the force budget"),
    "an easier task": (put(("problem", "task", "axes", 0, 0), 0.99), "the task"),
    "a task moved": (put(("problem", "task", "center", 1), 0.01), "the task"),
    "moments about another point": (
        together(
            put(("grasp", "torque_origin", 0), 0.01),
            put(("problem", "task", "torque_origin"), lambda o: [0.01, *o[1:]]),
        ),
        "the torque origin",
    ),
    "a contact without friction": (put(contact(0, "model"), "point"), "the model of contact 0"),
}


@pytest.mark.parametrize("name", LIES)
def test_a_proof_of_another_claim_fails_with_the_part_that_differs(name, saved):
    change, part = LIES[name]
    checks = checks_of(rewritten(saved, change))
    remedy = "`nlpgrasp prove` writes a new one"
    assert checks["proof"].failed
    assert checks["proof"].detail == (
        f"planar.proof (found beside the file) is of another claim: {part} differs from the file's; {remedy}"
    )


def test_a_proof_of_another_grasp_fails(saved, solution):
    grasp = solution.grasp
    points, normals = (np.concatenate([rows, rows[:1]]) for rows in (grasp.points, grasp.normals))
    more = ng.Grasp(points, normals, [*grasp.contacts, grasp.contacts[0]], grasp.torque_origin)
    turned = ng.Grasp(grasp.points[::-1], grasp.normals[::-1], grasp.contacts, grasp.torque_origin)
    for other, part in ((more, "the number of contacts"), (turned, "the position of contact 0")):
        ng.write_proof(other, solution.task, saved.with_suffix(".other"))
        checks = checks_of(saved, proof=saved.with_suffix(".other"))
        assert checks["proof"].detail.startswith(f"planar.other is of another claim: {part} differs from the file's")
        assert failed(checks) == ["proof"]


def test_a_proof_that_does_not_reach_the_stated_interval_fails(saved, solution):
    ng.write_proof(solution.grasp, solution.task, saved.with_suffix(".proof"), rtol=1.0)
    checks = checks_of(saved)
    assert failed(checks) == ["certified quality"]
    proof = ng.check_proof(saved.with_suffix(".proof"))
    assert checks["certified quality"].detail.endswith(
        f": at least {solution.mu.lower:.9g} stated, {proof.lower:.9g} certified"
    )


def test_an_interval_that_is_raised_is_not_proved(saved, solution):
    lower, upper = ng.mu(solution.grasp, solution.task, 1e-4).lower * 1.001, solution.mu.upper * 1.01
    checks = checks_of(rewritten(saved, put(("quality", "mu"), lambda mu: {**mu, "lower": lower, "upper": upper})))
    assert checks["proof"].passed
    assert "certified quality" in failed(checks)
    checks = checks_of(rewritten(saved, put(("quality", "mu"), lambda mu: {**mu, "lower": 0.5, "upper": 0.9 * upper})))
    assert "at most" in checks["certified quality"].detail


def changed_byte(content, position):
    return content[:position] + bytes([content[position] ^ 0x40]) + content[position + 1 :]


EDITS = {
    "another version": (lambda c: c.replace(b"nlpgrasp-proof 1", b"nlpgrasp-proof 2"), "the version of the format"),
    "cut in its claim": (lambda c: c[:200], "the file ends before its bounds"),
    "cut in its forces": (lambda c: c[:-5], "NOT PROVED: the file ends"),
    "no proof at all": (lambda c: b"", "the file ends before its bounds"),
    "forces changed": (lambda c: changed_byte(c, len(c) - 1), "outside the cone of contact 2"),
    "a better bound": (lambda c: c.replace(b"bounds 0.", b"bounds 0.9"), "NOT PROVED: bounds"),
    "other bytes behind": (lambda c: c + b"0", "NOT PROVED: more than a proof"),
}


@pytest.mark.parametrize("name", EDITS)
def test_an_edited_proof_fails_with_the_step(name, saved):
    change, message = EDITS[name]
    proof = saved.with_suffix(".proof")
    proof.write_bytes(change(proof.read_bytes()))
    checks = checks_of(saved)
    assert failed(checks) == ["proof"]  # the interval is proved anew
    assert message in checks["proof"].detail


def test_rounding_of_another_machine_is_no_other_claim(saved, solution):
    """The checker gets the file's claim: a proof with a last digit that differs is checked for the file's numbers."""
    proof = saved.with_suffix(".proof")
    x = solution.grasp.points[0, 1]
    other = repr(float(np.nextafter(x, 1.0))).encode()
    content = proof.read_bytes().replace(repr(float(x)).encode(), other)
    assert content != proof.read_bytes()
    assert ng.verify(saved, proof=content)


def test_without_a_compiler_rational_arithmetic_checks_what_is_given(saved, solution, tmp_path, monkeypatch):
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.setenv("NLPGRASP_CACHE", str(tmp_path / "cache"))
    assert "PROVED in rational arithmetic" in checks_of(saved)["proof"].detail
    saved.with_suffix(".proof").unlink()
    assert ", proved [" in checks_of(saved)["certified quality"].detail
    assert checks_of(saved)["certified quality"].passed
    grasp, task = ng.Grasp(*CORNERS, ng.FrictionContact(0.8)), ng.TaskEllipsoid([1, 1, 1, 0.05, 0.05, 0.05])
    bounds = proved_bounds.prove_anew(grasp, task, 0.1, "l2")
    assert bounds.unproved == (
        "there is no C compiler, and rational arithmetic takes half a minute for a proof in space"
    )
    assert bounds.lower <= ng.mu(grasp, task).upper


FUNCTION = ng.TaskSet(lambda y: (np.linalg.norm(y, axis=1), y / np.linalg.norm(y, axis=1, keepdims=True)), 6)
BALL = ng.TaskEllipsoid([1.0] * 6)
UNPROVED = {
    "no friction": (
        ng.Grasp(*CORNERS, ng.PointContact()),
        BALL,
        "no lower end is provable, as where wrenches do not span wrench space",
    ),
    "a task by a function": (ng.Grasp(*CORNERS, ng.FrictionContact(0.8)), FUNCTION, "the task is given by a function"),
    "a closed form": (
        ng.Grasp(*CORNERS, ng.BilateralContact(ng.FrictionContact(0.8))),
        BALL,
        "singular values give mu in closed form",
    ),
}


def test_that_mu_is_zero_is_proved():
    one_sided = ng.Grasp(CORNERS[0], [[0, 0, 1]] * 3, ng.FrictionContact(0.8))
    assert proved_bounds.prove_anew(one_sided, BALL, 0.05, "l2").evidence == "proved [0, 0]"


@pytest.mark.parametrize("name", UNPROVED)
def test_what_cannot_be_proved_is_certified_with_the_reason(name):
    grasp, task, reason = UNPROVED[name]
    bounds, certified = proved_bounds.prove_anew(grasp, task, 0.05, "l2"), ng.mu(grasp, task, 0.05)
    assert bounds.evidence == f"recomputed {bounds}, not proved: {reason}"
    assert bounds.lower <= certified.upper
    assert certified.lower <= bounds.upper


def test_a_solutions_proof_reaches_the_stated_lower_end(solution, tmp_path):
    tight = replace(solution, mu=ng.mu(solution.grasp, solution.task, 1e-5))
    proved = tight.write_proof(tmp_path / "g.proof", rtol=0.5)
    assert tight.mu.lower <= proved.lower
    assert proved.upper == pytest.approx(tight.mu.upper, rel=1e-6)
    for checker in ("c", "python"):
        assert ng.check_proof((tmp_path / "g.proof").read_bytes(), checker).lower == proved.lower


def test_a_claim_that_no_proof_reaches_is_refused_and_the_solution_is_saved(solution, tmp_path):
    lower = solution.mu.lower
    boastful = replace(solution, mu=ng.Bounds(1.2 * lower, 1.3 * lower), bound=None)
    with pytest.raises(ng.InputError, match=r"mu: got at least 0\.\d+, where 0\.\d+ is proved, expected bounds that a"):
        boastful.save(tmp_path / "f.json", proof=True)
    assert (tmp_path / "f.json").exists()
    assert not (tmp_path / "f.proof").exists()
    grasp = ng.Grasp(*CORNERS, ng.BilateralContact(ng.FrictionContact(0.8)))
    exact = ng.mu(grasp, BALL)
    with pytest.raises(ng.InputError, match="bounds by singular values, in closed form"):
        replace(solution, grasp=grasp, problem={**solution.problem, "task": BALL.to_dict()}, mu=exact).write_proof("f")


def test_a_bound_file_takes_no_proof(tmp_path):
    square = ng.Polygon([[-0.05, -0.05], [0.05, -0.05], [0.05, 0.05], [-0.05, 0.05]])
    problem = ng.GraspProblem(square, [ng.FrictionContact(0.5)] * 2, ng.TaskEllipsoid([1, 1, 0.02]))
    file = ng.best_possible(problem, time_limit=0.2).save(tmp_path / "bound.json")
    with pytest.raises(ng.InputError, match="none with a bound file, which has its own certificate"):
        ng.verify(file, proof=b"")
    with pytest.raises(ng.InputError, match=r"proof \(.*none\.proof\): got No such file"):
        ng.verify(ng.GraspSolution.from_dict(honest.planar(), "f"), proof=tmp_path / "none.proof")
