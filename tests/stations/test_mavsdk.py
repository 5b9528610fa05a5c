"""MAVSDK 4 as its own examples use it, on an endpoint that claims a receiver: they wait for its fix."""

import math
import time

import pytest

from mavsdk import ComponentType, Configuration, Mavsdk
from mavsdk.plugins import action, mission, mission_raw, offboard, param, telemetry

from haltere_testing.rig import degrees, wait_until

SPEED = 2

NAN = float("nan")
LOCAL_NED = 1


class Newest:
    """The newest value of a subscription."""

    def __init__(self, subscribe):
        self.value, self.all = None, []
        subscribe(self.take)

    def take(self, value, *_):
        self.value = value
        self.all.append(value)


class Drone:
    def __init__(self, port):
        self.mavsdk = Mavsdk(Configuration.create_with_component_type(
            ComponentType.GROUND_STATION))
        result = self.mavsdk.add_any_connection(f"udpout://127.0.0.1:{port}")
        assert int(getattr(result, "value", result)) == 0, result
        self.system = self.mavsdk.first_autopilot(20.0)
        assert self.system is not None, "no system discovered"
        self.action = action.Action(self.system)
        self.telemetry = telemetry.Telemetry(self.system)
        self.offboard = offboard.Offboard(self.system)
        self.mission = mission_raw.MissionRaw(self.system)
        t = self.telemetry
        self.health = Newest(t.subscribe_health)
        self.position = Newest(t.subscribe_position)
        self.local = Newest(t.subscribe_position_velocity_ned)
        self.mode = Newest(t.subscribe_flight_mode)
        self.armed = Newest(t.subscribe_armed)
        self.in_air = Newest(t.subscribe_in_air)
        self.landed = Newest(t.subscribe_landed_state)
        self.home = Newest(t.subscribe_home)
        self.battery = Newest(t.subscribe_battery)
        self.text = Newest(t.subscribe_status_text)
        self.odometry = Newest(t.subscribe_odometry)
        self.heading = Newest(t.subscribe_heading)

    def texts(self):
        return [t.text for t in self.text.all[-10:]]


@pytest.fixture(scope="module")
def drone(rig):
    drone = Drone(rig.ports["gps"])
    yield drone
    drone.mavsdk.destroy()


def test_without_the_claim_only_its_global_health_is_missing(rig):
    # MAVSDK takes a global position for good only with a receiver in SYS_STATUS.
    plain = Drone(rig.ports["generic"])
    wait_until(lambda: plain.health.value and plain.health.value.is_armable, 40, rig)
    wait_until(lambda: plain.position.value is not None, 10, rig)
    health = plain.health.value
    assert health.is_local_position_ok and health.is_home_position_ok
    assert not health.is_global_position_ok
    plain.mavsdk.destroy()


def name(value):
    return getattr(value, "name", str(value))


def test_telemetry_comes_without_asking(rig, drone):
    def ready():
        h = drone.health.value
        return h is not None and (h.is_local_position_ok and h.is_global_position_ok
                                  and h.is_home_position_ok and h.is_armable)
    try:
        wait_until(ready, 40, rig)
    except AssertionError as error:
        raise AssertionError(vars(drone.health.value)) from error
    health = drone.health.value
    assert health.is_gyrometer_calibration_ok and health.is_accelerometer_calibration_ok
    # The vehicle has no compass and does not say so either.
    assert not health.is_magnetometer_calibration_ok
    for what in ("position", "local", "battery", "odometry", "heading", "landed", "mode", "home"):
        wait_until(lambda what=what: getattr(drone, what).value is not None, 10, rig)
    lat, lon = degrees(drone.local.value.position.north_m, drone.local.value.position.east_m)
    assert abs(drone.position.value.latitude_deg - lat) < 2e-6
    assert abs(drone.position.value.longitude_deg - lon) < 2e-6
    assert 7.0 < drone.battery.value.voltage_v < 8.6
    assert "HOLD" in name(drone.mode.value), name(drone.mode.value)


def test_rates_and_origin(rig, drone):
    drone.telemetry.set_rate_position_velocity_ned(50.0)
    time.sleep(0.5)
    before, began = len(drone.local.all), rig.truth()["t_s"]
    time.sleep(4.0)
    # For a second of the vehicle's: the computer's may be longer.
    rate = (len(drone.local.all) - before) / (rig.truth()["t_s"] - began)
    assert abs(rate / 50 - 1) < 0.1, rate
    drone.telemetry.set_rate_position_velocity_ned(20.0)
    origin = drone.telemetry.get_gps_global_origin()
    assert abs(origin.latitude_deg - 0.5) < 1e-6
    drone.action.set_gps_global_origin(0.5, 0.5, 0.0)


def test_arm_take_off_goto_hold(rig, drone):
    with pytest.raises(action.ActionError):
        drone.action.goto_location(46.0, 8.0, 5.0, NAN)  # not in this room
    drone.action.arm()
    wait_until(lambda: drone.armed.value, 5, rig)
    drone.action.takeoff()  # its own 2 m
    wait_until(lambda: drone.in_air.value and rig.height() > 1.7, 25, rig)
    wait_until(lambda: "HOLD" in name(drone.mode.value), 15, rig)
    lat, lon = degrees(5.8, 5.3)
    drone.action.goto_location(lat, lon, 1.5, 0.0)
    wait_until(lambda: rig.distance(5.8, 5.3) < 0.4 and abs(rig.height() - 1.5) < 0.3, 25, rig)
    drone.action.set_current_speed(0.4)
    drone.action.hold()
    wait_until(lambda: "HOLD" in name(drone.mode.value), 5, rig)


def test_offboard(rig, drone):
    here = drone.local.value.position
    drone.offboard.set_position_ned(
        offboard.PositionNedYaw(here.north_m, here.east_m, -1.5, 0.0))
    drone.offboard.start()
    wait_until(lambda: "OFFBOARD" in name(drone.mode.value), 5, rig)
    drone.offboard.set_position_ned(offboard.PositionNedYaw(5.2, 5.0, -1.3, 0.0))
    wait_until(lambda: rig.distance(5.2, 5.0) < 0.4, 15, rig)
    drone.offboard.set_velocity_body(offboard.VelocityBodyYawspeed(0.3, 0.0, 0.0, 0.0))
    time.sleep(2.0)
    drone.offboard.set_velocity_ned(offboard.VelocityNedYaw(0.0, 0.0, 0.0, 0.0))
    time.sleep(1.0)
    # Longer than its watchdog, which ends everything when the heartbeat shows another mode.
    lat, lon = degrees(5.3, 5.2)
    drone.offboard.set_position_global(offboard.PositionGlobalYaw(
        lat, lon, 1.4, 0.0, offboard.PositionGlobalYaw.AltitudeType.REL_HOME))
    wait_until(lambda: rig.distance(5.3, 5.2) < 0.4, 15, rig)
    drone.offboard.set_position_velocity_ned(
        offboard.PositionNedYaw(5.0, 5.0, -1.3, 0.0),
        offboard.VelocityNedYaw(0.0, 0.0, 0.0, 0.0))
    wait_until(lambda: rig.distance(5.0, 5.0) < 0.4, 15, rig)
    assert drone.offboard.is_active()
    drone.offboard.stop()
    wait_until(lambda: "HOLD" in name(drone.mode.value), 5, rig)


def test_attitude_setpoints_are_refused_by_rule(rig, drone):
    drone.offboard.set_attitude(offboard.Attitude(0.0, 0.0, 0.0, 0.5))
    time.sleep(1.0)
    with pytest.raises(offboard.OffboardError):
        drone.offboard.start()
    wait_until(lambda: any("SET_ATTITUDE_TARGET refused" in t for t in drone.texts()), 5, rig)
    drone.action.hold()
    time.sleep(0.5)


def test_parameters(rig, drone):
    params = param.Param(drone.system)
    listed = params.get_all_params()
    names = {p.name for p in listed.float_params} | {p.name for p in listed.int_params}
    assert len(names) > 50 and "FLT_TKO_HGT" in names, len(names)
    before = params.get_param_float("FLT_TKO_HGT")
    params.set_param_float("FLT_TKO_HGT", 1.1)
    assert abs(params.get_param_float("FLT_TKO_HGT") - 1.1) < 1e-6
    params.set_param_float("FLT_TKO_HGT", before)
    with pytest.raises(param.ParamError):
        params.set_param_float("FLT_TKO_HGT", 500.0)


def test_mission_in_global_frame(rig, drone):
    # Above home, as its own mission example has it.
    plans = mission.Mission(drone.system)
    items = []
    for north, east in ((5.4, 5.0), (5.4, 5.3)):
        lat, lon = degrees(north, east)
        items.append(mission.MissionItem(
            latitude_deg=lat, longitude_deg=lon, relative_altitude_m=1.3, speed_m_s=0.5,
            is_fly_through=True, gimbal_pitch_deg=NAN, gimbal_yaw_deg=NAN,
            camera_action=mission.MissionItem.CameraAction.NONE, loiter_time_s=NAN,
            camera_photo_interval_s=NAN, acceptance_radius_m=NAN, yaw_deg=NAN,
            camera_photo_distance_m=NAN,
            vehicle_action=mission.MissionItem.VehicleAction.NONE))
    plans.upload_mission(mission.MissionPlan(items))
    back = plans.download_mission()
    assert len(back.mission_items) == 2
    plans.start_mission()
    wait_until(lambda: "MISSION" in name(drone.mode.value), 5, rig)
    wait_until(lambda: rig.distance(5.4, 5.3) < 0.4, 40, rig)
    wait_until(plans.is_mission_finished, 20, rig)


def item(seq, command, x, y, z, p1=0.0):
    return mission_raw.MissionItem(seq, LOCAL_NED, command, 1 if seq == 0 else 0, 1, p1, 0.0, 0.0,
                                   NAN, round(x * 1e4), round(y * 1e4), z, 0)


def test_mission_in_local_frame(rig, drone):
    plan = [item(0, 22, 0, 0, -1.2), item(1, 16, 5.5, 5.0, -1.2), item(2, 16, 5.5, 5.4, -1.2),
            item(3, 16, 5.0, 5.0, -1.2)]
    drone.mission.upload_mission(plan)
    progress = Newest(drone.mission.subscribe_mission_progress)
    back = drone.mission.download_mission()
    assert [(i.command, i.x, i.y) for i in back] == [(i.command, i.x, i.y) for i in plan]
    drone.mission.start_mission()
    wait_until(lambda: "MISSION" in name(drone.mode.value), 5, rig)
    drone.mission.pause_mission()
    wait_until(lambda: "HOLD" in name(drone.mode.value), 5, rig)
    drone.mission.set_current_mission_item(2)
    drone.mission.start_mission()
    wait_until(lambda: progress.value and progress.value.current == progress.value.total == 4, 40,
               rig)


def test_return_lands_and_disarms(rig, drone):
    drone.action.return_to_launch()
    wait_until(lambda: "RETURN" in name(drone.mode.value) or "LAND" in name(drone.mode.value), 5,
               rig)
    wait_until(lambda: not drone.armed.value, 60, rig)
    rig.assert_landed()
    wait_until(lambda: "GROUND" in name(drone.landed.value), 5, rig)
    assert math.isfinite(drone.position.value.relative_altitude_m)


def test_land_and_kill(rig, drone):
    drone.action.set_takeoff_altitude(0.8)
    drone.action.arm()
    drone.action.takeoff()
    wait_until(lambda: rig.height() > 0.6, 25, rig)
    wait_until(lambda: "HOLD" in name(drone.mode.value), 15, rig)
    with pytest.raises(action.ActionError):
        drone.action.disarm()  # in the air it is refused
    drone.action.land()
    wait_until(lambda: not drone.armed.value, 40, rig)
    rig.assert_landed()
    # Kill on the floor.
    drone.action.arm()
    wait_until(lambda: drone.armed.value, 5, rig)
    drone.action.kill()
    wait_until(lambda: not drone.armed.value, 5, rig)
