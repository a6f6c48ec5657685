"""A grasp pressed through its own hand's joints in MuJoCo."""

from nlpgrasp.simulation.hand.outcome import HandSimulation
from nlpgrasp.simulation.hand.protocol import simulate_hand
from nlpgrasp.simulation.hand.trial import HandTrial

__all__ = ["HandSimulation", "HandTrial", "simulate_hand"]
