"""What MAVSDK fetches and stores, as its own examples do: parameters, plans, files, logs, metadata."""

import json
import threading

import pytest
from mavsdk import ComponentType, Configuration, Mavsdk
from mavsdk.plugins import component_metadata, ftp, log_files, mission_raw, param

from haltere_testing.rig import wait_until

SPEED = 2

LOCAL_NED = 1


@pytest.fixture(scope="module", params=["generic", "px4"])
def system(rig, request):
    mavsdk = Mavsdk(Configuration.create_with_component_type(ComponentType.GROUND_STATION))
    mavsdk.add_any_connection(f"udpout://127.0.0.1:{rig.ports[request.param]}")
    system = mavsdk.first_autopilot(20.0)
    assert system is not None, rig.said()
    system.identity = request.param
    yield system
    mavsdk.destroy()


def test_parameters(system):
    plugin = param.Param(system)
    everything = plugin.get_all_params()
    names = {p.name for p in everything.float_params}
    assert not everything.int_params and len(names) > 100
    assert ("MIS_TAKEOFF_ALT" in names) == (system.identity == "px4")
    plugin.set_param_float("FLT_TKO_HGT", 1.25)
    assert plugin.get_param_float("FLT_TKO_HGT") == 1.25
    if system.identity == "px4":
        assert plugin.get_param_float("MIS_TAKEOFF_ALT") == 1.25
        plugin.set_param_float("MIS_TAKEOFF_ALT", 1.5)
        assert plugin.get_param_float("FLT_TKO_HGT") == 1.5
    with pytest.raises(Exception):
        plugin.set_param_float("FLT_TKO_HGT", 99.0)
    with pytest.raises(Exception):
        plugin.get_param_float("NO_SUCH")


def item(seq, command, x, y, z, kind, p1=0.0):
    return mission_raw.MissionItem(seq, LOCAL_NED, command, int(seq == 0), 1, p1, 0.0, 0.0, 0.0,
                                   round(x * 1e4), round(y * 1e4), z, kind)


def test_mission_fence_and_rally_points(system):
    plugin = mission_raw.MissionRaw(system)
    plan = [item(0, 22, 0, 0, -1.0, 0)] + [item(n, 16, 4 + n * 0.01, 5, -1.0, 0)
                                           for n in range(1, 60)]
    plugin.upload_mission(plan)
    fence = [item(n, 5001, x, y, 0, 1, 4.0)
             for n, (x, y) in enumerate([(1, 1), (1, 9), (9, 9), (9, 1)])]
    plugin.upload_geofence(fence)
    plugin.upload_rally_points([item(0, 5100, 4, 4, 0, 2)])
    got = plugin.download_mission()
    assert [(i.seq, i.command, i.x) for i in got] == [(i.seq, i.command, i.x) for i in plan]
    assert [(i.command, i.x, i.y) for i in plugin.download_geofence()] == [
        (i.command, i.x, i.y) for i in fence]
    assert len(plugin.download_rallypoints()) == 1
    plugin.clear_mission()


def download(plugin, path, folder):
    done, result = threading.Event(), []

    def told(code, *_):
        if code.name != "NEXT":
            result.append(code)
            done.set()

    plugin.download_async(path, str(folder), True, told)
    assert done.wait(60), "no end of the download"
    assert result[0].name == "SUCCESS", result
    return (folder / path.rsplit("/", 1)[1]).read_bytes()


def test_files(system, tmp_path):
    plugin = ftp.Ftp(system)
    listed = plugin.list_directory("/")
    assert {getattr(e, "name", "") for e in listed.entries} >= {"logs", "missions"}
    described = json.loads(download(plugin, "/param.json", tmp_path))
    assert len(described["parameters"]) > 100


def test_logs(system):
    entries = log_files.LogFiles(system).get_entries()
    assert len(entries) == 1 and entries[0].size_bytes > 10_000


def test_metadata(system, rig):
    plugin = component_metadata.ComponentMetadata(system)
    got = []
    plugin.subscribe_metadata_available(lambda update, _: got.append(update))
    plugin.request_autopilot_component()
    wait_until(lambda: got, 30, rig)
