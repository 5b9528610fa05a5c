"""A square of 2 m with MAVSDK-Python 4, by position setpoints. Connects where its argument says, to an endpoint
with `gps = "origin+gps"`: MAVSDK waits for a global position.

    haltere-sim lockstep --speed 2 &          # a vehicle; or a real companion
    python mavsdk_square.py udpin://0.0.0.0:14540
"""

import math
import sys
import time

from mavsdk import ComponentType, Configuration, Mavsdk
from mavsdk.plugins.action import Action
from mavsdk.plugins.offboard import Offboard, PositionNedYaw
from mavsdk.plugins.telemetry import Telemetry

HEIGHT_M = 1.2
CORNERS = [(4.0, 4.0), (4.0, 6.0), (6.0, 6.0), (6.0, 4.0), (4.0, 4.0)]


class Newest:
    """The newest value of a subscription."""

    def __init__(self, subscribe):
        self.value = None
        subscribe(self.take)

    def take(self, value, *_):
        self.value = value


def wait(what, holds, seconds=40):
    end = time.monotonic() + seconds
    while not holds():
        if time.monotonic() > end:
            sys.exit(f"{what}: not within {seconds} s")
        time.sleep(0.05)
    print(what)


def main(address):
    mavsdk = Mavsdk(Configuration.create_with_component_type(ComponentType.GROUND_STATION))
    mavsdk.add_any_connection(address)
    system = mavsdk.first_autopilot(20.0)
    if system is None:
        sys.exit(f"no vehicle at {address}")
    action, offboard, telemetry = Action(system), Offboard(system), Telemetry(system)
    health = Newest(telemetry.subscribe_health)
    local = Newest(telemetry.subscribe_position_velocity_ned)
    armed = Newest(telemetry.subscribe_armed)
    mode = Newest(telemetry.subscribe_flight_mode)
    telemetry.subscribe_status_text(lambda text, *_: print("vehicle:", text.text))

    wait("ready", lambda: health.value and health.value.is_armable and local.value)
    action.arm()
    action.set_takeoff_altitude(HEIGHT_M)
    action.takeoff()
    wait("in the air", lambda: -local.value.position.down_m > HEIGHT_M - 0.2)
    # Until then the take-off is not over, and other setpoints are refused.
    wait("holds", lambda: "HOLD" in getattr(mode.value, "name", str(mode.value)))

    def away_m(north, east):
        here = local.value.position
        return math.dist((here.north_m, here.east_m, -here.down_m), (north, east, HEIGHT_M))

    for n, (north, east) in enumerate(CORNERS):
        offboard.set_position_ned(PositionNedYaw(north, east, -HEIGHT_M, 0.0))
        if n == 0:
            offboard.start()
        wait(f"reached {north, east}", lambda: away_m(north, east) < 0.4)
    offboard.stop()
    action.land()
    wait("landed", lambda: armed.value is False)
    mavsdk.destroy()


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else "udpin://0.0.0.0:14540")
