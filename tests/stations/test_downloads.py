"""A log comes down byte for byte: by MAVProxy's code, by MAVSDK's, and by QGroundControl's way of asking."""

import random
import threading

import pytest
from mavsdk.plugins import log_files

from haltere_testing.clients import MavProxy, mavsdk_system
from haltere_testing.rig import Rig

SPEED = 2

#: Bytes: many blocks of 16 KiB, no multiple of the 90 of a piece, nor of the 46 080 that QGroundControl asks for at once.
SIZE = 300_017
PIECE, PIECES_AT_ONCE = 90, 512


def earlier(rig):
    """A log of an earlier flight."""
    file = rig.folder / "log" / "20260101-000000-00.mcap"
    file.write_bytes(random.Random(36).randbytes(SIZE))
    return file


@pytest.fixture(scope="module")
def log(rig):
    return earlier(rig)


@pytest.fixture
def still(tmp_path):
    """One whose time passes as the test asks for it: what is not answered is no matter of this computer."""
    with Rig(tmp_path, lockstep=True) as rig:
        rig.settle()
        yield rig


def test_by_mavproxy(rig, log, tmp_path):
    proxy = MavProxy(rig.address(client="mavproxy"), tmp_path, modules="log")
    proxy.do("log list", rf"Log 1  numLogs 2 lastLog 2 size {SIZE}")
    proxy.do("log download 1 down.bin", r"Finished downloading \S+", 90)
    proxy.close()
    assert (tmp_path / "down.bin").read_bytes() == log.read_bytes()


def test_by_mavsdk(rig, log, tmp_path):
    mavsdk, system = mavsdk_system(rig.address(client="mavsdk"))
    plugin = log_files.LogFiles(system)
    entry = next(entry for entry in plugin.get_entries() if entry.size_bytes == SIZE)
    done, results = threading.Event(), []

    def told(result, *_):
        if result.name != "NEXT":
            results.append(result.name)
            done.set()

    plugin.download_log_file_async(entry, str(tmp_path / "down.bin"), told)
    assert done.wait(90) and results == ["SUCCESS"], results
    mavsdk.destroy()
    assert (tmp_path / "down.bin").read_bytes() == log.read_bytes()


class Qgc:
    """Asks for 512 pieces at once; those that have not come 0.5 s after the last one are asked for again, one run at a
    time. A piece is whole when it came, whatever its length."""

    def __init__(self, station, number, size, loss=0.0):
        self.station, self.number, self.size = station, number, size
        self.data, self.luck, self.loss = bytearray(size), random.Random(5), loss
        self.asked_again = 0

    def ask(self, first, count):
        self.station.link.mav.log_request_data_send(1, 1, self.number, first * PIECE, count * PIECE)

    def take(self, missing):
        """What comes until it is silent; whether anything came."""
        quiet_since = self.station.clock.now()
        while missing and self.station.clock.now() - quiet_since < 0.5:
            message = self.station.receive(0.1)
            if message is None or message.get_type() != "LOG_DATA" or message.id != self.number:
                continue
            if self.luck.random() < self.loss:
                continue
            quiet_since = self.station.clock.now()
            self.data[message.ofs:message.ofs + message.count] = bytes(message.data[:message.count])
            missing.discard(message.ofs // PIECE)

    def download(self):
        pieces = -(-self.size // PIECE)
        for first in range(0, pieces, PIECES_AT_ONCE):
            missing = set(range(first, min(first + PIECES_AT_ONCE, pieces)))
            self.ask(first, len(missing))
            self.take(missing)
            while missing:
                start = end = min(missing)
                while end in missing:
                    end += 1
                self.asked_again += 1
                assert self.asked_again < 500, f"{len(missing)} pieces from {start} never come"
                self.ask(start, end - start)
                self.take(missing)
        self.station.link.mav.log_request_end_send(1, 1)
        return bytes(self.data)


@pytest.mark.parametrize("loss", [0.0, 0.01])
def test_as_qgroundcontrol_asks(still, loss):
    log, station = earlier(still), still.station("px4")
    station.link.mav.log_request_list_send(1, 1, 0, 0xFFFF)
    entry = station.wait("LOG_ENTRY", 5, lambda m: m.size == SIZE)
    client = Qgc(station, entry.id, entry.size, loss)
    assert client.download() == log.read_bytes()
    # What is asked for comes, unless it is lost on the way.
    assert (client.asked_again == 0) == (loss == 0.0), client.asked_again
