//! Time: a control loop that comes late or stands still, clocks that jump.

use super::condition::{Condition, Number, ROW, Watched};
use super::reaction::Reaction;
use crate::clock::{BACK_S, CONTROL_PERIOD_US};
use crate::out::voice::Severity;
use haltere_core::time::HostTime;

/// Steps over which the share of late ones is taken: half a second.
const WINDOW: f64 = 50.0;
/// Share of late steps that people are told of.
const LATE_SHARE: f64 = 0.3;
/// After a pause of the loop so long that something could have come meanwhile, s …
const DEAF_S: f64 = 0.05;
/// … what came is taken in within this time, s: the readers stood still as well and wake at the same moment.
const LISTEN_S: f64 = 0.05;
/// What happened once is shown as a condition for this long, s.
const SHOWN_S: f64 = 5.0;

/// How punctual the loop is.
#[derive(Debug, Default)]
pub(crate) struct Punctuality {
    late_share: f64,
    /// The end of the newest long pause, and its length, s.
    deaf: Option<(HostTime, f64)>,
    /// The longest pause in this flight, s, and the newest that was too long.
    gap_s: Option<f64>,
    /// By how much the host's clock went back in this flight, s.
    host_jump_s: Option<f64>,
    /// When the board's clock was last found elsewhere.
    board_jump_at: Option<HostTime>,
    board_restarts: u32,
}

impl Punctuality {
    /// A control step begins, so long after the last one.
    pub fn step(&mut self, at: HostTime, pause_s: f64, is_late: bool, longest_s: f64) {
        if pause_s > DEAF_S {
            self.deaf = Some((at, pause_s));
        }
        self.late_share += (f64::from(u8::from(is_late)) - self.late_share) / WINDOW;
        if pause_s > longest_s {
            self.gap_s = Some(self.gap_s.map_or(pause_s, |gap_s| gap_s.max(pause_s)));
        }
    }

    /// How much of a silence that is looked at now may be our own, s: right after the loop stood still what came
    /// meanwhile may wait to be read. Subtracted from the age, so that a loop which always pauses
    /// does not hide a silence.
    pub fn own_silence_s(&self, at: HostTime) -> f64 {
        self.deaf
            .filter(|(end, _)| at.seconds_since(*end) < LISTEN_S)
            .map_or(0.0, |(_, pause_s)| pause_s)
    }

    /// The board's clock was found elsewhere so often.
    pub fn board_clock(&mut self, at: HostTime, restarts: u32) {
        if std::mem::replace(&mut self.board_restarts, restarts) < restarts {
            self.board_jump_at = Some(at);
        }
    }

    /// The host's clock went back.
    pub fn host_clock_went_back(&mut self, by_s: f64) {
        self.host_jump_s = Some(by_s);
    }

    /// A flight begins: what was before does not count.
    pub fn begin_flight(&mut self) {
        self.gap_s = None;
        self.host_jump_s = None;
        self.board_jump_at = None;
    }
}

/// The loop stood still.
pub(super) const STUCK: Condition = Condition {
    name: "loop_stuck",
    seen_by: "Two control steps were farther apart than `supervisor.loop_gap_s`: the computer stood \
              still, or its clock jumped ahead.",
    numbers: &[Number {
        key: "supervisor.loop_gap_s",
        value: |c| c.supervisor.loop_gap_s,
        unit: "s",
        origin: "the generic board gives up 0.5 s after the last setpoint (docs/BOARDS.md)",
    }],
    latched: true,
    watched: Watched::Flight,
    wanted: |_| Reaction::Land,
    because: "control loop stood still",
    over: "",
    severity: Severity::Critical,
    is_seen: |sight| sight.flight.supervisor.punctuality.gap_s.is_some(),
    words: |sight| {
        let gap_s = sight.flight.supervisor.punctuality.gap_s.unwrap_or_default();
        format!("control loop stood still for {gap_s:.1} s")
    },
    ..ROW
};

/// The board flew by itself while we stood still.
pub(super) const PAUSED: Condition = Condition {
    name: "paused",
    seen_by: "The board may have heard no setpoint for longer than its own time-out (generic 0.5 s, px4 \
              `COM_OF_LOSS_T`, ardupilot `GUID_TIMEOUT`), because companion or computer stood still or the link was \
              out; the vehicle has sunk by itself meanwhile. It is over when UWB and IMU measured after the pause have \
              made a good estimate for 0.1 s. Until then no more than hover thrust is sent. Where the vehicle may \
              stand, thrust begins at 75 % of the base, which does not lift it off, and the floor is felt for at once.",
    numbers: &[Number {
        key: "",
        value: |_| 0.5,
        unit: "s",
        origin: "the generic board's (docs/BOARDS.md); a real firmware's is read from its parameter",
    }],
    gone_s: 0.0,
    wanted: |_| Reaction::Descend,
    because: "paused for longer than the board waits",
    over: "place and height are heard anew",
    severity: Severity::Critical,
    is_seen: |sight| sight.flight.resumption.pending_s().is_some(),
    words: |sight| {
        let pause_s = sight.flight.resumption.pending_s().unwrap_or_default();
        format!("board was alone for {pause_s:.1} s")
    },
    ..ROW
};

/// The loop comes late.
pub(super) const LATE: Condition = Condition {
    name: "loop_late",
    seen_by: "More than 30 % of the last 50 control steps began more than half a period late.",
    numbers: &[Number {
        key: "",
        value: |_| LATE_SHARE,
        unit: "",
        origin: "chosen: without real-time scheduling, both cores busy compiling, 1.5 % of 8016 steps were \
                 late, 27 % of the worst second \
                 (`haltere-sim demo --short --set timing.realtime=false`)",
    }],
    lasts_s: |_| 0.2,
    gone_s: 2.0,
    because: "control loop is late",
    over: "control loop is punctual again",
    severity: Severity::Warning,
    is_seen: |sight| sight.flight.supervisor.punctuality.late_share > LATE_SHARE,
    words: |sight| {
        format!(
            "control loop is late: {:.0} % of steps by over {} ms",
            sight.flight.supervisor.punctuality.late_share * 100.0,
            CONTROL_PERIOD_US / 2000
        )
    },
    ..ROW
};

/// The host's clock went back.
pub(super) const CLOCK: Condition = Condition {
    name: "clock_jumped",
    seen_by: "The computer's clock went back by more than 50 ms. Flight goes on by a clock that does not. \
              (A clock that leaps ahead is `loop_stuck`.)",
    numbers: &[Number {
        key: "",
        value: |_| BACK_S,
        unit: "s",
        origin: "chosen: five control periods; a clock that works never goes back",
    }],
    latched: true,
    wanted: |_| Reaction::Land,
    because: "the computer's clock jumped",
    over: "",
    severity: Severity::Critical,
    is_seen: |sight| sight.flight.supervisor.punctuality.host_jump_s.is_some(),
    words: |sight| {
        let by_s = sight.flight.supervisor.punctuality.host_jump_s.unwrap_or_default();
        format!("the computer's clock went back by {by_s:.2} s")
    },
    ..ROW
};

/// The board's clock is another.
pub(super) const BOARD_CLOCK: Condition = Condition {
    name: "board_clock_jumped",
    seen_by: "The board's clock was found elsewhere by more than 50 ms, by TIMESYNC. Samples are taken \
              at their time of arrival until it is known again.",
    numbers: &[Number {
        key: "",
        value: |_| BACK_S,
        unit: "s",
        origin: "chosen: eight times what round trips to real firmwares take (6.5 ms at 95 %); a clock that \
                 moved by 30 ms is followed",
    }],
    because: "the board's clock jumped",
    over: "",
    severity: Severity::Error,
    is_seen: |sight| {
        let jump = sight.flight.supervisor.punctuality.board_jump_at;
        jump.is_some_and(|t| sight.view.at.seconds_since(t) < SHOWN_S)
    },
    words: |_| "the board's clock jumped".to_owned(),
    ..ROW
};
