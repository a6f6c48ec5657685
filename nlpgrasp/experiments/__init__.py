"""Experiments: many variations of a base problem, solved on local cores or a cluster."""

from nlpgrasp.experiments.comparison import Comparison, compare
from nlpgrasp.experiments.experiment import Experiment, combinations
from nlpgrasp.experiments.experiment_result import ExperimentResult, VariationResult
from nlpgrasp.experiments.experiment_run import run_experiment
from nlpgrasp.experiments.solve_many import ManySolved, solve_many

__all__ = [
    "Comparison",
    "Experiment",
    "ExperimentResult",
    "ManySolved",
    "VariationResult",
    "combinations",
    "compare",
    "run_experiment",
    "solve_many",
]
