"""An angle step over real wires: flown as asked, ended by itself, refused where it must be."""

import math
import time

from conftest import from_autopilot, is_armed, mavlink, patience

NAN = float("nan")
PITCH = 1
# Forward drag of the simulated vehicle is near 4 1/s: 22 degrees end at about 1 m/s.
ANGLE_DEG = -22.0


def item(command, *params, x=0.0, y=0.0, z=0.0):
    params = list(params) + [0.0] * (4 - len(params))
    return command, params, x, y, z


def tilt(angle_deg, duration_s, beyond=0.0):
    return item(mavlink.MAV_CMD_USER_2, PITCH, angle_deg, duration_s, beyond)


def test_a_step_beyond_the_limit_needs_the_flag(world):
    assert world.upload([tilt(-50.0, 2.0)]) == mavlink.MAV_MISSION_INVALID
    world.said("tilt_deg = 45.0")
    # With it the thrust is looked at: 0.916 of full throttle carries 52 degrees on a full battery.
    assert world.upload([tilt(-53.0, 2.0, 1.0)]) == mavlink.MAV_MISSION_INVALID
    world.said("1 to 52 deg")


def test_a_step_is_flown_and_ends_by_itself(world):
    mission = [
        item(mavlink.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, NAN, z=-2.5),
        item(mavlink.MAV_CMD_NAV_WAYPOINT, 1.0, 0, 0, 0.0, x=2.0, y=5.0, z=-2.5),
        tilt(ANGLE_DEG, 2.5),
        item(mavlink.MAV_CMD_NAV_LAND, 0, 0, 0, NAN),
    ]
    assert world.upload(mission) == mavlink.MAV_MISSION_ACCEPTED, world.texts
    downloaded = world.download()
    assert downloaded[2].command == mavlink.MAV_CMD_USER_2
    assert abs(downloaded[2].param2 - ANGLE_DEG) < 1e-6
    world.arm()
    assert world.command(mavlink.MAV_CMD_MISSION_START) == mavlink.MAV_RESULT_ACCEPTED
    world.wait("MISSION_ITEM_REACHED", 60, lambda m: m.seq == 1)
    rows = []
    deadline = time.monotonic() + patience(60)
    while True:
        assert time.monotonic() < deadline, world.texts
        message = world.receive()
        rows.append(world.truth())
        if message and message.get_type() == "MISSION_ITEM_REACHED" and message.seq == 2:
            break

    def pitch_deg(row):
        w, x, y, z = (row[f"q_EB_{k}"] for k in "wxyz")
        return math.degrees(math.asin(max(-1.0, min(1.0, 2 * (w * y - x * z)))))

    steepest = min(pitch_deg(row) for row in rows)
    fastest = max(math.hypot(row["vel_E_x_mps"], row["vel_E_y_mps"]) for row in rows)
    assert -27.0 < steepest < -18.0, steepest
    assert 0.7 < fastest < 1.5, fastest
    assert all(abs(row["pos_E_z_m"] + 2.5) < 0.6 for row in rows)
    assert all(abs(row["pos_E_y_m"] - 5.0) < 0.6 for row in rows)
    # It has stopped; the truth file is written with some delay.
    world.drain(1.5)
    last = world.truth()
    assert math.hypot(last["vel_E_x_mps"], last["vel_E_y_mps"]) < 0.7, last
    world.wait("HEARTBEAT", 40, lambda m: from_autopilot(m) and not is_armed(m))
    assert world.truth()["crashed"] == 0
