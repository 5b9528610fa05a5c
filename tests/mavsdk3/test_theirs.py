"""Examples of MAVSDK-Python as their authors wrote them, each with a vehicle of its own, several at once.

They count from where the vehicle stands, so the room lies around that; each has the room that its example needs, and limits as
they are by default. Two go to places on the globe: the room's origin lies 10 m south of the one, and at the first of the other.
Those that fly are landed in the end, by themselves or by the stick."""

import concurrent.futures
import csv
import math
import os
import pathlib
import random
import re
import signal
import socket
import subprocess
import sys
import threading

import pytest

from haltere_testing.programs import free_port, program
from haltere_testing.rig import Rig, hall, wait_until

HERE = pathlib.Path(__file__).parent
#: Of goto.py, degrees and m; the origin is 10 m south of it (a degree of latitude there is 111 180 m), its ground at 488 m.
GOAL = (47.397606, 8.543060)
ORIGIN = (GOAL[0] - 10.0 / 111_180, GOAL[1], 488.0)
#: The first place of mission.py, and its ground.
FIRST = (47.398039859999997, 8.5455725400000002, 488.0)
#: A log of an earlier flight; its last piece is a short one.
EARLIER = random.Random(36).randbytes(100_007)
#: Longest that one may take, s.
LIMIT_S = 300
#: Fastest into the floor, m/s.
GENTLE_MPS = 1.0
#: So many at once.
AT_ONCE = 4
#: One after the other: ports that are free are free for each.
STARTS = threading.Lock()


class Flight:
    """One example: the room that it needs (north, east, ceiling), and, where it never ends by itself, what it is to have
    done by then. They wait by the clock, and this vehicle takes off slower than a multicopter: at a `speed` of two there is
    time enough to get where they go, on a computer that is busy too. One of them would get too far to come home."""

    def __init__(self, room=((-6.0, 6.0), (-6.0, 6.0), 7.0), speed=2, origin=ORIGIN, until=None):
        self.room, self.speed, self.origin, self.until = room, speed, origin, until
        self.rig, self.said = None, ""

    def fly(self, name, folder):
        north, east, ceiling = self.room
        room = (f"[room]\nnorth_m = {list(north)}\neast_m = {list(east)}\nceiling_m = {ceiling}\n"
                "[start]\nposition_m = [0.0, 0.0]\n")
        with STARTS:
            # The client listens and the companion speaks to it, as in the examples.
            port = free_port()
            self.rig = Rig(folder, lockstep=True, speed=self.speed, scenario=room, anchors=hall(*self.room), origin=self.origin,
                           endpoints=[f'{{ address = "udpout:127.0.0.1:{port}", gps = "origin+gps" }}'])
        self.rig.settle()
        earlier = folder / "log" / "20260101-000000-00.mcap"
        earlier.write_bytes(EARLIER)
        os.utime(earlier, (1_767_225_600, 1_767_225_600))
        self.lookout = self.rig.look_out()
        output = folder / "output.txt"
        with open(output, "w") as to:
            process = subprocess.Popen(
                [sys.executable, "-u", HERE / "run_theirs.py", HERE / "theirs" / f"{name}.py",
                 f"udpin://127.0.0.1:{port}", str(free_port(socket.SOCK_STREAM))],
                cwd=folder, stdout=to, stderr=subprocess.STDOUT, start_new_session=True)
        try:
            if self.until is None:
                assert process.wait(LIMIT_S) == 0, output.read_text()
            else:
                wait_until(lambda: self.until(self, output.read_text()), LIMIT_S / 3, self.rig)
                assert process.poll() is None, output.read_text()
        finally:
            # Its server too, which outlives it otherwise.
            try:
                os.killpg(process.pid, signal.SIGKILL)
            except ProcessLookupError:
                pass
            process.wait()
        self.said = output.read_text()
        # Whoever sinks on until it stands has landed: there is nothing left to hold, and that is refused.
        stands = "land: it stands on the floor" in self.rig.said()
        failed = [line for line in self.said.splitlines() if "failed" in line]
        assert all(stands and "Stopping offboard" in line for line in failed), self.said
        assert "Traceback" not in self.said, self.said
        return self

    def land(self):
        """Lands what still flies. It met the floor gently, and no wing stood still in the air."""
        to = f"udpout:127.0.0.1:{self.rig.ports['generic']}"
        if self.rig.truth()["on_ground"] == 0:
            subprocess.run([program(), "companion", "ctl", "--to", to, "land"], check=True, timeout=LIMIT_S)
        wait_until(lambda: self.rig.truth()["thrust_n"] == 0.0, LIMIT_S / 3, self.rig)
        self.rig.close()
        lifted, above, sink_mps, fastest_mps = False, False, 0.0, 0.0
        with open(self.rig.folder / "truth.csv") as file:
            for row in csv.DictReader(file):
                height_m, is_up = -float(row["pos_E_z_m"]), row["on_ground"] in ("0", "false")
                assert not (lifted and is_up and height_m > 0.3 and float(row["thrust_n"]) < 0.05), f"cut in the air: {row}"
                if above and not is_up:
                    fastest_mps = max(fastest_mps, sink_mps)
                lifted, above, sink_mps = lifted or height_m > 0.3, is_up, float(row["vel_E_z_mps"])
        self.sink_mps = fastest_mps
        assert lifted and not above, "it is to have flown, and to stand on the floor"
        assert row["crashed"] in ("0", "false") and fastest_mps < GENTLE_MPS, f"{fastest_mps:.2f} m/s into the floor"

    def near(self, *place):
        return math.dist(self.rig.position(), place) < 0.5

    def passed(self, points):
        """In this order; straight on between them is nobody's word."""
        track = iter(here.place for here in self.lookout.track if here.flies)
        for point in points:
            assert any(math.dist(at, point) < 0.7 for at in track), f"{point} was not passed"

    def flown_m(self):
        track = [here.place for here in self.lookout.track if here.flies]
        return sum(math.dist(a, b) for a, b in zip(track[::10], track[10::10]))


def printed_all(flight, said):
    return all(word in said for word in ("Battery: ", "GPS info: GpsInfo: [num_satellites: 8", "In air: False", "Position: ["))


FLIGHTS = {
    "offboard_velocity_body": Flight(((-12.0, 12.0), (-12.0, 12.0), 9.0), speed=1),
    "offboard_position_ned": Flight(((-4.0, 12.0), (-4.0, 14.0), 8.0)),
    "goto": Flight(((-12.0, 14.0), (-12.0, 12.0), 23.0), until=lambda flight, said: flight.near(10.0, 0.0, 20.0)),
    "offboard_velocity_ned": Flight(((-5.0, 13.0), (-13.0, 5.0), 13.0), speed=1),
    "offboard_position_velocity_ned": Flight(((-5.0, 55.0), (-15.0, 15.0), 14.0), speed=1),
    "mission": Flight(((-32.0, 8.0), (-50.0, 8.0), 29.0), speed=4, origin=FIRST),
    "manual_control": Flight(until=lambda flight, said: "Starting manual control" in said and flight.flown_m() > 6.0),
    "takeoff_and_land": Flight(),
    "logfile_download": Flight(),
    "telemetry": Flight(until=printed_all),
    "all_params": Flight(),
    "firmware_version": Flight(),
    "tune": Flight(),
}


@pytest.fixture(scope="module")
def flights(tmp_path_factory):
    with concurrent.futures.ThreadPoolExecutor(AT_ONCE) as pool:
        flown = {name: pool.submit(flight.fly, name, tmp_path_factory.mktemp(name)) for name, flight in FLIGHTS.items()}
        yield flown
    for flight in FLIGHTS.values():
        if flight.rig is not None:
            flight.rig.close()


@pytest.fixture
def flight(request, flights):
    """The flight of the example that a test is named after, when it is over."""
    return flights[request.node.name.removeprefix("test_")].result()


def test_takeoff_and_land(flight):
    assert max(here.height_m for here in flight.lookout.track) > 1.8
    flight.rig.assert_landed()
    assert flight.rig.distance(0.0, 0.0) < 0.5


def test_telemetry(flight):
    lat, lon = map(float, re.search(r"latitude_deg: ([\d.]+), longitude_deg: ([\d.]+)", flight.said).groups())
    assert abs(lat - ORIGIN[0]) < 1e-5 and abs(lon - ORIGIN[1]) < 1e-5


def test_all_params(flight):
    values = dict(re.findall(r"^(\w+): (\S+)$", flight.said, re.MULTILINE))
    assert len(values) > 150 and float(values["FLT_TKO_HGT"]) == 1.0 and float(values["MAV_SYS_ID"]) == 1.0


def test_firmware_version(flight):
    assert "flight_sw_major: 0, flight_sw_minor: 1, flight_sw_patch: 0" in flight.said


def test_tune(flight):
    # It is no error that there is nothing that sounds: that is told.
    assert "Tune played" in flight.said


def test_logfile_download(flight):
    # The one of an earlier flight, and that which is being written.
    down = [file.read_bytes() for file in flight.rig.folder.glob("log-*.ulog")]
    assert len(down) == 2 and EARLIER in down


def test_goto(flight):
    assert flight.near(10.0, 0.0, 20.0)
    flight.land()


def test_mission(flight):
    track = flight.lookout.track
    # It flies through its places, and cuts the corners by 2 m; then home and down by itself.
    west, south = min(track, key=lambda here: here.east_m), min(track, key=lambda here: here.north_m)
    assert west.east_m < -40.0 and south.north_m < -20.0 and max(here.height_m for here in track) > 24.0
    assert flight.rig.distance(0.0, 0.0) < 1.0
    flight.land()


def test_manual_control(flight):
    assert "mode manual: joystick asked" in flight.rig.said()
    # Sticks at random: it wanders, within the room.
    assert all(abs(here.north_m) < 6.0 and abs(here.east_m) < 6.0 for here in flight.lookout.track)
    assert flight.rig.truth()["crashed"] == 0


def test_offboard_position_ned(flight):
    flight.passed([(0.0, 0.0, 5.0), (5.0, 0.0, 5.0), (5.0, 10.0, 5.0), (0.0, 10.0, 0.2)])
    assert flight.rig.truth()["crashed"] == 0


def test_offboard_velocity_body(flight):
    track = flight.lookout.track
    assert max(here.height_m for here in track) > 1.2
    # Circles, how much of them hangs on the computer: out to each side, and no farther than two at 2 m/s and 30 deg/s lead.
    for extent in ([here.north_m for here in track], [here.east_m for here in track]):
        assert 1.0 < max(extent) - min(extent) < 16.0, (min(extent), max(extent))
    truth = flight.rig.truth()
    assert truth["crashed"] == 0 and truth["on_ground"] == 0
    assert "mode hold: hold asked" in flight.rig.said()
    flight.land()


def test_offboard_velocity_ned(flight):
    track = flight.lookout.track
    # North, then west; how far hangs on the computer. Then down, though no lower than 0.2 m, which setpoints are.
    north, west = max(track, key=lambda here: here.north_m), min(track, key=lambda here: here.east_m)
    assert north.north_m > 1.0 and west.east_m < -1.0 and north.t_s < west.t_s
    assert min(here.height_m for here in track if here.t_s > west.t_s) < 0.5 * west.height_m
    # Of the climb the take-off took the most, and that is said.
    assert "m flown that its rate asked for" in flight.rig.said()
    flight.land()


def test_offboard_position_velocity_ned(flight):
    far = max(flight.lookout.track, key=lambda here: here.north_m)
    assert far.north_m > 3.0
    flight.passed([(0.0, 0.0, 10.0), (far.north_m, 0.5, 10.0)])
    flight.land()
