"""Parameters: list, read, set, refusal, what is kept over a power cut."""

import math
import time

import pytest

from conftest import mavlink, patience

REAL32 = mavlink.MAV_PARAM_TYPE_REAL32


def fetch_all(world, component=1):
    world.link.mav.param_request_list_send(1, component)
    found, count = {}, None
    start = time.monotonic()
    deadline = start + patience(5)
    while count is None or len(found) < count:
        assert time.monotonic() < deadline, f"{len(found)} of {count}"
        message = world.receive()
        if message is not None and message.get_type() == "PARAM_VALUE":
            found[message.param_index] = message
            count = message.param_count
    return found, time.monotonic() - start


def read(world, name=b"", index=-1):
    world.link.mav.param_request_read_send(1, 1, name, index)
    return world.wait("PARAM_VALUE", 2, lambda m: not name or m.param_id == name.decode())


def put(world, name, value, kind=REAL32):
    world.link.mav.param_set_send(1, 1, name, value, kind)
    return world.wait("PARAM_VALUE", 2, lambda m: m.param_id == name.decode()).param_value


@pytest.mark.parametrize("component", [1, 0])
def test_all_are_listed(world, component):
    # How fast they come is held on simulated time (`tests/stations/test_timing.py`) and only printed here.
    found, seconds = fetch_all(world, component)
    print(f"{len(found)} parameters in {seconds:.3f} s, {len(found) / seconds:.0f} a second")
    assert sorted(found) == list(range(len(found)))
    assert len(found) > 100
    assert all(m.param_type == REAL32 and math.isfinite(m.param_value) for m in found.values())
    assert len({m.param_id for m in found.values()}) == len(found)


def test_one_is_read_by_name_and_by_index(world):
    by_name = read(world, b"FLT_TKO_HGT")
    by_index = read(world, index=by_name.param_index)
    assert by_index.param_id == "FLT_TKO_HGT" and by_index.param_value == by_name.param_value
    hashed = read(world, b"_HASH_CHECK")
    assert hashed.param_index == 65535


def test_a_new_value_is_echoed_and_acts(world):
    assert put(world, b"FLT_TKO_HGT", 1.5) == 1.5
    assert read(world, b"FLT_TKO_HGT").param_value == 1.5


@pytest.mark.parametrize("name, value, error", [
    (b"FLT_TKO_HGT", 99.0, 2), (b"FLT_TKO_HGT", float("nan"), 2), (b"LIM_BAT_CRIT", 7.0, 2),
])
def test_a_bad_value_is_refused_with_name_and_range(world, name, value, error):
    before = read(world, name).param_value
    world.texts.clear()
    world.link.mav.param_set_send(1, 1, name, value, REAL32)
    answer = world.wait("PARAM_ERROR", 2)
    assert answer.error == error and answer.param_id == name.decode()
    assert world.wait("PARAM_VALUE", 2).param_value == before
    world.said(name.decode())


def test_unknown_names_are_refused(world):
    world.link.mav.param_request_read_send(1, 1, b"NO_SUCH", -1)
    assert world.wait("PARAM_ERROR", 2).error == 1
    world.link.mav.param_set_send(1, 1, b"NO_SUCH", 1.0, REAL32)
    assert world.wait("PARAM_ERROR", 2).error == 1
    world.link.mav.param_request_read_send(1, 1, b"", 9999)
    assert world.wait("PARAM_ERROR", 2).error == 1


def test_what_was_set_outlives_a_power_cut(world):
    assert put(world, b"FLT_TKO_HGT", 1.75) == 1.75
    assert put(world, b"EST_UWB_STD", 0.25) == 0.25
    world.drain(0.5)
    world.cut_power()
    assert read(world, b"FLT_TKO_HGT").param_value == 1.75
    assert read(world, b"EST_UWB_STD").param_value == 0.25
    # Forgotten, they are those of the configuration again.
    result = world.command(mavlink.MAV_CMD_PREFLIGHT_STORAGE, 2)
    assert result == mavlink.MAV_RESULT_ACCEPTED
    world.cut_power()
    assert read(world, b"FLT_TKO_HGT").param_value == 1.0
