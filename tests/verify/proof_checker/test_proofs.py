"""Proofs of bounds on mu: every kind of cone, budget and task is proved by both checkers, and no false bound is."""

from pathlib import Path

import numpy as np
import pytest

import nlpgrasp as ng

BOX = np.array([[-0.04, 0.016, -0.002], [0.04, 0.016, -0.002], [-0.04, -0.016, -0.002], [0.04, -0.016, -0.002]])
INWARD = np.array([[1.0, 0, 0], [-1, 0, 0], [1, 0, 0], [-1, 0, 0]])
WHOLE = ng.TaskEllipsoid([5, 5, 10, 0.2, 0.2, 0.2])
LIFT = ng.TaskEllipsoid([1, 1, 2, 0.02, 0.02, 0.02], center=[0, 0, 3, 0, 0, 0])
WRENCHES = ng.TaskPolytope([[0, 0, 5, 0, 0, 0], [1, 0, 5, 0, 0, 0.1], [0, 1, 3, 0.1, 0, 0], [0, -1, 4, 0, 0.05, 0]])
PLANAR = ([[-1, 0], [1, 0.1], [0, 1.0]], [[1, 0], [-1, 0], [0, -1.0]])
CASES = {
    "friction": (ng.FrictionContact(0.6), WHOLE, "l2"),
    "box torsion": (ng.SoftContact(0.6, 0.01), LIFT, "l2"),
    "elliptic torsion": (ng.SoftContact(0.6, 0.01, model="elliptic"), LIFT, "shared"),
    "line": (ng.LineContact(0.02, 0.5, direction=[0, 1, 0]), LIFT, "per_finger"),
    "plane": (ng.PlaneContact(0.005, friction=0.5), WHOLE, "per_finger_size"),
    "small pads": (ng.PlaneContact(2e-4, friction=0.6), LIFT, "l2"),
    "pad under Coulomb's law": (ng.PlaneContact(extents=[0.02, 0.01], friction=0.5, direction=[0, 1, 0]), WHOLE, "l2"),
    "bilateral": (ng.BilateralContact(ng.FrictionContact(0.6)), LIFT, "l2"),
    "polytope": (ng.FrictionContact(0.6), WRENCHES, "shared"),
    "sum": (ng.FrictionContact(0.6), WRENCHES + ng.TaskEllipsoid([0.1, 0.1, 0.1, 0.01, 0.01, 0.01]), "l2"),
}


@pytest.fixture(params=CASES)
def case(request: pytest.FixtureRequest) -> tuple[ng.Grasp, ng.TaskEllipsoid | ng.TaskPolytope, str]:
    contact, task, budget = CASES[request.param]
    return ng.Grasp(BOX, INWARD, contact), task, budget


def test_both_checkers_prove_what_mu_certifies(case, tmp_path: Path) -> None:
    grasp, task, budget = case
    bounds = ng.write_proof(grasp, task, tmp_path / "g.proof", 0.2, force_budget=budget)
    certified = ng.mu(grasp, task, 0.01, force_budget=budget)
    assert bounds.lower <= certified.upper
    assert certified.lower <= bounds.upper <= 1.21 * bounds.lower
    for checker in ("c", "python"):
        checked = ng.check_proof(tmp_path / "g.proof", checker)
        assert (checked.lower, checked.upper, checked.checker) == (bounds.lower, bounds.upper, checker)


def test_no_bound_is_proved_that_is_better(case, tmp_path: Path) -> None:
    grasp, task, budget = case
    path = tmp_path / "g.proof"
    bounds = ng.write_proof(grasp, task, path, 0.2, force_budget=budget)
    data = path.read_bytes()
    stated = f"bounds {bounds.lower!r} {bounds.upper!r}\n".encode()
    for lower, upper in ((bounds.lower * (1.0 + 1e-9), bounds.upper), (bounds.lower, bounds.upper * (1.0 - 1e-9))):
        path.write_bytes(data.replace(stated, f"bounds {lower!r} {upper!r}\n".encode()))
        for checker in ("c", "python"):
            assert not ng.check_proof(path, checker)


@pytest.mark.parametrize("budget", ["l2", "shared"])
def test_pads_are_proved_as_closely_as_asked(budget: str, tmp_path: Path) -> None:
    pad = ng.LineContact(0.02, 0.5, direction=[0, 1, 0])
    grasp = ng.Grasp(BOX, INWARD, [pad, *[ng.FrictionContact(0.6)] * 3])
    bounds = ng.write_proof(grasp, LIFT, tmp_path / "g.proof", 1e-6, force_budget=budget)
    assert bounds.upper <= bounds.lower * (1.0 + 1.01e-6)
    for checker in ("c", "python"):
        assert ng.check_proof(tmp_path / "g.proof", checker)


def test_a_planar_grasp_is_proved(tmp_path: Path) -> None:
    grasp = ng.Grasp(*PLANAR, ng.FrictionContact(0.5))
    bounds = ng.write_proof(grasp, ng.TaskEllipsoid([1, 1, 0.5]), tmp_path / "g.proof", 0.01)
    for checker in ("c", "python"):
        assert ng.check_proof(tmp_path / "g.proof", checker).lower == bounds.lower
        assert ng.check_proof((tmp_path / "g.proof").read_bytes(), checker).lower == bounds.lower


# a planar force of at most 1 N, and a disc of 0.5 N: mu is 2
DISC = """nlpgrasp-proof 1 coordinates 2 0 1 origin 0 0 0 contacts 1 0 0 0 1 0 0 0 1 0 0 0 1 2 0 1
variables 2 lift 2 0 0 1 1 1 1 cones 1 3 {entries} task 1 0 3 0 0 0 0 0 0 .5 0 0 0 0 0 0 .5 0 0 0 0
bounds 0 {upper} upper {direction} 0 0 0 0 {multipliers} 1 0 2 1
lower
"""
ENTRIES = "3 0 2 1 1 0 1 2 1 1"
UPPER_ENDS = {  # entries of the cones, upper bound, direction, multipliers; whether it is proved
    "true": (ENTRIES, 2.001, "1 0", "1.0001 0 0", True),
    "too small": (ENTRIES, 1.999, "1 0", "1.0001 0 0", False),
    "multipliers outside": (ENTRIES, 1.0, "1 0", "0.5 0 0", False),
    "no direction": (ENTRIES, 0.0, "0 0", "0 0 0", False),
    "the pivot's entry in two": ("4 0 2 1 1 0 .5 1 0 .5 2 1 1", 0.001, "1 0", "1e-9 -2 0", False),
    "too large numbers": (ENTRIES, 2.001, "1e308 1e308", "1e308 0 0", False),
    "hexadecimal": (ENTRIES, "0x3", "1 0", "1.0001 0 0", False),
    "separated digits": (ENTRIES, "2_001", "1 0", "1.0001 0 0", False),
    "more than a proof": (ENTRIES, 2.001, "1 0", "1.0001 0 0 1 0 2 1\nlower\n0", False),
}


@pytest.mark.parametrize("name", UPPER_ENDS)
def test_upper_bounds_are_proved_only_if_they_are_true(name: str, tmp_path: Path) -> None:
    entries, upper, direction, multipliers, is_proved = UPPER_ENDS[name]
    text = DISC.format(entries=entries, upper=upper, direction=direction, multipliers=multipliers)
    (tmp_path / "g.proof").write_text(text)
    for checker in ("c", "python"):
        assert bool(ng.check_proof(tmp_path / "g.proof", checker)) == is_proved


EDITS = {
    "more friction": (b" 0.6", b" 0.7"),
    "another version": (b"nlpgrasp-proof 1", b"nlpgrasp-proof 2"),
    "NaN": (b" 0.2", b" nan"),
    "a huge count": (b"contacts 4", b"contacts 400000000"),
    "contacts moved apart": (b"-0.04", b"-0.05"),
}


def test_edited_files_are_refused_with_the_step(tmp_path: Path) -> None:
    grasp = ng.Grasp(BOX, INWARD, ng.FrictionContact(0.6))
    path = tmp_path / "g.proof"
    ng.write_proof(grasp, WHOLE, path, 0.2)
    data = path.read_bytes()
    for name, (old, new) in EDITS.items():
        path.write_bytes(data.replace(old, new))
        for checker in ("c", "python"):
            assert not ng.check_proof(path, checker), name
    rng = np.random.default_rng(0)
    start = data.find(b"\n", data.find(b"\nlower ") + 1) + 1
    for _ in range(40):  # forces: a changed bit may leave a true proof, of the same interval
        edited = bytearray(data)
        edited[rng.integers(start, len(data))] ^= 1 << int(rng.integers(0, 8))
        path.write_bytes(edited)
        checked = ng.check_proof(path, "c")
        assert checked.lower <= ng.mu(grasp, WHOLE, 0.01).upper
    for changed in (*(data[:end] for end in (10, start - 3, start + 5, len(data) - 1)), data.replace(b"\n", b" ")):
        path.write_bytes(changed)
        for checker in ("c", "python"):
            assert not ng.check_proof(path, checker)
    path.write_bytes(data + b"\0")
    assert ng.check_proof(path, "c").reason == "more than a proof (-1)"


@pytest.mark.parametrize("budget", ["l2", "per_finger", "per_finger_size", "shared"])
@pytest.mark.parametrize("name", ["friction", "box torsion", "line", "pad under Coulomb's law"])
def test_that_mu_is_zero_is_proved(name: str, budget: str, tmp_path: Path) -> None:
    above = ng.Grasp(
        BOX + np.array([0, 0, 0.02]), np.array([[0.3, 0, -1], [-0.3, 0, -1]] * 2) / 1.09**0.5, CASES[name][0]
    )
    assert ng.write_proof(above, WHOLE, tmp_path / "g.proof", force_budget=budget).upper == 0.0
    for checker in ("c", "python"):
        checked = ng.check_proof(tmp_path / "g.proof", checker)
        assert (checked.lower, checked.upper, checked.reason) == (0.0, 0.0, "")


def test_forces_that_balance_each_other_leave_a_bound_next_to_zero(tmp_path: Path) -> None:
    opposite = ng.Grasp(BOX[:2], INWARD[:2], ng.FrictionContact(0.6))
    assert 0.0 <= ng.write_proof(opposite, WHOLE, tmp_path / "g.proof").upper < 1e-9
    assert ng.check_proof(tmp_path / "g.proof")


def test_what_cannot_be_proved_is_refused(tmp_path: Path) -> None:
    grasp = ng.Grasp(BOX, INWARD, ng.FrictionContact(0.6))
    function = ng.TaskSet(lambda y: (np.linalg.norm(y, axis=1), y / np.linalg.norm(y, axis=1, keepdims=True)), 6)
    with pytest.raises(ng.InputError, match="ellipsoids, polytopes and sums"):
        ng.write_proof(grasp, function, tmp_path / "g.proof")
    with pytest.raises(ng.InputError, match=r"proof \(.*a proof file that can be read"):
        ng.check_proof(tmp_path / "none.proof")


def test_without_a_compiler_rational_arithmetic_checks(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    ng.write_proof(ng.Grasp(*PLANAR, ng.FrictionContact(0.5)), ng.TaskEllipsoid([1, 1, 0.5]), tmp_path / "g.proof")
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.setenv("NLPGRASP_CACHE", str(tmp_path / "cache"))
    assert ng.check_proof(tmp_path / "g.proof").checker == "python"
    with pytest.raises(ng.InputError, match="a C compiler"):
        ng.check_proof(tmp_path / "g.proof", "c")


@pytest.mark.parametrize("checker", [None, "python"])
def test_a_file_of_another_kind_or_version_is_named(checker):
    said = str(ng.check_proof(b"nlpgrasp-proof 2\n", checker))
    assert said == "NOT PROVED: version 2, expected a proof of version 1"
    assert "does not begin with nlpgrasp-proof" in str(ng.check_proof(b"{}", checker))
    assert not ng.check_proof(b"nlpgrasp-proof \xff\xfe", checker)


@pytest.mark.parametrize("checker", ["c", "python"])
@pytest.mark.parametrize("hidden", [b"\x00", b"\x00\xca7", b"\x0b", b"\xa0"])
def test_no_byte_that_is_no_text_is_read_over(checker, hidden, tmp_path: Path) -> None:
    """A number is what every reader takes it for: nothing hides behind a zero byte or an odd kind of space."""
    ng.write_proof(ng.Grasp(*PLANAR, ng.FrictionContact(0.6)), ng.TaskEllipsoid([1, 1, 0.5]), tmp_path / "g.proof", 0.3)
    data = (tmp_path / "g.proof").read_bytes()
    assert ng.check_proof(data, checker)
    checked = ng.check_proof(data.replace(b"variables 6", b"variables 6" + hidden + b" ", 1), checker)
    assert "no text" in checked.reason
