"""A real vehicle, with the companion that this computer runs for it: `pytest --haltere-real CONFIG`."""

from __future__ import annotations

import contextlib
import json
import pathlib
import subprocess
import sys
import time
from typing import Any, Iterator, Optional

import pytest

from .clock import RealTime
from .lookout import Here
from .programs import free_port, program
from .vehicle import Vehicle, newest_log, wait_until

#: Time in which a companion that is asked to end has landed, s: what its service is given (docs/SAFETY.md).
LANDS_WITHIN_S = 150.0
#: Armed and in the air, of EXTENDED_SYS_STATE: in the air, taking off, landing.
FLYING = (2, 3, 4)


def ask(question: str) -> None:
    """A question on the terminal, whatever pytest does with input and output; fails unless the answer is yes."""
    try:
        with open("/dev/tty", "r+b", buffering=0) as terminal:
            terminal.write(f"\nhaltere: {question} [yes/no] ".encode())
            answer = terminal.readline().decode(errors="replace").strip().lower()
    except OSError as error:
        pytest.fail(f"haltere: {question} Nobody can answer: no terminal ({error}); run pytest in one")
    if answer not in ("y", "yes"):
        pytest.fail(f"haltere: {question} Answered {answer!r}: it stays on the floor")


def configuration(config: pathlib.Path) -> dict[str, Any]:
    """What a configuration file holds."""
    try:
        import tomllib
    except ImportError:
        pytest.fail(f"--haltere-real {config}: reading it needs Python 3.11 or later, this is {sys.version.split()[0]}")
    try:
        with open(config, "rb") as file:
            return tomllib.load(file)
    except (OSError, tomllib.TOMLDecodeError) as error:
        pytest.fail(f"--haltere-real {config}: {error}")


def inline(endpoint: Any) -> str:
    """A ground endpoint as TOML."""
    if not isinstance(endpoint, dict):
        return json.dumps(endpoint)
    return "{ " + ", ".join(f"{key} = {json.dumps(value)}" for key, value in endpoint.items()) + " }"


class RealVehicle(Vehicle):
    """The vehicle of a configuration file: the companion is started with it, its ground endpoints as they are and the
    helper's own beside them. Positions are the companion's estimate; what only a simulator can do or know skips the test.
    Nothing takes off before somebody has said yes."""

    real = True

    def __init__(self, config: pathlib.Path, folder: pathlib.Path, test: str):
        super().__init__(folder)
        self.clock = RealTime()
        self.test = test
        self.before_arming = self._ask
        self.ports = {name: free_port() for name in ("generic", "px4", "gps", "script")}
        own = [f'"udpin:127.0.0.1:{self.ports["generic"]}"',
               f'{{ address = "udpin:127.0.0.1:{self.ports["px4"]}", identity = "px4", vehicle_type = 2 }}',
               f'{{ address = "udpin:127.0.0.1:{self.ports["gps"]}", gps = "origin+gps" }}',
               f'"udpout:127.0.0.1:{self.ports["script"]}"']
        told = configuration(config)
        others = told.get("ground", {}).get("endpoints", ["udpout:127.0.0.1:14550"])
        endpoints = ", ".join([*map(inline, others), *own])
        self._started = time.time()
        self._where = config.resolve().parent
        self._logs = self._where / told.get("record", {}).get("directory", "logs")
        self.companion = subprocess.Popen(
            [program(), "companion", "fly", "--config", str(config.resolve()), "--set", f"ground.endpoints=[{endpoints}]"],
            cwd=self._where, stdout=open(self.folder / "companion.txt", "w"), stderr=subprocess.STDOUT)

    def settle(self) -> None:
        """Until it knows where it is, and what its parameters are is known."""
        wait_until(lambda: self._runs() and "estimator aligned" in self.said(), 30, self)
        # Its number may be one that a station has set: it is the only vehicle on these ports.
        self.system_id = self.station(vehicle=None).vehicle
        self.observer()
        self.look_out()
        wait_until(self.here, 10, self)

    def _ask(self) -> None:
        ask(f"{self.test} is about to take off. Is the room clear, and somebody at the switch?")

    def _flies(self) -> bool:
        here = self.here()
        return here is not None and here.flies

    def _runs(self) -> bool:
        assert self.companion.poll() is None, f"the companion ended:\n{self.said()}"
        return True

    def address(self, port: str = "generic", *, client: Optional[str] = None) -> str:
        if client is not None:
            # What such a client does is not seen here: asked before it can arm.
            self._ask()
        return super().address(port, client=client)

    def here(self) -> Optional[Here]:
        local, state = self.observer().newest("LOCAL_POSITION_NED"), self.observer().newest("EXTENDED_SYS_STATE")
        if local is None:
            return None
        flies = state is not None and state.landed_state in FLYING
        return Here(local.time_boot_ms / 1000, local.x, local.y, -local.z, flies)

    def truth(self) -> dict[str, float]:
        pytest.skip("truth(): of a simulated vehicle only; position() is what the companion estimates")

    def fault(self, part: str, state: str = "off", **more: Any) -> None:
        pytest.skip(f"fault({part!r}): nothing of a real vehicle is broken for a test")

    def at(self, **when: Any) -> Any:
        pytest.skip("at(): nothing of a real vehicle is broken for a test")

    def log(self) -> Optional[pathlib.Path]:
        return newest_log(self._logs, self._started)

    def assert_landed(self) -> None:
        wait_until(lambda: self.here() is not None and not self._flies(), 30, self)

    def end(self) -> None:
        self.companion.terminate()
        try:
            code = self.companion.wait(LANDS_WITHIN_S)
        except subprocess.TimeoutExpired:
            # Never killed: it may be all that holds the vehicle in the air.
            pytest.fail(f"haltere: the companion (process {self.companion.pid}) has not ended within {LANDS_WITHIN_S:.0f} s: "
                        f"look at the vehicle\n{self.said()[-2500:]}")
        assert "panicked" not in self.said(), self.said()
        assert code == 0, f"exit code {code}: {self.said()}"

    @contextlib.contextmanager
    def kept(self) -> Iterator[None]:
        """Whatever a test does, it stands on the floor behind it, with the parameters that it had before."""
        station = self.stations[0]
        with station.kept_parameters():
            try:
                yield
            finally:
                station.catch_up()
                if self._flies():
                    station.land()
