//! The variables that we log, in three blocks of at most 26 bytes.
//!
//! | block | period | holds |
//! |---|---|---|
//! | 0 | 10 ms | specific force, rates, battery |
//! | 1 | 10 ms | attitude, eight differences of distance, the supervisor's bits, two outputs |
//! | 2 | 100 ms | the setpoint in force, and what changes slowly |
//!
//! Ids change with every build: the names are looked up in the board's own table. Of the Flapper's outputs m2 and m4
//! are its motors (crazyflie-firmware 2a18fc29, `power_distribution_flapper.c`).

use haltere_dialect::crtp::log::{LogRow, MAX_VARIABLES, Variable, Variables};
use haltere_dialect::crtp::supervisor::SupervisorBits;
use haltere_dialect::crtp::toc::TocItem;
use haltere_dialect::crtp::value::Kind;

/// Of each block, ms.
pub(crate) const PERIODS_MS: [u16; 3] = [10, 10, 100];

struct Wanted(u8, &'static str, &'static str, Kind, bool);

const COUNT: usize = 27;

/// Block, group, name, type as it is sent, and whether nothing flies without it.
const WANTED: [Wanted; COUNT] = [
    Wanted(0, "acc", "x", Kind::F32, true),
    Wanted(0, "acc", "y", Kind::F32, true),
    Wanted(0, "acc", "z", Kind::F32, true),
    Wanted(0, "gyro", "x", Kind::F32, true),
    Wanted(0, "gyro", "y", Kind::F32, true),
    Wanted(0, "gyro", "z", Kind::F32, true),
    Wanted(0, "pm", "vbatMV", Kind::U16, false),
    Wanted(1, "stateEstimateZ", "quat", Kind::U32, true),
    Wanted(1, "tdoa2", "d7-0", Kind::F16, true),
    Wanted(1, "tdoa2", "d0-1", Kind::F16, true),
    Wanted(1, "tdoa2", "d1-2", Kind::F16, true),
    Wanted(1, "tdoa2", "d2-3", Kind::F16, true),
    Wanted(1, "tdoa2", "d3-4", Kind::F16, true),
    Wanted(1, "tdoa2", "d4-5", Kind::F16, true),
    Wanted(1, "tdoa2", "d5-6", Kind::F16, true),
    Wanted(1, "tdoa2", "d6-7", Kind::F16, true),
    Wanted(1, "supervisor", "info", Kind::U16, true),
    Wanted(1, "motor", "m2", Kind::U16, false),
    Wanted(1, "motor", "m4", Kind::U16, false),
    Wanted(2, "ctrltarget", "roll", Kind::F16, true),
    Wanted(2, "ctrltarget", "pitch", Kind::F16, true),
    Wanted(2, "controller", "yaw", Kind::F16, true),
    // Up to 65535, which half precision does not reach.
    Wanted(2, "stabilizer", "thrust", Kind::F32, true),
    Wanted(2, "deckStatus", "bcLoco", Kind::U8, false),
    Wanted(2, "crtp", "rxRate", Kind::U16, false),
    Wanted(2, "baro", "pressure", Kind::F32, false),
    Wanted(2, "loco", "mode", Kind::U8, false),
];

/// A row of one of them; what the firmware does not have is not a number.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Row {
    Imu {
        force_g: [f64; 3],
        rates_deg_ps: [f64; 3],
        battery_mv: f64,
    },
    State {
        attitude: u32,
        tdoa_m: [f64; 8],
        supervisor: SupervisorBits,
        /// Of 65535.
        outputs: [f64; 2],
    },
    Slow {
        /// Roll, pitch and yaw in force, degrees, and thrust, of 65535.
        setpoint: [f64; 4],
        deck: f64,
        /// Packets that the board hears in a second.
        heard_hz: f64,
        pressure_mbar: f64,
        /// 2 is TDoA2, 3 TDoA3.
        loco_mode: f64,
    },
}

/// Their ids, as far as the table has told them.
#[derive(Debug, Default)]
pub(crate) struct Ids([Option<u16>; COUNT]);

impl Ids {
    /// An item of the table of log variables.
    pub fn learn(&mut self, item: &TocItem<'_>) {
        let known = WANTED.iter().zip(&mut self.0);
        for (_, id) in known.filter(|(of, _)| (of.1, of.2) == (item.group, item.name)) {
            *id = Some(item.id);
        }
    }

    /// Group and name of those that the firmware does not have, and whether nothing flies without.
    pub fn missing(&self) -> impl Iterator<Item = (&'static str, &'static str, bool)> {
        let known = WANTED.iter().zip(&self.0);
        known.filter(|(_, id)| id.is_none()).map(|(of, _)| (of.1, of.2, of.4))
    }

    /// Those of a block's packet: the first makes it, the others add to it; none where there are no more.
    pub fn part(&self, block: u8, part: u8) -> Option<Variables> {
        let mut variables = Variables::default();
        for (of, id) in self.of(block).skip(usize::from(part) * MAX_VARIABLES).take(MAX_VARIABLES) {
            variables.push(Variable { id, kind: of.3 });
        }
        (!variables.as_slice().is_empty()).then_some(variables)
    }

    /// What a row holds; `None`: it is of no block of ours, or not as long as the block.
    pub fn read(&self, row: &LogRow<'_>) -> Option<Row> {
        let mut kinds = [Kind::U8; COUNT];
        let mut len = 0;
        for ((of, _), kind) in self.of(row.block).zip(&mut kinds) {
            *kind = of.3;
            len += 1;
        }
        let mut values = row.values(kinds.get(..len)?)?;
        let mut all = [f64::NAN; COUNT];
        let known = WANTED.iter().zip(&self.0).zip(&mut all);
        for (_, value) in known.filter(|((of, id), _)| of.0 == row.block && id.is_some()) {
            *value = values.next()?.f64();
        }
        let [ax, ay, az, gx, gy, gz, battery_mv, attitude, rest @ ..] = all;
        let [d0, d1, d2, d3, d4, d5, d6, d7, supervisor, m2, m4, rest @ ..] = rest;
        let [roll, pitch, yaw, thrust, deck, heard_hz, pressure_mbar, loco_mode] = rest;
        match row.block {
            0 => Some(Row::Imu { force_g: [ax, ay, az], rates_deg_ps: [gx, gy, gz], battery_mv }),
            1 => Some(Row::State {
                attitude: attitude as u32,
                tdoa_m: [d0, d1, d2, d3, d4, d5, d6, d7],
                supervisor: SupervisorBits::from_bits_retain(supervisor as u16),
                outputs: [m2, m4],
            }),
            2 => {
                let setpoint = [roll, pitch, yaw, thrust];
                Some(Row::Slow { setpoint, deck, heard_hz, pressure_mbar, loco_mode })
            }
            _ => None,
        }
    }

    /// The variables of a block that the firmware has, in the order of its rows.
    fn of(&self, block: u8) -> impl Iterator<Item = (&'static Wanted, u16)> {
        let known = WANTED.iter().zip(&self.0).filter(move |(of, _)| of.0 == block);
        known.filter_map(|(of, id)| Some((of, (*id)?)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use haltere_dialect::crtp::log::MAX_ROW;

    fn ids(without: &str) -> Ids {
        let mut ids = Ids::default();
        for (id, of) in (100..).zip(&WANTED).filter(|(_, of)| of.2 != without) {
            ids.learn(&TocItem { id, code: of.3.log(), group: of.1, name: of.2 });
        }
        ids
    }

    #[test]
    fn prop_each_block_fits_a_row() {
        for block in 0..3 {
            let widths = WANTED.iter().filter(|of| of.0 == block).map(|of| of.3.width());
            assert!(widths.sum::<usize>() <= MAX_ROW, "{block}");
        }
        let sizes = |block| {
            let ids = ids("");
            (0..3).map_while(|part| Some(ids.part(block, part)?.as_slice().len())).collect()
        };
        let all: [Vec<usize>; 3] = [0, 1, 2].map(sizes);
        assert_eq!(all, [vec![7], vec![9, 3], vec![8]]);
    }

    #[test]
    fn prop_a_name_that_is_missing_moves_no_other() {
        let ids = ids("vbatMV");
        assert_eq!(ids.missing().collect::<Vec<_>>(), [("pm", "vbatMV", false)]);
        let bytes: Vec<u8> = (1..=6).flat_map(|n| (n as f32).to_le_bytes()).collect();
        let row = LogRow { block: 0, time_ms: 7, bytes: &bytes };
        let Some(Row::Imu { force_g, rates_deg_ps, battery_mv }) = ids.read(&row) else { panic!() };
        assert_eq!((force_g, rates_deg_ps), ([1.0, 2.0, 3.0], [4.0, 5.0, 6.0]));
        assert!(battery_mv.is_nan());
        assert_eq!(ids.read(&LogRow { bytes: &bytes[1..], ..row }), None);
        assert_eq!(ids.read(&LogRow { block: 9, time_ms: 7, bytes: &[] }), None);
    }
}
