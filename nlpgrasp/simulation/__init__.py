"""MuJoCo simulation of a grasp, by free fingertips or by the hand itself (extra ``sim``)."""

from nlpgrasp.simulation.hand import HandSimulation, HandTrial, simulate_hand
from nlpgrasp.simulation.outcome import Simulation, Trial
from nlpgrasp.simulation.simulate import simulate

__all__ = ["HandSimulation", "HandTrial", "Simulation", "Trial", "simulate", "simulate_hand"]
