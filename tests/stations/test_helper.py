"""The helper of examples/, as far as no other test uses it: moments, tracks, refusals, parameters, what a failure tells, and
a vehicle that is not simulated."""

import math
import os
import pathlib
import subprocess
import sys

import pexpect
import pytest

import haltere_testing
from haltere_testing import Here, Rig, hall
from haltere_testing.lookout import assert_along
from haltere_testing.missions import route
from haltere_testing.programs import Simulator, free_port
from haltere_testing.station import Refused

PACKAGE = pathlib.Path(haltere_testing.__file__).parent.parent
SQUARE = [(4.0, 4.0, 1.2), (4.0, 6.0, 1.2), (6.0, 6.0, 1.2), (6.0, 4.0, 1.2), (4.0, 4.0, 1.2)]


@pytest.fixture
def rig(tmp_path):
    with Rig(tmp_path, lockstep=True) as rig:
        rig.settle()
        rig.look_out()
        yield rig


def track(*places):
    """Straight from place to place in steps of a centimetre, in the air."""
    flown = []
    for start, end in zip(places, places[1:]):
        steps = max(1, round(math.dist(start, end) / 0.01))
        flown += [[a + (b - a) * n / steps for a, b in zip(start, end)] for n in range(steps)]
    return [Here(0.02 * n, *place, True) for n, place in enumerate([*flown, places[-1]])]


def test_a_track_is_held_against_the_ways_between_its_corners():
    around = [(5.0, 5.0, 0.1), (5.0, 5.0, 1.2), *SQUARE, (4.0, 4.0, 0.1)]
    assert assert_along(track(*around), SQUARE, 0.1) < 0.1
    # The way to the first corner and from the last one is nobody's.
    assert assert_along(track((9.0, 9.0, 3.0), *SQUARE, (0.0, 9.0, 0.1)), SQUARE, 0.1) < 0.1
    with pytest.raises(AssertionError, match=r"corner 2 .* was not reached within 0.1 m: it was 1\.41 m away"):
        assert_along(track(*SQUARE[:2], SQUARE[3]), SQUARE[:3], 0.1)
    with pytest.raises(AssertionError, match=r"0\.\d+ m off the way from corner 0 to 1, allowed 0.3 m: at \d"):
        assert_along(track(SQUARE[0], (4.5, 5.0, 1.2), SQUARE[1]), SQUARE[:2], 0.3)
    # In their order, and in height too.
    with pytest.raises(AssertionError, match="corner 2"):
        assert_along(track(SQUARE[2], SQUARE[1], SQUARE[0], SQUARE[3]), [SQUARE[0], SQUARE[3], SQUARE[1]], 0.1)
    with pytest.raises(AssertionError, match="corner 0"):
        assert_along(track(*[(n, e, h + 0.5) for n, e, h in SQUARE]), SQUARE, 0.3)
    with pytest.raises(AssertionError, match="it did not fly"):
        assert_along([], SQUARE, 1.0)


STARVED = """
import pathlib, pytest
from haltere_testing.vehicle import Vehicle

class Late(Vehicle):
    def not_judged(self):
        return "NOT JUDGED: the simulator itself was 569 times late; end other work"

@pytest.fixture
def vehicle(tmp_path):
    return Late(tmp_path)

def test_late(vehicle):
    assert not "landed"
"""


@pytest.mark.parametrize("also, code", [("", 75), ("def test_wrong():\n    assert not 'right'\n", 1)])
def test_a_failure_of_a_simulator_that_starved_is_told_apart(tmp_path, also, code):
    (tmp_path / "test_starved.py").write_text(STARVED + also)
    ran = subprocess.run([sys.executable, "-m", "pytest", "-p", "haltere_testing.plugin", "-p", "no:cacheprovider", "-q"],
                         cwd=tmp_path, env={**os.environ, "PYTHONPATH": str(PACKAGE)}, text=True, capture_output=True)
    assert ran.returncode == code, ran
    assert "test_late: NOT JUDGED: the simulator itself was 569 times late; end other work" in ran.stdout


def test_what_is_broken_at_a_moment_is_broken_then(rig):
    at_item = rig.at(item=2).fault("anchor", anchor=3)
    rig.at(near=(4.0, 6.0, 1.2), within=0.4).mend("anchor", anchor=3)
    near = rig.at(near=(6.0, 6.0, 1.2), within=0.4).fault("anchor", anchor=5)
    soon = rig.at(time_s=1.0).do(lambda: None)
    never = rig.at(item=99).fault("tag")
    began = rig.here().t_s
    rig.station().fly(SQUARE)
    assert abs(soon.came_s - began - 1.0) < 0.05
    places = {here.t_s: here.place for here in rig.lookout.track}
    assert math.dist(places[near.came_s], (6.0, 6.0, 1.2)) <= 0.4
    # Item 1 is the first corner, item 2 the way to the second.
    assert math.dist(places[at_item.came_s], SQUARE[0]) < 0.4
    assert any("anchor 3 silent" in event for event in rig.events())
    assert any("anchor 5 silent, 7 of 8 heard" in event for event in rig.events()), rig.events()
    with pytest.raises(AssertionError, match="anchor 3 silent"):
        rig.assert_no_events()
    rig.assert_no_events(but=["anchor"])
    with pytest.raises(AssertionError, match=r"never came in this flight: at\(item=99\)"):
        rig.lookout.assert_all_came()
    assert never.came_s is None
    with pytest.raises(ValueError, match="one of time_s, near and item"):
        rig.at()
    rig.assert_track(SQUARE, within=0.5)
    rig.assert_landed()


def test_a_fault_in_wrong_words_fails_the_test(rig):
    rig.at(time_s=0.1).fault("hat")
    with pytest.raises(ValueError, match="unknown variant `hat`"):
        rig.pass_time(1.0)


def test_a_mission_is_refused_in_the_vehicles_words(rig, tmp_path):
    station = rig.station()
    with pytest.raises(Refused, match="mission refused: MAV_MISSION_INVALID.*item 3"):
        station.upload(route([SQUARE[0], (40.0, 4.0, 1.2)]))
    with pytest.raises(Refused, match="take-off refused"):
        station.takeoff(60.0)
    with pytest.raises(ValueError, match="one at least"):
        route([])
    mission = tmp_path / "square.toml"
    mission.write_text('[[item]]\ncommand = "takeoff"\nheight_m = 1.2\n[[item]]\ncommand = "waypoint"\n'
                       'position_m = [5.5, 5.0, 1.2]\n[[item]]\ncommand = "land"\n')
    station.upload(mission)
    station.fly_mission()
    assert rig.distance(5.5, 5.0) < 0.5
    with pytest.raises(ValueError, match="none.toml"):
        station.upload(tmp_path / "none.toml")
    mission.write_text('[[item]]\ncommand = "hop"\n')
    with pytest.raises(ValueError, match="hop"):
        station.upload(mission)


def test_missions_of_other_stations_are_uploaded(rig, tmp_path):
    station = rig.station()
    lat, lon = haltere_testing.degrees(5.6, 5.0)
    waypoints = tmp_path / "there.waypoints"
    waypoints.write_text("QGC WPL 110\n"
                         "0\t0\t3\t22\t0\t0\t0\t0\t0\t0\t1.2\t1\n"
                         f"1\t0\t3\t16\t0\t0\t0\t0\t{lat:.9f}\t{lon:.9f}\t1.2\t1\n"
                         "2\t0\t2\t20\t0\t0\t0\t0\t0\t0\t0\t1\n")
    station.upload(str(waypoints))
    haltere = rig.at(near=(5.6, 5.0, 1.2), within=0.4)
    station.fly_mission()
    assert haltere.came_s is not None
    plan = tmp_path / "outside.plan"
    point = '{{ "type": "SimpleItem", "command": 16, "frame": 3, "params": [0, 0, 0, null, {}, {}, 1.2] }}'
    corners = ", ".join(str(list(haltere_testing.degrees(*corner))) for corner in ((4, 4), (4, 6), (6, 6), (6, 4)))
    plan.write_text('{ "fileType": "Plan", "version": 1, "mission": { "version": 2, "items": ['
                    + point.format(*haltere_testing.degrees(8.0, 8.0)) + '] }, "geoFence": { "version": 2, "circles": [], '
                    '"polygons": [ { "inclusion": true, "polygon": [' + corners + '] } ] }, '
                    '"rallyPoints": { "version": 2, "points": [] } }')
    with pytest.raises(Refused, match=r"mission of .*outside.plan refused: .*fence"):
        station.upload(plan)


def test_parameters_are_put_back(rig):
    station = rig.station()
    with station.kept_parameters():
        station.set_parameter("FLT_TKO_HGT", 1.5)
        assert station.parameters()["FLT_TKO_HGT"] == 1.5
        with pytest.raises(Refused, match="FLT_TKO_HGT = 500.*allowed"):
            station.set_parameter("FLT_TKO_HGT", 500.0)
    assert station.parameters()["FLT_TKO_HGT"] == 1.0


def test_another_number_on_the_network(tmp_path):
    with Rig(tmp_path, lockstep=True, system_id=7) as rig:
        rig.settle()
        rig.look_out()
        came = rig.at(item=1)
        station = rig.station()
        assert station.heartbeat.get_srcSystem() == 7
        station.fly([(5.5, 5.0, 1.0)])
        rig.assert_landed()
        assert came.came_s is not None and station.item() is not None


def pytest_on(folder, text, *more, **kept):
    """Runs pytest on one file, as a user does."""
    (folder / "test_it.py").write_text(text)
    environment = {**os.environ, "PYTHONPATH": str(PACKAGE), "COLUMNS": "200"}
    command = [sys.executable, "-m", "pytest", "-q", "--color=no", "-p", "haltere_testing.plugin",
               "--basetemp", str(folder / "runs"), "-p", "no:cacheprovider", *more, str(folder / "test_it.py")]
    return command, {"env": environment, "cwd": str(folder), **kept}


def test_a_failure_says_how_it_stands(tmp_path):
    command, options = pytest_on(tmp_path, """
def test_it(haltere):
    haltere.station().takeoff(1.2)
    assert haltere.height() > 5.0


def test_what_never_came(haltere):
    haltere.at(item=3).fault("tag")
""")
    ran = subprocess.run(command, text=True, capture_output=True, timeout=120, **options)
    assert ran.returncode == 1, ran.stdout + ran.stderr
    for words in ("vehicle's time: ", "true position: north ", "estimated position: north ", "hold: take-off height reached",
                  "never came in this flight: at(item=3)"):
        assert words in ran.stdout, ran.stdout
    log, page = (next(line.split(": ")[1] for line in ran.stdout.splitlines() if line.startswith(f"{name}: "))
                 for name in ("log", "report"))
    assert pathlib.Path(log).stat().st_size > 10_000
    assert "<svg" in pathlib.Path(page).read_text()


REAL = """
import pytest


def test_it_flies(haltere):
    haltere.station().set_parameter("FLT_TKO_HGT", 1.5)
    haltere.station().fly([(5.5, 5.0, 1.0)])
    haltere.assert_landed()
    haltere.assert_track([(5.5, 5.0, 1.0)], within=0.5)


def test_of_the_simulator_only(haltere):
    haltere.station().takeoff(1.0)
    haltere.fault("anchor", anchor=3)


def test_not_allowed(haltere):
    haltere.station().takeoff(1.0)
"""


def test_the_same_test_flies_a_vehicle_that_is_not_simulated(tmp_path):
    """Behind the ports of tag and board stands the simulator, of which the test run knows nothing."""
    simulator = Simulator(["serve", "--board", f"udpout:127.0.0.1:{free_port()}"], tmp_path / "sim.txt")
    (tmp_path / "anchors.toml").write_text(hall())
    config = tmp_path / "vehicle.toml"
    station = free_port()
    config.write_text(f"""
[tag]
port = "{simulator.greeting['tag']}"
[board]
address = "{simulator.greeting['board']}"
[ground]
system_id = 5
endpoints = [{{ address = "udpout:127.0.0.1:{station}", identity = "px4" }}]
[flight]
gear_height_m = 0.12
[estimator]
rest_height_m = 0.12
""")
    command, options = pytest_on(tmp_path, REAL, "-rs", "--haltere-real", str(config), encoding="utf-8", timeout=150)
    child = pexpect.spawn(command[0], command[1:], dimensions=(50, 200), **options)
    with open(tmp_path / "pytest.txt", "w") as said:
        child.logfile_read = said
        for answer in ("yes", "y", "no"):
            child.expect(r"is about to take off\. Is the room clear, and somebody at the switch\? \[yes/no\]")
            assert simulator.truth()["on_ground"] == 1
            child.sendline(answer)
        child.expect(pexpect.EOF)
    child.close()
    said = (tmp_path / "pytest.txt").read_text()
    assert "1 failed, 1 passed, 1 skipped" in said, said
    assert "nothing of a real vehicle is broken for a test" in said, said
    assert "Answered 'no': it stays on the floor" in said, said
    truth = simulator.truth()
    assert truth["on_ground"] == 1 and truth["crashed"] == 0
    # What the first test set is as it was, and each companion recorded beside the configuration.
    assert "1.5" not in "".join(p.read_text() for p in (tmp_path / "state").glob("*.toml"))
    assert list((tmp_path / "logs").glob("*.mcap"))
    assert haltere_testing.programs.stop([simulator.process]) == [0]
