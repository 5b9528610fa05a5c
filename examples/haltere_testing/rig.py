"""Simulated tag and board with the real companion, and an endpoint for every kind of client."""

import importlib.metadata
import json
import math
import os
import pathlib
import shutil
import signal
import socket
import subprocess
import tempfile
import threading
import time

from .clock import RealTime, Simulated

os.environ["MAVLINK20"] = "1"

# Origin of the room on Earth, room north 0.
ORIGIN = (0.5, 0.5)
# Where the simulator stands the vehicle in its hall of 10 x 10 x 7 m.
START = (5.0, 5.0)


def installed():
    """The simulator program that came with this package, where it was a wheel that holds it."""
    try:
        files = importlib.metadata.files("haltere-testing") or ()
    except importlib.metadata.PackageNotFoundError:
        return None
    places = (pathlib.Path(f.locate()).resolve() for f in files if f.name == "haltere-sim")
    return next((str(place) for place in places if place.exists()), None)


def program():
    """The simulator program, which is also the companion: HALTERE_SIM, else the one of the wheel, else the one
    on the path, else one built in this repository."""
    named = os.environ.get("HALTERE_TEST_SIM") or os.environ.get("HALTERE_SIM")
    found = named or installed() or shutil.which("haltere-sim")
    root = pathlib.Path(__file__).resolve().parents[2]
    for profile in ("release", "debug"):
        built = root / "target" / profile / "haltere-sim"
        if found is None and built.exists():
            found = str(built)
    if found is None or not os.path.exists(found):
        raise FileNotFoundError(
            f"haltere-sim is not {'at ' + found if found else 'in this package nor on the path'}: install the "
            "wheel that holds it (packaging/build-wheel), set HALTERE_SIM to the program, or build it with "
            "`cargo build --release --workspace`")
    return found


def free_port(kind=socket.SOCK_DGRAM):
    with socket.socket(socket.AF_INET, kind) as s:
        s.bind(("127.0.0.1", 0))
        return s.getsockname()[1]


def hall():
    """Anchors in the corners of the 10 x 10 x 7 m hall, as the simulator places them."""
    lines = ['frame = "ned"']
    for i in range(8):
        x, y, z = (10.0 if i & 1 else 0.0), (10.0 if i & 2 else 0.0), (-7.0 if i & 4 else 0.0)
        lines.append(f"[[anchor]]\nid = {i}\nposition_m = [{x}, {y}, {z}]")
    return "\n".join(lines) + "\n"


def degrees(north, east):
    """Latitude and longitude of a point of the room; at half a degree a metre is 1/110575 degree of
    latitude and 1/111315 of longitude (WGS 84)."""
    return ORIGIN[0] + north / 110575.2, ORIGIN[1] + east / 111315.3


class Simulator:
    """A process of haltere-sim that takes orders: `serve` (tag and board in real time) or `lockstep`
    (companion included, on simulated time). `said` is the file that holds what it says."""

    def __init__(self, arguments, said):
        self.said = pathlib.Path(said)
        self.lock = threading.Lock()
        self.process = subprocess.Popen(
            [program(), *arguments, "--orders"], stdin=subprocess.PIPE, stdout=subprocess.PIPE,
            stderr=open(self.said, "w"), text=True)
        line = self.process.stdout.readline()
        if not line:
            raise RuntimeError(f"haltere-sim did not start: {self.said.read_text()}")
        self.greeting = json.loads(line)

    def order(self, **order):
        with self.lock:
            try:
                self.process.stdin.write(json.dumps(order) + "\n")
                self.process.stdin.flush()
                line = self.process.stdout.readline()
            except BrokenPipeError:
                line = ""
        if not line:
            raise RuntimeError(f"haltere-sim is gone: {self.said.read_text()[-2000:]}")
        answer = json.loads(line)
        if "error" in answer:
            raise ValueError(answer["error"])
        return answer

    def run(self, seconds):
        """Lets simulated time pass; gives what it is then, s."""
        return self.order(run_s=seconds)["t_s"]

    def truth(self):
        """What really is, by the names of the columns of a truth file."""
        return self.order(truth=True)["truth"]


def stop(processes, seconds=40):
    """Ends processes by a signal; gives their exit codes."""
    codes = []
    for process in processes:
        if process.poll() is None:
            process.send_signal(signal.SIGTERM)
    for process in processes:
        try:
            codes.append(process.wait(timeout=seconds))
        except subprocess.TimeoutExpired:
            process.kill()
            codes.append("killed")
    return codes


def wait_until(holds, seconds, rig=None, every=0.1):
    """Waits until something holds; says what the companion said when it does not."""
    clock = rig.clock if rig else RealTime()
    deadline = clock.now() + clock.patience(seconds)
    while clock.now() < deadline:
        if holds():
            return
        if rig and clock.lockstep:
            rig.pass_time(every)
        else:
            clock.sleep(every)
    raise AssertionError(f"did not happen within {seconds} s\n{rig.said()[-2500:] if rig else ''}")


class Rig:
    """One simulated vehicle and its companion. `ports` names the endpoints.

    `lockstep`: both in one process on simulated time that passes only while this script waits; else the
    real companion on the simulator's real wires, in real time. With a `speed` simulated time passes so many
    times as fast as real time instead, for clients with a clock of their own. `scenario` is the text of a scenario file;
    `ground` and `more` are added to the companion's configuration, `endpoints` to its endpoints.
    """

    def __init__(self, folder=None, lockstep=False, speed=0, seed=1, scenario="", ground="", more="",
                 endpoints=()):
        self.own_folder = folder is None
        self.folder = pathlib.Path(folder or tempfile.mkdtemp(prefix="haltere-"))
        self.stations = []
        self.companion = None
        if speed and not lockstep:
            raise ValueError("speed: only with lockstep=True; real wires have real time")
        self.ports = {"generic": free_port(), "px4": free_port(), "gps": free_port(),
                      "tcp": free_port(socket.SOCK_STREAM), "slow": free_port()}
        where = ["--seed", str(seed), "--truth", str(self.folder / "truth.csv")]
        if scenario:
            (self.folder / "scenario.toml").write_text(scenario)
            where += ["--scenario", str(self.folder / "scenario.toml")]
        config = self.folder / "haltere.toml"
        (self.folder / "anchors.toml").write_text(hall())
        if lockstep:
            self.write(config, "", "", lockstep, ground, more, endpoints)
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
        self.write(config, greeting["tag"], greeting["board"], lockstep, ground, more, endpoints)
        self.companion = subprocess.Popen(
            [program(), "companion", "fly", "--config", str(config)], cwd=self.folder,
            stdout=open(self.folder / "companion.txt", "w"), stderr=subprocess.STDOUT)

    def write(self, config, tag, board, lockstep, ground, more, endpoints):
        p = self.ports
        tcp = "" if lockstep else f'"tcpin:127.0.0.1:{p["tcp"]}",'
        wires = "" if lockstep else f'[tag]\nport = "{tag}"\n[board]\naddress = "{board}"'
        config.write_text(f"""
{wires}
[ground]
endpoints = ["udpin:127.0.0.1:{p['generic']}",
             {{ address = "udpin:127.0.0.1:{p['px4']}", identity = "px4", vehicle_type = 2 }},
             {{ address = "udpin:127.0.0.1:{p['gps']}", gps = "origin+gps" }},
             {tcp}
             {{ address = "udpin:127.0.0.1:{p['slow']}", bytes_per_s = 1000 }}
             {"".join(f', "{e}"' for e in endpoints)}]
{ground}
[ground.origin]
latitude_deg = {ORIGIN[0]}
longitude_deg = {ORIGIN[1]}
altitude_m = 0.0
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
""")

    def settle(self):
        """Until the filter has been aligned for a while. A flight begun within the first second loses
        its measurements to the gate now and then, and lands by itself: that is not tested here."""
        wait_until(lambda: "estimator aligned" in self.said(), 30, self)
        self.pass_time(5.0)

    def said(self):
        """What the companion said to people."""
        return (self.folder / "companion.txt").read_text()

    # -- what a mission test does

    def address(self, port="generic"):
        """Where a client of this kind connects to."""
        return f"udpout:127.0.0.1:{self.ports[port]}"

    def station(self, port="generic", system=255, **more):
        """A ground station that is connected."""
        from .station import Station  # needs pymavlink, which other clients do not
        station = Station(self.address(port), system, clock=self.clock, **more)
        self.stations.append(station)
        return station

    def wait(self, holds, seconds=30.0):
        """Waits until something holds, with the stations alive; fails with what the companion said."""
        deadline = self.clock.now() + self.clock.patience(seconds)
        while not holds():
            if self.clock.now() >= deadline:
                raise AssertionError(
                    f"did not happen within {seconds} s; truth {self.truth()}\n{self.said()[-2500:]}")
            self.pass_time(0.05)

    def pass_time(self, seconds):
        """Lets time pass; stations send their heartbeats and keep the texts that come."""
        end = self.clock.now() + seconds
        while end - self.clock.now() > 1e-6:
            self.clock.sleep(min(0.1, end - self.clock.now()))
            for station in self.stations:
                station.beat()
                station.catch_up()

    def fault(self, part, state="off", **more):
        """Breaks something now, in the words of a scenario's [[fault]]: `fault("anchor", anchor=3)`."""
        self.simulator.order(fault={"part": part, "state": state, **more})

    def mend(self, part, **more):
        """Mends it."""
        self.fault(part, "healthy", **more)

    def truth(self):
        """What really is, which the companion does not know: by the columns of the truth file."""
        return self.simulator.truth()

    def height(self):
        return -self.truth()["pos_E_z_m"]

    def distance(self, north, east):
        """In the plane, m."""
        t = self.truth()
        return math.hypot(t["pos_E_x_m"] - north, t["pos_E_y_m"] - east)

    def assert_landed(self):
        wait_until(lambda: self.truth()["on_ground"] == 1, 30, self)
        assert self.truth()["crashed"] == 0, self.truth()

    # -- the end

    def close(self):
        for station in self.stations:
            station.close()
        processes = [p for p in (self.companion, self.simulator.process) if p]
        # The companion first: what still flies is landed, which needs the simulated vehicle.
        codes = [code for process in processes for code in stop([process])]
        said = self.said()
        assert "panicked" not in said, said
        assert codes == [0] * len(processes), f"exit codes {codes}: {said}"
        if self.own_folder:
            shutil.rmtree(self.folder, ignore_errors=True)

    def assert_replayed(self):
        """The log of this run, lived through again, says every byte that was said."""
        logs = list((self.folder / "log").glob("*.mcap"))
        assert logs, f"no log in {self.folder}"
        for log in logs:
            replay = subprocess.run([program(), "companion", "replay", str(log)], text=True,
                                    capture_output=True, timeout=120)
            said = replay.stdout + replay.stderr
            assert replay.returncode == 0 and "reproduced bit for bit" in said, said

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.close()
