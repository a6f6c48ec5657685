"""Comparison of grasps by several purposes at once: Pareto front, and best grasp by weights (Section 4)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from nlpgrasp.analysis.manipulability import manipulability
from nlpgrasp.analysis.mu_rates import mu_rates
from nlpgrasp.analysis.sensitivity import sensitivity
from nlpgrasp.common.formatting import columns, format_number
from nlpgrasp.common.types import Json
from nlpgrasp.common.validation import FloatArray, format_known_names, number
from nlpgrasp.errors import InputError
from nlpgrasp.hands import PosedHand
from nlpgrasp.problem.problem import GraspProblem
from nlpgrasp.solution.solution import GraspSolution

DIGITS = 4  # significant digits in tables


@dataclass(frozen=True)
class Purpose:
    """Quantity by which grasps are compared.

    Parameters
    ----------
    unit : str
        Of its values; empty for a pure number.
    larger_is_better : bool
        Whether the better of two grasps has the larger value.
    """

    unit: str
    larger_is_better: bool


PURPOSES: Mapping[str, Purpose] = {
    "mu": Purpose("", True),
    "sensitivity": Purpose("N", True),
    "manipulability": Purpose("m/s", True),
    "fragility": Purpose("1/m", False),
    "contacts": Purpose("", False),
    "force": Purpose("N", False),
}


@dataclass(frozen=True)
class PurposeComparison:
    """Values of grasps for several purposes, the Pareto front, and scores by weights.

    The purposes, each a measured number of a grasp:

    ``"mu"``
        Certified lower bound on mu; larger is better.
    ``"sensitivity"``
        Least force that the fingers feel of a wrench of the task's size, N: ``ng.sensitivity(grasp, task).felt``;
        larger is better. It falls with every added contact.
    ``"manipulability"``
        Geometric mean of the semi-axes of the body's velocity ellipsoid, m/s for rates of norm 1 of the joints, or of
        free fingertips: of ``ng.manipulability(solution, hand)``, ``measure ** (1 / d)``. All grasps have one torque
        scale, the mean of their mean arms, and ratios do not depend on it. Larger is better.
    ``"fragility"``
        Largest relative rate at which mu falls as one contact slides over the body, 1/m: of ``ng.mu_rates(solution)``,
        ``worst_contact.worst / mu``; smaller is better.
    ``"contacts"``
        Number of contacts, or their total cost if types have costs; smaller is better.
    ``"force"``
        Largest force of a finger that the task at full size needs, N: ``solution.needed.largest``; smaller is better.

    The units differ, so each value v counts by a ratio r to the best value among the grasps, from 0 to 1: v / best if
    larger is better, best / v otherwise, and 1 for a value equal to the best. A fragility may be 0, so its ratio is
    ``(1 + best h) / (1 + v h)`` with the displacement h: to first order the ratio of the shares of mu that remain when
    the worst contact is off by h. The score is the weighted geometric mean of the ratios,

        score = prod_p r_p ** (w_p / sum w),    log score = sum_p w_p log r_p / sum w.

    Another unit, or another best value, adds the same number to the logarithms of all grasps. Hence the order of two
    grasps depends neither on units nor on the grasps they are compared with, which does not hold for sums of ratios.
    With weights 1 for mu and fragility, grasps are ordered by the mu that remains, to first order, when the worst
    contact is off by h. A grasp with ratio 0 for a purpose of positive weight has score 0, for example if the hand
    cannot make some motion.

    A grasp beats another if it is at least as good for every purpose and better for one. A purpose of weight 0 counts
    here, though not in the score. The grasps that no other one beats are the Pareto front; the best is among them.

    Parameters
    ----------
    names : tuple of n str
        Names of the compared grasps.
    weights : mapping of str to float
        Weights of the purposes, at least 0.
    values : tuple of n mappings of str to float, or None
        Values of each grasp by purpose; ``None`` where there is no grasp.
    displacement : float
        h, metres: ``SolveOptions.robust_offset`` of a study. With 0, fragility counts in the front alone.
    """

    names: tuple[str, ...]
    weights: Mapping[str, float]
    values: tuple[Mapping[str, float] | None, ...]
    displacement: float = 1e-3

    @property
    def front(self) -> tuple[int, ...]:
        """Indices of the grasps that no other one beats, increasing."""
        grasps = [i for i, values in enumerate(self.values) if values is not None]
        signs = np.array([1.0 if PURPOSES[name].larger_is_better else -1.0 for name in self.weights])
        rows = [[values[name] for name in self.weights] for values in self.values if values is not None]
        gains = signs * np.array(rows).reshape(len(grasps), len(signs))  # larger is better
        is_as_good = (gains[:, None] >= gains).all(axis=2)
        is_better = (gains[:, None] > gains).any(axis=2)
        is_beaten = (is_as_good & is_better).any(axis=0)
        return tuple(i for i, beaten in zip(grasps, is_beaten, strict=True) if not beaten)

    @property
    def scores(self) -> tuple[float, ...]:
        """Weighted geometric mean of each grasp's ratios, from 0 to 1; 0 without a grasp."""
        exponents = np.array(list(self.weights.values())) / sum(self.weights.values())
        return tuple(np.prod(self._ratios**exponents, axis=1).tolist())

    @property
    def best(self) -> int | None:
        """Index of the grasp on the front with the largest score, of equal ones the first; ``None`` without grasps."""
        scores = self.scores
        return max(self.front, key=lambda i: (scores[i], -i), default=None)

    def with_weights(self, weights: Mapping[str, float]) -> PurposeComparison:
        """Return the comparison of the same grasps with other weights.

        Parameters
        ----------
        weights : mapping of str to float
            Of measured purposes; the others are left out, also from the front.

        Raises
        ------
        InputError
            On purposes that were not measured, weights that are not finite or below 0, and without one above 0.
        """
        measured = next((values for values in self.values if values is not None), self.weights)
        return replace(self, weights=check_weights(weights, list(measured)))

    @property
    def _ratios(self) -> FloatArray:
        """Ratios to the best values, (n, p), from 0 to 1; 0 without a grasp."""
        ratios = np.zeros((len(self.values), len(self.weights)))
        rows = [i for i, values in enumerate(self.values) if values is not None]
        if not rows:
            return ratios
        for j, name in enumerate(self.weights):
            column = np.array([values[name] for values in self.values if values is not None])
            if name == "fragility":
                column = 1.0 + self.displacement * column
            larger_is_better = PURPOSES[name].larger_is_better
            best = np.max(column) if larger_is_better else np.min(column)
            with np.errstate(divide="ignore", invalid="ignore"):
                ratio = column / best if larger_is_better else best / column
            ratios[rows, j] = np.where(column == best, 1.0, ratio)
        return ratios

    def to_dict(self) -> Json:
        """Return the comparison as JSON data; values that are not finite are ``None``."""
        front, scores, best = self.front, self.scores, self.best
        return {
            "weights": dict(self.weights),
            "displacement": self.displacement,
            "best": None if best is None else self.names[best],
            "grasps": [
                {
                    "name": name,
                    "values": None
                    if values is None
                    else {purpose: v if np.isfinite(v) else None for purpose, v in values.items()},
                    "score": score,
                    "front": i in front,
                }
                for i, (name, values, score) in enumerate(zip(self.names, self.values, scores, strict=True))
            ],
        }

    def __str__(self) -> str:
        front, scores, best = self.front, self.scores, self.best
        heads = [f"{name} [{PURPOSES[name].unit}]" if PURPOSES[name].unit else name for name in self.weights]
        rows = []
        for i, (name, values) in enumerate(zip(self.names, self.values, strict=True)):
            if values is None:
                rows.append([name, *([""] * len(heads)), "", "no grasp"])
            else:
                entries = [format_number(values[purpose], DIGITS) for purpose in self.weights]
                note = "best" if i == best else "not beaten" if i in front else "beaten"
                rows.append([name, *entries, format_number(scores[i], DIGITS), note])
        weights = ", ".join(f"{name} {format_number(weight)}" for name, weight in self.weights.items())
        return "\n".join([f"by weights: {weights}", *(f"  {s}" for s in columns(["", *heads, "score", "front"], rows))])


def check_weights(weights: Mapping[str, float], names: Sequence[str] = tuple(PURPOSES)) -> dict[str, float]:
    """Return validated weights of purposes.

    Parameters
    ----------
    weights : mapping of str to float
    names : sequence of str
        The allowed purposes.

    Raises
    ------
    InputError
        On unknown purposes, weights that are not finite or below 0, and without one above 0.
    """
    if not isinstance(weights, Mapping):
        raise InputError("weights", weights, "weights by purpose: " + ", ".join(names))
    unknown = [name for name in weights if name not in names]
    if unknown:
        raise InputError("weights", ", ".join(map(str, unknown)), f"some of {format_known_names(unknown, names)}")
    checked = {name: number(f"weights[{name!r}]", weight, at_least=0.0) for name, weight in weights.items()}
    if not any(checked.values()):
        raise InputError("weights", checked, "at least one above 0, of " + ", ".join(names))
    return checked


def check_purposes(weights: Mapping[str, float] | None, problems: Sequence[GraspProblem]) -> dict[str, float] | None:
    """Return validated weights of purposes that can be measured for all problems; ``None`` without weights.

    Raises
    ------
    InputError
        As ``check_weights``; on manipulability with a hand without joints, and fragility under a budget that depends
        on the posture.
    """
    if weights is None:
        return None
    checked = check_weights(weights)
    for problem in problems:
        hand, budget = problem.hand, problem.budget
        has_joints = isinstance(hand, PosedHand) and hand.loaded_joints
        if "manipulability" in checked and hand is not None and not has_joints:
            given = f"'manipulability' for hand {type(hand).__name__}"
            raise InputError("weights", given, "free contacts, or a hand with joints, such as ng.URDFHand")
        if "fragility" in checked and budget.depends_on_frames:
            given = f"'fragility' under force budget {budget.kind!r}"
            raise InputError("weights", given, "a budget that does not depend on the posture")
    return checked


def compare_purposes(
    names: Sequence[str],
    solutions: Sequence[GraspSolution],
    problems: Sequence[GraspProblem],
    costs: Sequence[float],
    weights: Mapping[str, float] | None,
    displacement: float,
) -> PurposeComparison | None:
    """Return the comparison of solutions by the purposes with weights; ``None`` without weights.

    Parameters
    ----------
    names : sequence of n str
    solutions : sequence of n GraspSolution
    problems : sequence of n GraspProblem
        Of the solutions.
    costs : sequence of n float
        Cost of the contacts of each solution, or their number.
    weights : mapping of str to float or None
        Validated by ``check_purposes``.
    displacement : float
        Metres.
    """
    if weights is None:
        return None
    arms = [s.grasp.mean_arm for s in solutions if s.success and s.grasp is not None]
    torque_scale = float(np.mean(arms)) if arms else 1.0
    values = [
        {name: _measure(name, solution, problem, cost, torque_scale) for name in weights} if solution.success else None
        for solution, problem, cost in zip(solutions, problems, costs, strict=True)
    ]
    return PurposeComparison(tuple(names), dict(weights), tuple(values), displacement)


def best_by_weights(comparison: PurposeComparison | None, weights: Mapping[str, float] | None) -> int | None:
    """Return the index of a study's best grasp by its own or other weights, or ``None`` without grasps.

    Raises
    ------
    InputError
        If the study had no weights; as ``PurposeComparison.with_weights``.
    """
    measured = require_comparison(comparison)
    return (measured if weights is None else measured.with_weights(weights)).best


def require_comparison(comparison: PurposeComparison | None) -> PurposeComparison:
    """Return the comparison of a study, or raise ``InputError`` if the study had no weights."""
    if comparison is None:
        raise InputError("weights", "none", "a study with weights=, for which the purposes are measured")
    return comparison


def _measure(name: str, solution: GraspSolution, problem: GraspProblem, cost: float, torque_scale: float) -> float:
    """Return the value of a solution for a purpose, in the purpose's unit; the torque scale is in metres."""
    if name == "mu":
        return solution.mu.lower
    if name == "sensitivity":
        return sensitivity(solution.require_grasp(), solution.task).felt
    if name == "fragility":
        rates = mu_rates(solution, problem.body, step=None)
        return rates.worst_contact.worst / rates.mu
    if name == "manipulability":
        hand = problem.hand if isinstance(problem.hand, PosedHand) else None
        body = manipulability(solution, hand, torque_scale).body
        return float(body.measure ** (1.0 / len(body.matrix)))
    if name == "force":
        return np.inf if solution.needed is None else float(np.max(solution.needed.largest))
    return float(cost)
