"""Records of grasps for a task that changes with a parameter."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nlpgrasp.common.validation import FloatArray
from nlpgrasp.solution.obstructions import of_the_grasp
from nlpgrasp.solution.solution import GraspSolution


@dataclass(frozen=True)
class DynamicStep:
    """The grasp for one value of the parameter.

    Parameters
    ----------
    parameter : float
        The value, in the caller's own unit.
    solution : GraspSolution
        Certified; can be saved and verified on its own.
    moved : (k,) array
        Displacement of each contact from the previous value, metres.
    regrasp : bool
        Whether this is another local optimum, not reached by sliding.
    stayed : float
        Upper bound on mu of the previous value's contacts for this task.
    cold : bool
        Whether no followed grasp held, so that this one comes from a cold solve.
    """

    parameter: float
    solution: GraspSolution
    moved: FloatArray
    regrasp: bool
    stayed: float
    cold: bool = False

    @property
    def how(self) -> str:
        """Motion of the fingers, as text."""
        most = 1e3 * float(np.max(self.moved, initial=0.0))
        if self.solution.mu.lower <= 0.0:
            return "no grasp, also by a cold solve"
        if self.cold:
            return "found by a cold solve, as none that was followed held"
        if self.regrasp:
            return "regrasp"
        return f"slide by at most {most:.1f} mm" if most > 0.0 else "stay"


@dataclass(frozen=True)
class DynamicGrasp:
    """Grasps for a changing task, each certified for the parameter of its own step.

    Nothing is certified between two steps: neither the tasks between them, nor the grasps while fingers slide.

    Parameters
    ----------
    name : str
        The problem's.
    steps : tuple of DynamicStep
        One per task, in order.
    """

    name: str
    steps: tuple[DynamicStep, ...]

    @property
    def paths(self) -> FloatArray:
        """Contacts over the parameter, (steps, k, space); a regrasp begins another path."""
        return np.array([step.solution.grasp.points for step in self.steps if step.solution.grasp is not None])

    def __str__(self) -> str:
        lines = [f"{self.name}: {len(self.steps)} steps, certified at each, not between them"]
        for step in self.steps:
            bounds, kind = step.solution.mu, step.solution.kind
            text = f"{step.parameter:10.4g}: {kind} in {bounds}, {step.how}"
            wrong = "".join(f"; {words}" for words in of_the_grasp(step.solution.hand))
            lines.append(f"{text}; staying would give at most {step.stayed:.4g}{wrong}")
        return "\n".join(lines)
