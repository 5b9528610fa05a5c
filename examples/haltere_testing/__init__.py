"""haltere vehicles for mission scripts and their tests: see README.md beside this folder."""

from .clock import RealTime, Simulated
from .lookout import Here, Lookout, Moment
from .programs import Simulator, free_port, program
from .rig import ORIGIN, START, Rig, degrees, hall
from .vehicle import Vehicle, wait_until

__all__ = ["ORIGIN", "START", "Here", "Lookout", "Moment", "RealTime", "Rig", "Simulated", "Simulator", "Vehicle",
           "degrees", "free_port", "hall", "program", "wait_until"]
