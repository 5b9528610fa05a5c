"""The helper's rig, for the older MAVSDK."""

import pytest

from haltere_testing.rig import Rig


@pytest.fixture(scope="module")
def rig(tmp_path_factory):
    rig = Rig(tmp_path_factory.mktemp("rig"))
    rig.settle()
    yield rig
    rig.close()
