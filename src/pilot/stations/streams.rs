//! What stations are shown, one row a message; what one link is sent unasked, how often, and within what its line
//! carries.
//!
//! Answers and other control traffic are always sent and only counted; streams take what is left.

use haltere_dialect::mav::haltere::{MavDataStream, MavMessage};

use haltere_core::time::HostTime;

use super::endpoint::{Endpoint, GpsClaim, Identity};
use super::radio::{Radio, USUAL_BPS};
use super::shown::{Shown, Turns};
use super::{telemetry, telemetry_counts, telemetry_estimator, telemetry_global, telemetry_imu};
use crate::out::events::SEQUENCE_ID as EVENT_SEQUENCE_ID;

/// Fastest stream, µs: the control period.
const LEAST_INTERVAL_US: i64 = 10_000;
/// Slowest stream, µs.
const MOST_INTERVAL_US: i64 = 1_000_000_000;

/// Rows that others name. HEARTBEAT cannot be switched off.
pub(crate) const HEARTBEAT: u32 = 0;
pub(crate) const MISSION_CURRENT: u32 = 42;
pub(crate) const AUTOPILOT_VERSION: u32 = 148;
pub(crate) const CURRENT_MODE: u32 = 436;
/// Identities whose stations know events without asking for them.
const KNOWS_EVENTS: Identity = Identity::Px4;

/// Share of a line that our own traffic may fill: the rest is for what the glue cannot count.
const LINE_SHARE: f64 = 0.9;
/// Traffic that may be sent at once after a pause, s of the line.
const BURST_S: f64 = 0.25;

/// One message that stations are shown.
pub struct Stream {
    /// Its number.
    pub id: u32,
    /// Unless asked otherwise, Hz; 0 is off.
    pub rate_hz: f64,
    /// ArduPilot's group, by which REQUEST_DATA_STREAM names it (GCS_Mavlink.cpp of ArduPilot as far as we have the
    /// messages).
    pub group: Option<Group>,
    /// It is sent when it is asked for, and cannot be streamed.
    pub on_request: bool,
    make: Make,
}

/// How a message is made, and what it waits for.
enum Make {
    Always(fn(&Shown<'_>) -> MavMessage),
    /// Until the vehicle has found where it is there is nothing to say.
    Aligned(fn(&Shown<'_>) -> MavMessage),
    /// It claims a place on Earth.
    Place(fn(&Shown<'_>) -> MavMessage),
    /// Both.
    Global(fn(&Shown<'_>) -> MavMessage),
    /// It claims a satellite receiver.
    Gps(fn(&Shown<'_>) -> MavMessage),
    Perhaps(fn(&Shown<'_>) -> Option<MavMessage>),
    /// Entries take turns.
    InTurn(fn(&Shown<'_>, &mut Turns) -> Option<MavMessage>),
}

impl Stream {
    /// Its present content. `None`: it is not claimed on this link, or has nothing to say yet.
    pub(crate) fn message(&self, shown: &Shown<'_>, turns: &mut Turns) -> Option<MavMessage> {
        match self.make {
            Make::Always(make) => Some(make(shown)),
            Make::Aligned(make) => shown.is_aligned().then(|| make(shown)),
            Make::Place(make) => shown.has_place().then(|| make(shown)),
            Make::Global(make) => (shown.is_aligned() && shown.has_place()).then(|| make(shown)),
            Make::Gps(make) => self.is_claimed(&shown.endpoint).then(|| make(shown)),
            Make::Perhaps(make) => make(shown),
            Make::InTurn(make) => make(shown, turns),
        }
    }

    /// Whether it claims no more than its endpoint does.
    fn is_claimed(&self, endpoint: &Endpoint) -> bool {
        match self.make {
            Make::Gps(_) => endpoint.gps == GpsClaim::OriginGps,
            Make::Place(_) | Make::Global(_) => endpoint.gps != GpsClaim::None,
            _ => true,
        }
    }
}

use Make::{Aligned, Always, Global, Gps, InTurn, Perhaps, Place};
use MavDataStream as Group;

const POSITION: Option<Group> = Some(Group::MAV_DATA_STREAM_POSITION);
const RAW: Option<Group> = Some(Group::MAV_DATA_STREAM_RAW_SENSORS);
const STATUS: Option<Group> = Some(Group::MAV_DATA_STREAM_EXTENDED_STATUS);
const EXTRA1: Option<Group> = Some(Group::MAV_DATA_STREAM_EXTRA1);
const EXTRA2: Option<Group> = Some(Group::MAV_DATA_STREAM_EXTRA2);
const EXTRA3: Option<Group> = Some(Group::MAV_DATA_STREAM_EXTRA3);

const fn stream(id: u32, rate_hz: f64, group: Option<Group>, make: Make) -> Stream {
    Stream { id, rate_hz, group, on_request: false, make }
}

const fn on_request(id: u32, make: Make) -> Stream {
    Stream { id, rate_hz: 0.0, group: None, on_request: true, make }
}

/// Everything that can be shown: HEARTBEAT first, what is sent on request alone last. Silent clients wait for these
/// (STATIONS.md, Telemetry by default). Our own messages go to who asks for them alone: a client that does not know
/// them counts the gaps that they leave in the sequence as loss, a fifth of a perfect link.
pub static STREAMS: &[Stream] = &[
    stream(HEARTBEAT, 1.0, None, Always(telemetry::heartbeat)),
    stream(1, 2.0, STATUS, Always(telemetry::sys_status)),
    stream(24, 2.0, STATUS, Gps(telemetry_global::gps_raw)),
    stream(30, 20.0, EXTRA1, Aligned(telemetry::attitude)),
    stream(31, 10.0, None, Aligned(telemetry::attitude_quaternion)),
    stream(32, 20.0, POSITION, Aligned(telemetry::local_position)),
    stream(33, 5.0, POSITION, Global(telemetry_global::global_position)),
    stream(MISSION_CURRENT, 2.0, STATUS, Always(telemetry::mission_current)),
    stream(49, 0.2, None, Place(telemetry_global::origin)),
    stream(64, 1.0, None, Aligned(telemetry_estimator::position_covariance)),
    stream(74, 4.0, EXTRA2, Aligned(telemetry_global::vfr_hud)),
    stream(85, 2.0, None, Perhaps(telemetry_estimator::position_target)),
    stream(141, 4.0, None, Aligned(telemetry_global::altitude)),
    stream(147, 2.0, EXTRA3, Perhaps(telemetry::battery)),
    stream(193, 1.0, EXTRA3, Gps(telemetry_estimator::ekf_status)),
    stream(230, 1.0, None, Aligned(telemetry_estimator::estimator_status)),
    stream(242, 0.5, None, Global(telemetry_global::home)),
    stream(245, 2.0, None, Always(telemetry::extended_state)),
    stream(251, 1.0, None, Perhaps(telemetry::hover_thrust)),
    stream(331, 5.0, None, Aligned(telemetry_estimator::odometry)),
    stream(CURRENT_MODE, 0.5, None, Always(telemetry::current_mode)),
    stream(437, 0.3, None, Always(telemetry::modes_monitor)),
    stream(54101, 0.0, None, Aligned(telemetry::estimate)),
    stream(54102, 0.0, None, Perhaps(telemetry::control)),
    stream(54103, 0.0, None, InTurn(telemetry_counts::pair)),
    stream(54104, 0.0, None, InTurn(telemetry_counts::drop)),
    stream(54105, 0.0, None, InTurn(telemetry_counts::link)),
    stream(2, 1.0, EXTRA3, Always(telemetry::system_time)),
    stream(162, 1.0, STATUS, Always(telemetry::fence)),
    stream(EVENT_SEQUENCE_ID, 0.5, None, InTurn(telemetry::event_sequence)),
    stream(26, 0.0, RAW, Perhaps(telemetry_imu::scaled_imu)),
    stream(105, 0.0, None, Perhaps(telemetry_imu::highres_imu)),
    stream(36, 1.0, None, Perhaps(telemetry::servos)),
    on_request(AUTOPILOT_VERSION, Always(telemetry::version)),
];

/// How many of them can be streamed.
const STREAMED: usize = {
    let mut count = 0;
    while count < STREAMS.len() && !STREAMS[count].on_request {
        count += 1;
    }
    count
};

/// The row of a message that can be shown.
pub(crate) fn of(msg_id: u32) -> Option<&'static Stream> {
    STREAMS.iter().find(|stream| stream.id == msg_id)
}

/// How often a row goes out on a link.
#[derive(Debug, Clone, Copy)]
struct Pace {
    msg_id: u32,
    default_us: Option<i64>,
    /// `None`: off.
    interval_us: Option<i64>,
    next: HostTime,
    /// It was due and had to wait: counted once.
    waits: bool,
}

/// The streams of one link.
#[derive(Debug)]
pub(crate) struct Streams {
    streams: [Pace; STREAMED],
    /// Who is looked at first: behind a full line all fall back alike.
    first: usize,
    /// Who had to wait first in this step.
    waiting: Option<usize>,
    line: Option<Line>,
    /// Stream messages that had to wait for the line.
    pub delayed: u64,
}

/// What may still be sent: a bucket that fills with the speed of the line.
#[derive(Debug, Clone, Copy)]
struct Line {
    speed_Bps: f64,
    radio: Radio,
    free_B: f64,
    filled_at: HostTime,
}

impl Streams {
    pub fn new(endpoint: &Endpoint, at: HostTime) -> Self {
        let streams = std::array::from_fn(|n| {
            let row = &STREAMS[n];
            let on = row.rate_hz > 0.0
                && row.is_claimed(endpoint)
                && (endpoint.identity == KNOWS_EVENTS || row.id != EVENT_SEQUENCE_ID);
            let default_us = on.then_some((1e6 / row.rate_hz) as i64);
            Pace { msg_id: row.id, default_us, interval_us: default_us, next: at, waits: false }
        });
        let line = endpoint.line_Bps.map(|line_Bps| {
            let speed_Bps = line_Bps * LINE_SHARE;
            Line { speed_Bps, radio: Radio::default(), free_B: speed_Bps * BURST_S, filled_at: at }
        });
        Self { streams, first: 0, waiting: None, line, delayed: 0 }
    }

    /// Changes a stream. µs: 0 is the default, -1 is off. `false`: no such stream.
    pub fn set_interval(&mut self, msg_id: u32, interval_us: f64, at: HostTime) -> bool {
        let Some(stream) = self.streams.iter_mut().find(|s| s.msg_id == msg_id) else {
            return false;
        };
        stream.interval_us = if interval_us < 0.0 {
            (msg_id == HEARTBEAT).then_some(1_000_000)
        } else if interval_us == 0.0 {
            stream.default_us
        } else {
            // The cast saturates.
            Some((interval_us as i64).clamp(LEAST_INTERVAL_US, MOST_INTERVAL_US))
        };
        stream.next = at;
        true
    }

    /// Whether nobody has changed any.
    pub fn are_default(&self) -> bool {
        self.streams.iter().all(|s| s.interval_us == s.default_us)
    }

    /// Switches all streams off, but for the heartbeat.
    pub fn silence(&mut self) {
        for stream in self.streams.iter_mut().filter(|s| s.msg_id != HEARTBEAT) {
            stream.interval_us = None;
        }
    }

    /// Changes all streams of a group of ArduPilot's, Hz. `false`: none belongs to it.
    pub fn set_group(&mut self, group: Group, rate_hz: f64, start: bool, at: HostTime) -> bool {
        let interval_us = if start && rate_hz > 0.0 { 1e6 / rate_hz } else { -1.0 };
        let all = group == Group::MAV_DATA_STREAM_ALL;
        let mut found = false;
        for row in STREAMS.iter().take(STREAMED) {
            let claimed = row.rate_hz == 0.0
                || self.streams.iter().any(|s| s.msg_id == row.id && s.default_us.is_some());
            if row.group.is_some_and(|of| all || of == group) {
                found = true;
                if claimed {
                    self.set_interval(row.id, interval_us, at);
                }
            }
        }
        found
    }

    /// Interval of a stream, µs: 0 unknown, -1 off. As MESSAGE_INTERVAL wants it.
    pub fn interval_us(&self, msg_id: u32) -> i32 {
        match self.streams.iter().find(|s| s.msg_id == msg_id) {
            Some(Pace { interval_us: Some(us), .. }) => i32::try_from(*us).unwrap_or(i32::MAX),
            Some(Pace { interval_us: None, .. }) => -1,
            None => 0,
        }
    }

    /// Bytes that went out on the link.
    pub fn spend(&mut self, bytes: usize) {
        if let Some(line) = &mut self.line {
            line.free_B -= bytes as f64;
        }
    }

    /// Begins a step: the line has drained since the last one.
    pub fn begin(&mut self, at: HostTime) {
        self.first = self.waiting.take().unwrap_or(self.first);
        if let Some(line) = &mut self.line {
            let since_s = at.seconds_since(line.filled_at).max(0.0);
            let speed_Bps = line.speed_Bps * line.radio.share;
            let full_B = speed_Bps * BURST_S;
            // Control traffic may leave a debt; it is forgiven after two bursts of time.
            line.free_B = (line.free_B + since_s * speed_Bps).clamp(-2.0 * full_B, full_B);
            line.filled_at = at;
        }
    }

    /// The radio at the end of the line has told how much of its buffer is free, percent.
    pub fn radio(&mut self, free_percent: u8, at: HostTime) {
        let unknown = Line {
            speed_Bps: USUAL_BPS * LINE_SHARE,
            radio: Radio::default(),
            free_B: 0.0,
            filled_at: at,
        };
        self.line.get_or_insert(unknown).radio.told(free_percent);
    }

    /// What the line carries, bytes/s. `None`: more than we ever send.
    pub fn line_Bps(&self) -> Option<f64> {
        self.line.map(|line| line.speed_Bps / LINE_SHARE * line.radio.share)
    }

    /// Whether the line has room for a stream message.
    pub fn has_room(&self) -> bool {
        self.line.is_none_or(|line| line.free_B > 0.0)
    }

    /// The id of a stream if it is due, marked as sent; `turn` counts up from 0 within a step. Each
    /// is sent at most once a step, whatever the clock does.
    pub fn due(&mut self, turn: usize, at: HostTime) -> Option<u32> {
        // HEARTBEAT stands first and is never held back.
        let index = match turn {
            0 => 0,
            _ => 1 + (self.first + turn - 1) % (STREAMED - 1),
        };
        let room = index == 0 || self.has_room();
        let stream = self.streams.get_mut(index)?;
        let interval_us = stream.interval_us.filter(|_| at >= stream.next)?;
        if !room {
            self.waiting.get_or_insert(index - 1);
            if !std::mem::replace(&mut stream.waits, true) {
                self.delayed = self.delayed.saturating_add(1);
            }
            return None;
        }
        stream.waits = false;
        // On the grid of its own rate, unless it fell behind by more than one interval.
        stream.next = stream.next.offset_us(interval_us);
        if at.seconds_since(stream.next) > 0.0 {
            stream.next = at.offset_us(interval_us);
        }
        Some(stream.msg_id)
    }

    /// Number of turns in a step.
    pub const TURNS: usize = STREAMED;
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(tick: u64) -> HostTime {
        HostTime::from_us(tick * 10_000)
    }

    /// Messages of each id in so many seconds, each of this size.
    fn run(
        streams: &mut Streams,
        seconds: u64,
        bytes: usize,
    ) -> std::collections::BTreeMap<u32, u32> {
        let mut sent = std::collections::BTreeMap::new();
        for tick in 0..seconds * 100 {
            streams.begin(at(tick));
            for turn in 0..Streams::TURNS {
                if let Some(id) = streams.due(turn, at(tick)) {
                    *sent.entry(id).or_default() += 1;
                    streams.spend(bytes);
                }
            }
        }
        sent
    }

    #[test]
    fn prop_streams_keep_their_rate() {
        for (interval_us, wanted) in [
            (33_000.0, 606.0),
            (10_000.0, 2000.0),
            (15_000.0, 1333.0),
            (70_000.0, 286.0),
            (1.0, 2000.0),
        ] {
            let mut streams = Streams::new(&Endpoint::default(), at(0));
            assert!(streams.set_interval(32, interval_us, at(0)));
            let sent = f64::from(run(&mut streams, 20, 40)[&32]);
            assert!((sent / wanted - 1.0_f64).abs() < 0.02, "{sent} in 20 s at {interval_us} us");
        }
    }

    #[test]
    fn prop_heartbeat_cannot_be_switched_off() {
        let mut streams = Streams::new(&Endpoint::default(), at(0));
        assert!(streams.set_interval(0, -1.0, at(0)));
        assert!(streams.set_group(Group::MAV_DATA_STREAM_ALL, 0.0, false, at(0)));
        assert_eq!(streams.due(0, at(0)), Some(0));
        assert_eq!(streams.interval_us(30), -1);
        assert!(!streams.set_interval(9999, 1000.0, at(0)));
        assert_eq!(streams.interval_us(9999), 0);
    }

    #[test]
    fn prop_a_slow_line_is_shared_and_never_overfilled() {
        // 9600 baud, ten bits a byte.
        let slow = Endpoint { line_Bps: Some(960.0), ..Endpoint::default() };
        let mut streams = Streams::new(&slow, at(0));
        let sent = run(&mut streams, 60, 50);
        let bytes = sent.values().sum::<u32>() * 50;
        assert!(f64::from(bytes) < 960.0 * 60.0, "{bytes}");
        assert!(f64::from(bytes) > 0.8 * 960.0 * 60.0, "{bytes}");
        // Nothing starves, the heartbeat least of all.
        assert!((59..=60).contains(&sent[&0]));
        let endpoint = Endpoint::default();
        let on = STREAMS.iter().filter(|row| {
            row.rate_hz > 0.0 && row.is_claimed(&endpoint) && row.id != EVENT_SEQUENCE_ID
        });
        for Stream { id, rate_hz, .. } in on {
            let count = f64::from(sent.get(id).copied().unwrap_or(0));
            // Half of an equal share of 17 messages/s, or what it asks for if that is less.
            let share = (0.5 * 17.0 * 60.0 / STREAMED as f64).min(0.5 * rate_hz * 60.0);
            assert!(count >= share.floor(), "{id}: {count}");
        }
        assert!(streams.delayed > 0);
    }

    /// MAVProxy and pymavlink called perfect links 16 to 22 % lossy.
    #[test]
    fn regress_messages_of_our_own_go_to_who_asks_alone() {
        let mut streams = Streams::new(&Endpoint::default(), at(0));
        streams.set_group(Group::MAV_DATA_STREAM_ALL, 4.0, true, at(0));
        assert!(run(&mut streams, 10, 40).keys().all(|id| *id < 54_100));
        assert!(streams.set_interval(54_101, 100_000.0, at(0)));
        let sent = run(&mut streams, 10, 40);
        assert!(sent[&54_101] > 95 && !sent.contains_key(&54_105));
        assert!(streams.set_interval(54_101, 0.0, at(0)));
        assert_eq!(streams.interval_us(54_101), -1);
    }

    #[test]
    fn prop_claims_decide_what_is_streamed() {
        let has = |gps, id| {
            let endpoint = Endpoint { gps, ..Endpoint::default() };
            run(&mut Streams::new(&endpoint, at(0)), 6, 40).contains_key(&id)
        };
        assert!(!has(GpsClaim::None, 33) && has(GpsClaim::Origin, 33));
        assert!(!has(GpsClaim::Origin, 24) && has(GpsClaim::OriginGps, 24));
        // A request for everything does not change a claim.
        let mut streams = Streams::new(&Endpoint::default(), at(0));
        streams.set_group(Group::MAV_DATA_STREAM_ALL, 4.0, true, at(0));
        let sent = run(&mut streams, 10, 40);
        assert!(!sent.contains_key(&24) && sent[&30] == 40);
    }
}
