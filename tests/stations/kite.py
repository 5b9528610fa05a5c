"""DroneKit 2.9.2 on today's Python: one name is put back, and the map of modes is in its place."""

import collections
import collections.abc
import os

import home  # noqa: F401

os.environ.pop("MAVLINK20", None)
os.environ["MAVLINK20"] = "1"
collections.MutableMapping = collections.abc.MutableMapping

import dronekit  # noqa: E402

LocationGlobalRelative = dronekit.LocationGlobalRelative
VehicleMode = dronekit.VehicleMode
APIException = dronekit.APIException


def connect(port, **more):
    return dronekit.connect(f"udpout:127.0.0.1:{port}", heartbeat_timeout=30, **more)


def has_parameters(vehicle):
    """Whether the vehicle says that it has parameters, by its capabilities."""
    encodings = 16 | 131072  # bytewise, by cast
    return bool((vehicle._capabilities or 0) & encodings)
