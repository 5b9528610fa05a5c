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
                 "EXTENDED_SYS_STATE", "MISSION_CURRENT"):
        world.wait(name, 2.5, from_autopilot)


def test_messages_of_our_own_come_to_who_asks_alone(world):
    # Whoever does not know them counts the gaps that they leave in the sequence as loss.
    names = {m.get_type() for m in world.drain(2.2) if from_autopilot(m)}
    assert not {name for name in names if name.startswith("HALTERE_")}, names


def test_values_that_no_dialect_knows_are_answered(world):
    assert world.command(42999) == mavlink.MAV_RESULT_UNSUPPORTED
    world.link.mav.mission_count_send(1, 1, 1, 77)
    refused = world.wait("MISSION_ACK", 2, lambda m: m.mission_type == 77)
    assert refused.type == mavlink.MAV_MISSION_UNSUPPORTED
    world.link.mav.mission_count_send(1, 1, 1, 0)
    world.wait("MISSION_REQUEST_INT", 2)
    world.link.mav.mission_item_int_send(1, 1, 0, 0, 42703, 0, 1, *[0.0] * 4, 0, 0, 1.0, 0)
    assert world.wait("MISSION_ACK", 2).type == mavlink.MAV_MISSION_UNSUPPORTED
    world.link.mav.param_set_send(1, 1, b"FLT_TKO_HGT", 1.5, 12)
    assert world.wait("PARAM_ERROR", 2).error == mavlink.MAV_PARAM_ERROR_TYPE_MISMATCH


def test_the_imu_comes_to_who_asks(world):
    result = world.command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, 105, 1e5)
    assert result == mavlink.MAV_RESULT_ACCEPTED
    imu = world.wait("HIGHRES_IMU", 3, from_autopilot)
    # Specific force at rest, down is positive.
    assert -12 < imu.zacc < -7, imu


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
    result = world.command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL,
                           mavlink.MAVLINK_MSG_ID_HALTERE_ESTIMATE, 1e5)
    assert result == mavlink.MAV_RESULT_ACCEPTED
    world.wait("HALTERE_ESTIMATE", 30, good)
    estimate = world.wait("HALTERE_ESTIMATE", 5, good)
    truth = world.truth()
    # The configuration says how high the vehicle stands; without it height on the floor would carry
    # the bias of floor reflections, 0.2 to 0.5 m a pair.
    for i, (axis, allowed) in enumerate(zip("xyz", (0.2, 0.2, 0.2))):
        error = estimate.position[i] - truth[f"pos_E_{axis}_m"]
        assert abs(error) < allowed, f"{axis}: estimate minus truth is {error:.3f} m"
