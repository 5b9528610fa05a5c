//! What the board has names for: log variables and parameters, each with its type. A part of what real firmware has.
//!
//! Names and types are those of crazyflie-firmware 2a18fc29 as it told them; ids are places in these lists, as ids
//! change with every build anyway.

use haltere_dialect::crtp::toc::{Table, TocAnswer, TocItem};
use haltere_dialect::crtp::value::{Kind, Value};

const EXTENDED: u8 = 0x10;
const CORE: u8 = 0x20;
const READ_ONLY: u8 = 0x40;
const FNV_BASIS: u32 = 0x811c_9dc5;
const FNV_PRIME: u32 = 0x0100_0193;

/// A log variable.
pub(super) struct Variable {
    pub group: &'static str,
    pub name: &'static str,
    pub kind: Kind,
}

/// A parameter.
pub(super) struct Parameter {
    pub group: &'static str,
    pub name: &'static str,
    pub kind: Kind,
    flags: u8,
    pub default: Value,
}

impl Parameter {
    pub fn is_read_only(&self) -> bool {
        self.flags & READ_ONLY != 0
    }

    pub fn is_extended(&self) -> bool {
        self.flags & EXTENDED != 0
    }
}

macro_rules! variables {
    ($($group:literal $kind:ident: $($name:literal)+;)+) => {
        pub(super) const VARIABLES: &[Variable] = &[$($(
            Variable { group: $group, name: $name, kind: Kind::$kind },
        )+)+];
    };
}

variables![
    "motor" U16: "m1" "m2" "m3" "m4";
    "loco" U8: "mode";
    "deckStatus" U8: "bcLoco";
    "tdoa2" F32: "d7-0" "d0-1" "d1-2" "d2-3" "d3-4" "d4-5" "d5-6" "d6-7";
    "pm" F32: "vbat";
    "pm" U16: "vbatMV";
    "pm" I8: "state";
    "controller" F32: "roll" "pitch" "yaw";
    "crtp" U16: "rxRate" "txRate";
    "range" U16: "zrange";
    "stateEstimate" F32: "x" "y" "z" "vx" "vy" "vz" "roll" "pitch" "yaw" "qx" "qy" "qz" "qw";
    "stateEstimateZ" U32: "quat";
    "gyro" F32: "x" "y" "z";
    "baro" F32: "asl" "temp" "pressure";
    "acc" F32: "x" "y" "z";
    "stabilizer" F32: "roll" "pitch" "yaw" "thrust";
    "ctrltarget" F32: "roll" "pitch" "yaw" "thrust";
    "supervisor" U16: "info";
    "sys" U8: "canfly" "isFlying" "isTumbled";
];

macro_rules! parameters {
    ($($group:literal $kind:ident $flags:tt: $($name:literal = $default:expr),+;)+) => {
        pub(super) const PARAMETERS: &[Parameter] = &[$($(
            Parameter {
                group: $group, name: $name, kind: Kind::$kind, flags: $flags, default: $default,
            },
        )+)+];
    };
}

use Value::{Float, Int};

parameters![
    "loco" U8 CORE: "mode" = Int(0), "fwdToEstimator" = Int(1);
    "deck" U8 (CORE | READ_ONLY): "bcDWM1000" = Int(1), "bcLoco" = Int(1);
    "tdoa2" F32 0: "stddev" = Float(0.15);
    "pm" F32 (EXTENDED | CORE): "lowVoltage" = Float(6.4), "criticalLowVoltage" = Float(6.0);
    "commander" U8 CORE: "enHighLevel" = Int(1);
    "flightmode" U8 CORE: "althold" = Int(0), "poshold" = Int(0), "posSet" = Int(0);
    "flightmode" U8 0: "yawMode" = Int(2);
    "flightmode" U8 CORE:
        "stabModeRoll" = Int(1), "stabModePitch" = Int(1), "stabModeYaw" = Int(0);
    "kalman" U8 CORE: "resetEstimation" = Int(0);
    "kalman" F32 CORE: "initialYaw" = Float(0.0);
    "powerDist" U32 (EXTENDED | CORE | READ_ONLY): "idleThrust" = Int(0);
    "stabilizer" U8 CORE: "estimator" = Int(2), "controller" = Int(1);
    "supervisor" U16 EXTENDED: "prefltTimeout" = Int(30_000), "landedTimeout" = Int(3_000);
    "supervisor" U8 EXTENDED: "tmblChckEn" = Int(1);
    "stabilizer" U8 CORE: "stop" = Int(0);
];

/// Of log variables, the number of them; `more` adds one that no other build has.
fn len(table: Table, more: bool) -> usize {
    usize::from(more)
        + match table {
            Table::Log => VARIABLES.len(),
            Table::Parameters => PARAMETERS.len(),
        }
}

/// Equal for equal tables. Which sum it is, is the firmware's own affair.
fn checksum(table: Table, more: bool) -> u32 {
    let mut sum = FNV_BASIS;
    for id in 0..len(table, more) {
        let Some(item) = item(table, id as u16, more) else { continue };
        for byte in [item.code].into_iter().chain(item.group.bytes()).chain(item.name.bytes()) {
            sum = (sum ^ u32::from(byte)).wrapping_mul(FNV_PRIME);
        }
    }
    sum
}

/// Another build has one name more, before all others: every id moves on by one.
fn item(table: Table, id: u16, more: bool) -> Option<TocItem<'static>> {
    if more && id == 0 {
        let code = if table == Table::Log { Kind::U8.log() } else { Kind::U8.parameter() };
        return Some(TocItem { id, code, group: "own", name: "build" });
    }
    let place = usize::from(id) - usize::from(more);
    let (code, group, name) = match table {
        Table::Log => VARIABLES.get(place).map(|v| (v.kind.log(), v.group, v.name))?,
        Table::Parameters => {
            PARAMETERS.get(place).map(|p| (p.kind.parameter() | p.flags, p.group, p.name))?
        }
    };
    Some(TocItem { id, code, group, name })
}

/// What is answered about a table.
pub(super) fn info(table: Table, more: bool) -> TocAnswer<'static> {
    TocAnswer::Info {
        count: len(table, more) as u16,
        crc: checksum(table, more),
        limits: (table == Table::Log)
            .then_some([super::blocks::MOST_BLOCKS as u8, super::blocks::MOST_VARIABLES as u8]),
    }
}

/// What is answered about an item.
pub(super) fn tell(table: Table, id: u16, more: bool) -> TocAnswer<'static> {
    item(table, id, more).map_or(TocAnswer::NoItem, TocAnswer::Item)
}
