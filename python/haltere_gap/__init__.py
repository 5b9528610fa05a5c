"""What has changed on a quadrotor since flights that were in order: `haltere gap diagnose --import` from Python, see README.md."""

from __future__ import annotations

import csv
import json
import os
import pathlib
import shutil
import subprocess
import tempfile
from dataclasses import dataclass, fields
from typing import Any, List, Mapping, Optional, Sequence, Union

__all__ = ["Axis", "Cause", "Diagnosis", "GapError", "HeldOut", "diagnose"]

#: A file, or a table of columns.
Flight = Union[str, os.PathLike, Mapping[str, Sequence[float]]]

#: Exit codes of `haltere gap diagnose` that stand for an outcome.
_OUTCOMES = (0, 10, 11, 12, 13, 14, 15, 20, 30)
_MOTORS = ("m1", "m2", "m3", "m4")
#: Columns of a table that may be missing.
_BESIDE = ("supply_v", "height_m", "speed_mps")


class GapError(RuntimeError):
    """The program refused; its words."""


@dataclass(frozen=True)
class Cause:
    """A cause with its size: losses of thrust of 1, loads in kg, one for each motor that the id names."""

    id: str
    probability: float
    sizes: List[float]
    sizes_90: List[List[float]]


@dataclass(frozen=True)
class Axis:
    """Vertical force or a moment in hover, against healthy flights, as shares of the weight."""

    axis: str
    share: float
    #: Deviation of the next healthy flight.
    sigma: float
    references: List[float]
    #: What the most probable cause leaves of it.
    left: Optional[float]


@dataclass(frozen=True)
class HeldOut:
    """Flights that the explanation was not found on."""

    flights: List[str]
    before: float
    after: float
    shrink: float


@dataclass(frozen=True)
class Diagnosis:
    """What was found; of a flight that cannot be judged outcome, verdict and raw alone."""

    outcome: str
    verdict: str
    #: Causes that are named: one, or a set that the flight cannot tell apart.
    causes: List[Cause]
    #: All that are listed, most probable first, named or not.
    candidates: List[Cause]
    balance: List[Axis]
    #: How many times as much the controller works; None where the logs cannot be compared.
    shaking: Optional[float]
    #: Probability that nothing has changed.
    nothing: Optional[float]
    #: Probability that it is another vehicle.
    another_vehicle: Optional[float]
    #: Smallest size of each kind of cause that these references can show; None: not even the largest.
    can_show: Mapping[str, Optional[float]]
    not_checked: List[str]
    held_out: Optional[HeldOut]
    #: The JSON of the program.
    raw: Mapping[str, Any]

    def balance_table(self):
        """The balance as a pandas table, a row for each axis."""
        return _table(self.balance, "axis")

    def candidates_table(self):
        """The candidates as a pandas table, most probable first."""
        return _table(self.candidates, "id")


def diagnose(
    flights: Sequence[Flight],
    references: Sequence[Flight],
    vehicle: Union[str, os.PathLike],
    *,
    kind: Optional[str] = None,
    columns: Optional[os.PathLike] = None,
    report: Optional[os.PathLike] = None,
    simulator: Optional[str] = None,
    program: Optional[Sequence[str]] = None,
) -> Diagnosis:
    """Judges the first flight by the references; the other flights are those that the explanation is tried on.

    `vehicle` is a vehicle file, or the name of one (`haltere vehicle list`). Flights are files of a `kind`, or tables. `report` is an HTML
    page to write, `simulator` a command that flies what causes do (docs/IMPORT.md), `program` the command in place of `haltere`.
    """
    every = [*flights, *references]
    tables = [flight for flight in every if not isinstance(flight, (str, os.PathLike))]
    if tables and (len(tables) < len(every) or kind or columns):
        raise ValueError("flights and references are all files, with their kind, or all tables, which have none")
    if not tables and kind is None:
        raise ValueError("files need their kind: usdlog, ulog, dataflash, or csv with columns")
    with tempfile.TemporaryDirectory() as folder:
        if tables:
            kind, columns = "csv", pathlib.Path(folder, "columns.toml")
            columns.write_text(_columns(tables))
            # Their names in reports.
            names = [f"flight-{k + 1}" for k in range(len(flights))]
            names += [f"reference-{k + 1}" for k in range(len(references))]
            every = [_written(table, pathlib.Path(folder, name)) for table, name in zip(every, names)]
        command = [*(program or [_program()]), "gap", "diagnose", "--json", "--import", str(kind)]
        command += ["--vehicle", os.fspath(vehicle)]
        command += ["--columns", os.fspath(columns)] if columns else []
        command += ["--report", os.fspath(report)] if report else []
        command += ["--simulator", simulator] if simulator else []
        command += [os.fspath(flight) for flight in every[: len(flights)]]
        command += ["--reference", *(os.fspath(flight) for flight in every[len(flights):])]
        ran = subprocess.run(command, text=True, capture_output=True)
    if ran.returncode not in _OUTCOMES:
        raise GapError(ran.stderr.strip() or f"{command[0]}: exit code {ran.returncode}")
    return _diagnosis(json.loads(ran.stdout))


def _diagnosis(raw: Mapping[str, Any]) -> Diagnosis:
    causes = raw.get("effects") or ([raw["effect"]] if "effect" in raw else [])
    held_out = raw.get("held_out")
    return Diagnosis(
        outcome=raw["outcome"],
        verdict=raw.get("verdict") or raw.get("why", ""),
        causes=[_cause(cause) for cause in causes],
        candidates=[_cause(cause) for cause in raw.get("candidates", [])],
        balance=[_of(Axis, axis) for axis in raw.get("balance", [])],
        shaking=raw.get("shaking"),
        nothing=raw.get("nothing"),
        another_vehicle=raw.get("another_vehicle"),
        can_show={smallest["kind"]: smallest["size"] for smallest in raw.get("can_show", [])},
        not_checked=raw.get("not_checked", []),
        held_out=_of(HeldOut, held_out) if held_out else None,
        raw=raw,
    )


def _of(kind: Any, raw: Mapping[str, Any]) -> Any:
    """What a newer program says more is in `raw` alone."""
    return kind(**{field.name: raw.get(field.name) for field in fields(kind)})


def _cause(raw: Mapping[str, Any]) -> Cause:
    return Cause(raw["id"], raw["probability"], raw["theta"], raw["theta_90"])


def _table(rows: Sequence[Any], index: str):
    try:
        import pandas
    except ImportError as why:
        raise ImportError("tables need pandas: pip install pandas") from why
    return pandas.DataFrame([vars(row) for row in rows]).set_index(index)


def _columns(tables: Sequence[Mapping[str, Sequence[float]]]) -> str:
    """The map of columns; one that not every table has is not read."""
    motors = ", ".join(f'{{ column = "{name}" }}' for name in _MOTORS)
    beside = [name for name in _BESIDE if all(name in table for table in tables)]
    rows = ['time_s = { column = "t_s" }', f"motors_frac = [{motors}]"]
    return "\n".join(rows + [f'{name} = {{ column = "{name}" }}' for name in beside]) + "\n"


def _written(table: Mapping[str, Sequence[float]], path: pathlib.Path) -> pathlib.Path:
    missing = [name for name in ("t_s", *_MOTORS) if name not in table]
    if missing:
        raise ValueError(f"a table has no column {', '.join(missing)}")
    names = ["t_s", *_MOTORS, *(name for name in _BESIDE if name in table)]
    with path.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(names)
        writer.writerows(zip(*(table[name] for name in names)))
    return path


def _program() -> str:
    found = os.environ.get("HALTERE") or shutil.which("haltere")
    if found is None:
        raise GapError("haltere is not on the path: install it (docs/INSTALL.md), or name the program by the variable HALTERE")
    return found
