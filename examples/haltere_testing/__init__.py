"""Simulated haltere vehicles for mission scripts and their tests: see README.md beside this folder."""

from .clock import RealTime, Simulated
from .rig import ORIGIN, START, Rig, Simulator, degrees, free_port, hall, program, wait_until

__all__ = ["ORIGIN", "START", "RealTime", "Rig", "Simulated", "Simulator", "degrees", "free_port",
           "hall", "program", "wait_until"]
