"""Two vehicles, each with a companion of its own, and one station on one network: missions side by side."""

import csv
import math

import pytest

from haltere_testing.programs import free_port
from haltere_testing.rig import Rig
from haltere_testing.station import Refused, Station, is_armed, mavlink, of_vehicle
from haltere_testing.missions import route

SPEED = 2

#: By system id. They are in halls of their own: what they share is the network.
SQUARES = {1: [(4.0, 4.0, 1.2), (4.0, 6.0, 1.2), (6.0, 6.0, 1.2)],
           2: [(6.0, 5.0, 1.0), (6.0, 3.0, 1.0), (4.0, 3.0, 1.0), (4.0, 5.0, 1.0)]}


@pytest.fixture(scope="module")
def port():
    return free_port()


@pytest.fixture(scope="module")
def rigs(tmp_path_factory, port):
    rigs = {number: Rig(tmp_path_factory.mktemp(f"rig{number}"), lockstep=True, speed=SPEED, seed=number,
                        system_id=number, endpoints=[f"udpout:127.0.0.1:{port}"]) for number in SQUARES}
    for rig in rigs.values():
        rig.settle()
    yield rigs
    for rig in rigs.values():
        rig.close()
        rig.assert_replayed()


@pytest.fixture(scope="module")
def station(rigs, port):
    station = Station(f"udpin:127.0.0.1:{port}", vehicle=None)
    # As a station does that finds several: it asks each for its version, and not the first one alone.
    for number in SQUARES:
        station.link.mav.command_long_send(
            number, 1, mavlink.MAV_CMD_REQUEST_MESSAGE, 0, mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION, 0, 0, 0, 0, 0, 0)
    heard = {m.get_srcSystem() for m in station.drain(3.0) if m.get_type() == "HEARTBEAT"}
    assert heard == set(SQUARES), heard
    yield station
    station.close()


def test_missions_are_flown_side_by_side(rigs, station):
    for number, points in SQUARES.items():
        station.vehicle = number
        station.upload(route(points))
    for number in SQUARES:
        station.vehicle = number
        station.arm()
        station.accepted(station.command(mavlink.MAV_CMD_MISSION_START), f"mission of {number}")
    flies, reached, together = set(SQUARES), {1: [], 2: []}, False
    end = station.clock.now() + station.clock.patience(120 / SPEED)
    while flies:
        assert station.clock.now() < end, (flies, reached, station.texts)
        message = station.receive()
        for number in SQUARES:
            if message is None or not of_vehicle(message, number):
                continue
            if message.get_type() == "MISSION_ITEM_REACHED":
                reached[number].append(message.seq)
            elif message.get_type() == "HEARTBEAT" and not is_armed(message, number):
                flies.discard(number)
        together = together or all(rig.height() > 0.8 for rig in rigs.values())
    assert together
    # Each hears what the station says to the other one, and takes nobody for missing.
    for rig in rigs.values():
        assert "asks system" not in (rig.folder / "companion.txt").read_text()
    for number, points in SQUARES.items():
        assert sorted(set(reached[number])) == list(range(len(points) + 2)), reached
        rigs[number].assert_landed()


def test_what_is_meant_for_one_does_not_reach_the_other(rigs, station):
    station.vehicle = 2
    station.set_parameter("FLT_TKO_HGT", 1.75)
    values = {}
    for station.vehicle in SQUARES:
        values[station.vehicle] = station.parameters()["FLT_TKO_HGT"]
    assert values == {1: 1.0, 2: 1.75}
    station.vehicle = 1
    with pytest.raises(Refused):
        station.upload(route([(40.0, 4.0, 1.2)]))
    # The other one still has its mission.
    station.vehicle = 2
    station.link.mav.mission_request_list_send(2, 1, mavlink.MAV_MISSION_TYPE_MISSION)
    assert station.wait("MISSION_COUNT", 5, station.of_vehicle).count == len(SQUARES[2]) + 2
    station.arm()
    assert rigs[1].truth()["on_ground"] == 1
    station.accepted(station.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 0), "disarming")


def test_the_truth_of_both(rigs):
    for number, points in SQUARES.items():
        rigs[number].close()
        with open(rigs[number].folder / "truth.csv") as file:
            places = [(float(r["pos_E_x_m"]), float(r["pos_E_y_m"]), -float(r["pos_E_z_m"])) for r in csv.DictReader(file)]
        for point in points:
            closest = min(math.dist(at, point) for at in places)
            assert closest < 0.5, f"vehicle {number}: {closest} m from {point}"
