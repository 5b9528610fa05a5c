"""A flight by hand: arm, take off, hold, follow setpoints, land."""

import time

from conftest import is_armed, mavlink

# type_mask: position and yaw count; velocity and yaw count.
POSITION = 0x9F8
VELOCITY = 0x9C7


def stream(world, seconds, mask, position=(0, 0, 0), velocity=(0, 0, 0)):
    """Sends setpoints at 20 Hz, gives the last estimate."""
    last = None
    deadline = time.monotonic() + seconds
    while time.monotonic() < deadline:
        world.link.mav.set_position_target_local_ned_send(
            0, 1, 1, mavlink.MAV_FRAME_LOCAL_NED, mask, *position, *velocity, 0, 0, 0, 0, 0
        )
        for message in world.drain(0.05):
            if message.get_type() == "LOCAL_POSITION_NED":
                last = message
    return last


def test_takeoff_waits_for_arming_then_holds(world):
    # Some ground stations ask for the take-off first and arm on its acknowledgement.
    result = world.command(mavlink.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, 0, 0, 0, 1.2)
    assert result == mavlink.MAV_RESULT_ACCEPTED, world.texts
    world.drain(1.0)
    assert world.truth()["on_ground"] == 1
    world.arm()
    world.wait("LOCAL_POSITION_NED", 20, lambda m: m.z < -1.0)
    world.drain(4.0)
    truth = world.truth()
    assert abs(truth["pos_E_z_m"] + 1.2) < 0.35, truth
    assert abs(truth["pos_E_x_m"] - 5.0) < 0.5 and abs(truth["pos_E_y_m"] - 5.0) < 0.5, truth
    state = world.wait("EXTENDED_SYS_STATE")
    assert state.landed_state == mavlink.MAV_LANDED_STATE_IN_AIR


def test_position_setpoints_are_followed(world):
    # Setpoints must already flow when the mode is asked for.
    stream(world, 0.5, POSITION, position=(5.8, 5.0, -1.2))
    assert world.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 6, 0) == mavlink.MAV_RESULT_ACCEPTED
    stream(world, 5.0, POSITION, position=(5.8, 5.0, -1.2))
    truth = world.truth()
    assert abs(truth["pos_E_x_m"] - 5.8) < 0.35, truth


def test_velocity_setpoints_are_followed_and_end_in_hold(world):
    before = world.truth()
    stream(world, 2.5, VELOCITY, velocity=(0.0, 0.4, 0.0))
    after = world.truth()
    moved = after["pos_E_y_m"] - before["pos_E_y_m"]
    assert 0.4 < moved < 1.6, moved
    # The client falls silent: the vehicle stays.
    world.wait("HEARTBEAT", 5, lambda m: is_armed(m) and m.custom_mode >> 16 & 0xFF == 4)
    world.drain(2.0)
    rest = world.truth()
    world.drain(1.0)
    assert abs(world.truth()["pos_E_y_m"] - rest["pos_E_y_m"]) < 0.3


def test_landing(world):
    world.land()
    truth = world.truth()
    assert truth["on_ground"] == 1 and truth["crashed"] == 0, truth


def test_second_flight(world):
    # In the usual order, and nothing of the first flight is left over.
    world.arm()
    world.drain(0.5)
    assert world.truth()["on_ground"] == 1
    result = world.command(mavlink.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, 0, 0, 0, 0.8)
    assert result == mavlink.MAV_RESULT_ACCEPTED, world.texts
    world.wait("LOCAL_POSITION_NED", 20, lambda m: m.z < -0.65)
    world.land()
    truth = world.truth()
    assert truth["on_ground"] == 1 and truth["crashed"] == 0, truth
