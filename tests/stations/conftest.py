"""One simulated vehicle for each file of tests.

Real wires and a companion of its own process unless the file says `SPEED`: then both live in one process, on
simulated time so many times as fast; with 0 it passes as the test asks for it. What a client says and is told
is the same; a machine that stands still for a moment is then no event of the flight. The wires themselves are
flown by `test_links`, `test_wire`, `test_zz_four` and by `tests/pymavlink` and `tests/mavsdk3`."""

import pytest

from haltere_testing.rig import Rig


@pytest.fixture(scope="module")
def rig(request, tmp_path_factory):
    speed = getattr(request.module, "SPEED", None)
    rig = Rig(tmp_path_factory.mktemp("rig"), lockstep=speed is not None, speed=speed or 0)
    rig.settle()
    yield rig
    rig.close()
    if getattr(request.module, "REPLAY", False):
        rig.assert_replayed()
