"""What else a test can ask of the helper."""

import pytest


def test_without_ranging_it_comes_down_by_itself(haltere):
    station = haltere.station()
    station.takeoff(1.2)
    haltere.fault("tag")
    station.wait_disarmed(30)
    haltere.assert_landed()


@pytest.mark.haltere(seed=7, scenario="[start]\nposition_m = [3.0, 6.0]\nyaw_deg = 90.0\n")
def test_a_scenario_of_its_own(haltere):
    assert haltere.distance(3.0, 6.0) < 0.05
    station = haltere.station()
    station.takeoff(1.0)
    station.land()
    assert haltere.distance(3.0, 6.0) < 0.5


@pytest.mark.haltere(lockstep=False)
def test_the_same_on_real_wires_in_real_time(haltere):
    station = haltere.station()
    station.takeoff(1.0)
    station.land()
    haltere.assert_landed()


def fly(haltere):
    station = haltere.station()
    station.takeoff(1.2)
    station.goto(5.5, 5.5, 1.2)
    haltere.wait(lambda: haltere.distance(5.5, 5.5) < 0.4)
    return haltere.clock.now(), haltere.truth()


def test_one_script_flies_the_same_each_time(haltere, tmp_path_factory):
    from haltere_testing import Rig
    first = fly(haltere)
    with Rig(tmp_path_factory.mktemp("second"), lockstep=True) as second:
        second.settle()
        assert fly(second) == first
