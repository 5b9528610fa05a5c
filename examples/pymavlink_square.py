"""A square of 2 m with pymavlink: upload, arm, start, wait, land. Connects where its argument says:

    haltere-sim lockstep --speed 5 &          # a vehicle; or a real companion
    python pymavlink_square.py udpin:127.0.0.1:14550
"""

import os
import sys
import time

os.environ["MAVLINK20"] = "1"
from pymavlink import mavutil  # noqa: E402

MAV = mavutil.mavlink
NAN = float("nan")
HEIGHT_M = 1.2


def item(command, north=0.0, east=0.0, height=0.0, params=(0, 0, 0, NAN)):
    """Local NED in the integers of MISSION_ITEM_INT: metres times 10000."""
    return command, params, round(north * 1e4), round(east * 1e4), -height


CORNERS = [(4.0, 4.0), (4.0, 6.0), (6.0, 6.0), (6.0, 4.0), (4.0, 4.0)]
MISSION = [item(MAV.MAV_CMD_NAV_TAKEOFF, 5.0, 5.0, HEIGHT_M)]
MISSION += [item(MAV.MAV_CMD_NAV_WAYPOINT, north, east, HEIGHT_M, (1.0, 0.4, 0, NAN))
            for north, east in CORNERS]
MISSION += [item(MAV.MAV_CMD_NAV_LAND, 4.0, 4.0)]


class Vehicle:
    def __init__(self, address):
        self.link = mavutil.mavlink_connection(address, source_system=255)
        self.beat_at = 0.0
        self.wait("HEARTBEAT", 20)
        self.link.target_system = self.link.target_component = 1

    def beat(self):
        self.beat_at = time.monotonic()
        self.link.mav.heartbeat_send(MAV.MAV_TYPE_GCS, MAV.MAV_AUTOPILOT_INVALID, 0, 0, 4)

    def receive(self):
        if time.monotonic() - self.beat_at > 1.0:  # the companion flies on without; others may not
            self.beat()
        message = self.link.recv_match(blocking=True, timeout=0.2)
        if message is not None and message.get_type() == "HEARTBEAT":
            self.beat()  # as often as the vehicle's, whose second may be shorter: --speed
        if message is not None and message.get_type() == "STATUSTEXT":
            print("vehicle:", message.text)
        return message

    def wait(self, name, seconds, when=lambda m: True):
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            message = self.receive()
            if message is not None and message.get_type() == name and when(message):
                return message
        sys.exit(f"no {name} within {seconds} s")

    def command(self, command, *params):
        params = [*params, *[0.0] * (7 - len(params))]
        self.link.mav.command_long_send(1, 1, command, 0, *params)
        return self.wait("COMMAND_ACK", 5, lambda m: m.command == command).result

    def upload(self, items):
        self.link.mav.mission_count_send(1, 1, len(items), MAV.MAV_MISSION_TYPE_MISSION)
        end = time.monotonic() + 10
        while time.monotonic() < end:
            message = self.receive()
            kind = message.get_type() if message else ""
            if kind in ("MISSION_REQUEST_INT", "MISSION_REQUEST"):
                command, params, x, y, z = items[message.seq]
                self.link.mav.mission_item_int_send(
                    1, 1, message.seq, MAV.MAV_FRAME_LOCAL_NED, command, 0, 1, *params, x, y, z,
                    MAV.MAV_MISSION_TYPE_MISSION)
            elif kind == "MISSION_ACK":
                return message.type
        sys.exit("the upload was not answered")


def is_armed(beat):
    return beat.get_srcComponent() == 1 and beat.base_mode & MAV.MAV_MODE_FLAG_SAFETY_ARMED


def main(address):
    vehicle = Vehicle(address)
    assert vehicle.upload(MISSION) == MAV.MAV_MISSION_ACCEPTED
    while vehicle.command(MAV.MAV_CMD_COMPONENT_ARM_DISARM, 1) != MAV.MAV_RESULT_ACCEPTED:
        time.sleep(0.5)  # it says why: most likely the filter is not aligned yet
    assert vehicle.command(MAV.MAV_CMD_MISSION_START) == MAV.MAV_RESULT_ACCEPTED
    vehicle.wait("HEARTBEAT", 10, is_armed)
    for seq in range(1, len(CORNERS) + 1):
        vehicle.wait("MISSION_ITEM_REACHED", 60, lambda m: m.seq >= seq)
        print("reached", CORNERS[seq - 1])
    vehicle.wait("HEARTBEAT", 60, lambda m: m.get_srcComponent() == 1 and not is_armed(m))
    print("landed")


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else "udpin:127.0.0.1:14550")
