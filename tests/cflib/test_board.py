"""Bitcraze's own client reads the simulated Crazyflie as it reads a real one: tables, parameters, anchors, log rows, arming."""

import json
import os
import struct
import subprocess
import threading
import time

import cflib.crtp
import pytest
from cflib.crazyflie import Crazyflie
from cflib.crazyflie.log import LogConfig
from cflib.crazyflie.mem import MemoryElement
from cflib.crtp.crtpstack import CRTPPacket

#: Longest wait for an answer, s.
PATIENCE_S = 30
#: The hall of the simulator, room north, east, up, m; anchor by bit 0 north, 1 east, 2 up. The anchors' own x is east.
ROOM = (10.0, 10.0, 7.0)
ANCHORS = [tuple(ROOM[axis] * (n >> axis & 1) for axis in (1, 0, 2)) for n in range(8)]
#: Where the tag is nearly: the middle of the floor.
TAG = (5.0, 5.0, 0.1)
#: Bits of the supervisor.
CAN_BE_ARMED, ARMED, CAN_FLY = 0x1, 0x2, 0x8


@pytest.fixture(params=["flapper", "bolt"])
def board(request, tmp_path):
    """A simulated board of that build, and its client, connected."""
    scenario = tmp_path / "scenario.toml"
    scenario.write_text(f'[board.crazyflie]\nbuild = "{request.param}"\n')
    command = [os.environ["HALTERE_TEST_SIM"], "serve", "--board", "crazyflie", "--scenario", str(scenario)]
    simulator = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    client = Crazyflie()
    try:
        told = json.loads(simulator.stdout.readline())
        assert told["board"].startswith("crtpudp:127.0.0.1:") and told["tag_protocol"] == "crazyflie"
        cflib.crtp.init_drivers()
        connected, failed = threading.Event(), []
        client.fully_connected.add_callback(lambda _: connected.set())
        client.connection_failed.add_callback(lambda _, why: (failed.append(why), connected.set()))
        client.open_link(told["board_own"])
        assert connected.wait(PATIENCE_S) and not failed, failed
        client.build = request.param
        yield client
    finally:
        client.close_link()
        simulator.terminate()
        simulator.wait(PATIENCE_S)


def ask(client, port, channel, data):
    """The payload of the first answer there."""
    came, answers = threading.Event(), []

    def back(packet):
        if packet.channel == channel:
            answers.append(bytes(packet.data))
            came.set()

    client.add_port_callback(port, back)
    packet = CRTPPacket()
    packet.port, packet.channel, packet.data = port, channel, data
    client.send_packet(packet)
    assert came.wait(PATIENCE_S)
    client.remove_port_callback(port, back)
    return answers[0]


def rows(client, kinds, seconds):
    """Rows of a block of 10 ms: stamp, ms, and values."""
    block, heard = LogConfig("block", 10), []
    for name, kind in kinds:
        block.add_variable(name, kind)
    block.data_received_cb.add_callback(lambda stamp, values, _: heard.append((stamp, values)))
    client.log.add_config(block)
    block.start()
    time.sleep(seconds)
    block.stop()
    return heard


def test_a_scan_finds_it(board):
    assert any(uri == board.link_uri for uri, *_ in cflib.crtp.scan_interfaces())


def test_tables_and_parameters(board):
    names = {f"{group}.{name}" for group, all in board.log.toc.toc.items() for name in all}
    assert {"tdoa2.d7-0", "acc.x", "gyro.z", "stateEstimateZ.quat", "pm.vbatMV", "supervisor.info"} <= names
    assert board.platform.get_protocol_version() == 12
    assert board.param.get_value("stabilizer.controller") == "1"
    set_to, came = [], threading.Event()
    board.param.add_update_callback("flightmode", "stabModeYaw", lambda _, value: (set_to.append(value), came.set()))
    board.param.set_value("flightmode.stabModeYaw", 1)
    assert came.wait(PATIENCE_S)
    end = time.monotonic() + PATIENCE_S
    while board.param.get_value("flightmode.stabModeYaw") != "1":
        assert time.monotonic() < end, set_to
        time.sleep(0.05)


def test_anchors_say_where_they_stand(board):
    [memory] = board.mem.get_mems(MemoryElement.TYPE_LOCO2)
    came = threading.Event()
    memory.update_id_list(lambda _: came.set())
    assert came.wait(PATIENCE_S) and sorted(memory.anchor_ids) == list(range(8))
    came.clear()
    memory.update_active_id_list(lambda _: came.set())
    assert came.wait(PATIENCE_S) and len(memory.active_anchor_ids) == 8
    came.clear()
    memory.update_data(lambda _: came.set())
    assert came.wait(PATIENCE_S)
    for n, anchor in memory.anchor_data.items():
        assert anchor.is_valid and anchor.position == pytest.approx(ANCHORS[n], abs=1e-4), n


def test_rows_come_every_10_ms_and_say_what_is(board):
    tdoa = [f"tdoa2.d{(n - 1) % 8}-{n}" for n in range(8)]
    kinds = [(name, "FP16") for name in tdoa] + [("pm.vbatMV", "uint16_t"), ("supervisor.info", "uint16_t")]
    heard = rows(board, kinds, 3.0)
    stamps = [stamp for stamp, _ in heard]
    assert 280 <= len(heard) <= 310, len(heard)
    assert {b - a for a, b in zip(stamps, stamps[1:])} == {10}
    distance = [sum((a - b) ** 2 for a, b in zip(TAG, at)) ** 0.5 for at in ANCHORS]
    for n, name in enumerate(tdoa):
        mean = sum(values[name] for _, values in heard) / len(heard)
        assert mean == pytest.approx(distance[n] - distance[n - 1], abs=0.5), name
    assert 6000 < heard[-1][1]["pm.vbatMV"] < 8500
    attitude = rows(board, [("acc.z", "float"), ("gyro.x", "float"), ("stabilizer.roll", "float")], 1.0)
    assert attitude[-1][1]["acc.z"] == pytest.approx(1.0, abs=0.1)
    assert abs(attitude[-1][1]["stabilizer.roll"]) < 5.0


def test_it_is_armed_where_it_wants_to_be(board):
    def bits():
        return struct.unpack("<H", ask(board, 9, 0, b"\x0c")[1:3])[0]

    if board.build == "flapper":
        assert bits() & (ARMED | CAN_FLY) == ARMED | CAN_FLY, "it arms by itself"
        return
    assert bits() & (CAN_BE_ARMED | ARMED) == CAN_BE_ARMED
    board.supervisor.send_arming_request(True)
    end = time.monotonic() + PATIENCE_S
    while bits() & (ARMED | CAN_FLY) != ARMED | CAN_FLY:
        assert time.monotonic() < end, hex(bits())
        time.sleep(0.05)
