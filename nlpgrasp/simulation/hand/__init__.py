"""A grasp pressed through its own hand's joints in MuJoCo."""

from nlpgrasp.simulation.hand.outcome import HandSimulation, HandTrial
from nlpgrasp.simulation.hand.protocol import simulate_hand

__all__ = ["HandSimulation", "HandTrial", "simulate_hand"]
