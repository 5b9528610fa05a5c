"""One simulated vehicle for each file of tests."""

import pytest

from haltere_testing.rig import Rig


@pytest.fixture(scope="module")
def rig(request, tmp_path_factory):
    rig = Rig(tmp_path_factory.mktemp("rig"))
    rig.settle()
    yield rig
    rig.close()
    if getattr(request.module, "REPLAY", False):
        rig.assert_replayed()
