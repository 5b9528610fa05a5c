"""Starts the simulated tag and board and the real companion, and gives a MAVLink connection."""

import pathlib
import subprocess
import time

import pytest

from haltere_testing.clock import RealTime
from haltere_testing.rig import Simulator, free_port, hall, program, stop
from haltere_testing.station import mavlink, mavutil, with_room

SIM = program()
patience = RealTime().patience


class World:
    """One simulated vehicle with its companion, and a ground station's connection to it."""

    def __init__(self, folder, seed=1, protocol="lps-sniffer", ground_keys="", sections="",
                 endpoint_keys="", more_endpoints=(), prepare=lambda link: None):
        """`ground_keys`, `sections` and, of our own endpoint, `endpoint_keys` are added to the
        configuration; `prepare` is given the ground station's connection before anything comes over
        it."""
        self.folder = folder
        self.sim = Simulator(
            ["serve", "--seed", str(seed), "--tag-protocol", protocol,
             "--board", f"udpout:127.0.0.1:{free_port()}"], folder / "sim.txt")
        greeting = self.sim.greeting
        ground = free_port()
        own = f'{{ address = "udpout:127.0.0.1:{ground}"{endpoint_keys} }}'
        endpoints = [own, *(f'"{address}"' for address in more_endpoints)]
        (folder / "anchors.toml").write_text(hall())
        (folder / "haltere.toml").write_text(f"""
[tag]
port = "{greeting['tag']}"
protocol = "{protocol}"
[board]
address = "{greeting['board']}"
[ground]
endpoints = [{", ".join(endpoints)}]
{ground_keys}
[flight]
gear_height_m = 0.12
[estimator]
rest_height_m = 0.12
[record]
directory = "{folder / 'log'}"
[store]
directory = "{folder / 'state'}"
{sections}
""")
        self.link = mavutil.mavlink_connection(
            f"udpin:127.0.0.1:{ground}", source_system=255, source_component=190
        )
        with_room(self.link)
        prepare(self.link)
        self.texts = []
        self.asked = 0
        self.start_companion()

    def start_companion(self):
        self.companion = subprocess.Popen(
            [SIM, "companion", "fly", "--config", str(self.folder / "haltere.toml")],
            stdout=open(self.folder / "companion.txt", "a"), stderr=subprocess.STDOUT,
        )
        self.wait("HEARTBEAT", timeout=15, when=lambda m: m.get_srcComponent() == 1)

    def cut_power(self):
        """The companion ends without a word, as in a power cut, and is started again."""
        self.companion.kill()
        self.companion.wait()
        self.drain(0.3)
        self.texts.clear()
        self.start_companion()

    def close(self):
        # The companion first: what still flies is landed, which needs the simulated vehicle.
        codes = stop([self.companion]) + stop([self.sim.process])
        self.link.close()
        said = (self.folder / "companion.txt").read_text()
        assert "panicked" not in said, said
        assert codes == [0, 0], f"exit codes {codes}: {said}"

    # -- receiving

    def receive(self, timeout=0.2):
        message = self.link.recv_match(blocking=timeout > 0, timeout=timeout)
        if message is not None and message.get_type() == "STATUSTEXT":
            self.texts.append(message.text)
        return message

    def wait(self, name, timeout=5.0, when=lambda m: True):
        """The next message of that name that fits."""
        deadline = time.monotonic() + patience(timeout)
        while time.monotonic() < deadline:
            message = self.receive()
            if message is not None and message.get_type() == name and when(message):
                return message
        raise AssertionError(
            f"no {name} within {timeout} s; the vehicle said: {self.texts}; "
            f"{(self.folder / 'companion.txt').read_text()[-1500:]}"
        )

    def catch_up(self):
        """Reads what waits: a test that was busy elsewhere has a full socket, which loses answers."""
        messages = []
        while (message := self.receive(timeout=0)) is not None:
            messages.append(message)
        return messages

    def until_answered(self, timeout=5.0):
        """Everything up to the answer to a PING that is sent now: what was sent before has had its answer
        then, however busy this machine is. A PING may be lost like any datagram, and is sent again."""
        messages = self.catch_up()
        first = self.asked + 1
        deadline = time.monotonic() + patience(timeout)
        again = 0.0
        while (now := time.monotonic()) < deadline:
            if now >= again:
                self.asked += 1
                self.link.mav.ping_send(0, self.asked, 0, 0)
                again = now + patience(1.0)
            message = self.receive()
            if message is not None:
                if message.get_type() == "PING" and first <= message.seq <= self.asked:
                    return messages
                messages.append(message)
        raise AssertionError(
            f"no PING from {first} to {self.asked} is answered within {timeout} s; {self.texts}"
        )

    def said(self, words, timeout=5.0):
        """Waits for a text."""
        deadline = time.monotonic() + patience(timeout)
        while not any(words in text for text in self.texts):
            assert time.monotonic() < deadline, f"{words!r} was not said: {self.texts}"
            self.receive()

    def drain(self, seconds):
        """Everything that comes for a while."""
        deadline = time.monotonic() + seconds
        messages = []
        while time.monotonic() < deadline:
            message = self.receive(timeout=0.05)
            if message is not None:
                messages.append(message)
        return messages

    # -- sending

    def command(self, command, *params, target=(1, 1), timeout=3.0):
        """Sends COMMAND_LONG, gives the result of its acknowledgement."""
        self.catch_up()
        params = list(params) + [float("nan")] * (7 - len(params))
        self.link.mav.command_long_send(*target, command, 0, *params)
        ack = self.wait("COMMAND_ACK", timeout, lambda m: m.command == command)
        return ack.result

    def arm(self, timeout=30.0):
        """Arms as soon as the vehicle is ready."""
        deadline = time.monotonic() + patience(timeout)
        result = None
        while time.monotonic() < deadline:
            result = self.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1, 0)
            if result == mavlink.MAV_RESULT_ACCEPTED:
                self.wait("HEARTBEAT", 5, is_armed)
                return
            assert result == mavlink.MAV_RESULT_TEMPORARILY_REJECTED, self.texts
            self.drain(0.5)
        raise AssertionError(f"not ready to arm: result {result}, {self.texts}")

    def land(self):
        assert self.command(mavlink.MAV_CMD_NAV_LAND) == mavlink.MAV_RESULT_ACCEPTED
        self.wait("HEARTBEAT", 30, lambda m: from_autopilot(m) and not is_armed(m))

    def upload(self, items):
        """Uploads a mission, gives the result."""
        self.catch_up()
        send = self.link.mav
        send.mission_count_send(1, 1, len(items), mavlink.MAV_MISSION_TYPE_MISSION)
        deadline = time.monotonic() + patience(10)
        while time.monotonic() < deadline:
            message = self.receive()
            if message is None:
                continue
            if message.get_type() in ("MISSION_REQUEST_INT", "MISSION_REQUEST"):
                command, params, x, y, z = items[message.seq]
                send.mission_item_int_send(
                    1, 1, message.seq, mavlink.MAV_FRAME_LOCAL_NED, command, 0, 1, *params,
                    round(x * 1e4), round(y * 1e4), z, mavlink.MAV_MISSION_TYPE_MISSION,
                )
            elif message.get_type() == "MISSION_ACK":
                return message.type
        raise AssertionError(f"upload not answered; {self.texts}")

    def download(self):
        """The mission as the vehicle holds it."""
        self.catch_up()
        self.link.mav.mission_request_list_send(1, 1, mavlink.MAV_MISSION_TYPE_MISSION)
        count = self.wait("MISSION_COUNT").count
        items = []
        for seq in range(count):
            self.link.mav.mission_request_int_send(1, 1, seq, mavlink.MAV_MISSION_TYPE_MISSION)
            items.append(self.wait("MISSION_ITEM_INT", when=lambda m: m.seq == seq))
        self.link.mav.mission_ack_send(1, 1, mavlink.MAV_MISSION_ACCEPTED,
                                       mavlink.MAV_MISSION_TYPE_MISSION)
        return items

    def truth(self):
        """What really is, by the columns of the simulator's truth file."""
        return self.sim.truth()


def from_autopilot(message):
    return message.get_srcSystem() == 1 and message.get_srcComponent() == 1


def is_armed(message):
    return from_autopilot(message) and bool(
        message.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED
    )


@pytest.fixture(scope="module")
def world(tmp_path_factory):
    world = World(pathlib.Path(tmp_path_factory.mktemp("world")))
    yield world
    world.close()
