"""One simulated vehicle whose watch page is served, in the air: in lockstep at real time, so that a busy computer
does not make it land. That the real companion serves the page too has a test of its own."""

import socket

import pytest

from haltere_testing.rig import Rig, free_port


@pytest.fixture(scope="session")
def port():
    return free_port(socket.SOCK_STREAM)


@pytest.fixture(scope="session")
def rig(tmp_path_factory, port):
    rig = Rig(tmp_path_factory.mktemp("rig"), lockstep=True, speed=1,
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
