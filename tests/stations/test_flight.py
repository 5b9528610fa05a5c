"""Flying by setpoints and joystick with pymavlink; two stations disagree; packets get lost."""

import random
import socket
import threading
import time

import pytest

from haltere_testing.rig import degrees, wait_until
from haltere_testing.station import NAN, Station, local_item, mavlink

SPEED = 2

ACCEPTED = mavlink.MAV_RESULT_ACCEPTED
REJECTED = mavlink.MAV_RESULT_TEMPORARILY_REJECTED


@pytest.fixture(scope="module")
def one(rig):
    station = Station(f"udpout:127.0.0.1:{rig.ports['generic']}")
    yield station
    station.close()


@pytest.fixture(scope="module")
def two(rig):
    station = Station(f"udpout:127.0.0.1:{rig.ports['generic']}", 245)
    yield station
    station.close()


class Repeat:
    """Sends a message at 20 Hz."""

    def __init__(self, send):
        self.on, self.send = True, send
        self.thread = threading.Thread(target=self.run, daemon=True)
        self.thread.start()

    def run(self):
        while self.on:
            self.send()
            time.sleep(0.05)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.on = False
        self.thread.join()


def local(station, frame, mask, position=(0, 0, 0), velocity=(0, 0, 0), yaw=0.0, rate=0.0):
    station.link.mav.set_position_target_local_ned_send(
        0, 1, 1, frame, mask, *position, *velocity, 0, 0, 0, yaw, rate)


def take_off(rig, station, height=1.2):
    station.arm(40)
    result = station.command(mavlink.MAV_CMD_NAV_TAKEOFF, NAN, NAN, NAN, NAN, NAN, NAN, height)
    assert result == ACCEPTED, station.texts
    # Sent again because the answer was lost: granted, not refused.
    result = station.command(mavlink.MAV_CMD_NAV_TAKEOFF, NAN, NAN, NAN, NAN, NAN, NAN, height)
    assert result == ACCEPTED, station.texts
    station.wait_mode(4, 3, 25)


def test_offboard_in_global_frames(rig, one):
    take_off(rig, one)
    lat, lon = degrees(5.7, 5.0)

    def send():
        # Frame 6, above home: position and yaw.
        one.link.mav.set_position_target_global_int_send(
            0, 1, 1, mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT, 0x9F8, round(lat * 1e7),
            round(lon * 1e7), 1.2, 0, 0, 0, 0, 0, 0, 0, 0)

    with Repeat(send):
        time.sleep(0.3)
        assert one.mode(6) == ACCEPTED, one.texts
        one.wait_mode(6)
        wait_until(lambda: rig.distance(5.7, 5.0) < 0.35, 15, rig)


def test_a_position_sent_once_persists(rig, one):
    # As MAVProxy sends it: once, in the body frame.
    time.sleep(1.0)
    local(one, mavlink.MAV_FRAME_LOCAL_NED, 0x9F8, (5.2, 5.3, -1.2))
    wait_until(lambda: rig.distance(5.2, 5.3) < 0.35, 15, rig)
    one.drain(1.5)
    assert one.wait("HEARTBEAT").custom_mode == 6 << 16, "a goal is not a stream"


def test_body_velocity_with_yaw_rate_ends_in_hold_with_words(rig, one):
    one.texts.clear()
    with Repeat(lambda: local(one, mavlink.MAV_FRAME_BODY_NED, 0x5C7, velocity=(0.0, -0.3, 0.0),
                              rate=0.2)):
        one.drain(2.5)
    one.wait_mode(4, 3, 5)
    one.drain(0.5)
    assert any("setpoints stopped" in t for t in one.texts), one.texts


def test_another_client_does_not_take_the_setpoints(rig, one, two):
    here = rig.truth()
    goal = (here["pos_E_x_m"], here["pos_E_y_m"], -1.2)
    two.texts.clear()
    with Repeat(lambda: local(one, mavlink.MAV_FRAME_LOCAL_NED, 0x9F8, goal)):
        time.sleep(0.3)
        assert one.mode(6) == ACCEPTED
        with Repeat(lambda: local(two, mavlink.MAV_FRAME_LOCAL_NED, 0x9F8, (2.0, 2.0, -3.0))):
            for _ in range(20):
                one.drain(0.05)
                two.drain(0.05)
        assert rig.distance(*goal[:2]) < 0.6
        # But any station may stop it.
        assert two.mode(4, 3) == ACCEPTED
        one.wait_mode(4, 3)
    assert any("another client flies" in t for t in two.texts), two.texts


def test_joystick(rig, one, two):
    def sticks(station, x=0, y=0, z=500, r=0):
        station.link.mav.manual_control_send(1, x, y, z, r, 0)

    assert one.mode(3) == REJECTED
    before = rig.truth()
    with Repeat(lambda: sticks(one, y=700)):
        time.sleep(0.3)
        assert one.mode(3) == ACCEPTED, one.texts
        one.wait_mode(3)
        one.drain(2.0)
    after = rig.truth()
    moved = ((after["pos_E_x_m"] - before["pos_E_x_m"]) ** 2
             + (after["pos_E_y_m"] - before["pos_E_y_m"]) ** 2) ** 0.5
    assert 0.25 < moved < 2.0, moved
    # Let go: it stays, and the mode with it, as long as the joystick speaks.
    one.texts.clear()
    with Repeat(lambda: sticks(one)):
        time.sleep(0.2)
        assert one.mode(3) == ACCEPTED, one.texts
        one.drain(1.5)
        rest = rig.truth()
        one.drain(1.5)
        assert rig.distance(rest["pos_E_x_m"], rest["pos_E_y_m"]) < 0.4
    # Silent: hold.
    one.wait_mode(4, 3, 5)
    one.drain(0.5)
    assert any("joystick silent" in t for t in one.texts), one.texts


def test_speed_yaw_and_frames(rig, one):
    assert one.command(mavlink.MAV_CMD_DO_CHANGE_SPEED, 1, 0.4, -1) == ACCEPTED
    lat, lon = degrees(5.0, 5.0)
    for frame, x, y, z in (
            (mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT, round(lat * 1e7), round(lon * 1e7), 1.0),
            (mavlink.MAV_FRAME_GLOBAL_INT, round(lat * 1e7), round(lon * 1e7), 1.0),
            (mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT, round(lat * 1e7), round(lon * 1e7), 1.0),
            (mavlink.MAV_FRAME_LOCAL_NED, 50_000, 50_000, -1.0)):
        assert one.command_int(mavlink.MAV_CMD_DO_REPOSITION, frame, x, y, z) == ACCEPTED, frame
    wait_until(lambda: rig.distance(5.0, 5.0) < 0.4, 20, rig)
    # COMMAND_LONG has no frame: above home for this identity.
    result = one.command(mavlink.MAV_CMD_DO_REPOSITION, -1, 1, 0, NAN, *degrees(5.3, 5.0), 1.1)
    assert result == ACCEPTED, one.texts
    wait_until(lambda: rig.distance(5.3, 5.0) < 0.4, 20, rig)
    assert one.command(mavlink.MAV_CMD_CONDITION_YAW, 60, 20, 1, 0) == ACCEPTED
    one.wait("ATTITUDE", 15, lambda m: abs(m.yaw - 1.047) < 0.2)
    one.wait("VFR_HUD", 5, lambda m: abs(m.heading - 60) < 14)


def test_pause_continue_and_jump_in_a_mission(rig, one):
    way = mavlink.MAV_CMD_NAV_WAYPOINT
    items = [local_item(mavlink.MAV_CMD_NAV_TAKEOFF, 0, 0, 1.0), local_item(way, 6.2, 5.0, 1.0),
             local_item(way, 5.0, 5.0, 1.0)]
    one.upload(items)
    assert one.command(mavlink.MAV_CMD_MISSION_START, 0, 0) == ACCEPTED
    one.wait_mode(4, 4)
    one.drain(0.5)
    assert one.command(mavlink.MAV_CMD_DO_PAUSE_CONTINUE, 0) == ACCEPTED
    one.wait_mode(4, 3)
    assert one.command(mavlink.MAV_CMD_DO_SET_MISSION_CURRENT, 2) == ACCEPTED
    one.wait("MISSION_CURRENT", 5, lambda m: m.seq == 2)
    assert one.command(mavlink.MAV_CMD_DO_SET_MISSION_CURRENT, 7) == mavlink.MAV_RESULT_DENIED
    assert one.command(mavlink.MAV_CMD_DO_PAUSE_CONTINUE, 1) == ACCEPTED
    one.wait("MISSION_ITEM_REACHED", 30, lambda m: m.seq == 2)


class Lossy:
    """A UDP wire that loses one packet in ten, doubles some, and lets some overtake others."""

    def __init__(self, port, seed=3):
        self.rng = random.Random(seed)
        self.front = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.front.bind(("127.0.0.1", 0))
        self.port = self.front.getsockname()[1]
        self.back = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.back.connect(("127.0.0.1", port))
        self.client, self.on, self.held = None, True, {}
        self.lost = self.passed = 0
        for s in (self.front, self.back):
            s.settimeout(0.1)
        for source in (self.front, self.back):
            threading.Thread(target=self.carry, args=(source,), daemon=True).start()

    def carry(self, source):
        while self.on:
            try:
                if source is self.front:
                    data, self.client = source.recvfrom(65536)
                else:
                    data = source.recv(65536)
            except (TimeoutError, ConnectionError):
                continue
            self.passed += 1
            chance = self.rng.random()
            if chance < 0.10:
                self.lost += 1
                continue
            out = [data, data] if chance < 0.13 else [data]
            if chance > 0.97 and source not in self.held:
                self.held[source] = data  # comes after its successor
                continue
            if source in self.held:
                out.append(self.held.pop(source))
            for piece in out:
                if source is self.front:
                    self.back.send(piece)
                elif self.client:
                    self.front.sendto(piece, self.client)

    def close(self):
        self.on = False


def patiently(station, attempt, tries=8):
    """As stations do: the same again when no answer comes."""
    for _ in range(tries):
        try:
            return attempt()
        except AssertionError:
            continue
    raise AssertionError(f"no answer in {tries} tries; {station.texts[-6:]}")


def test_one_packet_in_ten_is_lost(rig, one):
    wire = Lossy(rig.ports["generic"])
    lossy = Station(f"udpout:127.0.0.1:{wire.port}", 250)
    lat, lon = degrees(5.0, 5.5)
    answer = patiently(lossy, lambda: lossy.command_int(
        mavlink.MAV_CMD_DO_REPOSITION, mavlink.MAV_FRAME_GLOBAL, round(lat * 1e7),
        round(lon * 1e7), 2.0, timeout=0.6))
    assert answer == ACCEPTED
    # So high that the landing below is not over before somebody else speaks: its answer may be lost several times.
    wait_until(lambda: rig.distance(5.0, 5.5) < 0.4 and rig.height() > 1.7, 20, rig)
    # A mission goes up whole or not at all, by the requests that are repeated.
    way = mavlink.MAV_CMD_NAV_WAYPOINT
    items = [local_item(way, 5.0 + 0.01 * n, 5.0, 1.0) for n in range(30)]
    lossy.upload(items)
    # Two stations disagree: the last word counts, whoever says it.
    assert patiently(lossy, lambda: lossy.command(mavlink.MAV_CMD_NAV_LAND, timeout=0.6)) == ACCEPTED
    assert one.mode(4, 3) == ACCEPTED
    one.wait_mode(4, 3)
    assert patiently(lossy, lambda: lossy.command(mavlink.MAV_CMD_NAV_LAND, timeout=0.6)) == ACCEPTED
    one.wait_disarmed()
    rig.assert_landed()
    assert wire.lost > 0.05 * wire.passed
    assert "panicked" not in rig.said()
    wire.close()
    lossy.close()
