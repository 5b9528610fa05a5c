"""The first lines of any script of pymavlink's own documentation, unchanged, against each way to a vehicle, at the address
that is printed there."""

import math
import re
import subprocess
import sys

from haltere_testing.programs import Simulator, free_port, program, stop
from haltere_testing.rig import Rig, hall, wait_until
from haltere_testing.station import Station

SCRIPT = """
import sys
from pymavlink import mavutil
link = mavutil.mavlink_connection(sys.argv[1])
link.wait_heartbeat()
print("system", link.target_system)
while not link.motors_armed():
    link.arducopter_arm()
    link.wait_heartbeat()
link.mav.command_long_send(link.target_system, link.target_component, mavutil.mavlink.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, 0, 0, 0, 0, 1)
while link.recv_match(type="LOCAL_POSITION_NED", blocking=True).z > -0.8: pass
link.mav.command_long_send(link.target_system, link.target_component, mavutil.mavlink.MAV_CMD_NAV_LAND, 0, 0, 0, 0, 0, 0, 0, 0)
link.motors_disarmed_wait()
print("landed")
"""
LIMIT_S = 120


def run(address, folder):
    ran = subprocess.run([sys.executable, "-c", SCRIPT, address], cwd=folder, text=True, capture_output=True, timeout=LIMIT_S)
    assert ran.returncode == 0 and ran.stdout.split() == ["system", "1", "landed"], (address, ran)


def beside_others():
    """Other tests have the port that every script begins with."""
    return ["--set", f'ground.endpoints=["udpout:127.0.0.1:{free_port()}"]']


def usual(addresses):
    """The address that a script begins with."""
    found = [address for address in addresses if re.fullmatch(r"udpin:127\.0\.0\.1:\d+", address)]
    assert found, addresses
    return found[0]


def test_against_lockstep(tmp_path):
    simulator = Simulator(["lockstep", "--speed", "5", "--set", f"record.directory={tmp_path / 'log'}", *beside_others()],
                          tmp_path / "sim.txt")
    try:
        run(usual(simulator.greeting["ground"]), tmp_path)
        assert simulator.truth()["crashed"] == 0
    finally:
        stop([simulator.process])


def test_against_simulator_and_companion(tmp_path):
    simulator = Simulator(["serve"], tmp_path / "sim.txt")
    said, companion = tmp_path / "companion.txt", None
    try:
        (tmp_path / "anchors.toml.told").write_text(hall())
        subprocess.run([program(), "companion", "init", "--yes", "--no-probe", "--tag", simulator.greeting["tag"],
                        "--board", simulator.greeting["board"], "--station", "pymavlink", "--anchors", "anchors.toml.told"],
                       cwd=tmp_path, check=True)
        companion = subprocess.Popen(
            [program(), "companion", "fly", "--set", "flight.gear_height_m=0.12", "--set", "estimator.rest_height_m=0.12",
             "--set", "watch.address=", *beside_others()],
            cwd=tmp_path, stdout=open(said, "w"), stderr=subprocess.STDOUT)
        wait_until(lambda: "stations: " in said.read_text(), 20)
        run(usual(re.findall(r"stations: (\S+)", said.read_text())), tmp_path)
        assert simulator.truth()["crashed"] == 0
    finally:
        codes = stop([*([companion] if companion else []), simulator.process])
    assert codes == [0, 0], said.read_text()


def test_against_the_helper(tmp_path):
    """The address that the fixture gives for pymavlink; and its own stations beat in the vehicle's time."""
    speed = 5
    with Rig(tmp_path, lockstep=True, speed=speed) as rig:
        rig.settle()
        run(rig.address(client="pymavlink"), tmp_path)
        station = rig.station()
        beats, send = [], station.link.mav.heartbeat_send
        station.link.mav.heartbeat_send = lambda *told: beats.append(rig.truth()["t_s"]) or send(*told)
        began = rig.truth()["t_s"]
        rig.pass_time(20 / speed)
        passed = rig.truth()["t_s"] - began
        # One for each second of the vehicle, less what a busy computer holds up.
        assert len(beats) > 0.7 * passed, (len(beats), passed)


def test_the_room_that_is_shipped(tmp_path):
    """Where the simulators of PX4 have their home, and the vehicle stands in its middle."""
    simulator = Simulator(["lockstep", "--speed", "5", "--scenario", "zurich", "--set", "record.enabled=false", *beside_others()],
                          tmp_path / "sim.txt")
    try:
        station = Station(usual(simulator.greeting["ground"]))
        told = station.wait("GLOBAL_POSITION_INT", 30, lambda m: abs(m.relative_alt) < 500)
        station.close()
        assert math.dist((told.lat * 1e-7, told.lon * 1e-7), (47.397742, 8.545594)) < 2e-5, told
        assert abs(told.alt * 1e-3 - 488.0) < 1.0, told
    finally:
        stop([simulator.process])
