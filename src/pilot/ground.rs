//! One ground endpoint: who is there, and what it streams.

use haltere_dialect::mav_stream::MavSplitter;

use crate::time::HostTime;

use super::LinkId;

/// Message ids that are streamed unasked, with their rate, Hz.
///
/// HEARTBEAT, SYS_STATUS, ATTITUDE, ATTITUDE_QUATERNION, LOCAL_POSITION_NED, MISSION_CURRENT,
/// BATTERY_STATUS, EXTENDED_SYS_STATE, HALTERE_ESTIMATE, HALTERE_CONTROL, HALTERE_PAIR,
/// HALTERE_DROPS. Silent clients wait for these (GROUND.md, "telemetry by default").
const STREAMS: [(u32, f64); 12] = [
    (0, 1.0),
    (1, 2.0),
    (30, 20.0),
    (31, 10.0),
    (32, 20.0),
    (42, 2.0),
    (147, 2.0),
    (245, 2.0),
    (54101, 10.0),
    (54102, 10.0),
    (54103, 4.0),
    (54104, 1.0),
];

/// Number of streams.
pub(super) const STREAM_COUNT: usize = STREAMS.len();

/// Fastest stream, µs: the control period.
const LEAST_INTERVAL_US: i64 = 10_000;

/// HEARTBEAT cannot be switched off.
const HEARTBEAT_ID: u32 = 0;

#[derive(Debug, Clone, Copy)]
struct Stream {
    msg_id: u32,
    /// `None`: off.
    interval_us: Option<i64>,
    next: HostTime,
}

/// State of an endpoint.
#[derive(Debug)]
pub(super) struct GroundLink {
    pub link: LinkId,
    pub splitter: MavSplitter,
    /// When bytes last came.
    pub heard_at: HostTime,
    /// Whose turn it is in the streams of anchor pairs and of losses: per endpoint, since two that
    /// shared one would each see every other entry for ever.
    pub pair_cursor: usize,
    pub drop_cursor: usize,
    streams: [Stream; STREAMS.len()],
    /// Last sequence number of each peer, for loss accounting. Bounded: the oldest is forgotten.
    sequences: Vec<(u8, u8, u8)>,
}

/// Peers on one endpoint whose sequence numbers are followed.
const MOST_PEERS: usize = 16;

impl GroundLink {
    pub fn new(link: LinkId, at: HostTime) -> Self {
        Self {
            link,
            splitter: MavSplitter::new(),
            heard_at: at,
            pair_cursor: 0,
            drop_cursor: 0,
            streams: STREAMS.map(|(msg_id, rate_hz)| Stream {
                msg_id,
                interval_us: Some((1e6 / rate_hz) as i64),
                next: at,
            }),
            sequences: Vec::new(),
        }
    }

    /// The link was opened again: whoever speaks now counts anew.
    pub fn restart(&mut self) {
        self.sequences.clear();
    }

    /// Frames of this peer that never came.
    pub fn missing(&mut self, system_id: u8, component_id: u8, sequence: u8) -> u64 {
        let known =
            self.sequences.iter_mut().find(|(s, c, _)| (*s, *c) == (system_id, component_id));
        match known {
            Some((_, _, last)) => {
                let missing = sequence.wrapping_sub(*last).wrapping_sub(1);
                *last = sequence;
                // Half the ring or more is a restart or a reordered frame, not a loss.
                if missing < 128 { u64::from(missing) } else { 0 }
            }
            None => {
                if self.sequences.len() == MOST_PEERS {
                    self.sequences.remove(0);
                }
                self.sequences.push((system_id, component_id, sequence));
                0
            }
        }
    }

    /// Changes a stream. µs: 0 is the default, -1 is off. `false`: no such stream.
    pub fn set_interval(&mut self, msg_id: u32, interval_us: f64, at: HostTime) -> bool {
        let Some(i) = self.streams.iter().position(|s| s.msg_id == msg_id) else { return false };
        let stream = &mut self.streams[i];
        stream.interval_us = if interval_us < 0.0 {
            (msg_id == HEARTBEAT_ID).then_some(1_000_000)
        } else if interval_us == 0.0 {
            Some((1e6 / STREAMS[i].1) as i64)
        } else {
            Some((interval_us.min(1e9) as i64).max(LEAST_INTERVAL_US))
        };
        stream.next = at;
        true
    }

    /// Interval of a stream, µs: 0 off or unknown. As MESSAGE_INTERVAL wants it.
    pub fn interval_us(&self, msg_id: u32) -> i32 {
        match self.streams.iter().find(|s| s.msg_id == msg_id) {
            Some(Stream { interval_us: Some(us), .. }) => i32::try_from(*us).unwrap_or(i32::MAX),
            Some(Stream { interval_us: None, .. }) => -1,
            None => 0,
        }
    }

    /// The id of a stream by its number if it is due, marked as sent. Each is sent at most once a
    /// step, whatever the clock does.
    pub fn due(&mut self, number: usize, at: HostTime) -> Option<u32> {
        let stream = self.streams.get_mut(number)?;
        let interval_us = stream.interval_us.filter(|_| at >= stream.next)?;
        // On the grid of its own rate, unless it fell behind by more than one interval.
        stream.next = stream.next.offset_us(interval_us);
        if at.seconds_since(stream.next) > 0.0 {
            stream.next = at.offset_us(interval_us);
        }
        Some(stream.msg_id)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prop_streams_keep_their_rate() {
        let mut ground = GroundLink::new(LinkId::Ground(0), HostTime::from_us(0));
        assert!(ground.set_interval(32, 33_000.0, HostTime::from_us(0)));
        let mut sent = 0;
        for tick in 0..1000 {
            for number in 0..STREAM_COUNT {
                let id = ground.due(number, HostTime::from_us(tick * 10_000));
                sent += u32::from(id == Some(32));
            }
        }
        assert!((300..=306).contains(&sent), "{sent} in 10 s at 33 ms");
    }

    #[test]
    fn prop_heartbeat_cannot_be_switched_off() {
        let mut ground = GroundLink::new(LinkId::Ground(0), HostTime::from_us(0));
        assert!(ground.set_interval(0, -1.0, HostTime::from_us(0)));
        assert_eq!(ground.due(0, HostTime::from_us(0)), Some(0));
        assert!(!ground.set_interval(9999, 1000.0, HostTime::from_us(0)));
    }

    #[test]
    fn prop_gaps_are_counted_per_peer() {
        let mut ground = GroundLink::new(LinkId::Ground(0), HostTime::from_us(0));
        assert_eq!(ground.missing(255, 190, 250), 0);
        assert_eq!(ground.missing(255, 190, 252), 1);
        assert_eq!(ground.missing(245, 190, 7), 0);
        assert_eq!(ground.missing(255, 190, 253), 0);
        assert_eq!(ground.missing(255, 190, 2), 4);
    }
}
