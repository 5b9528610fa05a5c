"""DroneKit 2.9.2 on today's Python: one name is put back, and the map of modes is in its place."""

import collections
import collections.abc

import home  # noqa: F401

collections.MutableMapping = collections.abc.MutableMapping

import dronekit  # noqa: E402

LocationGlobalRelative = dronekit.LocationGlobalRelative
VehicleMode = dronekit.VehicleMode
APIException = dronekit.APIException


def connect(port, **more):
    return dronekit.connect(f"udpout:127.0.0.1:{port}", heartbeat_timeout=30, **more)
