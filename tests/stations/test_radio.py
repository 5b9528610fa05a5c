"""A pair of radios at 57 600 baud between vehicle and station, on simulated time: what it carries is less than the line,
pieces are lost and come late, and RADIO_STATUS tells how full its buffer is. A mission is uploaded, flown and watched."""

import collections
import random
import socket

import pytest

from haltere_testing.programs import free_port
from haltere_testing.rig import Rig
from haltere_testing.station import Station, is_armed, mavlink, mavutil
from haltere_testing.missions import route

CORNERS = [(4.0, 4.0, 1.2), (4.0, 6.0, 1.2), (6.0, 6.0, 1.2)]

#: Of a SiK radio: the line to it, what it carries through the air each way, its buffer, what one packet of it holds.
LINE_BPS, AIR_BPS, BUFFER_BYTES, PACKET_BYTES = 5760, 2000, 4096, 250
#: Share of its packets that is lost, and how late the others are, s.
LOST, LATE_S = 0.03, 0.15
#: So often it tells how full it is, s.
STATUS_S = 1.0


class Way:
    """One direction: bytes wait in the buffer of a radio, are sent at its speed, and some packets are lost."""

    def __init__(self, luck):
        self.luck, self.waiting, self.flying = luck, bytearray(), collections.deque()
        self.came = self.overflown = 0
        self.may_send, self.may_take = 0.0, 0.0

    def put(self, data):
        room = BUFFER_BYTES - len(self.waiting)
        self.came += len(data)
        self.overflown += max(0, len(data) - room)
        self.waiting += data[:room]

    def free_percent(self):
        return 100 * (BUFFER_BYTES - len(self.waiting)) // BUFFER_BYTES

    def carry(self, now_s, dt_s):
        """What comes out at the other end."""
        self.may_send = min(self.may_send + AIR_BPS * dt_s, PACKET_BYTES)
        while self.waiting and self.may_send >= min(PACKET_BYTES, len(self.waiting)):
            packet = bytes(self.waiting[:PACKET_BYTES])
            del self.waiting[:len(packet)]
            self.may_send -= len(packet)
            if self.luck.random() >= LOST:
                self.flying.append((now_s + LATE_S, packet))
        out = b""
        while self.flying and self.flying[0][0] <= now_s:
            out += self.flying.popleft()[1]
        return out


class Radios:
    """Both radios, between an endpoint of the companion and the address that a station connects to."""

    def __init__(self, rig, port, seed=1):
        luck = random.Random(seed)
        self.clock, self.down, self.up = rig.clock, Way(luck), Way(luck)
        self.far = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.far.connect(("127.0.0.1", port))
        self.near = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.near.bind(("127.0.0.1", 0))
        for end in (self.far, self.near):
            end.setblocking(False)
        self.address = f"udpout:127.0.0.1:{self.near.getsockname()[1]}"
        self.station, self.at_s, self.status_s = None, rig.clock.now(), 0.0
        self.says = mavutil.mavlink.MAVLink(None, srcSystem=51, srcComponent=68)
        rig.clock.lookers.append(self.step)

    def step(self):
        now_s = self.clock.now()
        dt_s, self.at_s = now_s - self.at_s, now_s
        self.take(self.near, self.up)
        self.take(self.far, self.down)
        up, down = self.up.carry(now_s, dt_s), self.down.carry(now_s, dt_s)
        if now_s >= self.status_s:
            self.status_s = now_s + STATUS_S
            told = [self.says.radio_status_encode(180, 180, way.free_percent(), 40, 40, 0, 0).pack(self.says)
                    for way in (self.down, self.up)]
            up, down = up + told[0], down + told[1]
        if up:
            self.far.send(up)
        if down and self.station:
            self.near.sendto(down, self.station)

    def take(self, end, way):
        while True:
            try:
                data, sender = end.recvfrom(65536)
            except BlockingIOError:
                return
            if end is self.near:
                self.station = sender
            way.put(data)


@pytest.fixture
def rig(tmp_path):
    port = free_port()
    with Rig(tmp_path, lockstep=True, seed=36,
             endpoints=[f'{{ address = "udpin:127.0.0.1:{port}", bytes_per_s = {LINE_BPS} }}']) as rig:
        rig.settle()
        rig.radios = Radios(rig, port)
        yield rig
    rig.assert_replayed()


@pytest.fixture
def station(rig):
    station = Station(rig.radios.address, clock=rig.clock)
    yield station
    station.close()


def patiently(station, ask, *args):
    """Again until it is answered, as stations do."""
    for _ in range(12):
        try:
            return ask(*args, timeout=1.5)
        except AssertionError:
            continue
    raise AssertionError(f"never answered: {args}; {station.texts}")


def test_a_mission_is_uploaded_flown_and_watched(rig, station):
    # While it watches: streams have filled the line when the upload begins.
    station.drain(10.0)
    down = rig.radios.down
    before = down.came, down.overflown
    assert station.offer(route(CORNERS)) == mavlink.MAV_MISSION_ACCEPTED
    end = rig.clock.now() + 20
    while patiently(station, station.command, mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1) != mavlink.MAV_RESULT_ACCEPTED:
        assert rig.clock.now() < end, station.texts
    assert patiently(station, station.command, mavlink.MAV_CMD_MISSION_START) == mavlink.MAV_RESULT_ACCEPTED
    began, told, reached, beats = rig.clock.now(), [], set(), []
    while True:
        assert rig.clock.now() < began + 120, (reached, station.texts)
        message = station.receive()
        if message is None or not station.of_vehicle(message):
            continue
        kind = message.get_type()
        if kind == "LOCAL_POSITION_NED":
            # How old what the station sees is, and how far from the truth.
            told.append((rig.truth()["host_time_us"] / 1e6 - message.time_boot_ms / 1000,
                         rig.distance(message.x, message.y)))
        elif kind == "MISSION_CURRENT":
            reached.add(message.seq)
        elif kind == "HEARTBEAT":
            beats.append(rig.clock.now())
            if beats[-1] > began + 5 and not is_armed(message):
                break
    rig.assert_landed()
    assert reached >= set(range(1, len(CORNERS) + 2)), reached
    flight_s = beats[-1] - began
    # A heartbeat a second, of which some are lost.
    assert len(beats) > 0.8 * flight_s and max(b - a for a, b in zip(beats, beats[1:])) < 4.0, beats
    assert len(told) > flight_s, (len(told), flight_s)
    # Late by the way and by what waits in the buffer, which is half empty most of the time.
    ages = sorted(age for age, _ in told)
    median_s = ages[len(ages) // 2]
    lost = (down.overflown - before[1]) / (down.came - before[0])
    print(f"flight of {flight_s:.0f} s: {len(told)} positions, age median {median_s:.2f} s, worst {ages[-1]:.2f} s, "
          f"{lost:.2%} of the bytes found no room")
    assert median_s < LATE_S + BUFFER_BYTES / AIR_BPS / 2, median_s
    assert lost < 0.02, f"{lost:.1%} of what was sent found no room"


def test_every_parameter_arrives(rig, station):
    station.drain(10.0)
    began = came_s = rig.clock.now()
    names, count = {}, None
    station.link.mav.param_request_list_send(1, 1)
    while count is None or len(names) < count:
        now_s = rig.clock.now()
        assert now_s < began + 120, f"{len(names)} of {count}"
        message = station.receive()
        if message is not None and message.get_type() == "PARAM_VALUE":
            names[message.param_index], count, came_s = message.param_id, message.param_count, now_s
        elif now_s > came_s + 3.0:
            # The list is over: what was lost is asked for again, as stations do.
            came_s = now_s
            if count is None:
                station.link.mav.param_request_list_send(1, 1)
            for index in sorted(set(range(count or 0)) - set(names))[:10]:
                station.link.mav.param_request_read_send(1, 1, b"", index)
    print(f"{count} parameters in {rig.clock.now() - began:.0f} s")
