//! A flight whose replay by this build would have told the board something else: its modes and setpoints are
//! those that were recorded, everything that was measured and the estimate are those of the replay.

use haltere_core::frames::wrap_pi_rad;
use haltere_core::time::HostTime;
use haltere_core::topics::{ControlRecord, ModeRecord};
use haltere_log::record::{Decoded, Entry, FlightPart, LogReader, back};
use haltere_log::replay::{Setpoint, setpoint_of};
use haltere_pilot::Mode;

use crate::flight::trace::Trace;

/// Steps of one time are one step: half of the control period, s.
const SAME_STEP_S: f64 = 0.005;
/// A mode of a build that had others.
const UNKNOWN_MODE: &str = "unknown";

/// What a log says by itself.
#[derive(Debug, Default)]
pub(super) struct AsFlown {
    /// Empty in a log without decoded topics.
    modes: Vec<ModeRecord>,
    /// Likewise.
    controls: Vec<ControlRecord>,
    setpoints: Vec<Setpoint>,
}

impl AsFlown {
    pub fn of(log: &LogReader, part: &FlightPart) -> Self {
        let mut flown = Self::default();
        let mut part = part.clone();
        let entries = log.entries_with(|channel| matches!(channel, "/mode" | "/control"));
        for entry in entries.filter(|entry| part.holds(entry)) {
            match entry {
                Entry::Output { at, link, bytes, .. } => {
                    flown.setpoints.extend(setpoint_of(at, link, &bytes));
                }
                Entry::Decoded(Decoded::Control(m)) => {
                    flown.controls.push(back::control(&m));
                }
                Entry::Decoded(Decoded::Mode(m)) => flown.modes.push(ModeRecord {
                    at: HostTime::from_us(m.at_us),
                    mode: Mode::from_name(&m.mode).map_or(UNKNOWN_MODE, Mode::name),
                    armed: m.armed,
                    cause: m.cause,
                }),
                _ => {}
            }
        }
        flown
    }

    /// In place of what this build would have done.
    pub fn put_into(self, trace: &mut Trace) {
        let replayed_modes = trace.modes.clone();
        if !self.modes.is_empty() {
            trace.modes = self.modes;
        }
        if self.controls.is_empty() {
            trace.controls = from_setpoints(&self.setpoints, trace, &replayed_modes);
        } else {
            trace.controls = self.controls;
        }
    }
}

/// Control steps out of what went to the board. What did not go there, such as the place that was flown to, is that
/// of the replay, as long as it was in the mode that was flown.
fn from_setpoints(
    setpoints: &[Setpoint],
    trace: &Trace,
    replayed_modes: &[ModeRecord],
) -> Vec<ControlRecord> {
    let mut steps: Vec<ControlRecord> = Vec::with_capacity(setpoints.len());
    let mut north_rad = first_north_rad(trace);
    for setpoint in setpoints {
        let Some(since) = mode_at(&trace.modes, setpoint.at) else { continue };
        // The step within which the mode began was still one of the mode before.
        let is_idle = since.at == setpoint.at && setpoint.thrust_frac == 0.0;
        if is_idle || !Mode::from_name(since.mode).is_some_and(Mode::has_thrust) {
            continue;
        }
        let next =
            trace.controls.partition_point(|c| c.at.seconds_since(setpoint.at) < -SAME_STEP_S);
        let of_replay = trace
            .controls
            .get(next)
            .filter(|c| c.at.seconds_since(setpoint.at) <= SAME_STEP_S)
            .copied();
        let replayed_mode = mode_at(replayed_modes, setpoint.at).map(|m| m.mode);
        let same_mode = replayed_mode == Some(since.mode);
        let mut step = of_replay.filter(|_| same_mode).unwrap_or_default();
        if let Some(replayed) = of_replay {
            north_rad = replayed.yaw_board_offset_rad;
        }
        // While thrust rises the board is held level, and the record tells what the loops would have.
        if !(same_mode && since.mode == Mode::Spool.name() && of_replay.is_some()) {
            let [roll_rad, pitch_rad, yaw_rad] = setpoint.attitude.euler_rad();
            step.roll_rad = roll_rad;
            step.pitch_rad = pitch_rad;
            step.yaw_rad = wrap_pi_rad(yaw_rad + north_rad);
        }
        step.at = setpoint.at;
        step.yaw_board_offset_rad = north_rad;
        step.thrust_frac = setpoint.thrust_frac;
        steps.push(step);
    }
    steps
}

/// The mode in force at a time.
fn mode_at(modes: &[ModeRecord], at: HostTime) -> Option<&ModeRecord> {
    let next = modes.partition_point(|m| m.at <= at);
    modes.get(next.checked_sub(1)?)
}

/// Angle from room north to the board's north where no step of the replay tells it, rad: the difference of both
/// headings when the vehicle was armed.
fn first_north_rad(trace: &Trace) -> f64 {
    let armed = trace.modes.iter().find(|m| m.armed).map(|m| m.at);
    let at = armed.unwrap_or_default();
    let ours = trace.estimates.iter().find(|e| e.at >= at);
    let board = trace.attitudes.iter().find(|a| a.received_at >= at);
    match (ours, board) {
        (Some(ours), Some(board)) => wrap_pi_rad(ours.R_EB.yaw_rad() - board.attitude.yaw_rad()),
        _ => 0.0,
    }
}
