"""Several stations at once: identity, links, streams, origin, routing, robustness. Never armed."""

import random
import socket
import struct
import time

import pytest

from haltere_testing.rig import ORIGIN, degrees
from haltere_testing.station import NAN, Station, is_armed, mavlink, of_vehicle

ACCEPTED = mavlink.MAV_RESULT_ACCEPTED
REPLAY = True


@pytest.fixture(scope="module")
def one(rig):
    station = Station(f"udpout:127.0.0.1:{rig.ports['generic']}")
    yield station
    station.close()


@pytest.fixture(scope="module")
def px4(rig):
    station = Station(f"udpout:127.0.0.1:{rig.ports['px4']}", 254)
    yield station
    station.close()


@pytest.fixture(scope="module")
def gps(rig):
    station = Station(f"udpout:127.0.0.1:{rig.ports['gps']}", 253)
    station.wait("LOCAL_POSITION_NED", 40)  # aligned: from here on there are positions
    yield station
    station.close()


def test_identity_is_of_the_endpoint(one, px4):
    beat = one.heartbeat
    assert (beat.type, beat.autopilot) == (mavlink.MAV_TYPE_FLAPPING_WING,
                                           mavlink.MAV_AUTOPILOT_GENERIC)
    beat = px4.heartbeat
    assert (beat.type, beat.autopilot) == (mavlink.MAV_TYPE_QUADROTOR, mavlink.MAV_AUTOPILOT_PX4)
    assert one.request(148) == ACCEPTED
    version = one.wait("AUTOPILOT_VERSION")
    for bit in ("MISSION_INT", "COMMAND_INT", "SET_POSITION_TARGET_LOCAL_NED",
                "SET_POSITION_TARGET_GLOBAL_INT", "MAVLINK2"):
        assert version.capabilities & getattr(mavlink, f"MAV_PROTOCOL_CAPABILITY_{bit}"), bit
    assert not version.capabilities & mavlink.MAV_PROTOCOL_CAPABILITY_SET_ATTITUDE_TARGET
    # The older way, and the version that QGroundControl wants of a PX4: at least 1.4.1.
    assert px4.command(mavlink.MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES, 1) == ACCEPTED
    assert px4.wait("AUTOPILOT_VERSION").flight_sw_version >> 8 >= 0x010401


def test_modes_are_listed_one_by_one_and_all_at_once(one):
    assert one.request(435, 1) == ACCEPTED
    first = one.wait("AVAILABLE_MODES")
    names = {}
    for index in range(1, first.number_modes + 1):
        assert one.request(435, index) == ACCEPTED
        mode = one.wait("AVAILABLE_MODES", when=lambda m, i=index: m.mode_index == i)
        names[mode.mode_name] = (mode.custom_mode, mode.standard_mode)
    assert names["Hold"] == (4 << 16 | 3 << 24, 0)
    assert names["Offboard"] == (6 << 16, 0)
    assert names["Mission"] == (4 << 16 | 4 << 24, mavlink.MAV_STANDARD_MODE_MISSION)
    # As stations/custom_mode_map.json has it for this identity.
    assert names["RTL"] == (4 << 16 | 5 << 24, mavlink.MAV_STANDARD_MODE_SAFE_RECOVERY)
    assert one.request(435, first.number_modes + 1) == mavlink.MAV_RESULT_DENIED
    one.link.mav.command_long_send(1, 1, mavlink.MAV_CMD_REQUEST_MESSAGE, 0, 435, 0, 0, 0, 0, 0, 0)
    got = [m for m in one.drain(1.0) if m.get_type() == "AVAILABLE_MODES"]
    assert len(got) == first.number_modes


def test_modes_that_cannot_be_are_refused_in_words(one):
    one.texts.clear()
    assert one.mode(1) == mavlink.MAV_RESULT_DENIED
    assert one.command(mavlink.MAV_CMD_DO_SET_MODE, 0, 4, 3) == mavlink.MAV_RESULT_DENIED
    assert one.command(mavlink.MAV_CMD_DO_SET_MODE, NAN, 4, 3) == mavlink.MAV_RESULT_DENIED
    assert one.command(mavlink.MAV_CMD_DO_SET_STANDARD_MODE, 1) == mavlink.MAV_RESULT_FAILED
    # Both forms of the number.
    assert one.mode(4, 3) == ACCEPTED
    assert one.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 4 << 16 | 3 << 24, 0) == ACCEPTED
    assert one.mode(6) == mavlink.MAV_RESULT_TEMPORARILY_REJECTED
    one.drain(0.3)
    assert any("no mode with main 1 sub 0" in t for t in one.texts), one.texts
    assert any("send setpoints first" in t for t in one.texts), one.texts


def test_streams_come_unasked_and_say_the_same(one, gps):
    messages = gps.drain(3.5)
    names = {m.get_type() for m in messages if of_vehicle(m)}
    wanted = {"HEARTBEAT", "SYS_STATUS", "ATTITUDE", "ATTITUDE_QUATERNION", "LOCAL_POSITION_NED",
              "GLOBAL_POSITION_INT", "VFR_HUD", "ALTITUDE", "BATTERY_STATUS", "EXTENDED_SYS_STATE",
              "ESTIMATOR_STATUS", "ODOMETRY", "LOCAL_POSITION_NED_COV", "MISSION_CURRENT",
              "HOME_POSITION", "CURRENT_MODE", "GPS_RAW_INT", "HALTERE_LINK"}
    assert wanted <= names, sorted(wanted - names)
    assert "GPS_RAW_INT" not in {m.get_type() for m in one.drain(1.5)}
    by_name = {m.get_type(): m for m in messages if of_vehicle(m)}
    local, globe = by_name["LOCAL_POSITION_NED"], by_name["GLOBAL_POSITION_INT"]
    lat, lon = degrees(local.x, local.y)
    assert abs(globe.lat * 1e-7 - lat) * 110575 < 0.1 and abs(globe.lon * 1e-7 - lon) * 111315 < 0.1
    # Origin altitude 0: above sea level and above home are one number.
    assert globe.alt == globe.relative_alt and abs(globe.alt / 1000 + local.z) < 0.1
    assert abs(by_name["VFR_HUD"].alt + local.z) < 0.1
    odometry, cov = by_name["ODOMETRY"], by_name["LOCAL_POSITION_NED_COV"]
    assert (odometry.frame_id, odometry.child_frame_id) == (mavlink.MAV_FRAME_LOCAL_NED,
                                                            mavlink.MAV_FRAME_BODY_FRD)
    assert 0 < odometry.pose_covariance[0] < 1 and 0 < cov.covariance[0] < 1
    assert by_name["GPS_RAW_INT"].fix_type == mavlink.GPS_FIX_TYPE_3D_FIX
    assert by_name["EXTENDED_SYS_STATE"].landed_state == mavlink.MAV_LANDED_STATE_ON_GROUND


def test_health_bits_tell_the_truth(one, gps):
    status = gps.wait("SYS_STATUS")
    bit = mavlink.MAV_SYS_STATUS_SENSOR_GPS
    assert status.onboard_control_sensors_present & bit
    status = one.wait("SYS_STATUS", 20,
                      lambda m: m.onboard_control_sensors_health & mavlink.MAV_SYS_STATUS_PREARM_CHECK)
    assert not status.onboard_control_sensors_present & bit
    assert not status.onboard_control_sensors_present & mavlink.MAV_SYS_STATUS_SENSOR_3D_MAG
    for name in ("SENSOR_3D_GYRO", "SENSOR_3D_ACCEL", "SENSOR_VISION_POSITION", "GEOFENCE", "AHRS",
                 "SENSOR_BATTERY"):
        bit = getattr(mavlink, f"MAV_SYS_STATUS_{name}")
        assert status.onboard_control_sensors_health & bit, name


def test_streams_of_one_station_are_not_anothers(one, gps):
    assert one.command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, 30, -1) == ACCEPTED
    one.drain(0.3)
    assert not [m for m in one.drain(1.0) if m.get_type() == "ATTITUDE"]
    gps.drain(0.3)
    assert [m for m in gps.drain(1.0) if m.get_type() == "ATTITUDE"]
    assert one.command(mavlink.MAV_CMD_GET_MESSAGE_INTERVAL, 30) == ACCEPTED
    assert one.wait("MESSAGE_INTERVAL", 2, lambda m: m.message_id == 30).interval_us == -1
    assert one.command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, 30, 0) == ACCEPTED
    assert one.command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, 31999, 1000) == mavlink.MAV_RESULT_DENIED
    # The heartbeat cannot be switched off.
    assert one.command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, 0, -1) == ACCEPTED
    assert [m for m in one.drain(2.5) if m.get_type() == "HEARTBEAT" and of_vehicle(m)]


def test_origin_and_home_both_ways(one, gps):
    home = gps.wait("HOME_POSITION", 10)
    assert abs(home.x - 5.0) < 0.5 and abs(home.y - 5.0) < 0.5 and home.z == 0
    lat, lon = degrees(home.x, home.y)
    assert abs(home.latitude * 1e-7 - lat) < 1e-7 * 10 and abs(home.longitude * 1e-7 - lon) < 1e-6
    # Another origin: every station is told at once, and positions follow.
    place = (round(47.397742e7), round(8.545594e7), 488_000)
    one.catch_up()
    gps.catch_up()
    one.link.mav.set_gps_global_origin_send(1, *place)
    for station in (one, gps):
        origin = station.wait("GPS_GLOBAL_ORIGIN", 2, lambda m: m.latitude == place[0])
        assert (origin.longitude, origin.altitude) == place[1:]
    globe = gps.wait("GLOBAL_POSITION_INT", 3, lambda m: m.lat > 470000000)
    assert abs(globe.alt - globe.relative_alt - 488_000) < 20
    one.texts.clear()
    one.link.mav.set_gps_global_origin_send(1, round(91e7), 0, 0)
    one.said("latitude within 90")
    one.catch_up()
    one.link.mav.set_gps_global_origin_send(1, round(ORIGIN[0] * 1e7), round(ORIGIN[1] * 1e7), 0)
    one.wait("GPS_GLOBAL_ORIGIN", 2, lambda m: m.latitude == round(ORIGIN[0] * 1e7))
    # Home by command: a point, and here.
    lat, lon = degrees(4.0, 6.0)
    where = (round(lat * 1e7), round(lon * 1e7), 0.0)
    gps.catch_up()
    set_home = mavlink.MAV_CMD_DO_SET_HOME
    assert one.command_int(set_home, mavlink.MAV_FRAME_GLOBAL, *where, (0, 0, 0, 0)) == ACCEPTED
    moved = gps.wait("HOME_POSITION", 5, lambda m: abs(m.x - 4.0) < 0.03)
    assert abs(moved.y - 6.0) < 0.03
    far = (round(46e7), round(8e7), 0.0)
    assert (one.command_int(set_home, mavlink.MAV_FRAME_GLOBAL, *far, (0, 0, 0, 0))
            == mavlink.MAV_RESULT_DENIED)
    assert one.command(set_home, 1, 0, 0, 0, 0, 0, 0) == ACCEPTED


def test_commands_refused_with_the_reason(one):
    reposition = mavlink.MAV_CMD_DO_REPOSITION
    lat, lon = degrees(5, 5)
    x, y = round(lat * 1e7), round(lon * 1e7)
    assert (one.command_int(reposition, mavlink.MAV_FRAME_LOCAL_ENU, x, y, 1.0)
            == mavlink.MAV_RESULT_COMMAND_UNSUPPORTED_MAV_FRAME)
    assert (one.command_int(reposition, mavlink.MAV_FRAME_GLOBAL, x, y, 1.0)
            == mavlink.MAV_RESULT_TEMPORARILY_REJECTED)
    assert (one.command_int(reposition, mavlink.MAV_FRAME_GLOBAL, x, y, 50.0)
            == mavlink.MAV_RESULT_DENIED)
    one.texts.clear()
    arm = mavlink.MAV_CMD_COMPONENT_ARM_DISARM
    assert one.command(arm, NAN) == mavlink.MAV_RESULT_DENIED
    assert one.command(arm, 2) == mavlink.MAV_RESULT_DENIED
    assert one.command(arm, 0) == ACCEPTED
    assert one.command(mavlink.MAV_CMD_DO_CHANGE_SPEED, 1, 900) == mavlink.MAV_RESULT_DENIED
    assert one.command(mavlink.MAV_CMD_CONDITION_YAW, 90) == mavlink.MAV_RESULT_TEMPORARILY_REJECTED
    assert one.command(mavlink.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, 0, 0, 0, 99) == mavlink.MAV_RESULT_DENIED
    assert one.command(mavlink.MAV_CMD_DO_PAUSE_CONTINUE, 7) == mavlink.MAV_RESULT_DENIED
    assert one.command(mavlink.MAV_CMD_MISSION_START) == mavlink.MAV_RESULT_DENIED
    assert one.command(mavlink.MAV_CMD_DO_DIGICAM_CONTROL) == mavlink.MAV_RESULT_UNSUPPORTED
    assert one.request(31999) == mavlink.MAV_RESULT_UNSUPPORTED
    one.drain(0.3)
    for says in ("allowed 1 to arm", "900 m/s, allowed 0.05", "take-off height = 99.00",
                 "no mission: upload one first"):
        assert any(says in t for t in one.texts), (says, one.texts)


def test_setpoints_that_cannot_be_followed_are_said_once(one):
    one.mode(6)
    one.texts.clear()
    for _ in range(5):
        one.link.mav.set_attitude_target_send(0, 1, 1, 7, [1, 0, 0, 0], 0, 0, 0, 0.5)
    one.drain(0.5)
    assert len([t for t in one.texts if "SET_ATTITUDE_TARGET refused" in t]) <= 1
    assert one.mode(6) == mavlink.MAV_RESULT_TEMPORARILY_REJECTED


def test_time_and_ping_are_answered(one):
    sent = time.time_ns()
    one.link.mav.timesync_send(0, sent)
    assert one.wait("TIMESYNC", 2, lambda m: m.ts1 == sent).tc1 > 0
    one.link.mav.ping_send(1234, 77, 0, 0)
    pong = one.wait("PING", 2, lambda m: m.seq == 77)
    assert (pong.time_usec, pong.target_system, pong.target_component) == (1234, 255, 190)
    # An answer to somebody is no question.
    one.link.mav.ping_send(1234, 78, 1, 1)
    assert not [m for m in one.drain(0.5) if m.get_type() == "PING" and m.seq == 78]


def test_tcp_stations_come_and_go(rig):
    address = f"tcp:127.0.0.1:{rig.ports['tcp']}"
    first, second = Station(address, 240), Station(address, 241)
    assert first.mode(4, 3) == ACCEPTED and second.mode(4, 3) == ACCEPTED
    first.close()
    assert second.mode(4, 3) == ACCEPTED
    second.said("left: ")
    second.close()
    third = Station(address, 242)
    assert third.mode(4, 3) == ACCEPTED
    third.close()


def test_sequences_count_per_link(one, gps):
    for station in (one, gps):
        station.drain(0.5)
        numbers = [m.get_seq() for m in station.drain(2.0) if of_vehicle(m)]
        gaps = [b for a, b in zip(numbers, numbers[1:]) if (a + 1) % 256 != b]
        assert not gaps, f"{len(gaps)} gaps of {len(numbers)}"


def raw_frame(msg_id, payload, system, component, sequence):
    """A MAVLink 2 frame of an id that no dialect of ours knows, with some checksum."""
    head = bytes([len(payload), 0, 0, sequence, system, component]) + struct.pack("<I", msg_id)[:3]
    crc = mavlink.x25crc(head + payload)
    crc.accumulate(b"\x55")
    return b"\xfd" + head + payload + struct.pack("<H", crc.crc)


def test_unknown_messages_pass_between_stations(rig, one, gps):
    payload = bytes(range(1, 20))
    frame = raw_frame(31337, payload, 255, 190, 9)
    one.drain(0.1)
    gps.drain(0.1)
    one.link.write(frame)
    deadline = time.monotonic() + 10
    seen = b""
    gps.link.port.setblocking(False)
    while time.monotonic() < deadline and frame not in seen:
        try:
            seen += gps.link.port.recv(65536)
        except BlockingIOError:
            time.sleep(0.01)
    assert frame in seen, "it did not come through"
    # Heartbeats of the others pass too, but never back to their sender.
    beats = []
    for _ in range(25):
        one.beat()
        beats += [m for m in gps.drain(0.1) if m.get_type() == "HEARTBEAT" and not of_vehicle(m)]
    assert 255 in {m.get_srcSystem() for m in beats}
    assert 253 not in {m.get_srcSystem() for m in beats}
    # What is for one system goes there only, and not to us.
    one.link.mav.command_long_send(253, 0, 520, 0, *[0.0] * 7)
    got = gps.wait("COMMAND_LONG", 2)
    assert (got.target_system, got.command) == (253, 520)


def test_nine_stations_fill_the_table_and_it_is_said(rig, gps):
    sockets = [socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(9)]
    beat = mavlink.MAVLink(None, 200, 1).heartbeat_encode(6, 8, 0, 0, 4)
    frame = beat.pack(mavlink.MAVLink(None, 200, 1))
    gps.texts.clear()
    for s in sockets:
        s.sendto(frame, ("127.0.0.1", rig.ports["px4"]))
    gps.said("a station found no place")
    links, full = set(), 0
    deadline = time.monotonic() + 40
    while time.monotonic() < deadline and not (full and len(links) >= 9):
        message = gps.receive()
        if message and message.get_type() == "HALTERE_LINK":
            links.add(message.link)
        elif message and message.get_type() == "HALTERE_DROPS" and message.reason == "stations_full":
            full = message.count
    assert full >= 1
    assert len(links) >= 9, links  # eight there, and others
    for s in sockets:
        s.close()


def test_random_bytes_hostile_lengths_and_reordered_packets(rig, one):
    rng = random.Random(7)
    target = ("127.0.0.1", rig.ports["generic"])
    noise = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    for n in range(600):
        kind = n % 4
        if kind == 0:
            data = rng.randbytes(rng.randrange(1, 1400))
        elif kind == 1:  # a head that promises more than there is, or nonsense behind it
            data = bytes([0xFD, rng.randrange(256), 0, 0, n % 256, 255, 190]) + rng.randbytes(
                rng.randrange(0, 300))
        elif kind == 2:  # right checksum, every target and value
            mav = mavlink.MAVLink(None, 255, 190)
            message = mav.command_long_encode(
                rng.choice([0, 1, 2, 255]), rng.choice([0, 1, 191]), rng.randrange(65536), 0,
                *[struct.unpack("<f", rng.randbytes(4))[0] for _ in range(7)])
            # Not what arms, and no failures of the board.
            if message.command in (400, 420):
                continue
            data = message.pack(mav)
        else:
            mav = mavlink.MAVLink(None, 255, 190)
            message = mav.set_position_target_local_ned_encode(
                0, 1, 1, rng.randrange(22), rng.randrange(65536),
                *[struct.unpack("<f", rng.randbytes(4))[0] for _ in range(11)])
            data = message.pack(mav)
        for copy in range(rng.choice([1, 1, 3])):
            noise.sendto(data, target)
        if n % 50 == 0:
            time.sleep(0.02)
    # Alive, at rest, and right. The queue of answers drains first.
    time.sleep(1.0)
    one.drain(1.0)
    assert one.mode(4, 3) == ACCEPTED
    beat = one.wait("HEARTBEAT", 3, of_vehicle)
    assert not is_armed(beat)
    assert rig.companion.poll() is None and "panicked" not in rig.said()
    truth = rig.truth()
    assert truth["on_ground"] == 1
    noise.close()
