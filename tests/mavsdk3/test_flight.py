"""MAVSDK 3 by its own asyncio API, as most scripts in the wild are written."""

import asyncio
import math
import socket

from mavsdk import System
from mavsdk.mission_raw import MissionItem
from mavsdk.offboard import PositionNedYaw, VelocityBodyYawspeed

from haltere_testing.rig import degrees, wait_until


def free_port():
    with socket.socket() as s:
        s.bind(("127.0.0.1", 0))
        return s.getsockname()[1]


async def first(stream, holds, seconds=40):
    """The first value that fits."""
    async def look():
        async for value in stream:
            if holds(value):
                return value
    return await asyncio.wait_for(look(), seconds)


async def until(rig, holds, seconds):
    await asyncio.to_thread(wait_until, holds, seconds, rig)


async def connected(rig):
    drone = System(port=free_port())
    await drone.connect(system_address=f"udpout://127.0.0.1:{rig.ports['gps']}")
    await first(drone.core.connection_state(), lambda state: state.is_connected)
    return drone


async def fly(rig):
    drone = await connected(rig)
    # As takeoff_and_land.py waits.
    await first(drone.telemetry.health(),
                lambda h: h.is_global_position_ok and h.is_home_position_ok)
    await drone.param.set_param_float("FLT_TKO_HGT", 1.2)
    assert abs(await drone.param.get_param_float("FLT_TKO_HGT") - 1.2) < 1e-6
    await drone.action.set_takeoff_altitude(1.3)
    await drone.action.arm()
    await drone.action.takeoff()
    await until(rig, lambda: rig.height() > 1.0, 25)
    await first(drone.telemetry.flight_mode(), lambda mode: str(mode) == "HOLD")
    lat, lon = degrees(5.6, 5.2)
    await drone.action.goto_location(lat, lon, 1.4, 0.0)
    await until(rig, lambda: rig.distance(5.6, 5.2) < 0.4, 25)
    # As offboard_position_ned.py does.
    await drone.offboard.set_position_ned(PositionNedYaw(5.6, 5.2, -1.4, 0.0))
    await drone.offboard.start()
    await drone.offboard.set_position_ned(PositionNedYaw(5.0, 5.0, -1.2, 0.0))
    await until(rig, lambda: rig.distance(5.0, 5.0) < 0.4, 20)
    await drone.offboard.set_velocity_body(VelocityBodyYawspeed(0.3, 0.0, 0.0, 0.0))
    await asyncio.sleep(2.0)
    await drone.offboard.stop()
    await first(drone.telemetry.flight_mode(), lambda mode: str(mode) == "HOLD")
    plan = [MissionItem(n, 1, command, int(n == 0), 1, 0.0, 0.0, 0.0, math.nan,
                        round(x * 1e4), round(y * 1e4), -1.2, 0)
            for n, (command, x, y) in enumerate([(22, 5.0, 5.0), (16, 5.4, 5.0), (16, 5.0, 5.0)])]
    await drone.mission_raw.upload_mission(plan)
    assert len(await drone.mission_raw.download_mission()) == 3
    await drone.mission_raw.start_mission()
    await first(drone.mission_raw.mission_progress(), lambda p: p.current == p.total == 3)
    await drone.action.land()
    await first(drone.telemetry.armed(), lambda armed: not armed)


def test_it_flies_from_connect_to_disarm(rig):
    asyncio.run(fly(rig))
    rig.assert_landed()
