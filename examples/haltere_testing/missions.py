"""Missions as what a station uploads: files of haltere's, QGroundControl's and MAVProxy's, or points of the room."""

from __future__ import annotations

import json
import math
import os
import subprocess
from typing import Iterable, NamedTuple, Sequence, Union

from .programs import program

NAN = math.nan
#: MAV_FRAME_LOCAL_NED, and the commands of a plain route.
LOCAL_NED, TAKEOFF, WAYPOINT, LAND = 1, 22, 16, 21


class Item(NamedTuple):
    """An item as MISSION_ITEM_INT has it: x and y as integers on the wire, z in metres, down where the frame is local."""

    frame: int
    command: int
    params: Sequence[float]
    x: int
    y: int
    z: float


def local_item(command: int, north: float, east: float, height: float, *params: float) -> Item:
    """An item in metres of the room; params are the first four, the others of them are not given."""
    filled = [*params, *[0.0, 0.0, 0.0, NAN][len(params):]]
    return Item(LOCAL_NED, command, filled, round(north * 1e4), round(east * 1e4), -height)


def route(points: Iterable[Sequence[float]], acceptance_m: float = 0.2, hold_s: float = 0.0) -> list[Item]:
    """Take-off to the height of the first point (north, east, height in m), the points, and a landing at the last."""
    points = [tuple(point) for point in points]
    if not points or any(len(point) != 3 for point in points):
        raise ValueError(f"points {points}: (north, east, height) in m are due, one at least")
    last = points[-1]
    return [local_item(TAKEOFF, 0.0, 0.0, points[0][2]),
            *[local_item(WAYPOINT, *point, hold_s, acceptance_m) for point in points],
            local_item(LAND, last[0], last[1], 0.0)]


class Plan(NamedTuple):
    """What a file holds; a part that it does not have is empty."""

    mission: list[Item]
    fence: list[Item]
    rally: list[Item]


def read(file: Union[str, os.PathLike]) -> Plan:
    """A mission file (`.toml`, `.plan`, `.waypoints`) as items, read by haltere's own program."""
    read = subprocess.run([program(), "companion", "ctl", "items", os.fspath(file)], text=True, capture_output=True)
    if read.returncode != 0:
        raise ValueError(read.stderr.strip() or f"{file}: not read")
    told = json.loads(read.stdout)

    def items(kind: str) -> list[Item]:
        return [Item(i["frame"], i["command"], [NAN if p is None else p for p in i["params"]], i["x"], i["y"], i["z"])
                for i in told[kind]]

    return Plan(items("mission"), items("fence"), items("rally"))
