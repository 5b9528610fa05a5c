"""Files with pymavlink's own FTP client: metadata, missions, logs; the classic log download."""

import io
import json
import time

import pytest
from pymavlink import mavftp

from conftest import mavlink, patience

MISSION_FILE = """
[[item]]
command = "takeoff"
height_m = 1.0
[[item]]
command = "waypoint"
position_m = [5.5, 5.0, 1.0]
[[item]]
command = "land"
"""


class Files:
    def __init__(self, world, loss=0):
        world.drain(0.1)
        self.ftp = mavftp.MAVFTP(world.link, 1, 1)
        self.ftp.ftp_settings.burst_read_size = 239
        self.ftp.ftp_settings.pkt_loss_rx = loss
        self.ftp.ftp_settings.pkt_loss_tx = loss

    def names(self, folder):
        assert self.ftp.cmd_list([folder]).error_code == 0
        return {entry.name: entry.size_b for entry in self.ftp.list_result}

    def get(self, path, timeout=60):
        got = []
        self.ftp.cmd_get([path], callback=lambda file: got.append(file.read() if file else None))
        self.ftp.process_ftp_reply("OpenFileRO", timeout=timeout)
        return got[0] if got else None

    def put(self, path, content):
        done = []
        self.ftp.cmd_put(["local", path], fh=io.BytesIO(content), callback=done.append)
        return self.ftp.process_ftp_reply("CreateFile", timeout=20), done


def crc32(data):
    crc = 0
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = crc >> 1 ^ (0xEDB88320 if crc & 1 else 0)
    return crc


# First: what is done in this world is in the log.
def test_logs_are_listed_and_downloaded_and_the_present_one_is_not_erased(world):
    world.cut_power()
    world.drain(1.5)
    logs = sorted((world.folder / "log").glob("*.mcap"))
    assert len(logs) == 2
    names = Files(world).names("/logs")
    assert set(names) == {log.name for log in logs}
    # The older one does not grow any more.
    content = logs[0].read_bytes()
    world.link.mav.log_request_list_send(1, 1, 0, 0xFFFF)
    entry = world.wait("LOG_ENTRY", 3, lambda m: m.id == 1)
    assert (entry.num_logs, entry.size) == (2, len(content))
    want = min(len(content), 200_000)
    got, start = bytearray(), time.monotonic()
    while len(got) < want:
        # What was lost on the way is asked for again, from there.
        world.link.mav.log_request_data_send(1, 1, 1, len(got), want - len(got))
        last = time.monotonic()
        while len(got) < want and time.monotonic() - last < 1:
            message = world.receive(timeout=0.2)
            if message is not None and message.get_type() == "LOG_DATA" and message.count:
                if message.ofs == len(got):
                    # MAVProxy takes a shorter one for the end of the log.
                    assert message.count == 90 or message.ofs + message.count >= want
                    got += bytes(message.data[:message.count])
                    last = time.monotonic()
    rate = want / (time.monotonic() - start) / 1000
    print(f"log: {want} bytes, {rate:.0f} kB/s")
    assert bytes(got) == content[:want]
    world.link.mav.log_request_end_send(1, 1)
    start = time.monotonic()
    assert Files(world).get(f"/logs/{logs[0].name}") == content
    print(f"ftp: {len(content)} bytes, {len(content) / (time.monotonic() - start) / 1000:.0f} kB/s")
    world.link.mav.log_erase_send(1, 1)
    deadline = time.monotonic() + patience(3)
    while logs[0].exists() and time.monotonic() < deadline:
        world.drain(0.1)
    assert not logs[0].exists() and logs[1].exists()
    world.link.mav.log_request_list_send(1, 1, 0, 0xFFFF)
    assert world.wait("LOG_ENTRY", 3).num_logs == 1


def test_metadata_is_found_over_ftp(world):
    world.link.mav.command_long_send(
        1, 1, mavlink.MAV_CMD_REQUEST_MESSAGE, 0, 397, 0, 0, 0, 0, 0, 0)
    message = world.wait("COMPONENT_METADATA", 2)
    assert message.uri.startswith("mftp:///")
    files = Files(world)
    general = files.get(message.uri[len("mftp://"):])
    assert crc32(general) == message.file_crc
    entry = json.loads(general)["metadataTypes"][0]
    assert entry["type"] == 1
    parameters = files.get(entry["uri"][len("mftp://"):])
    assert crc32(parameters) == entry["fileCrc"]
    described = {p["name"]: p for p in json.loads(parameters)["parameters"]}
    height = described["FLT_TKO_HGT"]
    assert (height["units"], height["min"], height["max"]) == ("m", 0.3, 20.0)
    assert described["EST_UWB_STD"]["rebootRequired"] is True


def test_root_and_what_leads_out_of_it(world):
    files = Files(world)
    assert set(files.names("/")) == {"logs", "missions", "general.json", "param.json", "events.json"}


@pytest.mark.parametrize("loss", [0, 5])
def test_a_mission_file_goes_up_and_down(world, loss):
    content = MISSION_FILE.encode() + b"# filler\n" * 300
    files = Files(world, loss)
    files.put("/missions/hop.toml", content)
    deadline = time.monotonic() + patience(10)
    while Files(world).names("/missions").get("hop.toml") != len(content):
        assert time.monotonic() < deadline, world.texts
    assert Files(world, loss).get("/missions/hop.toml") == content


def test_a_mission_file_is_loaded_as_a_program_by_its_number(world):
    if "hop.toml" not in Files(world).names("/missions"):
        Files(world).put("/missions/hop.toml", MISSION_FILE.encode())
    world.texts.clear()
    assert world.command(mavlink.MAV_CMD_USER_4, 0) == mavlink.MAV_RESULT_ACCEPTED
    world.drain(0.3)
    names = [text for text in world.texts if text.startswith("program ")]
    assert names[0] == "program 1: hop.toml", world.texts
    assert any(text.endswith(": diagnostic") for text in names), names
    assert world.command(mavlink.MAV_CMD_USER_4, 1) == mavlink.MAV_RESULT_ACCEPTED
    assert len(world.download()) == 3
    number = 1 + [text.split(": ")[1] for text in names].index("diagnostic")
    assert world.command(mavlink.MAV_CMD_USER_4, number) == mavlink.MAV_RESULT_ACCEPTED
    assert len(world.download()) > 20
    assert world.command(mavlink.MAV_CMD_USER_4, 63) == mavlink.MAV_RESULT_FAILED
    assert world.command(mavlink.MAV_CMD_USER_4, 1.5) == mavlink.MAV_RESULT_DENIED
    world.link.mav.mission_clear_all_send(1, 1, mavlink.MAV_MISSION_TYPE_MISSION)
    assert world.wait("MISSION_ACK").type == mavlink.MAV_MISSION_ACCEPTED
