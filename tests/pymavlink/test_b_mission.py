"""Missions: upload, read back, refusal of nonsense, flight."""

import math
import time

from conftest import from_autopilot, is_armed, mavlink, patience

NAN = float("nan")


def takeoff(height):
    return (mavlink.MAV_CMD_NAV_TAKEOFF, (0, 0, 0, NAN), 0.0, 0.0, -height)


def waypoint(north, east, height, hold=0.0):
    return (mavlink.MAV_CMD_NAV_WAYPOINT, (hold, 0, 0, NAN), north, east, -height)


LAND = (mavlink.MAV_CMD_NAV_LAND, (0, 0, 0, NAN), 0.0, 0.0, 0.0)
PLAN = [takeoff(1.0), waypoint(5.6, 5.0, 1.0, 0.5), waypoint(5.6, 5.4, 1.2), LAND]


def test_upload_is_read_back_unchanged(world):
    assert world.upload(PLAN) == mavlink.MAV_MISSION_ACCEPTED
    items = world.download()
    assert len(items) == len(PLAN)
    for item, (command, params, x, y, z) in zip(items, PLAN):
        assert item.command == command
        assert item.frame == mavlink.MAV_FRAME_LOCAL_NED
        assert (item.x, item.y) == (round(x * 1e4), round(y * 1e4))
        assert math.isclose(item.z, z, abs_tol=1e-6)
        assert item.param1 == params[0]


def test_a_point_outside_the_room_is_refused(world):
    far = [takeoff(1.0), waypoint(500.0, 5.0, 1.0), LAND]
    assert world.upload(far) != mavlink.MAV_MISSION_ACCEPTED
    # The good one is still there.
    assert len(world.download()) == len(PLAN)


def test_mission_is_flown(world):
    world.arm()
    result = world.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 4, 4)
    assert result == mavlink.MAV_RESULT_ACCEPTED
    reached = []
    peak = 0.0
    # A flight of 20 s; one that the vehicle breaks off before it has left the floor comes to no end here.
    deadline = time.monotonic() + patience(90)
    while True:
        assert time.monotonic() < deadline, (reached, peak, world.texts)
        message = world.receive(timeout=5)
        assert message is not None, "the vehicle fell silent"
        if message.get_type() == "MISSION_ITEM_REACHED":
            reached.append(message.seq)
        elif message.get_type() == "LOCAL_POSITION_NED":
            peak = max(peak, -message.z)
        elif message.get_type() == "HEARTBEAT" and from_autopilot(message):
            if peak > 0.5 and not is_armed(message):
                break
    assert reached[:3] == [0, 1, 2], (reached, world.texts)
    assert 1.0 < peak < 1.6, peak
    truth = world.truth()
    assert truth["crashed"] == 0 and truth["on_ground"] == 1, truth
    assert math.hypot(truth["pos_E_x_m"] - 5.6, truth["pos_E_y_m"] - 5.4) < 0.6, truth
