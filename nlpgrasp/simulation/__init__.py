"""MuJoCo scenes of grasps (MJCF), and their simulation (extra ``sim``)."""

from nlpgrasp.simulation.fingertip_outcome import Simulation, Trial
from nlpgrasp.simulation.hand_outcome import HandSimulation, HandTrial
from nlpgrasp.simulation.hand_protocol import simulate_hand
from nlpgrasp.simulation.simulate import simulate

__all__ = ["HandSimulation", "HandTrial", "Simulation", "Trial", "simulate", "simulate_hand"]
