"""MAVProxy 1.8.75 by its own commands, with the shipped map of modes."""

import pytest

from haltere_testing.clients import MavProxy
from haltere_testing.rig import degrees, wait_until

SPEED = 2


@pytest.fixture(scope="module")
def proxy(rig):
    proxy = MavProxy(rig.address(client="mavproxy"), rig.folder)
    yield proxy
    proxy.close()


def test_modes_are_known_by_name(rig, proxy):
    proxy.do("mode", r"Available modes:.*HOLD")
    proxy.do("mode HOLD", r"COMMAND_ACK: DO_SET_MODE: ACCEPTED|Got COMMAND_ACK: DO_SET_MODE: ACCEPTED")


def test_arm_take_off_and_guided(rig, proxy):
    proxy.until("arm throttle", r"ARM_DISARM: ACCEPTED")
    proxy.do("takeoff 1.2", r"NAV_TAKEOFF: ACCEPTED")
    wait_until(lambda: rig.height() > 1.0, 25, rig)
    # Its prompt, which shows every mode; spoken of are only those that last for two seconds.
    told, shown = r"AP: hold: take-off height reached", r"HOLD> "
    proxy.expect(rf"{told}[\s\S]*{shown}|{shown}[\s\S]*{told}", 20)
    lat, lon = degrees(5.8, 5.4)
    proxy.do(f"guided {lat:.8f} {lon:.8f} 1.3", r"DO_REPOSITION: ACCEPTED")
    wait_until(lambda: rig.distance(5.8, 5.4) < 0.4, 25, rig)


def test_speed_yaw_pause(rig, proxy):
    proxy.do("setspeed 0.4", r"DO_CHANGE_SPEED: ACCEPTED")
    proxy.do("setyaw 45 20 0", r"CONDITION_YAW: ACCEPTED")
    wait_until(lambda: abs(yaw_deg(rig) - 45) < 12, 15, rig)
    proxy.do("pause", r"DO_PAUSE_CONTINUE: ACCEPTED")


def yaw_deg(rig):
    import math
    t = rig.truth()
    w, x, y, z = (t[f"q_EB_{k}"] for k in "wxyz")
    return math.degrees(math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)))


def test_offboard_by_a_position_sent_once(rig, proxy):
    before = rig.truth()
    proxy.do("position 0.5 0 0")
    proxy.do("mode OFFBOARD", r"DO_SET_MODE: ACCEPTED")
    moved = lambda: rig.distance(before["pos_E_x_m"], before["pos_E_y_m"])  # noqa: E731
    wait_until(lambda: 0.25 < moved() < 1.0, 15, rig)
    proxy.do("mode HOLD", r"DO_SET_MODE: ACCEPTED")


def test_return_lands(rig, proxy):
    proxy.do("mode RTL", r"DO_SET_MODE: ACCEPTED")
    proxy.expect(r"DISARMED", 60)
    rig.assert_landed()


def test_parameters_and_a_global_mission(rig, proxy):
    proxy.do("param fetch", r"Received \d+ parameters \(ftp\)", 30)
    proxy.do("param show FLT_TKO_HGT", r"FLT_TKO_HGT\s+1")
    plan = rig.folder / "global.waypoints"
    rows = ["QGC WPL 110"]
    for seq, (command, north, east, height) in enumerate(
            [(22, 5.0, 5.0, 1.0), (16, 5.4, 5.0, 1.0), (16, 5.0, 5.0, 1.0), (21, 5.0, 5.0, 0.0)]):
        lat, lon = degrees(north, east)
        rows.append(f"{seq}\t0\t3\t{command}\t0\t0\t0\t0\t{lat:.8f}\t{lon:.8f}\t{height}\t1")
    plan.write_text("\n".join(rows) + "\n")
    proxy.do(f"wp load {plan}", r"Flight plan received|Sent all \d+ waypoints|Loaded \d+ waypoint", 20)
    proxy.do("mode MISSION", r"DO_SET_MODE: ACCEPTED")
    proxy.until("arm throttle", r"ARM_DISARM: ACCEPTED")
    proxy.expect(r"DISARMED", 90)
    rig.assert_landed()


def test_local_mission_by_floats(rig, proxy):
    # Integer items of MAVProxy are 1e7 times metres in every frame: local ones go as floats.
    plan = rig.folder / "plan.waypoints"
    rows = ["QGC WPL 110",
            "0 1 1 22 0 0 0 0 5.0 5.0 -1.0 1", "1 0 1 16 0 0 0 0 5.5 5.0 -1.0 1",
            "2 0 1 16 0 0 0 0 5.0 5.0 -1.0 1", "3 0 1 21 0 0 0 0 0 0 0 1"]
    plan.write_text("\n".join(r.replace(" ", "\t") if r[0].isdigit() else r for r in rows) + "\n")
    proxy.do("set wp_use_mission_int False")
    proxy.do(f"wp load {plan}", r"Flight plan received|Loaded \d+ waypoint", 20)
    proxy.do("wp list", r"Requesting \d+ waypoints|Saved \d+ waypoints", 20)
    proxy.do("mode MISSION", r"DO_SET_MODE: ACCEPTED")
    proxy.until("arm throttle", r"ARM_DISARM: ACCEPTED")
    proxy.expect(r"DISARMED", 90)
    rig.assert_landed()


def test_land_and_disarm_by_command(rig, proxy):
    proxy.until("arm throttle", r"ARM_DISARM: ACCEPTED")
    proxy.do("takeoff 0.8", r"NAV_TAKEOFF: ACCEPTED")
    wait_until(lambda: rig.height() > 0.6, 25, rig)
    proxy.do("land", r"DO_LAND_START: ACCEPTED")
    proxy.expect(r"DISARMED", 60)
    rig.assert_landed()
    proxy.until("arm throttle", r"ARM_DISARM: ACCEPTED")
    proxy.do("disarm", r"ARM_DISARM: ACCEPTED")


def test_origin_fence_and_rally_points(rig, proxy):
    lat, lon = degrees(0.0, 0.0)
    proxy.do(f"setorigin {lat:.7f} {lon:.7f} 0")
    proxy.do("watch GPS_GLOBAL_ORIGIN", r"GPS_GLOBAL_ORIGIN \{latitude : 500000\d, longitude : 500000\d", 20)
    proxy.do("watch")
    for module in ("fence", "rally"):
        proxy.do(f"module load {module}", rf"Loaded module {module}")
    fence = rig.folder / "fence.waypoints"
    rows = ["QGC WPL 110"]
    for seq, (north, east) in enumerate([(1, 1), (1, 9), (9, 9), (9, 1)]):
        lat, lon = degrees(north, east)
        rows.append(f"{seq}\t0\t3\t5001\t4\t0\t0\t0\t{lat:.8f}\t{lon:.8f}\t0\t1")
    fence.write_text("\n".join(rows) + "\n")
    proxy.do(f"fence load {fence}", r"Loaded 4 fence", 20)
    proxy.quiet(4.0)  # it sends in the background; asked to list meanwhile it forgets what it sends
    proxy.do("fence list", r"Saved 4 fence", 20)
    proxy.do("rally list", r"Requesting 0 rally items", 20)


def test_forced_disarm_stops_the_motors(rig, proxy):
    proxy.until("arm throttle", r"ARM_DISARM: ACCEPTED")
    # It tells a change between two heartbeats, one a second: it must have seen an armed one. And the
    # answer and the heartbeat that shows the change come in either order.
    proxy.quiet(3.0)
    proxy.do("disarm force", r"ARM_DISARM: ACCEPTED.*DISARMED|DISARMED.*ARM_DISARM: ACCEPTED", 10)
