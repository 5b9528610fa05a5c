"""The rig of tests/stations, for the older MAVSDK."""

import pathlib
import sys

import pytest

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent.parent / "stations"))
from rig import Rig  # noqa: E402


@pytest.fixture(scope="module")
def rig(tmp_path_factory):
    rig = Rig(tmp_path_factory.mktemp("rig"))
    rig.settle()
    yield rig
    rig.close()
