//! One flight as columns: the decoded topics of a log, sorted into what the plots and tables need.

use std::collections::BTreeMap;

use crate::report::svg::Limit;
use crate::report::truth::{TruthRow, interpolate};
use haltere_core::drops::Drops;
use haltere_core::estimate::Estimate;
use haltere_core::frames::{E, Vec3};
use haltere_core::measure::{
    AnchorId, BatterySample, BoardAttitude, ImuSample, OtherBattery, ReferencePose, ServoOutput,
};
use haltere_core::survey::Survey;
use haltere_core::time::HostTime;
use haltere_core::topics::{ControlRecord, HealthRecord, TextRecord, UwbRecord};
use haltere_log::record::is_on_floor;
use haltere_pilot::Mode;

/// Between two poses of motion capture further apart than this there is none, s.
const REFERENCE_GAP_S: f64 = 0.2;

/// A flight in memory.
#[derive(Debug, Clone, Default)]
pub struct Flight {
    /// Filter states, one a control step.
    pub estimates: Vec<Estimate>,
    /// Control steps.
    pub controls: Vec<ControlRecord>,
    /// TDOA measurements and their fate.
    pub uwb: Vec<UwbRecord>,
    /// Inertial measurements as used.
    pub imu: Vec<ImuSample>,
    /// Battery.
    pub battery: Vec<BatterySample>,
    /// Batteries that were not flown on.
    pub other_batteries: Vec<OtherBattery>,
    /// What the board told motors and servos.
    pub servos: Vec<ServoOutput>,
    /// The board's own attitude.
    pub board_attitudes: Vec<BoardAttitude>,
    /// Motion capture.
    pub references: Vec<ReferencePose>,
    /// Changes of mode.
    pub modes: Vec<ModeRow>,
    /// Mission items that were told as reached, as the wire counts them: from 0.
    pub reached: Vec<(HostTime, u16)>,
    /// How many items the mission has, where that changed.
    pub mission_items: Vec<(HostTime, u16)>,
    /// Texts.
    pub texts: Vec<TextRecord>,
    /// Losses and timing, once a second.
    pub health: Vec<HealthRecord>,
    /// Lateness of the glue, once a second.
    pub glue: Vec<GlueRow>,
    /// Truth of a simulated flight.
    pub truth: Vec<TruthRow>,
    /// Anchors.
    pub survey: Option<Survey>,
    /// When the companion started: the nought of every time axis. `None`: the first record.
    pub started: Option<HostTime>,
    /// Wake-ups of the core.
    pub wakes: Vec<HostTime>,
    /// Base thrust at the nominal voltage, 0 to 1.
    pub base_nominal_frac: Option<f64>,
    /// Voltages at which something happens.
    pub battery_limits: Vec<Limit>,
    /// What to know first: name and value.
    pub facts: Vec<(String, String)>,
    /// Keys of the configuration that differ from the defaults: key, value, default.
    pub configuration: Vec<[String; 3]>,
    /// Parameters that stations changed.
    pub parameters: Vec<ParameterRow>,
}

/// A parameter that a station changed.
#[derive(Debug, Clone, PartialEq)]
pub struct ParameterRow {
    /// When.
    pub at: HostTime,
    /// Its name.
    pub name: String,
    /// Value before, where it is known.
    pub from: Option<f64>,
    /// Value since then.
    pub to: f64,
    /// Unit; empty: none.
    pub unit: String,
}

impl Flight {
    /// First and last time of anything the pilot told.
    pub fn ends(&self) -> Option<(HostTime, HostTime)> {
        let times = [
            self.estimates.first().map(|e| e.at),
            self.controls.first().map(|c| c.at),
            self.health.first().map(|h| h.at),
            self.estimates.last().map(|e| e.at),
            self.controls.last().map(|c| c.at),
            self.health.last().map(|h| h.at),
        ];
        let known = || times.iter().flatten().copied();
        Some((known().min()?, known().max()?))
    }

    /// Changes of mode of what was flown last, the disarming included. Empty: it never left the floor.
    pub fn last_flown(&self) -> &[ModeRow] {
        let flights = self.modes.split_inclusive(|row| row.mode == Mode::Disarmed.name());
        let mut flown = flights.filter(|rows| rows.iter().any(|row| !is_on_floor(&row.mode)));
        flown.next_back().unwrap_or_default()
    }

    /// Each mode of what was flown last, with its begin and end.
    pub fn flown_modes(&self) -> impl Iterator<Item = (Mode, HostTime, HostTime)> {
        let (rows, end) =
            (self.last_flown(), self.ends().map_or(HostTime::default(), |ends| ends.1));
        rows.iter().enumerate().filter_map(move |(i, row)| {
            let to = rows.get(i + 1).map_or(end.max(row.at), |next| next.at);
            Some((Mode::from_name(&row.mode)?, row.at, to))
        })
    }

    /// Position and, where it is told, velocity by the simulator's truth, else by motion capture.
    pub fn truth_at(&self, at: HostTime) -> Option<(Vec3<E>, Option<Vec3<E>>)> {
        if !self.truth.is_empty() {
            return interpolate(&self.truth, at).map(|row| (row.pos_E_m, Some(row.vel_E_mps)));
        }
        let after = self.references.partition_point(|r| r.valid_at < at);
        let b = self.references.get(after)?;
        let a = self.references.get(after.checked_sub(1)?)?;
        let span_s = b.valid_at.seconds_since(a.valid_at);
        let share = at.seconds_since(a.valid_at) / span_s;
        (span_s > 0.0 && span_s < REFERENCE_GAP_S)
            .then(|| (a.pos_E_m + (b.pos_E_m - a.pos_E_m) * share, None))
    }

    /// Batteries that were not flown on: id, least and greatest voltage, V.
    pub fn other_packs(&self) -> BTreeMap<u8, [f64; 2]> {
        let mut packs: BTreeMap<u8, [f64; 2]> = BTreeMap::new();
        for other in &self.other_batteries {
            let v = other.sample.supply_v;
            let span = packs.entry(other.id).or_insert([v, v]);
            *span = [span[0].min(v), span[1].max(v)];
        }
        packs
    }

    /// Outputs of the board by port and number, both as the board counts them (outputs from 1): what each was told.
    pub fn outputs(&self) -> BTreeMap<(u8, usize), Vec<(HostTime, f32)>> {
        let mut all: BTreeMap<_, Vec<_>> = BTreeMap::new();
        for servos in &self.servos {
            for (n, value) in (1..).zip(servos.outputs()).filter(|(_, value)| value.is_finite()) {
                all.entry((servos.port, n)).or_default().push((servos.received_at, *value));
            }
        }
        all
    }

    /// Losses at the end of the log, all links together.
    pub fn drops(&self) -> Drops {
        let mut all = Drops::default();
        for (_, drops) in self.health.last().iter().flat_map(|last| last.drops.iter()) {
            all.merge(drops);
        }
        all
    }

    /// Measurements that the filter had an opinion on: not those from before it was first aligned, which
    /// are neither fused nor rejected.
    pub fn judged(&self) -> impl Iterator<Item = &UwbRecord> {
        let aligned = self.uwb.iter().position(|r| r.fused || r.var_innovation_m2 > 0.0);
        self.uwb.iter().skip(aligned.unwrap_or(self.uwb.len()))
    }

    /// Measurements by anchor pair, the smaller id first.
    pub fn pairs(&self) -> BTreeMap<(AnchorId, AnchorId), PairStats> {
        let mut pairs: BTreeMap<_, PairStats> = BTreeMap::new();
        for record in self.judged() {
            let (a, b) = (record.tdoa.anchor_a, record.tdoa.anchor_b);
            let (key, sign) = if a <= b { ((a, b), 1.0) } else { ((b, a), -1.0) };
            pairs.entry(key).or_default().add(record, sign);
        }
        pairs
    }
}

/// A change of mode, as in the log.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ModeRow {
    /// When.
    pub at: HostTime,
    /// Name of the mode that is now in force.
    pub mode: String,
    /// Whether the board reports armed.
    pub armed: bool,
    /// Why.
    pub cause: String,
}

/// How late the wake-ups of the core were since start.
#[derive(Debug, Clone, PartialEq)]
pub struct GlueRow {
    /// When.
    pub at: HostTime,
    /// Wake-ups of the core.
    pub wake_ups: u64,
    /// Of these, how many came late.
    pub late_wake_ups: u64,
    /// Worst lateness, s.
    pub worst_lateness_s: f64,
}

/// What became of the measurements of one pair of anchors.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct PairStats {
    /// Fused.
    pub fused: u32,
    /// Rejected by the gate.
    pub rejected: u32,
    sum_m: f64,
    sum_squares_m2: f64,
    /// Sum of squared innovations over their variance; its mean is 1 for a consistent filter.
    sum_normalised: f64,
}

impl PairStats {
    fn add(&mut self, record: &UwbRecord, sign: f64) {
        if !record.fused {
            self.rejected += 1;
            return;
        }
        let innovation_m = sign * record.innovation_m;
        if !innovation_m.is_finite() || record.var_innovation_m2 <= 0.0 {
            return;
        }
        self.fused += 1;
        self.sum_m += innovation_m;
        self.sum_squares_m2 += innovation_m * innovation_m;
        self.sum_normalised += innovation_m * innovation_m / record.var_innovation_m2;
    }

    /// Mean innovation of the fused measurements, m.
    pub fn mean_m(&self) -> Option<f64> {
        (self.fused > 0).then(|| self.sum_m / f64::from(self.fused))
    }

    /// Standard deviation of the fused innovations, m.
    pub fn std_m(&self) -> Option<f64> {
        let mean_m = self.mean_m()?;
        Some((self.sum_squares_m2 / f64::from(self.fused) - mean_m * mean_m).max(0.0).sqrt())
    }

    /// Mean of squared innovation over its variance.
    pub fn mean_normalised(&self) -> Option<f64> {
        (self.fused > 0).then(|| self.sum_normalised / f64::from(self.fused))
    }
}
