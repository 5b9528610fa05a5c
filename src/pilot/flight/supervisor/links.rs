//! Links and who is at their ends: board, stations, clients, pilots.

use super::condition::{Condition, Number, ROW, Watched};
use super::reaction::Reaction;
use crate::board::link::lateness::LATE_S;
use crate::flight::Flight;
use crate::flight::modes::Mode;
use crate::out::voice::Severity;
use crate::view::Sight;
use haltere_core::time::HostTime;

/// A station that was heard so long before the motors turned belongs to the flight, s.
const STATION_BEFORE_S: f64 = 10.0;
/// Deflection of a stick that is an order, as a share: a fifth is what a jolt does.
const STICK_SHARE: f64 = 0.3;
/// Sticks older than this order nothing, s.
const STICK_AGE_S: f64 = 0.5;

/// Who was heard, and when.
#[derive(Debug, Default)]
pub(crate) struct Heard {
    /// Longest silence of the board in this flight, s, once it was over.
    pub board_gap_s: Option<f64>,
    /// Newest heartbeat of any station.
    pub station_at: Option<HostTime>,
    /// When the motors began to turn.
    pub flight_at: Option<HostTime>,
    /// Largest deflection of the joystick's centred axes, and when.
    pub sticks: Option<(f64, HostTime)>,
}

impl Flight {
    /// Silence of the stations, s; 0 where none takes part.
    fn stations_silent_s(&self, at: HostTime) -> f64 {
        let heard = &self.supervisor.heard;
        match (heard.station_at, heard.flight_at) {
            (Some(beat), Some(flight)) if flight.seconds_since(beat) < STATION_BEFORE_S => {
                at.seconds_since(beat)
            }
            _ => 0.0,
        }
    }
}

impl Sight<'_> {
    fn board_silent_s(&self) -> f64 {
        let own_s = self.flight.supervisor.punctuality.own_silence_s(self.view.at);
        (self.board.link.silence_s(self.view.at).unwrap_or(0.0) - own_s).max(0.0)
    }

    fn follower_is_silent(&self, manual: bool) -> bool {
        let guidance = &self.flight.guidance;
        let own_s = self.flight.supervisor.punctuality.own_silence_s(self.view.at);
        let followed = if manual { &guidance.sticks } else { &guidance.setpoint };
        followed.as_ref().is_none_or(|s| {
            self.view.at.seconds_since(s.received_at) - own_s
                > self.view.config.limits.offboard_loss_s
                && (manual || s.needs_stream())
        })
    }
}

const FOLLOWING: Number = Number {
    key: "limits.offboard_loss_s",
    value: |c| c.limits.offboard_loss_s,
    unit: "s",
    origin: "as PX4's COM_OF_LOSS_T, halved: a room is small",
};

/// The board left our mode.
pub(super) const CONTROL: Condition = Condition {
    name: "control_lost",
    seen_by: "The board's heartbeat shows another mode than ours for longer than its grace \
              (docs/BOARDS.md): a pilot's remote control or a failsafe of the board has taken over.",
    watched: Watched::Armed,
    gone_s: 0.0,
    wanted: |_| Reaction::Yield,
    because: "board flies in a mode of its own",
    over: "board is in our mode again",
    severity: Severity::Critical,
    is_seen: |sight| sight.board.link.has_lost_control(),
    words: |sight| {
        let ours = sight.board.link.firmware().control_mode().map_or("", |m| m.name);
        format!("board left {ours} for {}", sight.board.link.mode_name())
    },
    ..ROW
};

/// Nothing comes from the board.
pub(super) const BOARD: Condition = Condition {
    name: "board_silent",
    seen_by: "Nothing came from the board for `limits.board_loss_s`.",
    numbers: &[Number {
        key: "limits.board_loss_s",
        value: |c| c.limits.board_loss_s,
        unit: "s",
        origin: "a heartbeat's interval; IMU samples come 250 times as often",
    }],
    watched: Watched::Always,
    wanted: |_| Reaction::Descend,
    because: "board is silent",
    over: "board speaks again",
    severity: Severity::Critical,
    is_seen: |sight| sight.board_silent_s() >= sight.view.config.limits.board_loss_s,
    words: |sight| format!("board silent for {:.1} s", sight.board_silent_s()),
    ..ROW
};

/// Lag of the attitude behind its setpoints that no loop stands, s.
pub(crate) const RESPONSE_MOST_S: f64 = 0.48;

/// What comes from the board is old, or what is sent to it arrives late.
pub(super) const BOARD_LATE: Condition = Condition {
    name: "board_late",
    seen_by: "The link to the board takes more than 0.1 s there and back: by three round trips of TIMESYNC in \
              a row, or by the stamps of all its samples for 0.15 s, whichever comes first. Over when a round \
              trip takes less than 60 ms and no sample is old, for a second. The descent goes by nothing that \
              is faster than the link, and the floor is felt for the slower the later it is.",
    numbers: &[Number {
        key: "",
        value: |_| LATE_S,
        unit: "s",
        origin: "two thirds of what the loops can stand beyond their own lag (0.15 s, `control::margins`); \
                 healthy links answer within 25 ms, one whose setpoints take 80 ms within 87",
    }],
    gone_s: 1.0,
    wanted: |_| Reaction::Descend,
    because: "link to the board is late",
    over: "link to the board is prompt again",
    severity: Severity::Critical,
    is_seen: |sight| sight.board.link.lateness().is_late(),
    words: |sight| {
        let latency_ms = sight.board.link.lateness().latency_s() * 1e3;
        format!("link to the board is late: {latency_ms:.0} ms")
    },
    ..ROW
};

/// The vehicle follows what it was asked for too late for the loops.
pub(super) const RESPONSE: Condition = Condition {
    name: "response_late",
    seen_by: "The board's attitude shows the tilts that were asked for later than 0.48 s after they were sent, where \
              they move by 4 deg and more (one sigma) and explain 60 % of what is seen: the board obeys late, or \
              setpoints wait where TIMESYNC does not. The delay that explains most counts, whatever the size of the \
              answer. Tilts asked for before the vehicle has leaned by 2 deg from how it stood do not count: the floor \
              holds it.",
    numbers: &[Number {
        key: "",
        value: |_| RESPONSE_MOST_S,
        unit: "s",
        origin: "in steps at full speed a loop of 0.6 of its speed shows 0.46 s and flies, a board that obeys \
                 0.25 s late shows 0.5 s and does not (`src/model/lockstep/tests/late.rs`); nominal 0.2 s",
    }],
    lasts_s: |_| 0.2,
    latched: true,
    watched: Watched::Air,
    wanted: |_| Reaction::Descend,
    because: "the vehicle follows its setpoints too late",
    over: "",
    severity: Severity::Critical,
    is_seen: |sight| sight.board.link.response_lag_s().is_some_and(|s| s > RESPONSE_MOST_S),
    words: |sight| {
        let lag_ms = sight.board.link.response_lag_s().unwrap_or_default() * 1e3;
        format!("attitude follows its setpoints after {lag_ms:.0} ms")
    },
    ..ROW
};

/// Nothing came from the board for a while.
pub(super) const BOARD_GAP: Condition = Condition {
    name: "board_was_silent",
    seen_by: "The board was silent for more than `limits.board_loss_s` and speaks again. What became \
              of our setpoints meanwhile nobody knows.",
    numbers: &[Number {
        key: "limits.board_loss_s",
        value: |c| c.limits.board_loss_s,
        unit: "s",
        origin: "as for board_silent",
    }],
    latched: true,
    wanted: |_| Reaction::Land,
    because: "board was silent",
    over: "",
    severity: Severity::Error,
    is_seen: |sight| sight.flight.supervisor.heard.board_gap_s.is_some(),
    words: |sight| {
        let silent_s = sight.flight.supervisor.heard.board_gap_s.unwrap_or_default();
        format!("board was silent for {silent_s:.1} s")
    },
    ..ROW
};

/// Two boards with one number on one port.
pub(super) const SECOND: Condition = Condition {
    name: "second_board",
    seen_by: "A board with the system id of ours speaks on the same link: from another UDP address, while ours speaks \
              from its own or has been silent for 3 s, or on the same line, which the numbers of the frames show. It is \
              not heard; at another address nothing is sent to it. When our board is \
              silent for 0.3 s at its address and its time since boot (SYSTEM_TIME, `time_boot_ms`) goes on at another \
              one within 0.25 s, it is the same board behind a router that changed its port: it is followed there, and \
              that is told.",
    watched: Watched::Always,
    because: "a second board speaks",
    over: "the second board is silent",
    severity: Severity::Critical,
    is_seen: |sight| sight.board.second(sight.view.at).is_some(),
    words: |sight| {
        let what = sight.board.second(sight.view.at).unwrap_or_default();
        format!("{what}: it is not heard")
    },
    ..ROW
};

/// The board does not fly our setpoints.
pub(super) const IGNORED: Condition = Condition {
    name: "setpoints_ignored",
    seen_by: "The board's ATTITUDE_TARGET has not shown our setpoints for longer than its firmware may \
              need (px4 and ardupilot; docs/BOARDS.md). Integrators are frozen meanwhile.",
    gone_s: 0.0,
    because: "board does not fly our setpoints",
    over: "board flies our setpoints again",
    watched: Watched::Air,
    severity: Severity::Critical,
    is_seen: |sight| sight.board.link.ignores_setpoints(),
    words: |sight| {
        let [sent, board] = sight.board.link.thrust_sent_and_in_force();
        format!("board does not fly our setpoints: thrust {board:.2} in force, {sent:.2} sent")
    },
    ..ROW
};

/// No station is heard.
pub(super) const GROUND: Condition = Condition {
    name: "ground_lost",
    seen_by: "No station has sent a heartbeat for `supervisor.ground_loss_s`, and one did at the \
              beginning of the flight. A station that sends none takes no part.",
    numbers: &[Number {
        key: "supervisor.ground_loss_s",
        value: |c| c.supervisor.ground_loss_s,
        unit: "s",
        origin: "five heartbeats",
    }],
    wanted: |c| c.supervisor.ground_loss.reaction(),
    because: "no station is heard",
    over: "a station is heard again",
    severity: Severity::Warning,
    is_seen: |sight| {
        sight.flight.stations_silent_s(sight.view.at) > sight.view.config.supervisor.ground_loss_s
    },
    words: |sight| {
        format!("no station heard for {:.1} s", sight.flight.stations_silent_s(sight.view.at))
    },
    ..ROW
};

/// The setpoints of a client stopped.
pub(super) const CLIENT: Condition = Condition {
    name: "setpoints_stopped",
    seen_by: "The client's setpoints stopped for `limits.offboard_loss_s`, and the last one was a velocity. A position \
              that nobody renews is held.",
    numbers: &[FOLLOWING],
    gone_s: 0.0,
    watched: Watched::In(&[Mode::Offboard]),
    wanted: |c| c.supervisor.offboard_loss.reaction().max(Reaction::Hold),
    because: "setpoints stopped",
    over: "",
    severity: Severity::Info,
    is_seen: |sight| sight.follower_is_silent(false),
    ..ROW
};

/// The joystick fell silent.
pub(super) const JOYSTICK: Condition = Condition {
    name: "joystick_silent",
    seen_by: "MANUAL_CONTROL stopped for `limits.offboard_loss_s`.",
    numbers: &[FOLLOWING],
    gone_s: 0.0,
    watched: Watched::In(&[Mode::Manual]),
    wanted: |_| Reaction::Hold,
    because: "joystick silent",
    over: "",
    severity: Severity::Info,
    is_seen: |sight| sight.follower_is_silent(true),
    ..ROW
};

/// A stick was moved.
pub(super) const STICKS: Condition = Condition {
    name: "stick_moved",
    seen_by: "A centred axis of MANUAL_CONTROL (x, y or r) is deflected by more than 30 %, and \
              `supervisor.stick_takeover` is on. z is not looked at: on many sticks it does not \
              return to its middle.",
    numbers: &[
        Number {
            key: "supervisor.stick_takeover",
            value: |c| f64::from(u8::from(c.supervisor.stick_takeover)),
            unit: "",
            origin: "off: a joystick that lies on a table must not fly",
        },
        Number { key: "", value: |_| STICK_SHARE, unit: "", origin: "as PX4's COM_RC_STICK_OV" },
    ],
    lasts_s: |_| 0.05,
    gone_s: 0.0,
    watched: Watched::In(&[Mode::Hold, Mode::Goto, Mode::Mission, Mode::Offboard, Mode::Return]),
    wanted: |_| Reaction::TakeOver,
    because: "a stick was moved",
    over: "",
    severity: Severity::Info,
    is_seen: |sight| {
        sight.view.config.supervisor.stick_takeover
            && sight.flight.supervisor.heard.sticks.is_some_and(|(share, t)| {
                share > STICK_SHARE && sight.view.at.seconds_since(t) < STICK_AGE_S
            })
    },
    ..ROW
};
