"""A flight over bad wires: a radio on a serial line, and a network that loses, doubles, reorders and
damages packets each way while a second station disagrees."""

import os
import random
import select
import socket
import threading
import time
import tty

import pytest

from haltere_testing.rig import Rig, wait_until
from haltere_testing.station import Station, local_item, mavlink

ACCEPTED = mavlink.MAV_RESULT_ACCEPTED


@pytest.fixture(scope="module")
def radio():
    """Both ends of a serial line: ours, and the device of the companion's."""
    ours, theirs = os.openpty()
    tty.setraw(ours)
    tty.setraw(theirs)
    yield ours, os.ttyname(theirs)
    os.close(ours)
    os.close(theirs)


@pytest.fixture(scope="module")
def rig(tmp_path_factory, radio):
    rig = Rig(tmp_path_factory.mktemp("rig"), endpoints=[f"serial:{radio[1]}:57600"])
    rig.settle()
    yield rig
    rig.close()
    rig.assert_replayed()


class Bridge:
    """Carries datagrams of one station to and from something else, and damages them on the way."""

    def __init__(self, seed, send, receive, bad=0.0):
        self.port = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.port.bind(("127.0.0.1", 0))
        self.address = f"udpout:127.0.0.1:{self.port.getsockname()[1]}"
        self.send, self.receive, self.bad = send, receive, bad
        self.luck, self.station, self.held = random.Random(seed), None, {}
        self.ends = threading.Event()
        self.thread = threading.Thread(target=self.run, daemon=True)
        self.thread.start()

    def spoil(self, way, data):
        """What becomes of a packet: lost, doubled, behind the next one, a byte changed."""
        out = [self.held.pop(way)] if way in self.held else []
        lot = self.luck.random() / self.bad if self.bad else 1.0
        if lot < 0.4:
            return out
        if lot < 0.6:
            return [data, data] + out
        if lot < 0.8 and not out:
            self.held[way] = data
            return []
        if lot < 1.0:
            at = self.luck.randrange(len(data))
            data = data[:at] + bytes([self.luck.randrange(256)]) + data[at + 1:]
        return [data] + out

    def run(self):
        while not self.ends.is_set():
            ready, _, _ = select.select([self.port, self.receive], [], [], 0.05)
            if self.port in ready:
                data, self.station = self.port.recvfrom(65536)
                for piece in self.spoil("up", data):
                    self.send(piece)
            if self.receive in ready:
                data = (os.read(self.receive, 4096) if isinstance(self.receive, int)
                        else self.receive.recv(65536))
                for piece in self.spoil("down", data):
                    if self.station:
                        self.port.sendto(piece, self.station)

    def close(self):
        self.ends.set()
        self.thread.join()
        self.port.close()


def test_a_station_on_a_serial_line_flies_it(rig, radio):
    bridge = Bridge(1, lambda data: os.write(radio[0], data), radio[0])
    station = Station(bridge.address)
    beat = station.heartbeat
    assert beat.type == mavlink.MAV_TYPE_FLAPPING_WING
    station.arm(60.0)
    assert station.command(mavlink.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, 0, 0, 0, 0.8) == ACCEPTED
    wait_until(lambda: (station.drain(0.1), rig.height() > 0.6)[1], 25, rig)
    # 57600 baud carry 5760 bytes a second, both ways together; streams leave room for answers.
    # By the vehicle's own clock: what waited in a buffer of this machine's comes at once.
    came = station.drain(5.0)
    stamps = [m.time_boot_ms for m in came if m.get_type() == "LOCAL_POSITION_NED"]
    rate_Bps = sum(len(m.get_msgbuf()) for m in came) / ((stamps[-1] - stamps[0]) / 1000)
    assert 2000 < rate_Bps <= 5760, rate_Bps
    assert station.command(mavlink.MAV_CMD_NAV_LAND) == ACCEPTED
    station.wait_disarmed(60)
    rig.assert_landed()
    station.close()
    bridge.close()


def patiently(ask, *args):
    """Again until it is answered, as stations do."""
    for _ in range(12):
        try:
            return ask(*args, timeout=1.0)
        except AssertionError:
            continue
    raise AssertionError(f"never answered: {args}")


def test_a_tenth_of_the_packets_is_lost_doubled_reordered_or_damaged(rig):
    line = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    line.connect(("127.0.0.1", rig.ports["generic"]))
    bridge = Bridge(2, line.send, line, bad=0.25)
    station = Station(bridge.address, 254)
    other = Station(f"udpout:127.0.0.1:{rig.ports['tcp']}".replace("udpout", "tcp"), 253)
    # It stays at the last point until every answer may have been lost a few times: who asks again once it lands is
    # refused, and rightly.
    plan = [local_item(22, 5, 5, 1.0), local_item(16, 5.5, 5.0, 1.0),
            local_item(16, 5.5, 5.4, 1.0), local_item(16, 5, 5, 1.0, 15.0), local_item(21, 0, 0, 0)]
    station.upload(plan)
    deadline = time.monotonic() + 60
    while True:
        assert time.monotonic() < deadline, station.texts
        arm = (mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1)
        if patiently(station.command, *arm) == ACCEPTED:
            break
        station.drain(0.5)
    assert patiently(station.command, mavlink.MAV_CMD_MISSION_START) == ACCEPTED
    wait_until(lambda: (station.drain(0.1), rig.height() > 0.7)[1], 25, rig)
    # The other one pauses it and the first one goes on: the last word counts, both are answered.
    assert other.command(mavlink.MAV_CMD_DO_PAUSE_CONTINUE, 0) == ACCEPTED
    other.wait_mode(4, 3)
    assert patiently(station.command, mavlink.MAV_CMD_DO_PAUSE_CONTINUE, 1) == ACCEPTED, station.texts
    other.wait_mode(4, 4)
    other.wait_disarmed(90)
    rig.assert_landed()
    assert rig.companion.poll() is None
    # What was damaged is counted with its reason. Which packets were is luck, and a station sends
    # few: one more for certain, its last byte (of the checksum) turned over.
    beat = bytearray(station.heartbeat.get_msgbuf())
    beat[-1] ^= 0xFF
    line.send(bytes(beat))
    seen = {}
    deadline = time.monotonic() + 60
    while "mav_bad_checksum" not in seen and time.monotonic() < deadline:
        message = other.receive()
        if message is not None and message.get_type() == "HALTERE_DROPS":
            seen[message.reason] = message.count
    assert seen.get("mav_bad_checksum", 0) > 0, seen
    for one in (station, other):
        one.close()
    bridge.close()
