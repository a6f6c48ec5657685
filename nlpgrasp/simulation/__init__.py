"""Proof in simulation: a solution's fingertips press in MuJoCo (extra ``sim``)."""

from nlpgrasp.simulation.outcome import Simulation, Trial
from nlpgrasp.simulation.simulate import simulate

__all__ = ["Simulation", "Trial", "simulate"]
