"""What a ground station sees before any flight. The vehicle is never armed here."""

from conftest import from_autopilot, mavlink


def test_arming_before_alignment_is_refused_with_a_reason(world):
    # The first thing after start: the filter cannot have its start values yet.
    world.texts.clear()
    result = world.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1, 0)
    assert result == mavlink.MAV_RESULT_TEMPORARILY_REJECTED
    # The reason: what it is depends on how long the start took.
    world.said("")


def test_heartbeat_identity(world):
    beat = world.wait("HEARTBEAT", when=from_autopilot)
    assert (beat.get_srcSystem(), beat.get_srcComponent()) == (1, 1)
    assert beat.type == mavlink.MAV_TYPE_FLAPPING_WING
    assert beat.autopilot == mavlink.MAV_AUTOPILOT_GENERIC
    assert beat.base_mode & mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
    assert not beat.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED
    # One a second of the vehicle's own clock.
    messages = [m for m in world.drain(3.2) if from_autopilot(m)]
    stamps = [m.time_boot_ms for m in messages if m.get_type() == "ATTITUDE"]
    beats = len([m for m in messages if m.get_type() == "HEARTBEAT"])
    assert abs(beats - (stamps[-1] - stamps[0]) / 1000) <= 1.2, (beats, stamps[0], stamps[-1])


def test_streams_come_unasked(world):
    for name in ("ATTITUDE", "LOCAL_POSITION_NED", "SYS_STATUS", "BATTERY_STATUS",
                 "EXTENDED_SYS_STATE", "MISSION_CURRENT", "HALTERE_ESTIMATE"):
        world.wait(name, 2.5, from_autopilot)


def test_unsupported_command_is_answered(world):
    result = world.command(mavlink.MAV_CMD_DO_SET_ROI_LOCATION, 0)
    assert result == mavlink.MAV_RESULT_UNSUPPORTED


def test_another_target_is_ignored(world):
    # Addressed to system 7: neither obeyed nor answered.
    world.link.mav.command_long_send(
        7, 1, mavlink.MAV_CMD_DO_SET_ROI_LOCATION, 0, *[0.0] * 7
    )
    assert not [m for m in world.until_answered() if m.get_type() == "COMMAND_ACK"]


def test_damaged_frames_cost_only_themselves(world):
    world.link.write(b"\xfd\x09\x00\x00garbage" * 20)
    result = world.command(mavlink.MAV_CMD_DO_SET_ROI_LOCATION, 0)
    assert result == mavlink.MAV_RESULT_UNSUPPORTED


def test_stands_where_it_stands(world):
    def good(m):
        return m.health == 1
    world.wait("HALTERE_ESTIMATE", 30, good)
    estimate = world.wait("HALTERE_ESTIMATE", 5, good)
    truth = world.truth()
    # The configuration says how high the vehicle stands; without it height on the floor would carry
    # the bias of floor reflections, 0.2 to 0.5 m a pair.
    for i, (axis, allowed) in enumerate(zip("xyz", (0.2, 0.2, 0.2))):
        error = estimate.position[i] - truth[f"pos_E_{axis}_m"]
        assert abs(error) < allowed, f"{axis}: estimate minus truth is {error:.3f} m"
