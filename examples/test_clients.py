"""The same flight by each client: take-off, a point, landing. Those that are not installed are skipped."""

import math

from haltere_testing import degrees

GOAL = (6.0, 5.0, 1.2)


def test_pymavlink(haltere):
    from pymavlink import mavutil

    mav = mavutil.mavlink
    link = haltere.station().link  # pymavlink's own connection; haltere.wait keeps it alive and lets time pass
    link.mav.command_long_send(1, 1, mav.MAV_CMD_COMPONENT_ARM_DISARM, 0, 1, 0, 0, 0, 0, 0, 0)
    haltere.wait(link.motors_armed, 5)
    link.mav.command_long_send(1, 1, mav.MAV_CMD_NAV_TAKEOFF, 0, *[math.nan] * 6, GOAL[2])
    haltere.wait(lambda: haltere.height() > 1.1, 20)
    lat, lon = degrees(*GOAL[:2])
    link.mav.command_int_send(1, 1, mav.MAV_FRAME_GLOBAL_RELATIVE_ALT, mav.MAV_CMD_DO_REPOSITION, 0, 0, -1, 1, 0,
                              math.nan, round(lat * 1e7), round(lon * 1e7), GOAL[2])
    haltere.wait(lambda: haltere.distance(*GOAL[:2]) < 0.4)
    link.mav.command_long_send(1, 1, mav.MAV_CMD_NAV_LAND, 0, *[math.nan] * 7)
    haltere.wait(lambda: not link.motors_armed(), 30)
    haltere.assert_landed()


def test_mavsdk(haltere, mavsdk):
    from mavsdk.plugins.action import Action
    from mavsdk.plugins.offboard import Offboard, PositionNedYaw

    action, offboard = Action(mavsdk), Offboard(mavsdk)
    action.set_takeoff_altitude(GOAL[2])
    action.arm()
    action.takeoff()
    haltere.wait(lambda: haltere.height() > 1.1, 20)
    offboard.set_position_ned(PositionNedYaw(GOAL[0], GOAL[1], -GOAL[2], 0.0))
    offboard.start()
    haltere.wait(lambda: haltere.distance(*GOAL[:2]) < 0.4)
    offboard.stop()
    action.land()
    haltere.assert_landed()


def test_mavproxy(haltere, mavproxy):
    mavproxy.until("arm throttle", "ARM_DISARM: ACCEPTED")
    mavproxy.do(f"takeoff {GOAL[2]}", "NAV_TAKEOFF: ACCEPTED")
    haltere.wait(lambda: "take-off height reached" in haltere.said(), 20)
    lat, lon = degrees(*GOAL[:2])
    mavproxy.do(f"guided {lat:.8f} {lon:.8f} {GOAL[2]}", "DO_REPOSITION: ACCEPTED")
    haltere.wait(lambda: haltere.distance(*GOAL[:2]) < 0.4)
    mavproxy.do("land", "DO_LAND_START: ACCEPTED")
    haltere.assert_landed()


def test_dronekit(haltere, dronekit):
    from dronekit import LocationGlobalRelative, VehicleMode

    haltere.wait(lambda: dronekit.is_armable)
    dronekit.armed = True
    haltere.wait(lambda: dronekit.armed)
    dronekit.simple_takeoff(GOAL[2])
    haltere.wait(lambda: "take-off height reached" in haltere.said())
    dronekit.simple_goto(LocationGlobalRelative(*degrees(*GOAL[:2]), GOAL[2]))
    haltere.wait(lambda: haltere.distance(*GOAL[:2]) < 0.4)
    dronekit.mode = VehicleMode("LAND")
    haltere.assert_landed()
