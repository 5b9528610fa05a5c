"""DroneKit 2.9.2 as its examples use it, with the shipped map of modes."""

import time

import pytest

import kite
from haltere_testing.rig import degrees, wait_until

SPEED = 2


@pytest.fixture(scope="module")
def vehicle(rig):
    vehicle = kite.connect(rig.ports["gps"],
                           wait_ready=True)
    yield vehicle
    vehicle.close()


def test_connects_and_sees(rig, vehicle):
    assert vehicle.mode.name == "HOLD"
    assert not vehicle.armed
    wait_until(lambda: vehicle.is_armable, 40, rig)
    lat, lon = degrees(5.0, 5.0)
    wait_until(lambda: vehicle.location.global_frame.lat is not None, 10, rig)
    frame = vehicle.location.global_frame
    assert abs(frame.lat - lat) < 1e-5 and abs(frame.lon - lon) < 1e-5
    wait_until(lambda: vehicle.location.local_frame.north is not None, 10, rig)
    assert abs(vehicle.location.local_frame.north - 5.0) < 0.5
    assert 7.0 < vehicle.battery.voltage < 8.6
    assert vehicle.ekf_ok
    assert vehicle.gps_0.fix_type == 3


def test_parameters(rig, vehicle):
    vehicle.wait_ready("parameters", timeout=30)
    assert len(vehicle.parameters) > 10


def test_arm_take_off_goto(rig, vehicle):
    # DroneKit's own "simple goto" example; its GUIDED is our HOLD.
    vehicle.mode = kite.VehicleMode("HOLD")
    vehicle.armed = True
    wait_until(lambda: vehicle.armed, 15, rig)
    vehicle.simple_takeoff(1.2)
    wait_until(lambda: (vehicle.location.global_relative_frame.alt or 0) > 1.1, 25, rig)
    wait_until(lambda: vehicle.mode.name == "HOLD", 10, rig)
    lat, lon = degrees(5.8, 5.4)
    vehicle.airspeed = 0.5
    vehicle.simple_goto(kite.LocationGlobalRelative(lat, lon, 1.2))
    wait_until(lambda: rig.distance(5.8, 5.4) < 0.4, 25, rig)
    assert vehicle.heading is not None and vehicle.groundspeed is not None


def test_mission(rig, vehicle):
    from dronekit import Command
    relative = 3
    commands = vehicle.commands
    commands.clear()
    for north, east in ((5.0, 5.0), (5.4, 5.0), (5.0, 5.2)):
        lat, lon = degrees(north, east)
        commands.add(Command(0, 0, 0, relative, 16, 0, 0, 0, 0, 0, 0, lat, lon, 1.2))
    commands.upload()
    commands.next = 0
    vehicle.mode = kite.VehicleMode("MISSION")
    wait_until(lambda: vehicle.mode.name == "MISSION", 5, rig)
    wait_until(lambda: rig.distance(5.0, 5.2) < 0.4 and vehicle.mode.name == "HOLD", 60, rig)


def test_return_and_land(rig, vehicle):
    vehicle.mode = kite.VehicleMode("RTL")
    wait_until(lambda: vehicle.mode.name in ("RTL", "LAND"), 5, rig)
    wait_until(lambda: not vehicle.armed, 60, rig)
    rig.assert_landed()
    assert rig.distance(5.0, 5.0) < 0.6


def test_refused_arming_is_seen(rig, vehicle):
    # Landing mode on the floor is granted and does nothing.
    vehicle.mode = kite.VehicleMode("LAND")
    time.sleep(1.0)
    assert not vehicle.armed
