"""Fixtures for pytest. `haltere` is a vehicle ready to fly, with the simulator and the companion behind it.

    def test_it_hovers(haltere):
        station = haltere.station()
        station.takeoff(1.2)
        assert abs(haltere.height() - 1.2) < 0.2
        station.land()

It runs in lockstep, faster than real time. `@pytest.mark.haltere(lockstep=False)` takes the real companion on
real wires, which clients with a clock of their own need; its other arguments are those of `Rig`.
"""

import pytest

from .rig import Rig


def pytest_configure(config):
    config.addinivalue_line("markers", "haltere(**options): how the fixture `haltere` is started")


@pytest.fixture
def haltere(request, tmp_path):
    marker = request.node.get_closest_marker("haltere")
    options = {"lockstep": True, **(marker.kwargs if marker else {})}
    rig = Rig(tmp_path, **options)
    try:
        rig.settle()
        yield rig
    finally:
        rig.close()
