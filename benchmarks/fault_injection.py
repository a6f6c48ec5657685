"""Faults put into the code of certificates and proofs, one at a time: no checker accepts a false bound.

``python -m benchmarks fault_injection:200`` copies the package, changes one place of the code that a proof runs
through (an operator, a comparison, a constant, an index, a function, a line), and lets it write proofs of some grasps.
Each file has to state the claim of the package as it is, as ``verify --proof`` requires; the checkers of the package as
it is judge it, and bounds are compared with fine certificates.
"""

from __future__ import annotations

import ast
import json
import os
import shutil
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import nlpgrasp as ng
from nlpgrasp.quality.proof import IntervalProof, prove, state_claim

PACKAGE = Path(ng.__file__).parent
FOLDERS = ("quality", "contacts", "budgets", "tasks")
SEED, TIME_OUT = 0, 240.0  # s of a mutant, which may loop for ever
RTOL, FINE = 0.3, 2e-3  # relative gaps of the proofs, and of the certificates that bounds are compared with
NEAR = 1e-9  # relative rounding of a fine certificate
BOX = np.array([[-0.04, 0.016, -0.002], [0.04, 0.016, -0.002], [-0.04, -0.016, -0.002], [0.04, -0.016, -0.002]])
INWARD = np.array([[1.0, 0, 0], [-1, 0, 0], [1, 0, 0], [-1, 0, 0]])
PLANAR = ([[-1, 0], [1, 0.1], [0, 1.0]], [[1, 0], [-1, 0], [0, -1.0]])


def cases() -> dict[str, tuple[ng.Grasp, ng.Task, object]]:
    """Return grasps with tasks and budgets that run through most of the code of a proof."""
    whole, lift = ng.TaskEllipsoid([5, 5, 10, 0.2, 0.2, 0.2]), ng.TaskEllipsoid([1, 1, 2, 0.02, 0.02, 0.02])
    wrenches = ng.TaskPolytope([[0, 0, 5, 0, 0, 0], [1, 0, 5, 0, 0, 0.1], [0, 1, 3, 0.1, 0, 0], [0, -1, 4, 0, 0.05, 0]])
    lifted = ng.TaskEllipsoid([1, 1, 2, 0.02, 0.02, 0.02], center=[0, 0, 3, 0, 0, 0])
    pad = ng.PlaneContact(extents=[0.02, 0.01], friction=0.5, direction=[0, 1, 0])
    jacobians = np.random.default_rng(0).normal(size=(4, 6, 3))
    return {
        "friction": (ng.Grasp(BOX, INWARD, ng.FrictionContact(0.6)), whole, "l2"),
        "mixed": (
            ng.Grasp(
                BOX,
                INWARD,
                [ng.SoftContact(0.6, 0.01), ng.SoftContact(0.6, 0.01, model="elliptic"), pad, ng.PlaneContact(0.005)],
                [0.1, 0, 0],
            ),
            lifted + wrenches,
            "per_finger_size",
        ),
        "torques": (ng.Grasp(BOX, INWARD, ng.FrictionContact(0.6)), lift, ng.JointTorqueLimits(jacobians, 0.5)),
        "line": (ng.Grasp(BOX, INWARD, ng.LineContact(0.02, 0.5, direction=[0, 1, 0])), lifted, "per_finger"),
        "planar": (ng.Grasp(*PLANAR, ng.FrictionContact(0.5)), ng.TaskEllipsoid([1, 1, 0.5]), "shared"),
        "zero": (ng.Grasp(BOX, np.tile([0.0, 0.0, 1.0], (4, 1)), ng.FrictionContact(0.6)), lift, "l2"),
    }


@dataclass(frozen=True)
class Fault:
    """A changed place: file, line, what was changed, and the changed source."""

    file: str
    line: int
    change: str
    source: str


SWAPS = {ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult, ast.And: ast.Or, ast.Or: ast.And}
ORDERS = {ast.Lt: ast.LtE, ast.LtE: ast.Lt, ast.Gt: ast.GtE, ast.GtE: ast.Gt, ast.Eq: ast.NotEq, ast.NotEq: ast.Eq}
TURNS = {ast.Lt: ast.Gt, ast.LtE: ast.GtE, ast.Gt: ast.Lt, ast.GtE: ast.LtE}
NAMES = {
    "min": "max", "max": "min", "minimum": "maximum", "maximum": "minimum", "argmin": "argmax", "argmax": "argmin",
    "any": "all", "all": "any", "zeros": "ones", "ones": "zeros", "isfinite": "isnan", "cross": "add",
}  # fmt: skip
DROPPED = {"abs", "sqrt", "norm", "asarray", "sort", "nextafter"}  # functions of which only the argument is left


def changes(node: ast.AST) -> Iterator[tuple[str, ast.AST | None]]:
    """Yield changes of a node of a syntax tree: what, and the new node, None for a removed line."""
    if isinstance(node, ast.BinOp) and type(node.op) in SWAPS:
        yield "operator", ast.BinOp(node.left, SWAPS[type(node.op)](), node.right)
        yield "left operand alone", node.left
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.MatMult):
        yield "transposed operand", ast.BinOp(node.left, ast.MatMult(), ast.Attribute(node.right, "T", ast.Load()))
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub | ast.Not):
        yield "sign", node.operand
    if isinstance(node, ast.Compare) and type(node.ops[0]) in ORDERS:
        yield "strictness", ast.Compare(node.left, [ORDERS[type(node.ops[0])]()], node.comparators)
    if isinstance(node, ast.Compare) and type(node.ops[0]) in TURNS:
        yield "direction", ast.Compare(node.left, [TURNS[type(node.ops[0])]()], node.comparators)
    if isinstance(node, ast.Constant) and type(node.value) is float:
        yield "constant by 1 %", ast.Constant(node.value * 1.01 or 0.01)
        yield "constant by 1e-6", ast.Constant(node.value * (1.0 + 1e-6) or 1e-6)
        yield "sign of a constant", ast.Constant(-node.value or -1.0)
    if isinstance(node, ast.Constant) and type(node.value) is int:
        yield "one more", ast.Constant(node.value + 1)
        yield "one less", ast.BinOp(node, ast.Sub(), ast.Constant(1))
    if isinstance(node, ast.Constant) and type(node.value) is bool:
        yield "flag", ast.Constant(not node.value)
    if isinstance(node, ast.Attribute) and node.attr in NAMES:
        yield NAMES[node.attr], ast.Attribute(node.value, NAMES[node.attr], node.ctx)
    if isinstance(node, ast.Attribute) and node.attr == "T":
        yield "not transposed", node.value
    if isinstance(node, ast.Call):
        name = node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")
        if name in DROPPED and len(node.args) == 1:
            yield f"no {name}", node.args[0]
    if isinstance(node, ast.IfExp):
        yield "condition", ast.IfExp(node.test, node.orelse, node.body)
    if isinstance(node, ast.If | ast.While):
        yield "no condition", type(node)(ast.UnaryOp(ast.Not(), node.test), node.body, node.orelse)
    if isinstance(node, ast.AugAssign | ast.Expr | ast.Break | ast.Continue):
        yield "removed line", None


def faults(count: int, lines: dict[str, set[int]]) -> list[Fault]:
    """Return changes of lines that were run: of a file at random, each time a place at random, half in ``quality``."""
    possible: dict[str, list[tuple[str, int, int, str]]] = {}
    for file, run in sorted(lines.items()):
        for i, node in enumerate(ast.walk(ast.parse((PACKAGE / file).read_text()))):
            if getattr(node, "lineno", 0) in run and not _is_text(node):
                possible.setdefault(file, []).extend((file, node.lineno, i, what) for what, _ in changes(node))
    rng = np.random.default_rng(SEED)
    files = [file for file, places in possible.items() if places]
    certificates = [file for file in files if file.startswith("quality")]
    supports = [file for file in files if not file.startswith("quality")]
    chosen: set[tuple[str, int, int, str]] = set()
    while len(chosen) < count:
        places = possible[rng.choice(certificates if rng.random() < 0.5 else supports)]
        chosen.add(places[rng.integers(len(places))])
    return [_fault(*place) for place in sorted(chosen)]


def _is_text(node: ast.AST) -> bool:
    return isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)


def _fault(file: str, line: int, place: int, what: str) -> Fault:
    """Return the change ``what`` of a node, by its place in the walk over the tree."""
    tree = ast.parse((PACKAGE / file).read_text())
    old = list(ast.walk(tree))[place]
    (new,) = [new for name, new in changes(old) if name == what]

    class Replace(ast.NodeTransformer):
        def visit(self, node: ast.AST) -> ast.AST:
            return (new or ast.Pass()) if node is old else self.generic_visit(node)

    before = ast.unparse(old).splitlines()[0][:60]
    after = "" if new is None else ast.unparse(ast.fix_missing_locations(new)).splitlines()[0][:60]
    changed = ast.fix_missing_locations(Replace().visit(tree))
    return Fault(file, line, f"{what}: {before} -> {after}", ast.unparse(changed))


def executed_lines() -> dict[str, set[int]]:
    """Return the lines of functions that proofs of the cases run through, by file."""
    lines: dict[str, set[int]] = {}

    def trace(frame: object, event: str, argument: object) -> object:
        del argument
        path = Path(frame.f_code.co_filename)
        if PACKAGE not in path.parents or path.relative_to(PACKAGE).parts[0] not in FOLDERS:
            return None
        if event == "line":
            lines.setdefault(str(path.relative_to(PACKAGE)), set()).add(frame.f_lineno)
        return trace

    sys.settrace(trace)
    try:
        for grasp, task, budget in cases().values():
            prove(grasp, task, RTOL, budget)
            ng.mu(grasp, task, RTOL, force_budget=budget)
    finally:
        sys.settrace(None)
    return lines


def child(folder: str) -> None:
    """Write proofs of the cases into a folder, and certified bounds or errors into ``said.json``."""
    said = {}
    for name, (grasp, task, budget) in cases().items():
        try:
            certified = ng.mu(grasp, task, RTOL, force_budget=budget)
            said[name] = {"mu": [certified.lower, certified.upper]}
            proof = prove(grasp, task, RTOL, budget)
            Path(folder, f"{name}.proof").write_bytes(proof.to_bytes())
            said[name]["proof"] = [proof.bounds.lower, proof.bounds.upper]
        except Exception as error:
            said.setdefault(name, {})["error"] = f"{type(error).__name__}: {error}"
    Path(folder, "said.json").write_text(json.dumps(said))


class Judge:
    """What is true of the cases, by the package as it is."""

    def __init__(self) -> None:
        self.cases = cases()
        self.claims = {name: state_claim(*case).encode("ascii") for name, case in self.cases.items()}
        self.proofs = {name: self._prove(*case) for name, case in self.cases.items()}
        self.fine = {name: ng.mu(g, t, FINE, force_budget=b) for name, (g, t, b) in self.cases.items()}
        self.unit = {name: task.paper_beta or 1.0 for name, (_, task, _) in self.cases.items()}

    @staticmethod
    def _prove(grasp: ng.Grasp, task: ng.Task, budget: object) -> IntervalProof:
        return prove(grasp, task, RTOL, budget)

    def is_false(self, name: str, lower: float, upper: float) -> bool:
        """Return whether bounds on a case's mu are false."""
        fine, room = self.fine[name], 1.0 + NEAR
        return not (lower <= fine.upper * room and upper * room >= fine.lower)

    def outcome(self, name: str, said: dict[str, object], path: Path) -> tuple[str, bool, bool]:
        """Return what came of a case, whether the proof's bounds differ, and whether they are false."""
        if "proof" not in said:
            return "error", False, False
        reference, unit = self.proofs[name].bounds, self.unit[name]
        lower, upper = said["proof"]
        differs = (lower, upper) != (reference.lower, reference.upper)
        is_false = self.is_false(name, lower * unit, upper * unit)
        data = path.read_bytes()
        if data == self.proofs[name].to_bytes():
            return "equal", False, False
        if not data.startswith(self.claims[name] + b"bounds "):
            return "refused: another claim", differs, is_false
        checked = ng.check_proof(path, "c")
        if not checked:
            return f"refused: {checked.reason.split(' (')[0]}", differs, is_false
        accepted_false = self.is_false(name, checked.lower * unit, checked.upper * unit)
        return "FALSE, ACCEPTED" if accepted_false else "accepted, true", differs, is_false


def run(count: str = "200", keep: str = "") -> None:
    """Print a row a fault, then counts of what came of proofs and of certificates."""
    judge, lines = Judge(), executed_lines()
    listed = faults(int(count), lines)
    total, certificates, of_faults = Counter(), Counter(), Counter()
    folder = Path(tempfile.mkdtemp(prefix="faults-"))
    shutil.copytree(PACKAGE, folder / "nlpgrasp", ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copytree(Path(__file__).parent, folder / "benchmarks", ignore=shutil.ignore_patterns("__pycache__", "peers"))
    for fault in listed:
        target, work = folder / "nlpgrasp" / fault.file, Path(tempfile.mkdtemp(dir=folder))
        kept = target.read_text()
        target.write_text(fault.source)
        environment = {**os.environ, "PYTHONPATH": str(folder), "PYTHONDONTWRITEBYTECODE": "1"}
        command = [sys.executable, "-W", "ignore", "-m", "benchmarks.fault_injection", "--child", str(work)]
        try:
            subprocess.run(command, env=environment, capture_output=True, timeout=TIME_OUT, check=False, cwd=folder)
        except subprocess.TimeoutExpired:
            of_faults["time is up"] += 1
        target.write_text(kept)
        said = json.loads((work / "said.json").read_text()) if (work / "said.json").exists() else {}
        results = {name: judge.outcome(name, said.get(name, {}), work / f"{name}.proof") for name in judge.cases}
        answers = Counter(answer for answer, _, _ in results.values())
        of_proof = {key: any(row[i] for row in results.values()) for i, key in ((1, "changed"), (2, "false"))}
        is_wrong = any("mu" in told and judge.is_false(name, *told["mu"]) for name, told in said.items())
        certificates["false"] += is_wrong
        of_faults["no proof at all"] += answers["error"] == len(results)
        of_faults["all equal"] += answers["equal"] == len(results)
        of_faults["changed a bound of a proof"] += of_proof["changed"]
        of_faults["stated a false bound in a proof"] += of_proof["false"]
        of_faults["stated a false certificate"] += is_wrong
        total += answers
        total["false bounds stated"] += sum(row[2] for row in results.values())
        mark = "FALSE " if any("FALSE" in answer for answer in answers) else "      "
        print(f"{mark}{fault.file}:{fault.line} {fault.change}: {dict(answers)}", flush=True)
        if not keep:
            shutil.rmtree(work)
    print(f"{len(listed)} faults, of which", *(f"  {number:5} {text}" for text, number in of_faults.items()), sep="\n")
    print(
        f"{len(listed) * len(judge.cases)} proofs:", *(f"  {n:5} {text}" for text, n in total.most_common()), sep="\n"
    )


if __name__ == "__main__":
    child(sys.argv[2])
