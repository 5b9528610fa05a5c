"""Missions, fence and rally points: lists, losses, locks, and what is kept."""

import random
import time

from conftest import mavlink, patience

NAN = float("nan")
MISSION = mavlink.MAV_MISSION_TYPE_MISSION
FENCE = mavlink.MAV_MISSION_TYPE_FENCE
RALLY = mavlink.MAV_MISSION_TYPE_RALLY
LOCAL = mavlink.MAV_FRAME_LOCAL_NED
RELATIVE = mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT
ACCEPTED = mavlink.MAV_MISSION_ACCEPTED


class Loss:
    """One packet in ten is lost, each way; the luck is the same in every run."""

    def __init__(self, share):
        self.luck = random.Random(1)
        self.share = share

    def hits(self):
        return self.luck.random() < self.share


def item(seq, command, x, y, z, frame=LOCAL, params=(0, 0, 0, NAN), kind=MISSION):
    scale = 1e4 if frame == LOCAL else 1e7
    return (1, 1, seq, frame, command, 0, 1, *params, round(x * scale), round(y * scale), z, kind)


def upload(world, items, kind=MISSION, loss=0.0):
    """Gives the result of the acknowledgement. Lost packets are lost to both sides."""
    send, lost = world.link.mav, Loss(loss)
    send.mission_count_send(1, 1, len(items), kind)
    asked = time.monotonic()
    deadline = asked + patience(120)
    while time.monotonic() < deadline:
        message = world.receive(timeout=0.05)
        if message is None and time.monotonic() - asked > 1.5:
            send.mission_count_send(1, 1, len(items), kind)
            asked = time.monotonic()
        if message is None or lost.hits():
            continue
        if message.get_type() in ("MISSION_REQUEST_INT", "MISSION_REQUEST"):
            asked = time.monotonic()
            if not lost.hits():
                send.mission_item_int_send(*items[message.seq])
        elif message.get_type() == "MISSION_ACK":
            return message.type
    raise AssertionError(f"not finished: {world.texts}")


def download(world, kind=MISSION, loss=0.0, in_flight=5):
    """With several requests in flight, as MAVProxy does; what is lost is asked for again."""
    send, lost = world.link.mav, Loss(loss)
    count, items = None, {}
    deadline = time.monotonic() + patience(120)
    while count is None or len(items) < count:
        assert time.monotonic() < deadline, f"{len(items)} of {count}"
        if count is None:
            send.mission_request_list_send(1, 1, kind)
        else:
            missing = [n for n in range(count) if n not in items][:in_flight]
            for seq in missing:
                if not lost.hits():
                    send.mission_request_int_send(1, 1, seq, kind)
        until = time.monotonic() + 0.1
        while time.monotonic() < until:
            message = world.receive(timeout=0.02)
            if message is None or lost.hits():
                continue
            if message.get_type() == "MISSION_COUNT" and message.mission_type == kind:
                count = message.count
                break
            if message.get_type() == "MISSION_ITEM_INT" and message.mission_type == kind:
                items[message.seq] = message
                if len(items) % in_flight == 0 or len(items) == count:
                    break
    return [items[n] for n in range(count)]


def said(world, words):
    """Also when the words are spread over two texts."""
    deadline = time.monotonic() + patience(5)
    while words not in "".join(world.texts):
        assert time.monotonic() < deadline, f"{words!r} was not said: {world.texts}"
        world.receive()


def long_mission(count):
    items = [item(0, mavlink.MAV_CMD_NAV_TAKEOFF, 5, 5, -1)]
    for n in range(1, count):
        items.append(item(n, mavlink.MAV_CMD_NAV_WAYPOINT, 3 + (n % 40) * 0.1, 4.5, -1.0 - n % 3))
    return items


def test_500_items_up_and_down_through_ten_percent_loss(world):
    items = long_mission(500)
    start = time.monotonic()
    assert upload(world, items, loss=0.1) == ACCEPTED
    middle = time.monotonic()
    got = download(world, loss=0.1)
    print(f"up {middle - start:.1f} s, down {time.monotonic() - middle:.1f} s")
    assert len(got) == 500
    for mine, theirs in zip(items, got):
        assert (theirs.seq, theirs.command, theirs.x, theirs.y, theirs.z) == (
            mine[2], mine[4], mine[11], mine[12], mine[13])


def fence(low, high):
    corners = [(low, low), (low, high), (high, high), (high, low)]
    inclusion = mavlink.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION
    return [item(n, inclusion, x, y, 0, params=(4, 0, 0, 0), kind=FENCE)
            for n, (x, y) in enumerate(corners)]


def test_fence_and_rally_points_have_lists_of_their_own(world):
    assert upload(world, long_mission(3)) == ACCEPTED
    assert upload(world, fence(1, 9), FENCE) == ACCEPTED
    rally = [item(0, mavlink.MAV_CMD_NAV_RALLY_POINT, 4, 4, 0, kind=RALLY)]
    assert upload(world, rally, RALLY) == ACCEPTED
    assert [len(download(world, kind)) for kind in (MISSION, FENCE, RALLY)] == [3, 4, 1]
    current = world.wait("MISSION_CURRENT", 3)
    assert current.total == 3
    # A mission that leaves the fence is refused, with the item named.
    assert upload(world, fence(3, 7), FENCE) == ACCEPTED
    world.texts.clear()
    leaving = [item(0, mavlink.MAV_CMD_NAV_TAKEOFF, 5, 5, -1),
               item(1, mavlink.MAV_CMD_NAV_WAYPOINT, 8, 5, -1)]
    assert upload(world, leaving) == mavlink.MAV_MISSION_INVALID
    said(world, "item 2: it, or the way to it, is outside the fence")
    for kind in (MISSION, FENCE, RALLY):
        world.link.mav.mission_clear_all_send(1, 1, kind)
        assert world.wait("MISSION_ACK").type == ACCEPTED
        assert download(world, kind) == []


def test_bad_items_are_refused_by_name(world):
    takeoff = item(0, mavlink.MAV_CMD_NAV_TAKEOFF, 5, 5, -1)
    for bad, result, says in [
        (item(1, mavlink.MAV_CMD_DO_SET_ROI, 5, 5, -1), mavlink.MAV_MISSION_UNSUPPORTED,
         "MAV_CMD_DO_SET_ROI"),
        (item(1, mavlink.MAV_CMD_NAV_WAYPOINT, 5, 5, -1, mavlink.MAV_FRAME_BODY_FRD),
         mavlink.MAV_MISSION_UNSUPPORTED_FRAME, "MAV_FRAME_BODY_FRD"),
        # 1000 times too far, as MAVProxy and QGroundControl scale a local frame.
        (item(1, mavlink.MAV_CMD_NAV_WAYPOINT, 5000, 5000, -1), mavlink.MAV_MISSION_INVALID,
         "outside"),
        (item(1, mavlink.MAV_CMD_DO_JUMP, 0, 0, 0, mavlink.MAV_FRAME_MISSION, (9, 1, 0, 0)),
         mavlink.MAV_MISSION_INVALID_PARAM1, "jumps to 10"),
    ]:
        world.texts.clear()
        assert upload(world, [takeoff, bad]) == result
        said(world, says)


def test_plans_outlive_a_power_cut(world):
    assert upload(world, long_mission(20)) == ACCEPTED
    assert upload(world, fence(1, 9), FENCE) == ACCEPTED
    world.drain(0.5)
    before = world.wait("MISSION_CURRENT", 3)
    world.cut_power()
    world.drain(1.0)
    assert len(download(world)) == 20 and len(download(world, FENCE)) == 4
    after = world.wait("MISSION_CURRENT", 3)
    assert after.total == before.total == 20
    world.link.mav.mission_clear_all_send(1, 1, mavlink.MAV_MISSION_TYPE_ALL)
    assert world.wait("MISSION_ACK").type == ACCEPTED
