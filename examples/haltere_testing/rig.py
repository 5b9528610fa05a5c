"""Simulated tag and board with the real companion, and an endpoint for every kind of client."""

import json
import math
import os
import pathlib
import signal
import socket
import subprocess
import time

os.environ["MAVLINK20"] = "1"

SIM = os.environ["HALTERE_TEST_SIM"]
# Origin of the room on Earth, room north 0.
ORIGIN = (0.5, 0.5)
# Where the simulator stands the vehicle in its hall of 10 x 10 x 7 m.
START = (5.0, 5.0)


def free_port(kind=socket.SOCK_DGRAM):
    with socket.socket(socket.AF_INET, kind) as s:
        s.bind(("127.0.0.1", 0))
        return s.getsockname()[1]


def hall():
    lines = ['frame = "ned"']
    for i in range(8):
        x, y, z = (10.0 if i & 1 else 0.0), (10.0 if i & 2 else 0.0), (-7.0 if i & 4 else 0.0)
        lines.append(f"[[anchor]]\nid = {i}\nposition_m = [{x}, {y}, {z}]")
    return "\n".join(lines) + "\n"


def degrees(north, east):
    """Latitude and longitude of a point of the room; at half a degree a metre is 1/110575 degree of
    latitude and 1/111315 of longitude (WGS 84)."""
    return ORIGIN[0] + north / 110575.2, ORIGIN[1] + east / 111315.3


class Rig:
    """One simulated vehicle and its companion. `ports` names the endpoints."""

    def __init__(self, folder, seed=1, ground="", more="", endpoints=()):
        self.folder = pathlib.Path(folder)
        self.truth_file = self.folder / "truth.csv"
        command = [SIM, "serve", "--seed", str(seed), "--truth", str(self.truth_file),
                   "--board", f"udpout:127.0.0.1:{free_port()}"]
        self.sim = subprocess.Popen(command, stdout=subprocess.PIPE,
                                    stderr=open(self.folder / "sim.txt", "w"), text=True)
        # The stand-in for hardware must keep its time beside whatever else this machine computes.
        try:
            os.setpriority(os.PRIO_PROCESS, self.sim.pid, -10)
        except PermissionError:
            pass
        greeting = json.loads(self.sim.stdout.readline())
        self.ports = {"generic": free_port(), "px4": free_port(), "gps": free_port(),
                      "tcp": free_port(socket.SOCK_STREAM), "slow": free_port()}
        p = self.ports
        (self.folder / "anchors.toml").write_text(hall())
        (self.folder / "haltere.toml").write_text(f"""
[tag]
port = "{greeting['tag']}"
[board]
address = "{greeting['board']}"
[ground]
endpoints = ["udpin:127.0.0.1:{p['generic']}",
             {{ address = "udpin:127.0.0.1:{p['px4']}", identity = "px4", vehicle_type = 2 }},
             {{ address = "udpin:127.0.0.1:{p['gps']}", gps = "origin+gps" }},
             "tcpin:127.0.0.1:{p['tcp']}",
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
        self.companion = subprocess.Popen(
            [SIM, "companion", "fly", "--config", str(self.folder / "haltere.toml")],
            cwd=self.folder, stdout=open(self.folder / "companion.txt", "w"),
            stderr=subprocess.STDOUT)

    def settle(self):
        """Until the filter has been aligned for a while. A flight begun within the first second loses
        its measurements to the gate now and then, and lands by itself: that is not tested here."""
        wait_until(lambda: "estimator aligned" in self.said(), 30, self)
        time.sleep(5.0)

    def said(self):
        return (self.folder / "companion.txt").read_text()

    def close(self):
        codes = []
        for process in (self.companion, self.sim):
            if process.poll() is None:
                process.send_signal(signal.SIGTERM)
        for process in (self.companion, self.sim):
            try:
                codes.append(process.wait(timeout=20))
            except subprocess.TimeoutExpired:
                process.kill()
                codes.append("killed")
        said = self.said()
        assert "panicked" not in said, said
        assert codes == [0, 0], f"exit codes {codes}: {said}"

    def assert_replayed(self):
        """The log of this run, lived through again, says every byte that was said."""
        for log in (self.folder / "log").glob("*.mcap"):
            replay = subprocess.run([SIM, "companion", "replay", str(log)], text=True,
                                    capture_output=True, timeout=120)
            said = replay.stdout + replay.stderr
            assert replay.returncode == 0 and "reproduced bit for bit" in said, said

    def truth(self):
        """Newest complete row of the simulator's truth, by column name."""
        with open(self.truth_file, "rb") as f:
            names = f.readline().decode().strip().split(",")
            f.seek(0, os.SEEK_END)
            f.seek(max(f.tell() - 4096, 0))
            lines = f.read().decode(errors="replace").split("\n")
        return dict(zip(names, map(float, lines[-2].split(","))))

    def height(self):
        return -self.truth()["pos_E_z_m"]

    def distance(self, north, east):
        t = self.truth()
        return math.hypot(t["pos_E_x_m"] - north, t["pos_E_y_m"] - east)

    def assert_landed(self):
        wait_until(lambda: self.truth()["on_ground"] == 1, 30, self)
        assert self.truth()["crashed"] == 0, self.truth()


def wait_until(holds, seconds, rig=None, every=0.1):
    """Waits until something holds; says what the companion said when it does not."""
    deadline = time.monotonic() + seconds
    while time.monotonic() < deadline:
        if holds():
            return
        time.sleep(every)
    raise AssertionError(f"did not happen within {seconds} s\n{rig.said()[-2500:] if rig else ''}")
