"""DroneKit 2.9.2 on today's Python: one name is put back, and the map of modes is in its place."""

import collections
import collections.abc

import home  # noqa: F401

collections.MutableMapping = collections.abc.MutableMapping

import dronekit  # noqa: E402
from pymavlink import mavutil  # noqa: E402

LocationGlobalRelative = dronekit.LocationGlobalRelative
VehicleMode = dronekit.VehicleMode
APIException = dronekit.APIException
# MAV_PROTOCOL_CAPABILITY_PARAM_ENCODE_BYTEWISE and _C_CAST.
PARAMETERS = 16 | 131072


def capabilities(port):
    """Of the vehicle, asked before DroneKit connects."""
    link = mavutil.mavlink_connection(f"udpout:127.0.0.1:{port}", source_system=255,
                                      source_component=1)
    for _ in range(20):
        link.mav.command_long_send(1, 1, 512, 0, 148, 0, 0, 0, 0, 0, 0)
        message = link.recv_match(type="AUTOPILOT_VERSION", blocking=True, timeout=1)
        if message:
            link.close()
            return message.capabilities
    raise AssertionError("no AUTOPILOT_VERSION")


class WithoutParameters(dronekit.Vehicle):
    """DroneKit connects only to vehicles with parameters: one without looks as if it had none."""

    _params_count = property(lambda self: 0, lambda self, value: None)


def has_parameters(port):
    return bool(capabilities(port) & PARAMETERS)


def connect(port, **more):
    kind = dronekit.Vehicle if has_parameters(port) else WithoutParameters
    return dronekit.connect(f"udpout:127.0.0.1:{port}", heartbeat_timeout=30, vehicle_class=kind,
                            **more)
