//! The decoded topics of a log as tables: one table per topic, units in the names of the columns.
//!
//! Column `t_s` is the time since the companion started, the same that `haltere report` and
//! `haltere log trim` count; the columns `…_us` hold the clock of the log itself.

use std::borrow::Cow;

use crate::record::{Decoded, Entry, LogEnd, LogReader, pb};

/// One topic.
#[derive(Debug, Clone, PartialEq)]
pub struct Table {
    /// Name of the topic.
    pub name: String,
    /// Columns of equal length.
    pub columns: Vec<Column>,
}

/// One column.
#[derive(Debug, Clone, PartialEq)]
pub struct Column {
    /// Quantity, frame and unit.
    pub name: Cow<'static, str>,
    /// Its values, one a row.
    pub values: Values,
}

/// Values of a column.
#[derive(Debug, Clone, PartialEq)]
pub enum Values {
    /// Real numbers; what was not known or is not finite is absent.
    Real(Vec<Option<f64>>),
    /// Whole numbers.
    Whole(Vec<i64>),
    /// Yes or no.
    Flag(Vec<bool>),
    /// Words.
    Text(Vec<String>),
}

pub(super) enum Cell {
    Real(Option<f64>),
    Whole(i64),
    Flag(bool),
    Text(String),
}

impl Table {
    /// Rows.
    pub fn rows(&self) -> usize {
        self.columns.first().map_or(0, |column| match &column.values {
            Values::Real(v) => v.len(),
            Values::Whole(v) => v.len(),
            Values::Flag(v) => v.len(),
            Values::Text(v) => v.len(),
        })
    }

    /// Forgets the rows, not the columns.
    pub(super) fn clear(&mut self) {
        for column in &mut self.columns {
            match &mut column.values {
                Values::Real(v) => v.clear(),
                Values::Whole(v) => v.clear(),
                Values::Flag(v) => v.clear(),
                Values::Text(v) => v.clear(),
            }
        }
    }

    pub(super) fn push(&mut self, row: Row) {
        if self.columns.is_empty() {
            let begin = |(name, cell): &(&'static str, Cell)| Column {
                name: Cow::Borrowed(name),
                values: match cell {
                    Cell::Real(_) => Values::Real(Vec::new()),
                    Cell::Whole(_) => Values::Whole(Vec::new()),
                    Cell::Flag(_) => Values::Flag(Vec::new()),
                    Cell::Text(_) => Values::Text(Vec::new()),
                },
            };
            self.columns = row.iter().map(begin).collect();
        }
        // All rows of a topic come from one arm of `cells`: same columns, same kinds.
        for (column, (_, cell)) in self.columns.iter_mut().zip(row) {
            match (&mut column.values, cell) {
                (Values::Real(v), Cell::Real(x)) => v.push(x.filter(|x| x.is_finite())),
                (Values::Whole(v), Cell::Whole(x)) => v.push(x),
                (Values::Flag(v), Cell::Flag(x)) => v.push(x),
                (Values::Text(v), Cell::Text(x)) => v.push(x),
                _ => {}
            }
        }
    }
}

/// Hands out every row of the decoded topics of a log, in its order, with the name of its table. Says how the log
/// ends.
pub(super) fn rows<E>(
    log: &LogReader,
    mut take: impl FnMut(&'static str, Row) -> Result<(), E>,
) -> Result<LogEnd, E> {
    let start_us = log.session().pilot_started_at.as_us();
    // Divided, so that six decimals print as six decimals.
    let t_s = |us: u64| (us as f64 - start_us as f64) / 1e6;
    let mut add = |name: &'static str, at_us: u64, rest: Row| {
        let mut row = vec![("t_s", real(t_s(at_us)))];
        row.extend(rest);
        take(name, row)
    };
    let mut entries = log.entries();
    for entry in entries.by_ref() {
        let Entry::Decoded(decoded) = entry else { continue };
        let at_us = decoded.at().as_us();
        if let Decoded::Health(health) = &decoded {
            for drop in &health.drops {
                let row = vec![
                    ("at_us", whole(at_us)),
                    ("link", whole(u64::from(drop.link))),
                    ("reason", Cell::Text(drop.reason.clone())),
                    ("count", whole(drop.count)),
                ];
                add("drops", at_us, row)?;
            }
        }
        if let Decoded::Servos(servos) = &decoded {
            for (n, value) in (1..).zip(&servos.output) {
                let row = vec![
                    ("received_at_us", whole(at_us)),
                    ("port", whole(u64::from(servos.port))),
                    ("output", whole(n)),
                    ("told", real(f64::from(*value))),
                ];
                add("servos", at_us, row)?;
            }
            continue;
        }
        add(decoded.channel().trim_start_matches('/'), at_us, cells(&decoded))?;
    }
    Ok(entries.end())
}

pub(super) type Row = Vec<(&'static str, Cell)>;

fn real(value: f64) -> Cell {
    Cell::Real(Some(value))
}

fn whole(value: u64) -> Cell {
    Cell::Whole(i64::try_from(value).unwrap_or(i64::MAX))
}

fn xyz(row: &mut Row, names: [&'static str; 3], v: Option<pb::Vec3>) {
    let values = v.map_or([None; 3], |v| [v.x, v.y, v.z].map(Some));
    row.extend(names.into_iter().zip(values.map(Cell::Real)));
}

fn wxyz(row: &mut Row, names: [&'static str; 4], q: Option<pb::Quaternion>) {
    let values = q.map_or([None; 4], |q| [q.w, q.x, q.y, q.z].map(Some));
    row.extend(names.into_iter().zip(values.map(Cell::Real)));
}

/// One row of a topic, by hand: the names are what people's scripts rely on.
#[rustfmt::skip]
fn cells(decoded: &Decoded) -> Row {
    let mut row = Row::new();
    match decoded {
        Decoded::Imu(m) => {
            row.extend([("valid_at_us", whole(m.valid_at_us)), ("received_at_us", whole(m.received_at_us))]);
            xyz(&mut row, ["acc_B_x_mps2", "acc_B_y_mps2", "acc_B_z_mps2"], m.acc_b_mps2);
            xyz(&mut row, ["rate_B_x_radps", "rate_B_y_radps", "rate_B_z_radps"], m.rate_b_radps);
        }
        Decoded::Uwb(m) => row.extend([
            ("valid_at_us", whole(m.valid_at_us)),
            ("received_at_us", whole(m.received_at_us)),
            ("anchor_a", whole(u64::from(m.anchor_a))),
            ("anchor_b", whole(u64::from(m.anchor_b))),
            ("distance_diff_m", real(m.distance_diff_m)),
            ("std_m", Cell::Real(m.std_m)),
            ("innovation_m", real(m.innovation_m)),
            ("var_innovation_m2", real(m.var_innovation_m2)),
            ("test_ratio", real(m.test_ratio)),
            ("fused", Cell::Flag(m.fused)),
        ]),
        Decoded::Estimate(m) => {
            row.push(("at_us", whole(m.at_us)));
            xyz(&mut row, ["pos_E_x_m", "pos_E_y_m", "pos_E_z_m"], m.pos_e_m);
            xyz(&mut row, ["vel_E_x_mps", "vel_E_y_mps", "vel_E_z_mps"], m.vel_e_mps);
            xyz(&mut row, ["vel_B_x_mps", "vel_B_y_mps", "vel_B_z_mps"], m.vel_b_mps);
            wxyz(&mut row, ["q_EB_w", "q_EB_x", "q_EB_y", "q_EB_z"], m.q_eb);
            row.extend([("roll_rad", real(m.roll_rad)), ("pitch_rad", real(m.pitch_rad)), ("yaw_rad", real(m.yaw_rad))]);
            xyz(&mut row, ["rate_B_x_radps", "rate_B_y_radps", "rate_B_z_radps"], m.rate_b_radps);
            xyz(&mut row, ["std_pos_E_x_m", "std_pos_E_y_m", "std_pos_E_z_m"], m.std_pos_e_m);
            xyz(&mut row, ["std_vel_B_x_mps", "std_vel_B_y_mps", "std_vel_B_z_mps"], m.std_vel_b_mps);
            xyz(&mut row, ["std_att_B_x_rad", "std_att_B_y_rad", "std_att_B_z_rad"], m.std_att_b_rad);
            row.push(("uwb_noise_factor", real(m.uwb_noise_factor)));
            row.push(("health", Cell::Text(m.health().as_str_name().to_lowercase())));
        }
        Decoded::Control(m) => {
            row.extend([
                ("at_us", whole(m.at_us)),
                ("pos_setpoint_E_x_m", Cell::Real(m.pos_setpoint_north_m)),
                ("pos_setpoint_E_y_m", Cell::Real(m.pos_setpoint_east_m)),
                ("pos_setpoint_E_z_m", Cell::Real(m.pos_setpoint_down_m)),
            ]);
            xyz(&mut row, ["vel_setpoint_E_x_mps", "vel_setpoint_E_y_mps", "vel_setpoint_E_z_mps"], m.vel_setpoint_e_mps);
            row.extend([
                ("roll_rad", real(m.roll_rad)),
                ("pitch_rad", real(m.pitch_rad)),
                ("yaw_rad", real(m.yaw_rad)),
                ("roll_ff_rad", real(m.roll_ff_rad)),
                ("pitch_ff_rad", real(m.pitch_ff_rad)),
                ("thrust_frac", real(m.thrust_frac)),
                ("thrust_base_frac", real(m.thrust_base_frac)),
                ("thrust_feedback_frac", real(m.thrust_feedback_frac)),
                ("ground_factor", real(m.ground_factor)),
                ("tilt_factor", Cell::Real(m.tilt_factor)),
                ("yaw_board_offset_rad", real(m.yaw_board_offset_rad)),
                ("velocity_cut", Cell::Flag(m.velocity_cut)),
                ("tilt_cut", Cell::Flag(m.tilt_cut)),
                ("thrust_cut_high", Cell::Flag(m.thrust_cut_high)),
                ("thrust_cut_low", Cell::Flag(m.thrust_cut_low)),
            ]);
        }
        Decoded::Shadow(m) => {
            row.push(("at_us", whole(m.at_us)));
            wxyz(&mut row, ["q_board_w", "q_board_x", "q_board_y", "q_board_z"], m.q_board);
            row.extend([
                ("roll_rad", real(m.roll_rad)),
                ("pitch_rad", real(m.pitch_rad)),
                ("yaw_rad", real(m.yaw_rad)),
                ("thrust_frac", real(m.thrust_frac)),
            ]);
            xyz(&mut row, ["place_E_x_m", "place_E_y_m", "place_E_z_m"], m.place_e_m);
            row.extend([
                ("theirs_roll_rad", Cell::Real(m.theirs_roll_rad)),
                ("theirs_pitch_rad", Cell::Real(m.theirs_pitch_rad)),
                ("theirs_yaw_rad", Cell::Real(m.theirs_yaw_rad)),
                ("theirs_thrust_frac", Cell::Real(m.theirs_thrust_frac)),
            ]);
        }
        Decoded::Battery(m) => row.extend([
            ("received_at_us", whole(m.received_at_us)),
            ("supply_v", real(m.supply_v)),
            ("current_a", Cell::Real(m.current_a)),
            ("remaining_frac", Cell::Real(m.remaining_frac)),
        ]),
        Decoded::OtherBattery(m) => row.extend([
            ("received_at_us", whole(m.received_at_us)),
            ("id", whole(u64::from(m.id))),
            ("function", whole(u64::from(m.function))),
            ("supply_v", real(m.supply_v)),
            ("current_a", Cell::Real(m.current_a)),
            ("remaining_frac", Cell::Real(m.remaining_frac)),
        ]),
        // A row for each output: boards differ in their number.
        Decoded::Servos(_) => {}
        Decoded::BoardAttitude(m) => {
            row.extend([("valid_at_us", whole(m.valid_at_us)), ("received_at_us", whole(m.received_at_us))]);
            wxyz(&mut row, ["q_board_w", "q_board_x", "q_board_y", "q_board_z"], m.q_board);
            row.extend([("roll_rad", real(m.roll_rad)), ("pitch_rad", real(m.pitch_rad)), ("yaw_rad", real(m.yaw_rad))]);
        }
        Decoded::Baro(m) => row.extend([
            ("valid_at_us", whole(m.valid_at_us)),
            ("received_at_us", whole(m.received_at_us)),
            ("pressure_pa", real(m.pressure_pa)),
        ]),
        Decoded::Mag(m) => {
            row.extend([("valid_at_us", whole(m.valid_at_us)), ("received_at_us", whole(m.received_at_us))]);
            xyz(&mut row, ["field_B_x_tesla", "field_B_y_tesla", "field_B_z_tesla"], m.field_b_tesla);
        }
        Decoded::Reference(m) => {
            row.extend([("valid_at_us", whole(m.valid_at_us)), ("received_at_us", whole(m.received_at_us))]);
            xyz(&mut row, ["pos_E_x_m", "pos_E_y_m", "pos_E_z_m"], m.pos_e_m);
            wxyz(&mut row, ["q_EB_w", "q_EB_x", "q_EB_y", "q_EB_z"], m.q_eb);
        }
        Decoded::Mode(m) => row.extend([
            ("at_us", whole(m.at_us)),
            ("mode", Cell::Text(m.mode.clone())),
            ("armed", Cell::Flag(m.armed)),
            ("cause", Cell::Text(m.cause.clone())),
        ]),
        Decoded::Text(m) => row.extend([
            ("at_us", whole(m.at_us)),
            ("severity", whole(u64::from(m.severity))),
            ("text", Cell::Text(m.text.clone())),
        ]),
        Decoded::Health(m) => row.extend([
            ("at_us", whole(m.at_us)),
            ("deadline_misses", whole(m.deadline_misses)),
            ("control_steps", whole(m.control_steps)),
            ("uwb_age_s", Cell::Real(m.uwb_age_s)),
            ("imu_age_s", Cell::Real(m.imu_age_s)),
            ("std_board_clock_s", Cell::Real(m.std_board_clock_s)),
            ("left_out", whole(u64::from(m.left_out))),
        ]),
        Decoded::Glue(m) => row.extend([
            ("at_us", whole(m.at_us)),
            ("wake_ups", whole(m.wake_ups)),
            ("late_wake_ups", whole(m.late_wake_ups)),
            ("worst_lateness_s", real(m.worst_lateness_s)),
        ]),
    }
    row
}
