//! Who speaks on the board's link, by address: the board is bound to the one that it was found at.
//!
//! Boards leave the factory with one system id. Two of them on one UDP port would be one board that stands and
//! flies at once, and what is meant for one would move both. A router that changes its port is no second board:
//! the old address falls silent, and the time since boot goes on at the new one.

use core::net::SocketAddr;

use haltere_dialect::mav_stream::{MavFrame, MavSplitter};

use haltere_core::time::HostTime;

/// An address that was silent for so long does not speak any more, s: below the time-out of every board for
/// setpoints (0.3 to 1 s), which still go to the old address.
const SILENT_S: f64 = 0.3;
/// Who spoke within this time speaks now, s: attitude comes fifty times a second.
const MOVING_S: f64 = 0.1;
/// A board that is gone may be replaced by another one after this time, s; who spoke within it speaks: three
/// heartbeats at 1 Hz.
pub(super) const GONE_S: f64 = 3.0;
/// Two that speak turn by turn for so long speak at once, s: on their way datagrams overtake each other by less.
const OVERTAKEN_S: f64 = 0.1;
/// The time since boot goes on when it differs by no more, µs: what a line delays its bytes by, and less than what lies
/// between two hands that plug in two batteries.
const SAME_BOOT_US: u64 = 250_000;
/// Most that waits of one of them, bytes: half a second of a line of 921600 baud.
const MOST_WAITING_B: usize = 48 << 10;
/// Most others that are followed: a stranger must not make us remember without end.
const MOST_OTHERS: usize = 4;

/// Another address than the board's.
#[derive(Debug)]
pub(crate) struct Other {
    pub address: SocketAddr,
    /// Its bytes, apart from those of the board.
    pub splitter: MavSplitter,
    /// When it first and last spoke as a board does, and with which number.
    spoke: Option<(HostTime, HostTime, u8)>,
    boot_us: Option<i64>,
    /// The board spoke at the same time.
    beside: bool,
    /// What it said since the board fell silent: heard late if it is the board.
    waiting: Vec<u8>,
    /// When each frame in that came, and its end.
    waiting_ends: Vec<(HostTime, usize)>,
}

impl Other {
    /// How many it were.
    fn forget_waiting(&mut self) -> u64 {
        let count = self.waiting_ends.len() as u64;
        self.waiting.clear();
        self.waiting_ends.clear();
        count
    }
}

/// Frames that waited until it was clear who had sent them.
#[derive(Debug, Default)]
pub(crate) struct Late {
    bytes: Vec<u8>,
    ends: Vec<(HostTime, usize)>,
}

impl Late {
    /// Each with the time at which it came, but for what is older than a change of address takes.
    pub fn frames(&self) -> impl Iterator<Item = (HostTime, &[u8])> {
        let newest = self.ends.last().map_or(HostTime::default(), |(at, _)| *at);
        let starts = std::iter::once(0).chain(self.ends.iter().map(|(_, end)| *end));
        let frame = |((at, end), start): (&(HostTime, usize), usize)| {
            Some((*at, self.bytes.get(start..*end)?))
        };
        let all = self.ends.iter().zip(starts).filter_map(frame);
        all.filter(move |(at, _)| is_new(*at, newest, SILENT_S + MOVING_S))
    }
}

/// Those who speak.
#[derive(Debug, Default)]
pub(crate) struct Peers {
    /// Where the bytes come from that come next. `None`: the link has one far end.
    sender: Option<SocketAddr>,
    board: Option<SocketAddr>,
    /// When it was switched on by its own account: host time, µs, which may lie before that began.
    boot_us: Option<i64>,
    others: Vec<Other>,
    /// Frames of others that nobody will hear.
    forgotten: u64,
}

impl Peers {
    /// From here on bytes come from this address.
    pub fn sender(&mut self, address: SocketAddr) {
        self.sender = Some(address);
    }

    /// Where the board is; `None`: not found yet, or its link has one far end.
    pub fn board(&self) -> Option<SocketAddr> {
        self.board
    }

    /// The link was opened anew.
    pub fn forget(&mut self) {
        self.board = None;
        self.boot_us = None;
        self.others.clear();
    }

    /// Place among the others of the address that speaks now. `None`: the board does. `Err`: there is no room to
    /// follow it.
    pub fn other(&mut self, at: HostTime) -> Result<Option<usize>, ()> {
        let Some(address) = self.sender.filter(|sender| self.board != Some(*sender)) else {
            return Ok(None);
        };
        if let Some(index) = self.others.iter().position(|o| o.address == address) {
            return Ok(Some(index));
        }
        if self.others.len() >= MOST_OTHERS {
            let speaks = |o: &Other| o.spoke.is_some_and(|(_, last, _)| is_new(last, at, GONE_S));
            let silent = self.others.iter().position(|o| !speaks(o)).ok_or(())?;
            self.others.remove(silent);
        }
        self.others.push(Other {
            address,
            splitter: MavSplitter::new(),
            spoke: None,
            boot_us: None,
            beside: false,
            waiting: Vec::new(),
            waiting_ends: Vec::new(),
        });
        Ok(Some(self.others.len() - 1))
    }

    /// One of the others.
    pub fn other_mut(&mut self, index: usize) -> Option<&mut Other> {
        self.others.get_mut(index)
    }

    /// The board spoke.
    pub fn board_spoke(&mut self, at: HostTime, frame: &MavFrame<'_>) {
        self.boot_us = booted_us(at, frame).or(self.boot_us);
        for other in &mut self.others {
            let first = other.spoke.map(|(first, ..)| first);
            other.beside |= first.is_some_and(|first| at.seconds_since(first) > OVERTAKEN_S);
            self.forgotten += other.forget_waiting();
        }
    }

    /// One of the others spoke as a board does.
    pub fn other_spoke(&mut self, at: HostTime, index: usize, frame: &MavFrame<'_>) {
        let Some(other) = self.others.get_mut(index) else { return };
        let first = match other.spoke {
            Some((first, last, _)) if is_new(last, at, GONE_S) => first,
            // Who comes back after a while begins anew.
            _ => {
                other.beside = false;
                at
            }
        };
        other.spoke = Some((first, at, frame.header.system_id));
        other.boot_us = booted_us(at, frame).or(other.boot_us);
        if other.waiting.len() + frame.raw.len() > MOST_WAITING_B {
            self.forgotten += other.forget_waiting();
        }
        other.waiting.extend_from_slice(frame.raw);
        other.waiting_ends.push((at, other.waiting.len()));
    }

    /// How many frames of others were thrown away since the last call.
    pub fn take_forgotten(&mut self) -> u64 {
        std::mem::take(&mut self.forgotten)
    }

    /// Whether one of the others is the board at another address, which itself has been silent for so long, s.
    pub fn is_same_board(&self, index: usize, silent_s: f64) -> bool {
        silent_s >= SILENT_S && self.others.get(index).is_some_and(|other| self.goes_on_at(other))
    }

    /// Whether the time since the board's boot goes on at another address, alone.
    fn goes_on_at(&self, other: &Other) -> bool {
        let both = self.boot_us.zip(other.boot_us).filter(|_| !other.beside);
        both.is_some_and(|(ours_us, theirs_us)| ours_us.abs_diff(theirs_us) < SAME_BOOT_US)
    }

    /// Whether the board, silent for so long, s, seems to speak at another address by now, where it is not heard yet.
    pub fn is_moving(&self, at: HostTime, silent_s: f64) -> bool {
        let speaks = |other: &Other| {
            other.spoke.is_some_and(|(_, last, _)| is_new(last, at, MOVING_S))
                && self.goes_on_at(other)
        };
        silent_s < SILENT_S + MOVING_S && self.others.iter().any(speaks)
    }

    /// Whether a board that has been silent for so long, s, may be replaced by another one.
    pub fn is_gone(silent_s: f64) -> bool {
        silent_s >= GONE_S
    }

    /// Another one that speaks as a board does: its system id and where it is.
    pub fn speaker(&self, at: HostTime) -> Option<(u8, SocketAddr)> {
        let speaks = |other: &Other| {
            let (_, _, id) = other.spoke.filter(|(_, last, _)| is_new(*last, at, GONE_S))?;
            Some((id, other.address))
        };
        self.others.iter().find_map(speaks)
    }

    /// The board is at the address of one of the others from now on. What that said already.
    pub fn bind(&mut self, index: usize) -> Late {
        if index >= self.others.len() {
            return Late::default();
        }
        let other = self.others.swap_remove(index);
        self.boot_us = other.boot_us;
        self.board = Some(other.address);
        Late { bytes: other.waiting, ends: other.waiting_ends }
    }

    /// A second board with the number of the one that we are bound to, which has been silent for so long, s.
    pub fn second(&self, at: HostTime, system_id: u8, silent_s: f64) -> Option<SocketAddr> {
        let alone = silent_s >= GONE_S;
        let speaks = |other: &&Other| {
            other.spoke.is_some_and(|(_, last, id)| id == system_id && is_new(last, at, GONE_S))
        };
        let second = self.others.iter().filter(speaks).find(|other| other.beside || alone)?;
        Some(second.address)
    }
}

fn is_new(last: HostTime, at: HostTime, within_s: f64) -> bool {
    at.seconds_since(last) < within_s
}

/// When the sender of a frame was switched on, by its own account: host time, µs.
fn booted_us(at: HostTime, frame: &MavFrame<'_>) -> Option<i64> {
    let offset = match frame.header.msg_id {
        // SYSTEM_TIME.
        2 => 8,
        // SCALED_IMU, SCALED_PRESSURE, ATTITUDE, ATTITUDE_QUATERNION, LOCAL_POSITION_NED, GLOBAL_POSITION_INT,
        // ATTITUDE_TARGET.
        26 | 29 | 30 | 31 | 32 | 33 | 83 => 0,
        _ => return None,
    };
    if !frame.checked {
        return None;
    }
    // Zeros at the end are cut on the wire.
    let byte = |i: usize| frame.payload.get(offset + i).copied().unwrap_or_default();
    let boot_ms = u32::from_le_bytes([byte(0), byte(1), byte(2), byte(3)]);
    Some(at.as_us().cast_signed().saturating_sub(i64::from(boot_ms) * 1000))
}

#[cfg(test)]
mod tests {
    use haltere_dialect::mav::haltere::{ATTITUDE_QUATERNION_DATA, MavMessage, SYSTEM_TIME_DATA};
    use haltere_dialect::mav_stream;

    use super::*;

    fn at(ms: u64) -> HostTime {
        HostTime::from_us(1_000_000 + ms * 1000)
    }

    fn address(port: u16) -> SocketAddr {
        SocketAddr::from(([192, 168, 1, 7], port))
    }

    /// What a frame of a board says that was switched on at host time `boot_ms` (may be before its beginning).
    fn says(boot_ms: i64, ms: u64, mut hear: impl FnMut(&MavFrame<'_>)) {
        let time_boot_ms = (1000 + ms.cast_signed() - boot_ms) as u32;
        let attitude = ATTITUDE_QUATERNION_DATA { time_boot_ms, q1: 1.0, ..Default::default() };
        let clock = SYSTEM_TIME_DATA { time_unix_usec: 7, time_boot_ms };
        let messages = [MavMessage::ATTITUDE_QUATERNION(attitude), MavMessage::SYSTEM_TIME(clock)];
        let mut splitter = MavSplitter::new();
        let mut bytes = Vec::new();
        mav_stream::encode(&mut bytes, 1, 1, 0, &messages[usize::from(ms.is_multiple_of(20))]);
        splitter.push(&bytes);
        while let Some(frame) = splitter.next() {
            hear(&frame.unwrap());
        }
    }

    /// Bound to the first address, which has spoken since 0 ms.
    fn bound() -> Peers {
        let mut peers = Peers::default();
        peers.sender(address(1));
        let index = peers.other(at(0)).unwrap().unwrap();
        says(-5000, 0, |f| peers.other_spoke(at(0), index, f));
        assert_eq!(peers.bind(index).frames().count(), 1);
        assert_eq!(peers.other(at(0)), Ok(None));
        peers
    }

    fn hear(peers: &mut Peers, port: u16, boot_ms: i64, ms: u64) -> Option<usize> {
        peers.sender(address(port));
        let other = peers.other(at(ms)).unwrap();
        match other {
            None => says(boot_ms, ms, |f| peers.board_spoke(at(ms), f)),
            Some(index) => says(boot_ms, ms, |f| peers.other_spoke(at(ms), index, f)),
        }
        other
    }

    #[test]
    fn prop_a_port_that_changed_is_the_same_board_and_another_clock_is_not() {
        for (boot_ms, same) in [(-5000, true), (-4800, true), (-4000, false), (900, false)] {
            let mut peers = bound();
            hear(&mut peers, 1, -5000, 1000);
            for ms in (1010..1400).step_by(10) {
                let index = hear(&mut peers, 2, boot_ms, ms).unwrap();
                let silent_s = (ms - 1000) as f64 * 1e-3;
                let is_same = peers.is_same_board(index, silent_s);
                assert_eq!(is_same, same && ms >= 1300, "{boot_ms} {ms}");
                assert_eq!(peers.second(at(ms), 1, silent_s), None);
            }
            assert_eq!(peers.board(), Some(address(1)));
            let late = peers.bind(0);
            let times: Vec<HostTime> = late.frames().map(|(at, _)| at).collect();
            assert!(times.into_iter().eq((1010..1400).step_by(10).map(at)), "all of it, in order");
            assert!(late.frames().all(|(_, frame)| frame.first() == Some(&0xFD)));
            assert_eq!(peers.board(), Some(address(2)));
        }
    }

    #[test]
    fn prop_two_at_once_are_two_whatever_their_clocks_say() {
        let mut peers = bound();
        for ms in (1000..3000).step_by(10) {
            hear(&mut peers, 1, -5000, ms);
            hear(&mut peers, 2, -5000, ms + 3);
        }
        assert_eq!(peers.second(at(3000), 1, 0.0), Some(address(2)));
        // With another number it confuses nobody.
        assert_eq!(peers.second(at(3000), 2, 0.0), None);
        // Nor is it the board when that falls silent.
        let index = hear(&mut peers, 2, -5000, 3400).unwrap();
        assert!(!peers.is_same_board(index, 0.41));
        // It has gone.
        assert_eq!(peers.second(at(6500), 1, 0.0), None);
        // One datagram that was overtaken does not make two of one.
        let mut peers = bound();
        hear(&mut peers, 2, -5000, 1000);
        hear(&mut peers, 1, -5000, 1020);
        let index = hear(&mut peers, 2, -5000, 1400).unwrap();
        assert!(peers.is_same_board(index, 0.38));
    }

    #[test]
    fn prop_others_are_bounded_and_the_silent_make_room() {
        let mut peers = bound();
        for port in 2..6 {
            hear(&mut peers, port, 0, 1000);
        }
        peers.sender(address(9));
        assert_eq!(peers.other(at(1500)), Err(()));
        assert!(peers.other(at(4500)).is_ok());
        assert_eq!(peers.others.len(), MOST_OTHERS);
    }
}
