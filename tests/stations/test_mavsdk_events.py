"""MAVSDK 4: events with the words that the vehicle gives for them, arming checks, and the joystick."""

import threading
import time

import pytest
from mavsdk.plugins import events, manual_control

from haltere_testing.rig import wait_until
from test_mavsdk import Drone, Newest, name

SPEED = 2


@pytest.fixture(scope="module")
def drone(rig):
    drone = Drone(rig.ports["px4"])
    drone.events = events.Events(drone.system)
    drone.happened = Newest(drone.events.subscribe_events)
    drone.checks = Newest(drone.events.subscribe_health_and_arming_checks)
    yield drone
    drone.mavsdk.destroy()


def test_arming_checks_are_reported_with_their_words(rig, drone):
    def checked():
        report = drone.checks.value
        return report is not None and not report.all_problems
    wait_until(checked, 40, rig)
    report = drone.checks.value
    names = {c.name for c in report.health_components}
    assert names >= {"estimate", "uwb", "imu", "battery", "board"}, names
    assert all(c.is_present and not c.has_error for c in report.health_components
               if c.name != "none"), report


def test_changes_of_mode_come_as_events(rig, drone):
    drone.action.arm()
    wait_until(lambda: drone.armed.value, 5, rig)
    wait_until(lambda: any("board armed" in e.message for e in drone.happened.all), 5, rig)
    said = [e for e in drone.happened.all if "board armed" in e.message][0]
    assert (said.event_namespace, said.event_name) == ("haltere", "mode_changed"), vars(said)


class Sticks:
    """A joystick that is held: its position is sent 20 times a second."""

    def __init__(self, plugin):
        self.plugin, self.at, self.ends = plugin, (0.0, 0.0, 0.5, 0.0), threading.Event()
        self.thread = threading.Thread(target=self.send, daemon=True)
        self.thread.start()

    def send(self):
        while not self.ends.wait(0.05):
            self.plugin.set_manual_control_input(*self.at)

    def close(self):
        self.ends.set()
        self.thread.join()


def test_a_joystick_flies_it(rig, drone):
    drone.action.set_takeoff_altitude(1.2)
    drone.action.takeoff()
    wait_until(lambda: rig.height() > 1.0, 25, rig)
    wait_until(lambda: "HOLD" in name(drone.mode.value), 15, rig)
    plugin = manual_control.ManualControl(drone.system)
    sticks = Sticks(plugin)
    time.sleep(0.5)
    plugin.start_position_control()
    wait_until(lambda: "POSCTL" in name(drone.mode.value), 5, rig)
    north = rig.truth()["pos_E_x_m"]
    sticks.at = (0.6, 0.0, 0.5, 0.0)
    wait_until(lambda: rig.truth()["pos_E_x_m"] > north + 0.5, 15, rig)
    sticks.at = (0.0, 0.0, 0.5, 0.0)
    time.sleep(1.5)
    before = rig.truth()
    time.sleep(1.0)
    assert rig.distance(before["pos_E_x_m"], before["pos_E_y_m"]) < 0.25, "it stays when let go"
    sticks.close()
    # Silence ends in Hold.
    wait_until(lambda: "HOLD" in name(drone.mode.value), 5, rig)
    drone.action.land()
    wait_until(lambda: not drone.armed.value, 40, rig)
    rig.assert_landed()
