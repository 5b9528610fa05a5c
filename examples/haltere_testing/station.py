"""A ground station of pymavlink, with our dialect where the test runner gives it."""

import importlib.util
import os
import socket
import sys

os.environ["MAVLINK20"] = "1"
from pymavlink import mavutil  # noqa: E402

from .clock import RealTime  # noqa: E402

NAN = float("nan")


def _dialect():
    path = os.environ.get("HALTERE_TEST_DIALECT")
    if not path or os.environ.get("HALTERE_STOCK_DIALECT"):
        return mavutil.mavlink
    spec = importlib.util.spec_from_file_location("haltere_dialect", path)
    module = importlib.util.module_from_spec(spec)
    sys.modules["haltere_dialect"] = module
    spec.loader.exec_module(module)
    mavutil.mavlink = module
    mavutil.current_dialect = "haltere"
    return module


mavlink = _dialect()

#: What a vehicle sends in over half a minute; the system's usual buffer is full after two seconds.
#: The system may allow less.
RECEIVE_BUFFER = 4 << 20


def with_room(link):
    """Gives a connection a buffer that keeps answers while its program is busy elsewhere."""
    if isinstance(getattr(link, "port", None), socket.socket):
        link.port.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, RECEIVE_BUFFER)
    return link


#: Messages of haltere's own, Hz: only who asks is sent them.
OWN_STREAMS = {"HALTERE_ESTIMATE": 10, "HALTERE_CONTROL": 10, "HALTERE_PAIR": 4, "HALTERE_DROPS": 1,
               "HALTERE_LINK": 1}


class Station:
    """Connects as a ground station does: it speaks first, and sends a heartbeat every second."""

    def __init__(self, address, system=255, component=190, timeout=20, clock=None):
        self.clock = clock or RealTime()
        self.link = with_room(mavutil.mavlink_connection(address, source_system=system,
                                                         source_component=component))
        self.texts = []
        self.chunks = ""
        self.backlog = []  # what came between the last command and its answer
        self.beat_at = None
        self.beat()
        self.heartbeat = self.wait("HEARTBEAT", timeout,
                                   lambda m: m.get_srcSystem() == 1 and m.get_srcComponent() == 1)
        self.link.target_system, self.link.target_component = 1, 1
        for name, rate_hz in OWN_STREAMS.items():
            number = getattr(mavlink, f"MAVLINK_MSG_ID_{name}", None)
            if number is not None:
                # Not waited for: the line may be one that loses answers.
                self.link.mav.command_long_send(1, 1, mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, 0,
                                                number, 1e6 / rate_hz, 0, 0, 0, 0, 0)

    def close(self):
        self.link.close()

    def beat(self):
        if self.beat_at is None or self.clock.now() - self.beat_at >= 1.0:
            self.beat_at = self.clock.now()
            self.link.mav.heartbeat_send(mavlink.MAV_TYPE_GCS, mavlink.MAV_AUTOPILOT_INVALID,
                                         0, 0, 4)

    def receive(self, timeout=0.2):
        self.beat()
        return self.look(self.clock.receive(self.link, timeout))

    def look(self, message):
        """Joins the chunks of long texts."""
        if message is not None and message.get_type() == "STATUSTEXT" and of_vehicle(message):
            self.chunks += message.text
            if message.id == 0 or len(message.text) < 50:
                self.texts.append(self.chunks)
                self.chunks = ""
        return message

    def said(self, words, timeout=5.0, since=0):
        """Waits for a text, one after the first `since`."""
        deadline = self.clock.now() + self.clock.patience(timeout)
        while self.clock.now() < deadline:
            if any(words in text for text in self.texts[since:]):
                return
            self.receive()
        raise AssertionError(f"{words!r} was not said: {self.texts[-12:]}")

    def wait(self, name, timeout=5.0, when=lambda m: True):
        for message in self.backlog:
            # A heartbeat comes again, and an old one may tell what is over.
            if message.get_type() == name != "HEARTBEAT" and when(message):
                self.backlog.remove(message)
                return message
        deadline = self.clock.now() + self.clock.patience(timeout)
        while self.clock.now() < deadline:
            message = self.receive()
            if message is not None and message.get_type() == name and when(message):
                return message
        raise AssertionError(f"no {name} within {timeout} s; the vehicle said: {self.texts[-12:]}")

    def drain(self, seconds):
        self.backlog = []
        deadline = self.clock.now() + seconds
        messages = []
        while self.clock.now() < deadline:
            message = self.receive(timeout=0.02)
            if message is not None:
                messages.append(message)
        return messages

    # -- commands

    def _answer(self, command, timeout):
        self.backlog = []
        deadline = self.clock.now() + self.clock.patience(timeout)
        while self.clock.now() < deadline:
            message = self.receive()
            if message is None:
                continue
            if message.get_type() != "COMMAND_ACK" or message.command != command:
                self.backlog.append(message)
            elif message.result != mavlink.MAV_RESULT_IN_PROGRESS:
                return message.result
        raise AssertionError(f"{command} not answered within {timeout} s; {self.texts[-8:]}")

    def catch_up(self):
        """Reads what waits: a test that was busy elsewhere has a full socket, which loses answers."""
        while True:
            if self.look(self.link.recv_match(blocking=False)) is None:
                return

    def command(self, command, *params, target=(1, 1), timeout=4.0):
        self.catch_up()
        params = list(params) + [NAN] * (7 - len(params))
        self.link.mav.command_long_send(*target, command, 0, *params)
        return self._answer(command, timeout)

    def command_int(self, command, frame, x, y, z, params=(NAN, NAN, NAN, NAN), timeout=4.0):
        self.catch_up()
        self.link.mav.command_int_send(1, 1, frame, command, 0, 0, *params, x, y, z)
        return self._answer(command, timeout)

    def request(self, msg_id, param2=0.0):
        return self.command(mavlink.MAV_CMD_REQUEST_MESSAGE, msg_id, param2, 0, 0, 0, 0, 0)

    def mode(self, main, sub=0):
        return self.command(mavlink.MAV_CMD_DO_SET_MODE, 1, main, sub)

    def arm(self, timeout=40.0, *more):
        deadline = self.clock.now() + self.clock.patience(timeout)
        result = None
        while self.clock.now() < deadline:
            result = self.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1, *more)
            if result == mavlink.MAV_RESULT_ACCEPTED:
                self.wait("HEARTBEAT", 5, is_armed)
                return
            assert result == mavlink.MAV_RESULT_TEMPORARILY_REJECTED, self.texts
            self.drain(0.5)
        raise AssertionError(f"not ready to arm: result {result}, {self.texts[-12:]}")

    def wait_mode(self, main, sub=0, timeout=10.0):
        number = main << 16 | sub << 24
        return self.wait("HEARTBEAT", timeout,
                         lambda m: of_vehicle(m) and m.custom_mode == number)

    def wait_disarmed(self, timeout=40.0):
        self.wait("HEARTBEAT", timeout, lambda m: of_vehicle(m) and not is_armed(m))

    # -- a flight in a few lines; each fails with what the vehicle said

    def accepted(self, result, what):
        assert result == mavlink.MAV_RESULT_ACCEPTED, f"{what}: result {result}; {self.texts[-8:]}"

    def takeoff(self, height):
        """Arms and takes off to a height over the floor, m; returns when the vehicle holds."""
        self.arm()
        before = len(self.texts)
        result = self.command(mavlink.MAV_CMD_NAV_TAKEOFF, *[NAN] * 6, height)
        self.accepted(result, "take-off")
        # Not by the mode: on the floor it is shown as HOLD too.
        self.said("take-off height reached", 30, before)

    def goto(self, north, east, height):
        """Begins to fly to a point of the room, m."""
        self.accepted(self.command_int(
            mavlink.MAV_CMD_DO_REPOSITION, mavlink.MAV_FRAME_LOCAL_NED, round(north * 1e4),
            round(east * 1e4), -height, (-1, 1, 0, NAN)), "goto")

    def land(self):
        """Lands where it is; returns when the motors are off."""
        self.accepted(self.command(mavlink.MAV_CMD_NAV_LAND), "landing")
        self.wait_disarmed()

    def upload(self, items):
        """Items: frame, command, params, x, y, z as in MISSION_ITEM_INT."""
        self.catch_up()
        send = self.link.mav
        mission = mavlink.MAV_MISSION_TYPE_MISSION

        def announce():
            send.mission_count_send(1, 1, len(items), mission)

        def give(seq):
            frame, command, params, x, y, z = items[seq]
            send.mission_item_int_send(1, 1, seq, frame, command, 0, 1, *params, x, y, z, mission)

        again = announce
        again()
        deadline = self.clock.now() + self.clock.patience(20)
        repeat = self.clock.now() + 0.7
        while self.clock.now() < deadline:
            message = self.receive(0.1)
            kind = message.get_type() if message else None
            if kind in ("MISSION_REQUEST_INT", "MISSION_REQUEST"):
                again = lambda seq=message.seq: give(seq)  # noqa: E731
            elif kind == "MISSION_ACK":
                return message.type
            elif self.clock.now() < repeat:
                continue
            # Asked for, or silence: the protocol repeats what was sent last.
            again()
            repeat = self.clock.now() + 0.7
        raise AssertionError(f"upload not answered; {self.texts[-12:]}")


def local_item(command, north, east, height, *params):
    params = list(params) + [0.0, 0.0, 0.0, NAN][len(params):]
    return (mavlink.MAV_FRAME_LOCAL_NED, command, params, round(north * 1e4), round(east * 1e4),
            -height)


def of_vehicle(message):
    return message.get_srcSystem() == 1 and message.get_srcComponent() == 1


def is_armed(message):
    return of_vehicle(message) and bool(message.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED)
