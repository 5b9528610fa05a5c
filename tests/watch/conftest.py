"""One simulated vehicle with the real companion, whose watch page is served, in the air."""

import socket

import pytest

from haltere_testing.rig import Rig, free_port


@pytest.fixture(scope="session")
def port():
    return free_port(socket.SOCK_STREAM)


@pytest.fixture(scope="session")
def rig(tmp_path_factory, port):
    rig = Rig(tmp_path_factory.mktemp("rig"),
              more=f'[watch]\naddress = "tcpin:127.0.0.1:{port}"\n')
    rig.settle()
    yield rig
    rig.close()
    # What the page costs the core is nothing that a replay could see.
    rig.assert_replayed()


@pytest.fixture(scope="session")
def station(rig):
    station = rig.station()
    station.takeoff(1.2)
    yield station
    station.land()
    rig.assert_landed()
