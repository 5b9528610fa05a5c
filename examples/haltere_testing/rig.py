"""Simulated tag and board with the real companion, and an endpoint for every kind of client."""

from __future__ import annotations

import os
import pathlib
import shutil
import socket
import subprocess
import tempfile
from typing import Any, Optional, Sequence, Union

from .clock import RealTime, Simulated
from .lookout import Here
from .programs import NOT_JUDGED, Simulator, free_port, installed, program, stop  # noqa: F401  (for those who import them here)
from .vehicle import Vehicle, newest_log, wait_until

os.environ["MAVLINK20"] = "1"

# Origin of the room on Earth, room north 0.
ORIGIN = (0.5, 0.5)
# Where the simulator stands the vehicle in its hall of 10 x 10 x 7 m.
START = (5.0, 5.0)


def hall(north: Sequence[float] = (0.0, 10.0), east: Sequence[float] = (0.0, 10.0), ceiling: float = 7.0) -> str:
    """Anchors in the corners of a hall, as the simulator places them; that of 10 x 10 x 7 m unless told otherwise."""
    lines = ['frame = "ned"']
    for i in range(8):
        x, y, z = north[i & 1], east[i >> 1 & 1], (-float(ceiling) if i & 4 else 0.0)
        lines.append(f"[[anchor]]\nid = {i}\nposition_m = [{float(x)}, {float(y)}, {z}]")
    return "\n".join(lines) + "\n"


def degrees(north: float, east: float) -> tuple[float, float]:
    """Latitude and longitude of a point of the room; at half a degree a metre is 1/110575 degree of
    latitude and 1/111315 of longitude (WGS 84)."""
    return ORIGIN[0] + north / 110575.2, ORIGIN[1] + east / 111315.3


class Rig(Vehicle):
    """One simulated vehicle and its companion. `ports` names the endpoints.

    `lockstep`: both in one process on simulated time that passes only while this script waits; else the
    real companion on the simulator's real wires, in real time. With a `speed` simulated time passes so many
    times as fast as real time instead, for clients with a clock of their own. `scenario` is the text of a scenario file,
    `anchors` that of the survey (`hall()`), `origin` where the room lies on Earth (degrees, degrees, m); `ground` and `more`
    are added to the companion's configuration, `endpoints` to its endpoints.
    """

    def __init__(self, folder: Union[str, os.PathLike, None] = None, lockstep: bool = False, speed: float = 0,
                 seed: int = 1, scenario: str = "", ground: str = "", more: str = "", endpoints: Sequence[str] = (),
                 system_id: int = 1, anchors: Optional[str] = None, origin: Sequence[float] = (*ORIGIN, 0.0)):
        super().__init__(pathlib.Path(folder or tempfile.mkdtemp(prefix="haltere-")))
        self.own_folder = folder is None
        self.companion: Optional[subprocess.Popen] = None
        self.system_id, self.speed = system_id, speed
        if speed and not lockstep:
            raise ValueError("speed: only with lockstep=True; real wires have real time")
        self.ports = {"generic": free_port(), "px4": free_port(), "gps": free_port(),
                      "tcp": free_port(socket.SOCK_STREAM), "slow": free_port(), "script": free_port()}
        where = ["--seed", str(seed), "--truth", str(self.folder / "truth.csv")]
        if scenario:
            (self.folder / "scenario.toml").write_text(scenario)
            where += ["--scenario", str(self.folder / "scenario.toml")]
        config = self.folder / "haltere.toml"
        (self.folder / "anchors.toml").write_text(hall() if anchors is None else anchors)

        def write(wires: str, tcp: str) -> None:
            config.write_text(self._configuration(wires, tcp, ground, more, endpoints, origin))

        if lockstep:
            write("", "")
            self.simulator = Simulator(["lockstep", "--speed", str(speed), "--config", str(config), *where],
                                       self.folder / "companion.txt")
            self.clock = RealTime() if speed else Simulated(self.simulator.run)
            return
        self.clock = RealTime()
        self.simulator = Simulator(
            ["serve", "--board", f"udpout:127.0.0.1:{free_port()}", *where],
            self.folder / "sim.txt")
        # The stand-in for hardware must keep its time beside whatever else this machine computes.
        try:
            os.setpriority(os.PRIO_PROCESS, self.simulator.process.pid, -10)
        except PermissionError:
            pass
        greeting = self.simulator.greeting
        write(f'[tag]\nport = "{greeting["tag"]}"\n[board]\naddress = "{greeting["board"]}"',
              f'"tcpin:127.0.0.1:{self.ports["tcp"]}",')
        self.companion = subprocess.Popen(
            [program(), "companion", "fly", "--config", str(config)], cwd=self.folder,
            stdout=open(self.folder / "companion.txt", "w"), stderr=subprocess.STDOUT)

    def _configuration(self, wires: str, tcp: str, ground: str, more: str, endpoints: Sequence[str],
                       origin: Sequence[float]) -> str:
        p = self.ports
        return f"""
{wires}
[ground]
system_id = {self.system_id}
endpoints = ["udpin:127.0.0.1:{p['generic']}",
             {{ address = "udpin:127.0.0.1:{p['px4']}", identity = "px4", vehicle_type = 2 }},
             {{ address = "udpin:127.0.0.1:{p['gps']}", gps = "origin+gps" }},
             {tcp}
             {{ address = "udpin:127.0.0.1:{p['slow']}", bytes_per_s = 1000 }},
             "udpout:127.0.0.1:{p['script']}"
             {"".join(f', "{e}"' if not e.startswith("{") else f", {e}" for e in endpoints)}]
{ground}
[ground.origin]
latitude_deg = {origin[0]}
longitude_deg = {origin[1]}
altitude_m = {float(origin[2])}
north_deg = 0.0
[flight]
gear_height_m = 0.12
[estimator]
rest_height_m = 0.12
[record]
directory = "{self.folder / 'log'}"
[store]
directory = "{self.folder / 'state'}"
{more}
"""

    def settle(self) -> None:
        """Until the filter has been aligned for a while. A flight begun within the first second loses
        its measurements to the gate now and then, and lands by itself: that is not tested here."""
        wait_until(lambda: "estimator aligned" in self.said(), 30, self)
        self.pass_time(5.0 / (self.speed or 1))

    def fault(self, part: str, state: str = "off", **more: Any) -> None:
        self.simulator.order(fault={"part": part, "state": state, **more})

    def truth(self) -> dict[str, float]:
        return self.simulator.truth()

    def not_judged(self) -> Optional[str]:
        return self.simulator.order(late=True)["not_judged"]

    def here(self) -> Here:
        t = self.truth()
        return Here(t["t_s"], t["pos_E_x_m"], t["pos_E_y_m"], -t["pos_E_z_m"], t["on_ground"] == 0)

    def log(self) -> Optional[pathlib.Path]:
        return newest_log(self.folder / "log")

    def assert_landed(self) -> None:
        wait_until(lambda: self.truth()["on_ground"] == 1, 30, self)
        assert self.truth()["crashed"] == 0, self.truth()

    def end(self) -> None:
        processes = [p for p in (self.companion, self.simulator.process) if p]
        # The companion first: what still flies is landed, which needs the simulated vehicle.
        codes = [code for process in processes for code in stop([process])]
        # That the simulator was late is told by who judges.
        codes[-1] = 0 if codes[-1] == NOT_JUDGED else codes[-1]
        said = self.said()
        assert "panicked" not in said, said
        assert codes == [0] * len(processes), f"exit codes {codes}: {said}"
        if self.own_folder:
            shutil.rmtree(self.folder, ignore_errors=True)
