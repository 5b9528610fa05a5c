"""A ground station of pymavlink, with our dialect where the test runner gives it."""

from __future__ import annotations

import contextlib
import functools
import importlib.util
import os
import socket
import sys
from typing import Any, Callable, Iterator, Optional, Sequence, Union

os.environ["MAVLINK20"] = "1"
from pymavlink import mavutil  # noqa: E402

from . import missions  # noqa: E402
from .clients import use_mode_map  # noqa: E402
from .clock import RealTime  # noqa: E402
from .missions import NAN, Item, local_item  # noqa: E402, F401


def _dialect() -> Any:
    path = os.environ.get("HALTERE_TEST_DIALECT")
    if not path or os.environ.get("HALTERE_STOCK_DIALECT"):
        return mavutil.mavlink
    spec = importlib.util.spec_from_file_location("haltere_dialect", path)
    assert spec and spec.loader, path
    module = importlib.util.module_from_spec(spec)
    sys.modules["haltere_dialect"] = module
    spec.loader.exec_module(module)
    mavutil.mavlink = module
    mavutil.current_dialect = "haltere"
    return module


mavlink = _dialect()
use_mode_map()

#: What a vehicle sends in over half a minute; the system's usual buffer is full after two seconds.
#: The system may allow less.
RECEIVE_BUFFER = 4 << 20


def with_room(link: Any) -> Any:
    """Gives a connection a buffer that keeps answers while its program is busy elsewhere."""
    if isinstance(getattr(link, "port", None), socket.socket):
        link.port.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, RECEIVE_BUFFER)
    return link


#: Messages of haltere's own, Hz: only who asks is sent them.
OWN_STREAMS = {"HALTERE_ESTIMATE": 10, "HALTERE_CONTROL": 10, "HALTERE_PAIR": 4, "HALTERE_DROPS": 1,
               "HALTERE_LINK": 1}


#: Within this time the words for a refusal have come, s.
WORDS_WITHIN_S = 0.4


def done(reached: Optional[int]) -> int:
    """How many items are done; MAVLink counts them from 0."""
    return 0 if reached is None else reached + 1


class Refused(AssertionError):
    """The vehicle refused something. `result` is the protocol's answer, `words` what the vehicle said about it."""

    def __init__(self, what: str, result: str, words: Sequence[str]):
        super().__init__(f"{what} refused: {result}; the vehicle said: {'; '.join(words) or 'nothing'}")
        self.what, self.result, self.words = what, result, list(words)


def name_of(enum: str, value: int) -> str:
    """What MAVLink calls a number."""
    entry = mavlink.enums[enum].get(value)
    return entry.name if entry else str(value)


class Station:
    """Connects as a ground station does: it speaks first, and sends a heartbeat every second, of the vehicle's time where
    that passes faster.

    `vehicle` is the system id of the vehicle that is commanded, None the first that is heard; one station may change it to
    command another one.
    """

    def __init__(self, address: str, system: int = 255, component: int = 190, timeout: float = 20,
                 clock: Any = None, vehicle: Optional[int] = 1, before_arming: Optional[Callable[[], None]] = None):
        self.clock = clock or RealTime()
        self.vehicle = vehicle or 0
        self.before_arming, self._may_arm, self._was_armed = before_arming, False, False
        self.link = with_room(mavutil.mavlink_connection(address, source_system=system,
                                                         source_component=component))
        self.texts: list[str] = []
        self.chunks = ""
        self.backlog: list[Any] = []  # what came between the last command and its answer
        self.beat_at: Optional[float] = None
        self._due = False
        self.beat()
        self.heartbeat = self.wait(
            "HEARTBEAT", timeout, lambda m: m.autopilot != mavlink.MAV_AUTOPILOT_INVALID
            and of_vehicle(m, vehicle or m.get_srcSystem()))
        self.vehicle = self.heartbeat.get_srcSystem()
        self.link.target_system, self.link.target_component = self.vehicle, 1
        for name, rate_hz in OWN_STREAMS.items():
            number = getattr(mavlink, f"MAVLINK_MSG_ID_{name}", None)
            if number is not None:
                # Not waited for: the line may be one that loses answers.
                self.link.mav.command_long_send(self.vehicle, 1, mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, 0,
                                                number, 1e6 / rate_hz, 0, 0, 0, 0, 0)

    def close(self) -> None:
        """Ends the connection."""
        self.link.close()

    def of_vehicle(self, message: Any) -> bool:
        """Whether the vehicle that is commanded sent it."""
        return of_vehicle(message, self.vehicle)

    def beat(self) -> None:
        """Sends a heartbeat if one is due."""
        if self.beat_at is None or self._due or self.clock.now() - self.beat_at >= 1.0:
            self.beat_at, self._due = self.clock.now(), False
            self.link.mav.heartbeat_send(mavlink.MAV_TYPE_GCS, mavlink.MAV_AUTOPILOT_INVALID,
                                         0, 0, 4)

    def receive(self, timeout: float = 0.2) -> Any:
        """The next message; None where none came."""
        self.beat()
        return self.look(self.clock.receive(self.link, timeout))

    def look(self, message: Any) -> Any:
        """Joins the chunks of long texts."""
        if message is None or not self.of_vehicle(message):
            return message
        kind = message.get_type()
        if kind == "STATUSTEXT":
            self.chunks += message.text
            if message.id == 0 or len(message.text) < 50:
                self.texts.append(self.chunks)
                self.chunks = ""
        elif kind == "HEARTBEAT":
            # As often as the vehicle's, whose second may be shorter than ours.
            self._due = True
            armed = is_armed(message, self.vehicle)
            # The next take-off is another one.
            self._may_arm = self._may_arm and (armed or not self._was_armed)
            self._was_armed = armed
        return message

    def catch_up(self) -> None:
        """Reads what waits: a test that was busy elsewhere has a full socket, which loses answers."""
        while True:
            if self.look(self.link.recv_match(blocking=False)) is None:
                return

    def newest(self, name: str) -> Any:
        """The newest message of that name that came; None: there was none."""
        return self.link.messages.get(name)

    def item(self) -> Optional[int]:
        """The item that the mission is at."""
        told = self.newest("MISSION_CURRENT")
        return told.seq if told is not None else None

    def said(self, words: str, timeout: float = 5.0, since: int = 0) -> None:
        """Waits for a text, one after the first `since`."""
        deadline = self.clock.now() + self.clock.patience(timeout)
        while self.clock.now() < deadline:
            if any(words in text for text in self.texts[since:]):
                return
            self.receive()
        raise AssertionError(f"{words!r} was not said: {self.texts[-12:]}")

    def wait(self, name: str, timeout: float = 5.0, when: Callable[[Any], Any] = lambda m: True) -> Any:
        """The next message of that name for which `when` holds."""
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

    def drain(self, seconds: float) -> list[Any]:
        """Everything that comes for a while."""
        self.backlog = []
        deadline = self.clock.now() + seconds
        messages = []
        while self.clock.now() < deadline:
            message = self.receive(timeout=0.02)
            if message is not None:
                messages.append(message)
        return messages

    # -- commands

    def _answer(self, command: int, timeout: float, system: int) -> int:
        self.backlog = []
        deadline = self.clock.now() + self.clock.patience(timeout)
        while self.clock.now() < deadline:
            message = self.receive()
            if message is None:
                continue
            is_answer = (message.get_type() == "COMMAND_ACK" and message.command == command
                         and system in (0, message.get_srcSystem()))
            if not is_answer:
                self.backlog.append(message)
            elif message.result != mavlink.MAV_RESULT_IN_PROGRESS:
                return message.result
        raise AssertionError(f"{command} not answered within {timeout} s; {self.texts[-8:]}")

    def command(self, command: int, *params: float, target: Optional[Sequence[int]] = None,
                timeout: float = 4.0) -> int:
        """Sends a COMMAND_LONG; gives the result of its answer. Params that are left out are NaN."""
        arms = command == mavlink.MAV_CMD_COMPONENT_ARM_DISARM and params[:1] == (1,)
        if arms and self.before_arming and not self._may_arm:
            self.before_arming()
            self._may_arm, self._was_armed = True, False
        self.catch_up()
        system, component = target or (self.vehicle, 1)
        filled = list(params) + [NAN] * (7 - len(params))
        self.link.mav.command_long_send(system, component, command, 0, *filled)
        return self._answer(command, timeout, system)

    def command_int(self, command: int, frame: int, x: int, y: int, z: float,
                    params: Sequence[float] = (NAN, NAN, NAN, NAN), timeout: float = 4.0) -> int:
        """Sends a COMMAND_INT; gives the result of its answer."""
        self.catch_up()
        self.link.mav.command_int_send(self.vehicle, 1, frame, command, 0, 0, *params, x, y, z)
        return self._answer(command, timeout, self.vehicle)

    def request(self, msg_id: int, param2: float = 0.0) -> int:
        """Asks for one message by its number."""
        return self.command(mavlink.MAV_CMD_REQUEST_MESSAGE, msg_id, param2, 0, 0, 0, 0, 0)

    def mode(self, main: int, sub: int = 0) -> int:
        """Asks for a mode by PX4's numbers, as docs/MODES.md has them."""
        return self.command(mavlink.MAV_CMD_DO_SET_MODE, 1, main, sub)

    def arm(self, timeout: float = 40.0, *more: float) -> None:
        """Arms as soon as the vehicle is ready."""
        deadline = self.clock.now() + self.clock.patience(timeout)
        result = None
        while self.clock.now() < deadline:
            result = self.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1, *more)
            if result == mavlink.MAV_RESULT_ACCEPTED:
                self.wait("HEARTBEAT", 5, lambda m: is_armed(m, self.vehicle))
                return
            assert result == mavlink.MAV_RESULT_TEMPORARILY_REJECTED, self.texts
            self.drain(0.5)
        raise AssertionError(f"not ready to arm: result {result}, {self.texts[-12:]}")

    def wait_mode(self, main: int, sub: int = 0, timeout: float = 10.0) -> Any:
        """Waits until it flies in a mode."""
        number = main << 16 | sub << 24
        return self.wait("HEARTBEAT", timeout,
                         lambda m: self.of_vehicle(m) and m.custom_mode == number)

    def wait_disarmed(self, timeout: float = 40.0) -> None:
        """Waits until the motors are off."""
        self.wait("HEARTBEAT", timeout, lambda m: self.of_vehicle(m) and not is_armed(m, self.vehicle))

    # -- a flight in a few lines; each fails with what the vehicle said

    def accepted(self, result: int, what: str, since: int = -8, enum: str = "MAV_RESULT") -> None:
        """Raises what was refused, with the vehicle's own words."""
        if result != 0:  # MAV_RESULT_ACCEPTED, MAV_MISSION_ACCEPTED
            self.drain(WORDS_WITHIN_S)
            raise Refused(what, name_of(enum, result), self.texts[since:])

    def takeoff(self, height: float) -> None:
        """Arms and takes off to a height over the floor, m; returns when the vehicle holds."""
        self.arm()
        before = len(self.texts)
        result = self.command(mavlink.MAV_CMD_NAV_TAKEOFF, *[NAN] * 6, height)
        self.accepted(result, "take-off", before)
        # Not by the mode: on the floor it is shown as HOLD too.
        self.said("take-off height reached", 30, before)

    def goto(self, north: float, east: float, height: float) -> None:
        """Begins to fly to a point of the room, m."""
        before = len(self.texts)
        self.accepted(self.command_int(
            mavlink.MAV_CMD_DO_REPOSITION, mavlink.MAV_FRAME_LOCAL_NED, round(north * 1e4),
            round(east * 1e4), -height, (-1, 1, 0, NAN)), "goto", before)

    def land(self) -> None:
        """Lands where it is; returns when the motors are off."""
        before = len(self.texts)
        self.accepted(self.command(mavlink.MAV_CMD_NAV_LAND), "landing", before)
        self.wait_disarmed()

    def fly(self, points: Sequence[Sequence[float]], timeout: float = 300.0) -> None:
        """Takes off, flies through the points (north, east, height in m) and lands at the last; returns when the motors
        are off."""
        self.upload(missions.route(points))
        self.fly_mission(timeout)

    def fly_mission(self, timeout: float = 300.0) -> None:
        """Arms, starts the mission in force, and returns when it is flown to its end and the motors are off."""
        before = len(self.texts)
        self.link.mav.mission_request_list_send(self.vehicle, 1, mavlink.MAV_MISSION_TYPE_MISSION)
        last = self.wait("MISSION_COUNT", 5, self.of_vehicle).count - 1
        self.arm()
        self.accepted(self.command(mavlink.MAV_CMD_MISSION_START), "mission", before)
        reached: Optional[int] = None
        deadline = self.clock.now() + self.clock.patience(timeout)
        while self.clock.now() < deadline:
            message = self.receive()
            if message is None or not self.of_vehicle(message):
                continue
            if message.get_type() == "MISSION_ITEM_REACHED":
                reached = message.seq
            elif message.get_type() == "HEARTBEAT" and not is_armed(message, self.vehicle):
                assert reached == last, (
                    f"the flight ended after {done(reached)} of {last + 1} items; the vehicle said: "
                    f"{'; '.join(self.texts[before:])}")
                return
        raise AssertionError(f"the mission was not flown within {timeout} s, {done(reached)} of {last + 1} "
                             f"items were done; the vehicle said: {'; '.join(self.texts[before:])}")

    def upload(self, mission: Union[str, os.PathLike, Sequence[Item]]) -> None:
        """Replaces the mission: by a file (`.toml`, `.plan` with its fence and rally points, `.waypoints`) or by items as
        in MISSION_ITEM_INT. Raises `Refused` with the vehicle's words."""
        if not isinstance(mission, (str, os.PathLike)):
            self._upload(mission, mavlink.MAV_MISSION_TYPE_MISSION, "mission")
            return
        plan = missions.read(mission)
        # The fence first: the mission is judged by it. A part that the file does not have stays as it is.
        for items, kind, what in ((plan.fence, mavlink.MAV_MISSION_TYPE_FENCE, "fence"),
                                  (plan.rally, mavlink.MAV_MISSION_TYPE_RALLY, "rally points"),
                                  (plan.mission, mavlink.MAV_MISSION_TYPE_MISSION, "mission")):
            if items:
                self._upload(items, kind, f"{what} of {os.fspath(mission)}")

    def _upload(self, items: Sequence[Item], kind: int, what: str) -> None:
        before = len(self.texts)
        self.accepted(self.offer(items, kind), what, before, "MAV_MISSION_RESULT")

    def offer(self, items: Sequence[Item], kind: int = mavlink.MAV_MISSION_TYPE_MISSION) -> int:
        """Uploads items of one kind; gives the protocol's answer (MAV_MISSION_RESULT), whatever it is."""
        self.catch_up()
        send = self.link.mav

        def announce() -> None:
            send.mission_count_send(self.vehicle, 1, len(items), kind)

        def give(seq: int) -> None:
            frame, command, params, x, y, z = items[seq]
            send.mission_item_int_send(self.vehicle, 1, seq, frame, command, 0, 1, *params, x, y, z, kind)

        again: Callable[[], None] = announce
        again()
        deadline = self.clock.now() + self.clock.patience(20)
        repeat = self.clock.now() + 0.7
        while self.clock.now() < deadline:
            message = self.receive(0.1)
            answers = message is not None and self.of_vehicle(message)
            name = message.get_type() if answers else None
            if name in ("MISSION_REQUEST_INT", "MISSION_REQUEST"):
                again = functools.partial(give, message.seq)
            elif name == "MISSION_ACK":
                return message.type
            elif self.clock.now() < repeat:
                continue
            # Asked for, or silence: the protocol repeats what was sent last.
            again()
            repeat = self.clock.now() + 0.7
        raise AssertionError(f"upload not answered; {self.texts[-12:]}")

    # -- parameters

    def parameters(self, timeout: float = 20.0) -> dict[str, float]:
        """All parameters of the vehicle, by name."""
        found: dict[int, tuple[str, float]] = {}
        count = None
        deadline = self.clock.now() + self.clock.patience(timeout)
        repeat = 0.0
        while self.clock.now() < deadline:
            if count is not None and len(found) == count:
                return dict(found.values())
            if self.clock.now() >= repeat:
                self.link.mav.param_request_list_send(self.vehicle, 1)
                repeat = self.clock.now() + self.clock.patience(5)
            message = self.receive()
            if message is not None and message.get_type() == "PARAM_VALUE" and self.of_vehicle(message):
                if message.param_index < message.param_count:  # else an answer to who set or read one
                    found[message.param_index] = message.param_id, message.param_value
                    count = message.param_count
        raise AssertionError(f"{len(found)} of {count} parameters came within {timeout} s")

    def set_parameter(self, name: str, value: float) -> None:
        """Sets one; raises `Refused` with the vehicle's words."""
        self.catch_up()
        before = len(self.texts)
        asked = mavutil.mavlink.MAV_PARAM_TYPE_REAL32
        for _ in range(3):
            self.link.mav.param_set_send(self.vehicle, 1, name.encode(), value, asked)
            try:
                told = self.wait("PARAM_VALUE", 2, lambda m: self.of_vehicle(m) and m.param_id == name)
            except AssertionError:
                if any(name in text for text in self.texts[before:]):
                    raise Refused(f"{name} = {value}", "no value", self.texts[before:]) from None
                continue
            if abs(told.param_value - value) > 1e-6 * max(1.0, abs(value)):
                self.accepted(mavlink.MAV_RESULT_DENIED, f"{name} = {value}", before)
            return
        raise AssertionError(f"{name} = {value} not answered; {self.texts[before:]}")

    @contextlib.contextmanager
    def kept_parameters(self) -> Iterator[None]:
        """Whatever is set within this block, by whomever, is put back behind it."""
        before = self.parameters()
        try:
            yield
        finally:
            now = self.parameters()
            for name, value in before.items():
                if now.get(name) != value:
                    self.set_parameter(name, value)


def of_vehicle(message: Any, vehicle: int = 1) -> bool:
    """Whether a vehicle's companion sent it."""
    return message.get_srcSystem() == vehicle and message.get_srcComponent() == 1


def is_armed(message: Any, vehicle: int = 1) -> bool:
    """Whether it is a heartbeat of a vehicle that is armed."""
    return of_vehicle(message, vehicle) and bool(message.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED)
