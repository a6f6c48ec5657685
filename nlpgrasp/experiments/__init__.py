"""Experiments: one base problem, many variations, over cores or a cluster."""

from nlpgrasp.experiments.combinations import combinations
from nlpgrasp.experiments.compare import Comparison, compare
from nlpgrasp.experiments.experiment import Experiment
from nlpgrasp.experiments.result import ExperimentResult
from nlpgrasp.experiments.run import run_experiment
from nlpgrasp.experiments.variation_result import VariationResult

__all__ = [
    "Comparison",
    "Experiment",
    "ExperimentResult",
    "VariationResult",
    "combinations",
    "compare",
    "run_experiment",
]
