"""A mission test in ten lines: an anchor dies in flight, and the vehicle still reaches its goal."""


def test_a_lost_anchor_does_not_matter(haltere):
    station = haltere.station()
    station.takeoff(1.2)
    haltere.fault("anchor", anchor=3)
    station.goto(6.0, 5.0, 1.2)
    haltere.wait(lambda: haltere.distance(6.0, 5.0) < 0.4)
    station.land()
    haltere.assert_landed()
