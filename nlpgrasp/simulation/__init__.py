"""Proof in simulation: a solution's fingertips, or its hand, press in MuJoCo (extra ``sim``)."""

from nlpgrasp.simulation.hand import HandSimulation, HandTrial, simulate_hand
from nlpgrasp.simulation.outcome import Simulation, Trial
from nlpgrasp.simulation.simulate import simulate

__all__ = ["HandSimulation", "HandTrial", "Simulation", "Trial", "simulate", "simulate_hand"]
