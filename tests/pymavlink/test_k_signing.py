"""Signed MAVLink 2 against pymavlink, which signs and checks by itself: a companion that demands
signatures, and everything that may be wrong with one."""

import os
import pathlib
import signal
import stat
import subprocess
import time

import pytest
from conftest import SIM, World, free_port, from_autopilot, mavlink, patience

KEY = bytes(range(1, 33))
NEW_KEY = bytes(range(101, 133))
#: 10 us since 2015-01-01.
MINUTE = 60 * 100_000


def now():
    return int((time.time() - 1_420_070_400) * 100_000)


class Signer:
    """Makes frames as a station would, with any key, time, link id and system."""

    def __init__(self, key, link_id=20, timestamp=None, system=255):
        self.mav = mavlink.MAVLink(None, srcSystem=system, srcComponent=190)
        self.mav.signing.secret_key = key
        self.mav.signing.link_id = link_id
        self.mav.signing.timestamp = now() if timestamp is None else timestamp
        self.mav.signing.sign_outgoing = key is not None

    def command(self, command, *params):
        params = list(params) + [0.0] * (7 - len(params))
        message = mavlink.MAVLink_command_long_message(1, 1, command, 0, *params)
        return message.pack(self.mav)


def sign_with(key):
    def prepare(link):
        link.setup_signing(key, sign_outgoing=True, allow_unsigned_callback=None, link_id=3)
    return prepare


@pytest.fixture(scope="module")
def world(tmp_path_factory):
    folder = pathlib.Path(tmp_path_factory.mktemp("signed"))
    key_file = folder / "signing.key"
    key_file.write_text(KEY.hex() + "\n")
    key_file.chmod(0o600)
    port = free_port()
    world = World(
        folder,
        ground_keys='signing = "require"\ncommanders = [255]',
        sections='[signing]\nkey_file = "signing.key"',
        more_endpoints=[f"udpin:127.0.0.1:{port}"],
        prepare=sign_with(KEY),
    )
    world.port = port
    world.key_file = key_file
    yield world
    world.close()


def losses(world):
    """Losses of the station's link by reason: they take turns, one message at a time."""
    world.link.mav.command_long_send(
        1, 1, mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, 0, mavlink.MAVLINK_MSG_ID_HALTERE_DROPS,
        20_000, 0, 0, 0, 0, 0,
    )
    found = {}
    for m in world.drain(1.5):
        if m.get_type() == "HALTERE_DROPS" and m.link == 2:
            found[m.reason] = m.count
    return found


def answers(world, frame):
    """Results of commands, up to the answer to what is asked after them."""
    world.link.write(frame)
    return [m.result for m in world.until_answered() if m.get_type() == "COMMAND_ACK"]


def answers_to_the_deaf(world, frame):
    """The same where the station itself is not answered."""
    world.link.write(frame)
    return [m.result for m in world.drain(0.7) if m.get_type() == "COMMAND_ACK"]


ASK = mavlink.MAV_CMD_REQUEST_MESSAGE


def test_everything_it_sends_is_signed_and_verifies(world):
    messages = [m for m in world.drain(2.0) if from_autopilot(m)]
    assert len(messages) > 20
    # pymavlink was given no leave for unsigned frames: what it yields it has verified.
    assert all(m.get_signed() for m in messages)
    links = {m.get_link_id() for m in messages}
    assert links == {2}, "the number of the link"


def test_signed_commands_are_obeyed(world):
    assert answers(world, Signer(KEY).command(ASK, 148)) == [mavlink.MAV_RESULT_ACCEPTED]


def test_what_is_wrong_is_kept_out_and_counted_by_reason(world):
    before = losses(world)
    cases = {
        "mav_unsigned": Signer(None).command(ASK, 148),
        "mav_bad_signature": Signer(NEW_KEY, 21).command(ASK, 148),
        "mav_stale_time": Signer(KEY, 22, now() - MINUTE - 500_000).command(ASK, 148),
    }
    for reason, frame in cases.items():
        assert answers(world, frame) == [], reason
    replayed = Signer(KEY, 23).command(ASK, 148)
    assert answers(world, replayed) == [mavlink.MAV_RESULT_ACCEPTED]
    assert answers(world, replayed) == [], "the same frame again"
    older = Signer(KEY, 23, now() - MINUTE // 2).command(ASK, 148)
    assert answers(world, older) == [], "an older one of the same stream"
    expected = {"mav_unsigned": 1, "mav_bad_signature": 1, "mav_stale_time": 1, "mav_replayed": 2}
    deadline = time.monotonic() + patience(5)
    lost = {}
    while lost != expected and time.monotonic() < deadline:
        after = losses(world)
        # Not the gaps: the frames made here count by themselves.
        lost = {r: n - before.get(r, 0) for r, n in after.items()
                if n != before.get(r, 0) and r != "mav_sequence_gap"}
    assert lost == expected
    world.said("kept out")


def test_every_damaged_byte_is_kept_out(world):
    frame = Signer(KEY, 24).command(ASK, 148)
    for at in range(len(frame)):
        damaged = bytearray(frame)
        damaged[at] ^= 0x10
        world.link.write(bytes(damaged))
        # What a damaged length swallows must not be the next case.
        world.link.write(b"\0" * 300)
    assert [m for m in world.until_answered() if m.get_type() == "COMMAND_ACK"] == []
    assert answers(world, Signer(KEY, 25).command(ASK, 148)) == [mavlink.MAV_RESULT_ACCEPTED]


def test_who_may_only_look_is_denied_even_when_signed(world):
    arm = mavlink.MAV_CMD_COMPONENT_ARM_DISARM
    assert answers(world, Signer(KEY, 26, system=254).command(arm, 1)) == [
        mavlink.MAV_RESULT_DENIED
    ]
    assert answers(world, Signer(KEY, 26, system=254).command(ASK, 148)) == [
        mavlink.MAV_RESULT_ACCEPTED
    ]
    world.said("may look, not command")


def test_a_signed_flight(world):
    world.arm()
    nan = float("nan")
    assert world.command(
        mavlink.MAV_CMD_NAV_TAKEOFF, nan, nan, nan, nan, nan, nan, 1.0
    ) == mavlink.MAV_RESULT_ACCEPTED
    world.wait("LOCAL_POSITION_NED", 30, lambda m: m.z < -0.8)
    # In the air too: nobody else lands it.
    assert answers(world, Signer(None).command(mavlink.MAV_CMD_NAV_LAND)) == []
    world.land()


def ctl(world, *arguments):
    return subprocess.run(
        [SIM, "companion", "ctl", "--to", f"udpout:127.0.0.1:{world.port}", *arguments],
        capture_output=True, text=True, timeout=60,
    )


def test_our_own_small_station_signs_too(world):
    signed = ctl(world, "--signing-key", str(world.key_file), "status")
    assert signed.returncode == 0 and "battery:" in signed.stdout, signed
    # Without a key it is not even told that somebody is there.
    unsigned = ctl(world, "status")
    assert unsigned.returncode != 0 and "no heartbeat" in unsigned.stderr, unsigned
    world.key_file.chmod(0o644)
    open_key = ctl(world, "--signing-key", str(world.key_file), "status")
    world.key_file.chmod(0o600)
    assert open_key.returncode != 0, open_key
    assert "its mode is 644, allowed is 600" in open_key.stderr, open_key


def newest_time(world):
    times = [m.get_msgbuf()[-12:-6] for m in world.until_answered() if from_autopilot(m)]
    return max(int.from_bytes(bytes(t), "little") for t in times)


def test_a_restart_never_goes_back(world):
    before = newest_time(world)
    world.cut_power()
    messages = [m for m in world.until_answered() if from_autopilot(m)]
    first = min(int.from_bytes(bytes(m.get_msgbuf()[-12:-6]), "little") for m in messages)
    assert first > before
    # What was recorded long before is no new stream, whatever was forgotten.
    assert answers(world, Signer(KEY, 27, before - MINUTE - 1000).command(ASK, 148)) == []


def test_a_key_is_changed_only_by_who_holds_it_and_kept(world):
    def setup(signer):
        return mavlink.MAVLink_setup_signing_message(1, 1, NEW_KEY, now()).pack(signer.mav)
    world.link.write(setup(Signer(None)))
    world.link.write(setup(Signer(NEW_KEY, 30)))
    assert answers(world, Signer(NEW_KEY, 31).command(ASK, 148)) == []
    assert answers(world, Signer(KEY, 32).command(ASK, 148)) == [mavlink.MAV_RESULT_ACCEPTED]
    world.link.write(setup(Signer(KEY, 33)))
    sign_with(NEW_KEY)(world.link)
    assert answers(world, Signer(NEW_KEY, 34).command(ASK, 148)) == [mavlink.MAV_RESULT_ACCEPTED]
    assert answers(world, Signer(KEY, 35).command(ASK, 148)) == []
    deadline = time.monotonic() + patience(5)
    while world.key_file.read_text().strip() != NEW_KEY.hex():
        assert time.monotonic() < deadline, "the new key is not written"
        time.sleep(0.1)
    assert stat.S_IMODE(os.stat(world.key_file).st_mode) == 0o600
    world.drain(2.0)  # so that outputs are on the disk, for the replay below
    world.cut_power()
    assert answers(world, Signer(NEW_KEY, 36).command(ASK, 148)) == [mavlink.MAV_RESULT_ACCEPTED]


def test_no_key_is_in_any_log_or_output_and_the_flights_replay(world):
    world.companion.send_signal(signal.SIGTERM)
    world.companion.wait(timeout=15)
    files = [f for f in world.folder.rglob("*") if f.is_file() and f != world.key_file]
    assert any(f.suffix == ".mcap" for f in files)
    for file in files:
        content = file.read_bytes()
        for key in (KEY, NEW_KEY):
            assert key not in content, f"{file} holds the key"
            assert key.hex().encode() not in content, f"{file} holds the key"
    for log in sorted((world.folder / "log").glob("*.mcap")):
        replay = subprocess.run(
            [SIM, "companion", "replay", str(log)], capture_output=True, text=True, timeout=120
        )
        assert "reproduced bit for bit" in replay.stdout, replay.stdout + replay.stderr
    world.start_companion()
