"""MuJoCo simulation of a grasp by the joints of its own hand."""

from nlpgrasp.simulation.hand.outcome import HandSimulation
from nlpgrasp.simulation.hand.protocol import simulate_hand
from nlpgrasp.simulation.hand.trial import HandTrial

__all__ = ["HandSimulation", "HandTrial", "simulate_hand"]
