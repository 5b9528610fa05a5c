"""Four clients at once, twice in a row, without a retry by hand: each steers its part of a flight."""

import os

os.environ["HALTERE_STOCK_DIALECT"] = "1"  # DroneKit brings its own

import kite  # noqa: E402
import pytest  # noqa: E402
from mavsdk import ComponentType, Configuration, Mavsdk  # noqa: E402
from mavsdk.plugins import action, telemetry  # noqa: E402
from haltere_testing.clients import MavProxy  # noqa: E402
from haltere_testing.rig import degrees, wait_until  # noqa: E402
from haltere_testing.station import NAN, Station, local_item, mavlink  # noqa: E402


REPLAY = True


class Four:
    def __init__(self, rig):
        self.proxy = MavProxy(rig.address(client="mavproxy"), rig.folder)
        self.qgc = Station(f"udpout:127.0.0.1:{rig.ports['px4']}", 255, 190)
        self.vehicle = kite.connect(rig.ports["gps"], wait_ready=["gps_0", "armed", "mode"])
        self.mavsdk = Mavsdk(Configuration.create_with_component_type(
            ComponentType.GROUND_STATION))
        self.mavsdk.add_any_connection(f"tcpout://127.0.0.1:{rig.ports['tcp']}")
        system = self.mavsdk.first_autopilot(20.0)
        assert system is not None
        self.action = action.Action(system)
        self.telemetry = telemetry.Telemetry(system)
        self.armed, self.mode = None, ""
        self.telemetry.subscribe_armed(lambda value, *_: setattr(self, "armed", value))
        self.telemetry.subscribe_flight_mode(
            lambda value, *_: setattr(self, "mode", getattr(value, "name", str(value))))

    def close(self):
        self.mavsdk.destroy()
        self.vehicle.close()
        self.qgc.close()
        self.proxy.close()


@pytest.fixture(scope="module")
def four(rig):
    four = Four(rig)
    yield four
    four.close()


@pytest.mark.parametrize("flight", [1, 2])
def test_four_clients_fly_together(rig, four, flight):
    # MAVSDK arms and takes off; everybody sees it.
    wait_until(lambda: four.vehicle.is_armable, 40, rig)
    four.action.arm()
    wait_until(lambda: four.vehicle.armed and four.armed, 5, rig)
    four.action.set_takeoff_altitude(1.2)
    four.action.takeoff()
    wait_until(lambda: rig.height() > 1.0 and "HOLD" in four.mode, 25, rig)
    wait_until(lambda: four.vehicle.mode.name == "HOLD", 5, rig)
    # The station of QGroundControl's kind sends it to a point.
    lat, lon = degrees(5.7, 5.0)
    result = four.qgc.command_int(mavlink.MAV_CMD_DO_REPOSITION, mavlink.MAV_FRAME_GLOBAL,
                                  round(lat * 1e7), round(lon * 1e7), 1.2, (-1, 1, 0, NAN))
    assert result == mavlink.MAV_RESULT_ACCEPTED, four.qgc.texts
    wait_until(lambda: rig.distance(5.7, 5.0) < 0.4, 20, rig)
    # DroneKit holds; MAVProxy pauses, which is the same and granted too.
    four.vehicle.mode = kite.VehicleMode("HOLD")
    wait_until(lambda: "HOLD" in four.mode, 5, rig)
    four.proxy.quiet(0.0)
    four.proxy.do("mode HOLD", r"DO_SET_MODE: ACCEPTED")
    # The mission of one is started by another.
    way = mavlink.MAV_CMD_NAV_WAYPOINT
    plan = [local_item(way, 5.3, 5.0, 1.2), local_item(way, 5.3, 5.3, 1.2)]
    four.qgc.upload(plan)
    four.vehicle.mode = kite.VehicleMode("MISSION")
    wait_until(lambda: "MISSION" in four.mode, 5, rig)
    wait_until(lambda: rig.distance(5.3, 5.3) < 0.4 and "HOLD" in four.mode, 40, rig)
    # MAVProxy brings it back; all see it disarmed.
    four.proxy.do("mode RTL", r"DO_SET_MODE: ACCEPTED")
    wait_until(lambda: not four.armed and not four.vehicle.armed, 60, rig)
    four.qgc.catch_up()
    four.qgc.wait_disarmed(5)
    rig.assert_landed()
