"""Result of a solve of the public program: values, multipliers, residuals and the certified grasp."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from nlpgrasp.common.validation import FloatArray
from nlpgrasp.quality.bounds import Bounds
from nlpgrasp.quality.grasp import Grasp
from nlpgrasp.solution.kkt import KKT


@dataclass(frozen=True, repr=False)
class FormulationResult:
    """Result of ``Formulation.solve``: values and multipliers by name, KKT residuals, and the grasp.

    Parameters
    ----------
    values : dict of str to (m,) array
        Variables by name, SI units.
    multipliers : dict of str to (m,) array
        Of the constraints by name: change of the objective per unit of the limit, positive at upper limits.
    bound_multipliers : dict of str to (m,) array
        The same for the variables' bounds.
    objective : float
        Maximised objective value.
    status : str
        The solver's status.
    success : bool
        Whether the solver reports convergence; ``kkt`` is computed independently.
    stats : dict
        The solver's statistics from CasADi.
    kkt : KKT
        Residuals, recomputed from values and multipliers.
    grasp : Grasp
        The contacts, on the body; ``ng.mu(grasp, task)`` certifies it.
    faces : tuple of str
        The face each contact is on.
    mu : Bounds, optional
        Certified interval of the grasp's mu, after ``refine``.
    rounds : int
        Programs solved.
    """

    values: dict[str, FloatArray]
    multipliers: dict[str, FloatArray]
    bound_multipliers: dict[str, FloatArray]
    objective: float
    status: str
    success: bool
    stats: dict[str, Any]
    kkt: KKT
    grasp: Grasp
    faces: tuple[str, ...]
    mu: Bounds | None = None
    rounds: int = 1

    @property
    def beta(self) -> float:
        """Scale beta of the task at the solution."""
        return float(self.values["beta"][0])

    def __repr__(self) -> str:
        iterations = self.stats.get("iter_count", "?")
        certified = "" if self.mu is None else f"certified {self.mu} after {self.rounds} programs, "
        return (
            f"{self.status}: beta {self.beta:.6g}, {certified}objective {self.objective:.6g}, {iterations} iterations; "
            f"stationarity {self.kkt.stationarity:.1e}, feasibility {self.kkt.feasibility:.1e}, "
            f"complementarity {self.kkt.complementarity:.1e}"
        )
