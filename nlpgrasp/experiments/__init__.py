"""Experiments: many variations of a base problem, solved on local cores or a cluster."""

from nlpgrasp.experiments.ask.combinations import combinations
from nlpgrasp.experiments.ask.experiment import Experiment
from nlpgrasp.experiments.found.compare import Comparison, compare
from nlpgrasp.experiments.found.result import ExperimentResult
from nlpgrasp.experiments.found.variation_result import VariationResult
from nlpgrasp.experiments.run.many import ManySolved, solve_many
from nlpgrasp.experiments.run.run import run_experiment

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
