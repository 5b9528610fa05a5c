"""The Foxglove stream, by a client written from the public specification: docs/spec.md of the repository
foxglove/ws-protocol, sub-protocol foxglove.websocket.v1."""

import base64
import json
import struct
import time

import pytest
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory

from sockets import Refused, WebSocket

PROTOCOL = "foxglove.websocket.v1"


class Viewer:
    def __init__(self, port, **more):
        # Viewers offer what they know; the server chooses.
        self.socket = WebSocket(port, "/", protocols=("foxglove.sdk.v1", PROTOCOL), **more)
        assert self.socket.protocol == PROTOCOL
        self.info = json.loads(self.socket.receive())
        advertised = json.loads(self.socket.receive())
        assert advertised["op"] == "advertise"
        self.channels = {c["topic"]: c for c in advertised["channels"]}

    def type_of(self, topic):
        channel = self.channels[topic]
        assert channel["encoding"] == channel["schemaEncoding"] == "protobuf"
        files = descriptor_pb2.FileDescriptorSet.FromString(base64.b64decode(channel["schema"]))
        pool = descriptor_pool.DescriptorPool()
        for file in files.file:
            pool.Add(file)
        return message_factory.GetMessageClass(pool.FindMessageTypeByName(channel["schemaName"]))

    def subscribe(self, **topics):
        self.socket.send(json.dumps({"op": "subscribe", "subscriptions": [
            {"id": id, "channelId": self.channels["/" + topic]["id"]} for topic, id in topics.items()]}))

    def data(self, seconds=10):
        """The next message with data: subscription, time in ns, payload."""
        deadline = time.monotonic() + seconds
        while time.monotonic() < deadline:
            message = self.socket.receive()
            if isinstance(message, bytes):
                opcode, id, ns = struct.unpack_from("<BIQ", message)
                assert opcode == 1
                return id, ns, message[13:]
        raise AssertionError("no data")


@pytest.fixture
def viewer(rig, port):
    viewer = Viewer(port)
    yield viewer
    viewer.socket.close()


def test_it_says_what_there_is(viewer):
    assert viewer.info["op"] == "serverInfo" and viewer.info["name"].startswith("haltere ")
    assert viewer.info["capabilities"] == []
    for topic in ("/estimate", "/control", "/uwb", "/imu", "/battery", "/mode", "/text", "/health", "/glue"):
        assert topic in viewer.channels
    ids = [c["id"] for c in viewer.channels.values()]
    assert len(ids) == len(set(ids))


def test_messages_decode_and_are_those_of_the_flight(rig, viewer, station):
    viewer.subscribe(estimate=7, uwb=70_000)
    types = {7: viewer.type_of("/estimate"), 70_000: viewer.type_of("/uwb")}
    seen = {7: [], 70_000: []}
    while min(map(len, seen.values())) < 50:
        id, ns, payload = viewer.data()
        assert abs(ns * 1e-9 - time.time()) < 30  # the calendar, as far as this machine has one
        seen[id].append((ns, types[id].FromString(payload)))
    newest, truth = seen[7][-1][1], rig.truth()
    assert abs(newest.pos_E_m.x - truth["pos_E_x_m"]) < 0.5, (newest, truth)
    assert abs(newest.pos_E_m.z - truth["pos_E_z_m"]) < 0.5
    times = [m.at_us for _, m in seen[7]]
    assert times == sorted(times) and times[-1] - times[0] > 300_000
    # None is missing: the estimate comes with each control step.
    assert max(b - a for a, b in zip(times, times[1:])) < 200_000
    assert {m.anchor_a for _, m in seen[70_000]} <= set(range(8))
    assert any(m.fused for _, m in seen[70_000])


def test_only_what_was_asked_for_comes_and_it_ends_when_asked(rig, viewer):
    viewer.subscribe(battery=3)
    assert {viewer.data()[0] for _ in range(5)} == {3}
    viewer.socket.send('{"op": "unsubscribe", "subscriptionIds": [3]}')
    viewer.subscribe(estimate=4)
    last = [viewer.data()[0] for _ in range(60)][-30:]
    assert set(last) == {4}, last


def test_what_cannot_be_is_answered(rig, viewer):
    for said, needed in (("{", "not understood"), ('{"op": "getParameters"}', "only publishes"),
                         ('{"op": "subscribe", "subscriptions": [{"id": 1, "channelId": 999}]}',
                          "no channel 999")):
        viewer.socket.send(said)
        status = viewer.socket.wait(lambda m: m["op"] == "status")
        assert needed in status["message"], status


def test_other_sites_are_refused_here_too(rig, port):
    with pytest.raises(Refused) as refused:
        Viewer(port, origin="https://evil.example")
    assert refused.value.status == 403
