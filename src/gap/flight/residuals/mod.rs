//! Residuals: each block of the chain is given its logged inputs and compared with its logged
//! output. One file per channel; each writes its statistics to a [`Sheet`].

pub mod attitude;
pub mod battery;
pub mod bias;
pub mod force;
pub mod loops;
pub mod servos;
pub mod timing;
pub mod uwb;

use nalgebra::Vector3;

use crate::flight::smoother::{Gains, GridTdoa, Smoothed, grid_tdoa, smooth};
use crate::flight::timeline::{NotObservable, STEP_S, Timeline};
use crate::flight::trace::Trace;
use crate::nominal::{Nominal, RESPONSE_STEP_S};
use haltere_core::frames::G_MPS2;
use haltere_core::measure::AnchorId;
use haltere_model::effects::Block;

/// What a residual is of.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, serde::Serialize)]
#[allow(missing_docs)] // the names are the meaning
pub enum Channel {
    ForceX,
    ForceY,
    ForceZ,
    AttitudeRoll,
    AttitudePitch,
    Yaw,
    Gyro,
    Battery,
    Current,
    Uwb,
    Bias,
    North,
    Height,
    Timing,
    Loop,
}

/// What a statistic is.
#[derive(Debug, Clone)]
pub struct StatSpec {
    /// Name, unique.
    pub name: String,
    /// Block of the chain whose fault moves it most directly.
    pub block: Block,
    /// Channel that it is computed from.
    pub channel: Channel,
    /// Unit.
    pub unit: &'static str,
    /// In words.
    pub meaning: &'static str,
    /// Smallest difference that says anything about the vehicle, in the statistic's unit; zero: any.
    /// The simulator is exact to the last bit where a computer is not.
    pub resolution: f64,
    /// Says something beside accepted flights of the same vehicle only: laws and trims of its board, which no vehicle file
    /// knows.
    pub relative: bool,
}

/// Statistics as they are written: what they are and how large, in one list.
#[derive(Debug, Default)]
pub struct Sheet {
    /// What.
    pub specs: Vec<StatSpec>,
    /// How large; NaN: not visited.
    pub values: Vec<f64>,
}

impl Sheet {
    /// One statistic more.
    pub fn put(
        &mut self,
        (block, channel): (Block, Channel),
        name: impl Into<String>,
        unit: &'static str,
        meaning: &'static str,
        value: f64,
    ) {
        self.specs.push(StatSpec {
            name: name.into(),
            block,
            channel,
            unit,
            meaning,
            resolution: 0.0,
            relative: false,
        });
        self.values.push(if value.is_finite() { value } else { f64::NAN });
    }

    /// The statistic that was put last is [`StatSpec::relative`].
    pub fn relative(&mut self) {
        if let Some(spec) = self.specs.last_mut() {
            spec.relative = true;
        }
    }

    /// Resolution of the statistic that was put last.
    pub fn resolved_to(&mut self, resolution: f64) {
        if let Some(spec) = self.specs.last_mut() {
            spec.resolution = resolution;
        }
    }
}

/// A lag is known to this, s: what comes 100 times a second waits for the next step of a computer that steps as often, and how long is
/// decided for a whole flight when the two are started: anything within a step, 10 ms, of which this is the spread (`1/√12`). Where
/// the streams of a board are no such multiple, as our own's are not, the wait is the mean of all.
pub const LAG_KNOWN_S: f64 = 0.0029;

/// A flight with all that its residuals are computed from.
#[derive(Debug)]
pub struct Flight<'a> {
    /// The records.
    pub trace: &'a Trace,
    /// The nominal chain.
    pub nominal: &'a Nominal,
    /// On the grid.
    pub line: Timeline,
    /// By kinematics alone.
    pub states: Vec<Smoothed>,
    /// How the smoother answers to another measurement.
    pub gains: Gains,
    /// TDOA on the grid.
    pub tdoa: Vec<GridTdoa>,
    /// Anchors, ascending id, Earth, m.
    pub sites_E_m: Vec<Vector3<f64>>,
    /// Their ids.
    pub ids: Vec<AnchorId>,
    /// Flap rate that the nominal lag makes of logged throttle and voltage, Hz.
    pub flap_hz: Vec<f64>,
    /// Feet over the floor by the smoother, m.
    pub height_m: Vec<f64>,
    /// Velocity, body, m/s.
    pub vel_B_mps: Vec<Vector3<f64>>,
    /// Heading from room north, rad.
    pub yaw_rad: Vec<f64>,
    /// Nominal response to the logged attitude setpoints, rad.
    pub response_rad: Vec<[f64; 3]>,
    /// The same every 10 ms, per axis, and the measured attitude's place on it.
    pub fine_response_rad: [Vec<f64>; 3],
    /// In the air and clear of take-off and landing.
    pub clear: Vec<bool>,
}

/// Spans at the ends of a flight that are left out, s.
const MARGIN_S: f64 = 2.0;
/// Control steps in a step of the grid.
const FINE: usize = (STEP_S / RESPONSE_STEP_S + 0.5) as usize;

impl<'a> Flight<'a> {
    /// Resamples, smooths and predicts.
    pub fn new(trace: &'a Trace, nominal: &'a Nominal) -> Result<Self, NotObservable> {
        let line = Timeline::new(trace, nominal.until_s)?;
        let ids = trace.survey.ids().to_vec();
        let sites_E_m: Vec<_> =
            ids.iter().filter_map(|id| trace.survey.position_E_m(*id)).map(|p| p.raw()).collect();
        let tdoa = grid_tdoa(trace, &line);
        let gear_m = nominal.vehicle.body.gear_m;
        let (states, gains) = smooth(trace, &line, &tdoa, &sites_E_m, -gear_m);
        let height_m: Vec<f64> = states.iter().map(|s| -s.pos_E_m.z - gear_m).collect();
        let turn = |k: usize| {
            nalgebra::UnitQuaternion::from_axis_angle(&Vector3::z_axis(), states[k].north_rad)
                * line.board[k]
        };
        let vel_B_mps = (0..line.len()).map(|k| turn(k).inverse() * states[k].vel_E_mps).collect();
        let yaw_rad = (0..line.len()).map(|k| line.euler_rad[k][2] + states[k].north_rad).collect();
        let flap_hz = flap(trace, &line, nominal);
        let fine = fine_setpoints(trace, &line);
        let fine_response_rad: [Vec<f64>; 3] = std::array::from_fn(|axis| {
            nominal.response_rad(axis, &fine[axis], line.euler_rad[0][axis])
        });
        let response_rad = (0..line.len())
            .map(|k| {
                std::array::from_fn(|axis| {
                    let fine = &fine_response_rad[axis];
                    fine[(k * FINE).min(fine.len() - 1)]
                })
            })
            .collect();
        let margin = (MARGIN_S / STEP_S) as usize;
        let first = line.flying.iter().position(|f| *f).unwrap_or(0) + margin;
        let last = line.flying.iter().rposition(|f| *f).unwrap_or(0);
        let last = last.saturating_sub(margin);
        let clear = (0..line.len()).map(|k| k >= first && k <= last && line.flying[k]).collect();
        let flight = Self {
            trace,
            nominal,
            states,
            gains,
            tdoa,
            sites_E_m,
            ids,
            flap_hz,
            height_m,
            vel_B_mps,
            yaw_rad,
            response_rad,
            fine_response_rad,
            clear,
            line,
        };
        Ok(flight)
    }

    /// Number of points.
    pub fn len(&self) -> usize {
        self.line.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.line.is_empty()
    }

    /// Points in the air, clear of take-off and landing.
    pub fn clear_points(&self) -> impl Iterator<Item = usize> + Clone + '_ {
        (0..self.len()).filter(|k| self.clear[*k])
    }

    /// Nominal thrust per mass over g, ground effect not counted.
    pub fn thrust_ratio(&self, k: usize) -> f64 {
        self.nominal.thrust_n(self.flap_hz[k]) / (self.nominal.vehicle.body.mass_kg * G_MPS2)
    }

    /// Slow hover: little speed by the smoother.
    pub fn hovering(&self, k: usize) -> bool {
        self.clear[k] && self.states[k].vel_E_mps.norm() < 0.25
    }

    /// What a loop of another nominal chain leaves of the measured attitude, mean square about its mean, rad².
    pub fn left_by_loop(&self, nominal: &Nominal, axis: usize) -> f64 {
        let fine = &fine_setpoints(self.trace, &self.line)[axis];
        let response_rad = nominal.response_rad(axis, fine, self.line.euler_rad[0][axis]);
        let last = response_rad.len() - 1;
        let left = |k: usize| self.line.euler_rad[k][axis] - response_rad[(k * FINE).min(last)];
        let n = self.clear_points().count() as f64;
        let mean = self.clear_points().map(left).sum::<f64>() / n;
        self.clear_points().map(|k| (left(k) - mean).powi(2)).sum::<f64>() / n
    }

    /// Flap rate of a wing in hover, as the nominal drive makes it; `None`: there was none.
    pub fn hover_hz(&self) -> Option<f64> {
        let hover: Vec<usize> = (0..self.line.len()).filter(|k| self.hovering(*k)).collect();
        let sum: f64 = hover.iter().map(|k| self.flap_hz[*k]).sum();
        (!hover.is_empty()).then_some(sum / hover.len() as f64)
    }
}

/// Throttle times voltage through the nominal lag.
fn flap(trace: &Trace, line: &Timeline, nominal: &Nominal) -> Vec<f64> {
    let lag_s = nominal.vehicle.wings.flap_lag_s;
    let (mut flap_hz, mut k) = (0.0, 0);
    let mut out = Vec::with_capacity(line.len());
    let mut last = line.start;
    let mut target = 0.0;
    for c in &trace.controls {
        let dt = c.at.seconds_since(last).clamp(0.0, 1.0);
        flap_hz += (target - flap_hz) * (1.0 - (-dt / lag_s).exp());
        last = c.at;
        let now_s = c.at.seconds_since(line.start);
        while k < line.len() && line.t_s[k] <= now_s + 1e-9 {
            out.push(flap_hz);
            k += 1;
        }
        let at = line.place(c.at).map_or(line.len() - 1, |(k, _)| k);
        target = nominal.flap_target_hz(c.thrust_frac, line.supply_v[at]);
    }
    out.resize(line.len(), flap_hz);
    out
}

/// Setpoints as the board got them at the control period, yaw unwrapped.
fn fine_setpoints(trace: &Trace, line: &Timeline) -> [Vec<f64>; 3] {
    let n = line.len() * FINE;
    let mut out: [Vec<f64>; 3] = std::array::from_fn(|_| Vec::with_capacity(n));
    let mut i = 0;
    let mut yaw = line.euler_rad[0][2];
    for j in 0..n {
        let at_s = j as f64 * RESPONSE_STEP_S;
        while i + 1 < trace.controls.len()
            && trace.controls[i + 1].at.seconds_since(line.start) <= at_s + 1e-9
        {
            i += 1;
        }
        let c = &trace.controls[i];
        yaw += haltere_core::frames::wrap_pi_rad(c.yaw_rad - c.yaw_board_offset_rad - yaw);
        out[0].push(c.roll_rad);
        out[1].push(c.pitch_rad);
        out[2].push(yaw);
    }
    out
}
