"""Simulated batteries, missions and sensors, clearly named as simulated."""

from ohmward.simulate.cells import BATTERIES, SimulatedBattery
from ohmward.simulate.plant import simulate

__all__ = ["BATTERIES", "SimulatedBattery", "simulate"]
