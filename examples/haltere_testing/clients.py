"""Other people's clients, connected to a vehicle: MAVProxy in a pseudo-terminal, MAVSDK's system, DroneKit's vehicle."""

from __future__ import annotations

import collections
import collections.abc
import json
import os
import pathlib
import re
import shutil
import signal
import sys
import time
from typing import Any, Optional, Union

#: Modules that a flight needs.
MODULES = "arm,mode,misc,cmdlong,wp,param,link,rc,battery,ftp"


def mode_map() -> Optional[pathlib.Path]:
    """The map of modes that MAVProxy and DroneKit need: of this package, or of the sources that it lies in."""
    here = pathlib.Path(__file__).resolve()
    places = (here.parent / "custom_mode_map.json", here.parents[2] / "stations" / "custom_mode_map.json")
    return next((place for place in places if place.exists()), None)


def use_mode_map() -> None:
    """Makes the names of haltere's modes known to pymavlink in this program, as its file in the home folder would."""
    from pymavlink import mavutil
    modes = mode_map()
    if modes is not None:
        for kind, names in json.loads(modes.read_text()).items():
            known = mavutil.AP_MAV_TYPE_MODE_MAP.get(int(kind), {})
            mavutil.AP_MAV_TYPE_MODE_MAP[int(kind)] = {**known, **{int(mode): name for mode, name in names.items()}}


class MavProxy:
    """MAVProxy as a person has it before them: lines are typed, and what it prints is read."""

    def __init__(self, address: str, folder: Union[str, os.PathLike], modules: str = MODULES, vehicle: int = 1):
        import pexpect  # with MAVProxy, which only some tests need
        self._pexpect = pexpect
        folder = pathlib.Path(folder)
        beside = os.path.join(os.path.dirname(sys.executable), "mavproxy.py")
        script = beside if os.path.exists(beside) else shutil.which("mavproxy.py")
        if script is None:
            raise ImportError("mavproxy.py is not there: pip install MAVProxy future pexpect")
        # A home of its own, with the shipped map of modes where pymavlink looks for it.
        home = folder / "home"
        (home / ".pymavlink").mkdir(parents=True, exist_ok=True)
        modes = mode_map()
        if modes is not None:
            shutil.copy(modes, home / ".pymavlink")
        environment = dict(os.environ, HOME=str(home), TERM="dumb", MPLBACKEND="agg", PYTHONWARNINGS="ignore")
        environment.pop("PYTHONPATH", None)
        self.log = open(folder / "mavproxy.txt", "w")
        self.child = pexpect.spawn(
            sys.executable, [script, f"--master={address}", "--mav20", f"--default-modules={modules}",
                             "--state-basedir", str(folder)],
            env=environment, cwd=str(folder), encoding="utf-8", codec_errors="replace", timeout=20, logfile=self.log)
        self.expect(rf"Detected vehicle {vehicle}:1|online system {vehicle}", 40)

    def expect(self, pattern: str, timeout: float = 20) -> int:
        """Waits until it prints something that fits a regular expression."""
        try:
            return self.child.expect(pattern, timeout=timeout)
        except (self._pexpect.TIMEOUT, self._pexpect.EOF) as error:
            self.log.flush()
            raise AssertionError(
                f"{pattern!r} was not said; it said {self.child.before[-1500:]!r}") from error

    def do(self, line: str, pattern: Optional[str] = None, timeout: float = 20) -> None:
        """Types a line, and waits for what it is to bring."""
        self.child.sendline(line)
        if pattern:
            self.expect(pattern, timeout)

    def until(self, line: str, pattern: str, tries: int = 20) -> None:
        """The same again, as a person does who is told to wait."""
        for _ in range(tries):
            self.child.sendline(line)
            if self.child.expect([pattern, self._pexpect.TIMEOUT], timeout=2) == 0:
                return
        raise AssertionError(f"{pattern!r} not after {line!r}: {self.child.before[-1500:]!r}")

    def quiet(self, seconds: float = 1.0) -> str:
        """What it prints within a while."""
        time.sleep(seconds)
        try:
            text = self.child.read_nonblocking(100_000, 0)
        except self._pexpect.TIMEOUT:
            text = ""
        return re.sub(r"\x1b\[[0-9;]*[A-Za-z]", "", text)

    def close(self) -> None:
        """Ends it."""
        # `close` alone gives a child that is to die 0.1 s, and raises where a busy computer takes longer.
        self.child.kill(signal.SIGKILL)
        self.child.wait()
        self.child.close()
        self.log.close()


class Newest:
    """The newest value of one of MAVSDK's subscriptions: `Newest(telemetry.subscribe_armed).value`."""

    def __init__(self, subscribe: Any):
        self.value: Any = None
        self.all: list[Any] = []
        subscribe(self._take)

    def _take(self, value: Any, *_: Any) -> None:
        self.value = value
        self.all.append(value)


def mavsdk_system(address: str, seconds: float = 20.0) -> tuple[Any, Any]:
    """MAVSDK 4 and the system that it found at an address; the first has `destroy()`."""
    try:
        from mavsdk import ComponentType, Configuration, Mavsdk
    except ImportError as error:
        raise ImportError(
            f"{error}: the fixture is for MAVSDK 4 (pip install 'mavsdk>=4'); scripts for version 3 connect to "
            "haltere.address(client='mavsdk') by themselves") from error
    mavsdk = Mavsdk(Configuration.create_with_component_type(ComponentType.GROUND_STATION))
    mavsdk.add_any_connection(address)
    system = mavsdk.first_autopilot(seconds)
    assert system is not None, f"no vehicle at {address} within {seconds} s"
    return mavsdk, system


def dronekit_vehicle(address: str) -> Any:
    """DroneKit's vehicle, connected and ready; 2.9.2 asks for a name that Python 3.10 has moved."""
    setattr(collections, "MutableMapping", collections.abc.MutableMapping)
    import dronekit
    use_mode_map()
    return dronekit.connect(address, wait_ready=True, heartbeat_timeout=30)
