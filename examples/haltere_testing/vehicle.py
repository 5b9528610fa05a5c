"""What a mission test does with a vehicle, simulated or real."""

from __future__ import annotations

import math
import pathlib
import re
import subprocess
import time
from typing import Any, Callable, Optional, Sequence

from .clock import RealTime, Simulated
from .lookout import Here, Lookout, Moment, Point, assert_along
from .programs import program

#: The endpoint that each client needs, and how it writes an address.
CLIENTS = {"pymavlink": ("script", "udpin:"), "mavproxy": ("generic", "udpout:"), "dronekit": ("gps", "udpout:"),
           "mavsdk": ("gps", "udpout://"), "qgroundcontrol": ("px4", "")}

#: A line in which the companion says that something is wrong.
EVENT = re.compile(r"^\S+Z\s+(?:WARN|ERROR)\s+(.*)$", re.MULTILINE)


class Vehicle:
    """One vehicle with its companion. `ports` names the companion's endpoints."""

    clock: RealTime | Simulated
    #: Whether people stand next to it.
    real = False
    #: Its number on the network.
    system_id = 1
    #: What is asked before it may take off; raises where the answer is no.
    before_arming: Optional[Callable[[], None]] = None

    def __init__(self, folder: pathlib.Path):
        self.folder = folder
        self.ports: dict[str, int] = {}
        self.stations: list[Any] = []
        self.lookout: Optional[Lookout] = None
        self._observer: Any = None
        self._closed = False

    # -- clients

    def address(self, port: str = "generic", *, client: Optional[str] = None) -> str:
        """Where a client connects to: the endpoint of that name, or the one that `client` needs, as it writes it."""
        if client is None:
            return f"udpout:127.0.0.1:{self.ports[port]}"
        if client not in CLIENTS:
            raise ValueError(f"client {client!r}: allowed are {', '.join(CLIENTS)}")
        port, scheme = CLIENTS[client]
        return f"{scheme}127.0.0.1:{self.ports[port]}"

    def station(self, port: str = "generic", system: int = 255, **more: Any) -> Any:
        """A ground station of pymavlink that is connected."""
        from .station import Station  # needs pymavlink, which other clients do not
        more.setdefault("vehicle", self.system_id)
        station = Station(self.address(port), system, clock=self.clock, before_arming=self.before_arming, **more)
        self.stations.append(station)
        return station

    # -- time

    def wait(self, holds: Callable[[], Any], seconds: float = 30.0) -> None:
        """Waits until something holds, with the stations alive; fails with what the companion said."""
        deadline = self.clock.now() + self.clock.patience(seconds)
        while not holds():
            if self.clock.now() >= deadline:
                raise AssertionError(f"did not happen within {seconds} s; {self.position()}\n{self.said()[-2500:]}")
            self.pass_time(0.05)

    def pass_time(self, seconds: float) -> None:
        """Lets time pass; stations send their heartbeats and keep the texts that come."""
        end = self.clock.now() + seconds
        while end - self.clock.now() > 1e-6:
            self.clock.sleep(min(0.1, end - self.clock.now()))
            for station in self.stations:
                station.beat()
                station.catch_up()
            if self.lookout is not None:
                self.lookout.check()

    # -- what is

    def here(self) -> Optional[Here]:
        """Where it is now; None: nothing is known yet."""
        raise NotImplementedError

    def truth(self) -> dict[str, float]:
        """What really is, which the companion does not know: by the columns of a truth file."""
        raise NotImplementedError

    def not_judged(self) -> Optional[str]:
        """Why a failure says nothing of the vehicle: its simulator did not keep its time. None: it did."""
        return None

    def position(self) -> tuple[float, float, float]:
        """North, east and height over the floor, m: in truth, of a real vehicle as estimated."""
        here = self.here()
        assert here is not None, f"no position is known\n{self.said()[-2500:]}"
        return here.place

    def height(self) -> float:
        """Over the floor, m."""
        return self.position()[2]

    def distance(self, north: float, east: float) -> float:
        """From a point, in the plane, m."""
        at = self.position()
        return math.hypot(at[0] - north, at[1] - east)

    def said(self) -> str:
        """What the companion said to people."""
        file = self.folder / "companion.txt"
        return file.read_text(errors="replace") if file.exists() else ""

    def events(self) -> list[str]:
        """The warnings, alarms and faults of it."""
        return EVENT.findall(self.said())

    def log(self) -> Optional[pathlib.Path]:
        """The newest flight log; None: there is none."""
        raise NotImplementedError

    # -- faults

    def fault(self, part: str, state: str = "off", **more: Any) -> None:
        """Breaks something now, in the words of a scenario's [[fault]]: `fault("anchor", anchor=3)`."""
        raise NotImplementedError

    def mend(self, part: str, **more: Any) -> None:
        """Mends it."""
        self.fault(part, "healthy", **more)

    def at(self, *, time_s: Optional[float] = None, near: Optional[Point] = None, within: float = 0.5,
           item: Optional[int] = None) -> Moment:
        """A moment that comes once: `time_s` seconds from now, `near` a point (north, east, height) while it flies, or as
        the mission begins with an `item`. `at(item=3).fault("anchor", anchor=3)` breaks something then."""
        if [time_s, near, item].count(None) != 2:
            raise ValueError("at(): one of time_s, near and item is due")
        if time_s is not None:
            began = self.here()
            start_s = began.t_s if began else 0.0
            words, holds = f"at(time_s={time_s})", lambda here: here.t_s >= start_s + time_s
        elif near is not None:
            point = tuple(near)
            words = f"at(near={point}, within={within})"
            holds = lambda here: here.flies and math.dist(here.place, point) <= within  # noqa: E731
        else:
            observer = self.observer()
            words, holds = f"at(item={item})", lambda here: here.flies and observer.item() == item
        moment = Moment(words, holds, self)
        self.look_out().moments.append(moment)
        return moment

    def look_out(self) -> Lookout:
        """Keeps the track from now on. The fixture does it by itself."""
        if self.lookout is None:
            self.lookout = Lookout(self._look)
            if isinstance(self.clock, Simulated):
                self.clock.lookers.append(self.lookout.look)
            else:
                self.lookout.start()
        return self.lookout

    def observer(self) -> Any:
        """A station of the helper's own, which only listens."""
        if self._observer is None:
            from .station import Station
            # Not one of `stations`: whoever looks out reads it, perhaps on another thread.
            self._observer = Station(self.address(), 250, clock=self.clock, vehicle=self.system_id)
        return self._observer

    def _look(self) -> Optional[Here]:
        if self._observer is not None:
            self._observer.beat()
            self._observer.catch_up()
        return self.here()

    # -- what must have been

    def assert_landed(self) -> None:
        """It stands on the floor, and is whole."""
        raise NotImplementedError

    def assert_track(self, corners: Sequence[Point], within: float) -> float:
        """The flight passed each corner (north, east, height in m) in its order within so many metres, and stayed as near
        to the straight ways between them: in truth, of a real vehicle as estimated. Gives the largest distance, m."""
        if self.lookout is None:
            raise ValueError("no track was kept: call look_out() before the flight")
        self.lookout.check()
        return assert_along(self.lookout.track, corners, within)

    def assert_no_events(self, but: Sequence[str] = ()) -> None:
        """The companion said no warning, alarm or fault, but such as hold one of these words."""
        events = [event for event in self.events() if not any(words in event for words in but)]
        assert not events, "the companion said: " + "; ".join(events)

    def assert_replayed(self) -> None:
        """The log of this run, lived through again, says every byte that was said."""
        log = self.log()
        assert log, f"no log in {self.folder}"
        replay = subprocess.run([program(), "companion", "replay", str(log)], text=True, capture_output=True,
                                timeout=120)
        said = replay.stdout + replay.stderr
        assert replay.returncode == 0 and "reproduced bit for bit" in said, said

    # -- the end

    def facts(self) -> list[str]:
        """How it stands, for who reads of a failure."""
        place = "north {:.2f}, east {:.2f}, height {:.2f} m"
        facts = []
        here = or_none(self.here)
        if here is not None:
            name = "estimated position" if self.real else "true position"
            facts += [f"vehicle's time: {here.t_s:.2f} s", f"{name}: {place.format(*here.place)}"]
        estimate = None if self.real else or_none(self.estimate)
        if estimate is not None:
            facts.append(f"estimated position: {place.format(*estimate)}")
        lines = self.said().splitlines()
        late = or_none(self.not_judged)
        facts += [late] if late else []
        facts += ["the companion said last:", *[f"  {line}" for line in lines[-12:]], f"log: {or_none(self.log)}"]
        return facts

    def estimate(self) -> Optional[tuple[float, float, float]]:
        """North, east and height as the companion tells them now, m."""
        from .station import Station
        station = Station(self.address(), 249, clock=self.clock, vehicle=self.system_id, timeout=3)
        try:
            told = station.wait("LOCAL_POSITION_NED", 3)
            return told.x, told.y, -told.z
        finally:
            station.close()

    def page(self) -> Optional[pathlib.Path]:
        """The log of the flight drawn as a page (`haltere report`), after `close`; None: it could not be drawn."""
        log, page = self.log(), self.folder / "report.html"
        if log is None:
            return None
        truth = self.folder / "truth.csv"
        with_truth = ["--truth", str(truth)] if truth.exists() else []
        drawn = subprocess.run([program(), "companion", "report", str(log), *with_truth, "--output", str(page)],
                               capture_output=True, timeout=120)
        return page if drawn.returncode == 0 else None

    def close(self) -> None:
        """Ends everything; what still flies is landed first."""
        if self._closed:
            return
        self._closed = True
        if self.lookout is not None:
            self.lookout.close()
            if isinstance(self.clock, Simulated):
                self.clock.lookers.remove(self.lookout.look)
        for station in [*self.stations, *([self._observer] if self._observer else [])]:
            station.close()
        self.end()

    def end(self) -> None:
        """Ends the programs."""
        raise NotImplementedError

    def __enter__(self) -> Any:
        return self

    def __exit__(self, *_: Any) -> None:
        self.close()


def or_none(look: Callable[[], Any]) -> Any:
    """A failure is told with what can be found, whatever else is broken."""
    try:
        return look()
    except Exception:
        return None


def newest_log(folder: pathlib.Path, since_s: float = 0.0) -> Optional[pathlib.Path]:
    """The newest log of a folder that was written to after a moment of the wall's time."""
    logs = [log for log in folder.glob("*.mcap") if log.stat().st_mtime >= since_s]
    return max(logs, key=lambda log: log.stat().st_mtime, default=None)


def wait_until(holds: Callable[[], Any], seconds: float, rig: Optional[Vehicle] = None, every: float = 0.1) -> None:
    """Waits until something holds; says what the companion said when it does not."""
    clock = rig.clock if rig else RealTime()
    deadline = clock.now() + clock.patience(seconds)
    while clock.now() < deadline:
        if holds():
            return
        if rig and clock.lockstep:
            rig.pass_time(every)
        else:
            time.sleep(every)
    raise AssertionError(f"did not happen within {seconds} s\n{rig.said()[-2500:] if rig else ''}")
