"""QGroundControl's message sequence, played from its sources (STATIONS.md), against identity px4.

It sees a quadrotor of PX4's: with vehicle type 2 the take-off button exists."""

import time

import pytest

from haltere_testing.rig import degrees, wait_until
from haltere_testing.station import NAN, Station, local_item, mavlink, of_vehicle

SPEED = 2

ACCEPTED = mavlink.MAV_RESULT_ACCEPTED


@pytest.fixture(scope="module")
def qgc(rig):
    station = Station(f"udpout:127.0.0.1:{rig.ports['px4']}", 255, 190)
    yield station
    station.close()


def set_mode(qgc, main, sub):
    """It sends SET_MODE and waits 1.3 s, three times."""
    number = main << 16 | sub << 24
    qgc.catch_up()
    for _ in range(3):
        qgc.link.mav.set_mode_send(1, mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED, number)
        deadline = time.monotonic() + 1.3
        while time.monotonic() < deadline:
            message = qgc.receive(0.1)
            if message and message.get_type() == "HEARTBEAT" and of_vehicle(message):
                if message.custom_mode == number:
                    return
    raise AssertionError(f"Vehicle not changing to {main}/{sub}; {qgc.texts[-8:]}")


def test_initial_connect(qgc):
    assert qgc.request(148) == ACCEPTED
    version = qgc.wait("AUTOPILOT_VERSION")
    assert version.capabilities & mavlink.MAV_PROTOCOL_CAPABILITY_COMMAND_INT
    index, count = 1, 1
    while index <= count:
        assert qgc.request(435, index) == ACCEPTED
        count = qgc.wait("AVAILABLE_MODES", when=lambda m: m.mode_index == index).number_modes
        index += 1
    assert count == 7
    # What it asks of everybody it meets is answered at once, also with no.
    for msg_id in (397, 395, 300):
        assert qgc.request(msg_id) in (ACCEPTED, mavlink.MAV_RESULT_UNSUPPORTED)
    qgc.wait("HOME_POSITION", 40)
    status = qgc.wait("SYS_STATUS")
    # So "set estimator origin" is offered.
    assert not status.onboard_control_sensors_present & mavlink.MAV_SYS_STATUS_SENSOR_GPS


def test_parameters_fence_and_rally_are_read_as_it_reads_them(qgc):
    # The hash first, then the list, asked of component 0.
    qgc.catch_up()
    qgc.link.mav.param_request_read_send(1, 1, b"_HASH_CHECK", -1)
    assert qgc.wait("PARAM_VALUE", 1.0, lambda m: m.param_id == "_HASH_CHECK").param_index == 65535
    qgc.link.mav.param_request_list_send(1, 0)
    found, count = {}, None
    deadline = time.monotonic() + 5
    while time.monotonic() < deadline and (count is None or len(found) < count):
        message = qgc.receive(0.05)
        if message and message.get_type() == "PARAM_VALUE" and message.param_index != 65535:
            found[message.param_index], count = message.param_id, message.param_count
    assert count and len(found) == count, (len(found), count)
    assert {"MIS_TAKEOFF_ALT", "RTL_RETURN_ALT", "SYS_AUTOSTART"} <= set(found.values())
    for mission_type in (mavlink.MAV_MISSION_TYPE_FENCE, mavlink.MAV_MISSION_TYPE_RALLY):
        qgc.link.mav.mission_request_list_send(1, 1, mission_type)
        answer = qgc.wait("MISSION_COUNT", 1.5, lambda m, t=mission_type: m.mission_type == t)
        assert answer.count == 0


def test_takeoff_before_arming_goto_and_pause(rig, qgc):
    qgc.wait("SYS_STATUS", 40,
             lambda m: m.onboard_control_sensors_health & mavlink.MAV_SYS_STATUS_PREARM_CHECK)
    # Take-off, metres above sea level, before arming; then it arms on the acknowledgement.
    result = qgc.command(mavlink.MAV_CMD_NAV_TAKEOFF, -1, 0, 0, NAN, NAN, NAN, 1.2)
    assert result == ACCEPTED, qgc.texts
    qgc.arm(40, 0)
    qgc.wait("EXTENDED_SYS_STATE", 20,
             lambda m: m.landed_state == mavlink.MAV_LANDED_STATE_IN_AIR)
    wait_until(lambda: rig.height() > 1.0, 20, rig)
    # Goto: COMMAND_INT, frame GLOBAL, above sea level.
    lat, lon = degrees(5.8, 5.4)
    result = qgc.command_int(mavlink.MAV_CMD_DO_REPOSITION, mavlink.MAV_FRAME_GLOBAL,
                             round(lat * 1e7), round(lon * 1e7), 1.3, (-1, 1, 0, NAN))
    assert result == ACCEPTED, qgc.texts
    wait_until(lambda: rig.distance(5.8, 5.4) < 0.4, 20, rig)
    # Change of altitude: no latitude, no longitude.
    result = qgc.command(mavlink.MAV_CMD_DO_REPOSITION, -1, 1, 0, NAN, NAN, NAN, 0.9)
    assert result == ACCEPTED, qgc.texts
    wait_until(lambda: abs(rig.height() - 0.9) < 0.3, 15, rig)
    # Pause: nothing at all.
    assert qgc.command(mavlink.MAV_CMD_DO_REPOSITION, -1, 1, 0, NAN, NAN, NAN, NAN) == ACCEPTED
    qgc.wait_mode(4, 3)


def test_commands_are_acknowledged_in_time_while_flying(rig, qgc):
    latencies = []
    for n in range(100):
        began = time.monotonic()
        assert qgc.request(436) == ACCEPTED
        latencies.append(time.monotonic() - began)
    latencies.sort()
    # Here the half of them, for the real threads and sockets; in `test_timing.py` all of them, where nobody
    # else uses the machine's time.
    assert latencies[50] < 0.05, latencies
    print(f"acknowledged: median {latencies[50] * 1e3:.1f} ms, 99 % {latencies[98] * 1e3:.1f} ms")


def test_mission_mode_while_flying_return_and_land(rig, qgc):
    items = [local_item(mavlink.MAV_CMD_NAV_TAKEOFF, 0, 0, 1.0),
             local_item(mavlink.MAV_CMD_NAV_WAYPOINT, 5.4, 5.0, 1.0),
             local_item(mavlink.MAV_CMD_NAV_WAYPOINT, 5.0, 5.4, 1.0)]
    qgc.upload(items)
    set_mode(qgc, 4, 4)
    qgc.wait("MISSION_ITEM_REACHED", 40, lambda m: m.seq == 2)
    set_mode(qgc, 4, 5)
    qgc.wait_disarmed(60)
    rig.assert_landed()


def test_mission_is_started_disarmed_then_armed(rig, qgc):
    qgc.wait("SYS_STATUS", 40,
             lambda m: m.onboard_control_sensors_health & mavlink.MAV_SYS_STATUS_PREARM_CHECK)
    # As it draws them: above home, degrees times 1e7.
    relative = mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT

    def drawn(command, north, east, height):
        lat, lon = degrees(north, east)
        return (relative, command, [0, 0, 0, NAN], round(lat * 1e7), round(lon * 1e7), height)

    items = [drawn(mavlink.MAV_CMD_NAV_TAKEOFF, 5.0, 5.0, 0.9),
             drawn(mavlink.MAV_CMD_NAV_WAYPOINT, 5.3, 5.2, 0.9),
             drawn(mavlink.MAV_CMD_NAV_LAND, 5.3, 5.2, 0)]
    qgc.upload(items)
    set_mode(qgc, 4, 4)
    assert rig.truth()["on_ground"] == 1
    qgc.arm(40, 0)
    qgc.wait("MISSION_ITEM_REACHED", 40, lambda m: m.seq == 1)
    qgc.wait_disarmed(60)
    rig.assert_landed()


def test_forced_arming_skips_no_check_and_emergency_stop_works(rig, qgc):
    qgc.arm(40, 2989)
    # Emergency stop on the floor.
    assert qgc.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 0, 21196) == ACCEPTED
    qgc.wait_disarmed()
    rig.assert_landed()


def test_origin_events_and_joystick_as_it_does(rig, qgc):
    # "Set estimator origin": the message, and GPS_GLOBAL_ORIGIN back.
    qgc.catch_up()
    lat, lon = round(0.5e7), round(0.5e7)
    qgc.link.mav.set_gps_global_origin_send(1, lat, lon, 0)
    origin = qgc.wait("GPS_GLOBAL_ORIGIN", 5)
    assert (origin.latitude, origin.longitude) == (lat, lon)
    # Events come without asking, and it asks for the report of the checks.
    sequence = qgc.wait("CURRENT_EVENT_SEQUENCE", 5).sequence
    assert qgc.command(mavlink.MAV_CMD_RUN_PREARM_CHECKS) == ACCEPTED
    report = qgc.wait("EVENT", 5)
    assert report.id >> 24 == 1 and (report.sequence - sequence) % 65536 < 100
    # Its joystick: 25 times a second, x and y -1000 to 1000, z 0 to 1000.
    qgc.arm(40.0)
    assert qgc.command(mavlink.MAV_CMD_NAV_TAKEOFF, -1, 0, 0, NAN, NAN, NAN, 1.0) == ACCEPTED
    wait_until(lambda: (qgc.drain(0.1), rig.height() > 0.8)[1], 25, rig)
    qgc.wait_mode(4, 3, 20)

    def stick(x, seconds):
        until = time.monotonic() + seconds
        while time.monotonic() < until:
            qgc.link.mav.manual_control_send(1, x, 0, 500, 0, 0)
            qgc.drain(0.04)

    stick(0, 0.3)
    set_mode(qgc, 3, 0)
    north = rig.truth()["pos_E_x_m"]
    stick(600, 3.0)
    assert rig.truth()["pos_E_x_m"] > north + 0.4
    stick(0, 1.0)
    set_mode(qgc, 4, 6)
    qgc.wait_disarmed(60)
    rig.assert_landed()
