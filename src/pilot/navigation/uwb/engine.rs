//! TDOA engine: bytes of the sniffer in, differences of distance out.
//!
//! # Equation
//!
//! A packet of anchor n arrives at tag time T_n, sent at X_n of n's clock. For another anchor r
//! whose last packet both the tag (at T_r) and n (at RX_rn) have heard:
//!
//! ```text
//! dT = (T_n − T_r) − K_n · ( tof_rn + (X_n − RX_rn) )        [tag ticks]
//! d  = c · dT / f_tick = |p − p_n| − |p − p_r|               [m]
//! ```
//!
//! K_n is the tag's clock rate over n's, from [`super::anchor_clock`]; it includes the Doppler of
//! the tag's motion, which makes d true at T_r. Antenna delays are in T and in tof, and cancel.
//! Source: LPS TDoA2 and TDoA3 (INTERFACES). Noise at zero error of the stamps: four rounded
//! stamps, 2.7 mm one sigma.
//!
//! # What keeps false values out
//!
//! * A pair needs the same 7-bit counter in n's report and in the last packet of r that the tag
//!   accepted, at most [`MAX_PAIR_AGE_TICKS`] ago: the counter comes round after 2 s, RX_rn after
//!   67 ms.
//! * Both packets must fit their anchor's clock. One that does not is neither paired nor kept for
//!   the next packet to pair with, else it would spoil two measurements.
//! * |d| may not exceed the distance between the anchors.
//! * The tag's time goes forward. It may begin elsewhere only where the tag may have rebooted: after it was
//!   connected anew, or was silent for as long as that takes; one that goes on where it stopped is late, no reboot, and
//!   what is later than the least delay by far is not used ([`TagClock`]). And a payload that was heard before, at times that its
//!   anchor's clock contradicts, is an echo ([`super::echo`]). Both are what a stream looks like that is played again.
//!
//! Every packet ends in at least one TDOA or in exactly one counted reason.

use haltere_dialect::lps::sniffer::{SnifferDecoder, SnifferFrame, SnifferLoss};
use haltere_dialect::lps::tdoa2::{self, Tdoa2Packet};
use haltere_dialect::lps::tdoa3::{MAX_REMOTES, Remote, Tdoa3Packet};
use haltere_dialect::lps::{RX_BITS, TICK_HZ, TICK_M};

use super::anchor_clock::{AnchorClock, Fit, MAX_GAP_TICKS};
use super::echo::Echo;
use super::{REBOOT_SILENCE_S, TagClock, UwbConfig};
use haltere_core::drops::{DropReason, Drops};
use haltere_core::frames::{E, Vec3};
use haltere_core::measure::{AnchorId, Tdoa};
use haltere_core::survey::Survey;
use haltere_core::time::{HostTime, TagTime};

/// Oldest packet to pair with, ticks: 33.6 ms, two frames of TDoA2, half of what 32 bits tell.
const MAX_PAIR_AGE_TICKS: i64 = 1 << 31;

/// Counters are compared on 7 bits: TDoA3 sends no more.
const COUNTER_MASK: u8 = 0x7F;

/// A pause of the stream of more than this needs a second packet as witness: the tag's 40-bit time
/// may have wrapped any number of times, or the tag may have rebooted. µs.
const MAX_PAUSE_US: f64 = 1e6;

/// One anchor that starts anew has rebooted. When this many do with no other fitting in between, it
/// was the tag, by less than [`MAX_PAUSE_US`] of apparent time.
const RESTARTS_OF_THE_TAG: u32 = 2;

/// The tag's time goes on after a pause if the map finds it no earlier and no later than this, s.
const SAME_TIME_S: std::ops::Range<f64> = -0.02..0.2;

/// What is known of one anchor.
#[derive(Debug, Clone, Copy, Default)]
struct Anchor {
    pos_E_m: Option<Vec3<E>>,
    clock: AnchorClock,
    counter: u8,
    packets: u64,
    positions_sent: u64,
    last_heard: HostTime,
}

/// Statistics of one anchor.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AnchorHeard {
    /// The anchor.
    pub id: AnchorId,
    /// Packets heard since start.
    pub packets: u64,
    /// When the last one came.
    pub last_heard: HostTime,
    /// Rate of the tag's clock over the anchor's, minus one, ppm; `None` until settled.
    pub clock_skew_ppm: Option<f64>,
    /// Packets that also told a position. They are not used: the survey holds.
    pub positions_sent: u64,
}

/// A packet of either protocol.
struct Packet {
    source: u8,
    counter: u8,
    tx: u32,
    remotes: [Remote; MAX_REMOTES],
    remotes_len: usize,
    tells_position: bool,
}

/// A possible partner of a packet.
#[derive(Debug, Clone, Copy)]
struct Pair {
    age_ticks: i64,
    id: u8,
    /// tof_rn + X_n − RX_rn, ticks of n.
    sent_after_ticks: i64,
}

/// So many frames may be left over from before the line was opened: one that lay in its buffer stood before the text.
const LEFT_OVER: usize = 8;

/// The engine.
#[derive(Debug, Clone)]
pub struct TdoaEngine {
    config: UwbConfig,
    gate_ticks: f64,
    latency_us: i64,
    decoder: SnifferDecoder,
    /// Frames since the tag was connected, as far as [`LEFT_OVER`]: it says text before them.
    framed: usize,
    /// Whether a packet was ever paired with another one.
    paired: bool,
    anchors: Box<[Anchor; 256]>,
    tag_clock: TagClock,
    /// Unwrapped tag time of the last packet that fitted, and when it came.
    now: Option<(i64, HostTime)>,
    /// Tag time of a packet that contradicts `now`, raw.
    suspect: Option<u64>,
    /// When a packet was last heard, whatever became of it.
    heard_at: Option<HostTime>,
    /// Whether the tag may have rebooted since the last packet that fitted.
    may_be_elsewhere: bool,
    /// Whether the newest packet's time was before the stream's.
    backwards: bool,
    /// Whether the newest packet came far later than such packets once did.
    old: bool,
    echo: Echo,
    /// Anchor clocks that started anew in a row, with no packet between that fitted an old one.
    restarts: u32,
}

impl TdoaEngine {
    /// For the anchors of a survey.
    pub fn new(config: UwbConfig, survey: &Survey) -> Self {
        let mut anchors = Box::new([Anchor::default(); 256]);
        for (id, anchor) in (0..=u8::MAX).zip(anchors.iter_mut()) {
            anchor.pos_E_m = survey.position_E_m(AnchorId(id));
        }
        Self {
            gate_ticks: config.clock_gate_m / TICK_M,
            latency_us: (config.tag_latency_s * 1e6).round() as i64,
            config,
            decoder: SnifferDecoder::new(),
            framed: 0,
            paired: false,
            anchors,
            tag_clock: TagClock::new(),
            now: None,
            suspect: None,
            heard_at: None,
            may_be_elsewhere: false,
            backwards: false,
            old: false,
            echo: Echo::new(),
            restarts: 0,
        }
    }

    /// Takes bytes of the tag that were read at `received_at`; appends to `out`. With
    /// neighbouring slots the measurements ascend in `valid_at`; after losses, and with more than
    /// one pair a packet, they may not.
    pub fn tag_bytes(
        &mut self,
        received_at: HostTime,
        bytes: &[u8],
        out: &mut Vec<Tdoa>,
        drops: &mut Drops,
    ) {
        // The decoder lends from its buffer while the rest of the engine works on the frame.
        let mut decoder = std::mem::take(&mut self.decoder);
        decoder.push(bytes);
        while let Some(found) = decoder.next() {
            match found {
                Ok(frame) => {
                    self.framed = (self.framed + 1).min(LEFT_OVER);
                    if let Err(reason) = self.frame(received_at, &frame, out, drops) {
                        drops.add(reason, 1);
                    }
                }
                Err(loss) => {
                    let (reason, n) = match loss {
                        SnifferLoss::GarbageBytes(n) if self.framed < LEFT_OVER => {
                            (DropReason::TagStartByte, n as u64)
                        }
                        loss => reason_of(loss),
                    };
                    drops.add(reason, n);
                }
            }
        }
        self.decoder = decoder;
    }

    /// The tag was reconnected: the beginning of a frame that waits will not be completed.
    /// Clocks go on if the tag did not lose power.
    pub fn reconnected(&mut self) {
        self.decoder.flush();
        self.framed = 0;
        self.may_be_elsewhere = true;
        if std::mem::take(&mut self.old) {
            self.tag_clock.reset();
        }
        self.echo.end();
    }

    /// Whether the tag's time runs backwards, or its packets were heard before: nothing of it is used.
    pub fn is_played_again(&self) -> bool {
        self.echo.sounds() || self.backwards
    }

    /// Whether what comes is old: nothing of it is used.
    pub fn is_old(&self) -> bool {
        self.old
    }

    /// The anchors that were heard.
    pub fn anchors_heard(&self) -> impl Iterator<Item = AnchorHeard> + '_ {
        (0..=u8::MAX).zip(self.anchors.iter()).filter(|(_, a)| a.packets > 0).map(|(id, a)| {
            AnchorHeard {
                id: AnchorId(id),
                packets: a.packets,
                last_heard: a.last_heard,
                clock_skew_ppm: a.clock.settled().then_some(a.clock.skew() * 1e6),
                positions_sent: a.positions_sent,
            }
        })
    }

    /// The map from the tag's time to ours.
    pub fn tag_clock(&self) -> &TagClock {
        &self.tag_clock
    }

    fn anchor(&self, id: u8) -> &Anchor {
        &self.anchors[usize::from(id)] // 256 of them
    }

    fn frame(
        &mut self,
        received_at: HostTime,
        frame: &SnifferFrame<'_>,
        out: &mut Vec<Tdoa>,
        drops: &mut Drops,
    ) -> Result<(), DropReason> {
        let packet = read(frame).ok_or(DropReason::TagBadPayload)?;
        let gate_ticks = self.gate_ticks;
        let anchor = &mut self.anchors[usize::from(packet.source)];
        anchor.packets += 1;
        anchor.positions_sent += u64::from(packet.tells_position);
        anchor.last_heard = received_at;
        let pos_n = anchor.pos_E_m.ok_or(DropReason::UwbUnknownAnchor)?;
        let silent_s = self.heard_at.replace(received_at).map(|t| received_at.seconds_since(t));
        self.may_be_elsewhere |= silent_s.is_none_or(|s| s >= REBOOT_SILENCE_S);
        let known = self.echo.hear(frame.payload);
        if self.echo.sounds() {
            return Err(DropReason::UwbDuplicate);
        }
        let t_n = self.unwrap(frame.rx_ticks, received_at);
        self.backwards = t_n.is_none() && !self.may_be_elsewhere;
        let t_n = t_n.ok_or(DropReason::UwbClockJump)?;
        let anchor = &mut self.anchors[usize::from(packet.source)];
        match anchor.clock.observe(t_n, packet.tx, gate_ticks) {
            Fit::Fits => {}
            Fit::Repeated => return Err(DropReason::UwbDuplicate),
            Fit::Jump if known => {
                self.echo.begin();
                return Err(DropReason::UwbDuplicate);
            }
            Fit::Jump => {
                // A clock that has just started anew stands on this packet.
                if anchor.clock.last_arrival() == Some(t_n) {
                    anchor.counter = packet.counter;
                    self.now = Some((t_n, received_at));
                    self.restarts += 1;
                    if self.restarts == RESTARTS_OF_THE_TAG {
                        self.tag_clock.reset();
                    }
                }
                return Err(DropReason::UwbClockJump);
            }
        }
        anchor.counter = packet.counter;
        let clock_n = anchor.clock;
        self.now = Some((t_n, received_at));
        self.may_be_elsewhere = false;
        self.tag_clock.observe(tag_time(t_n), received_at);
        self.old = self.tag_clock.is_old(tag_time(t_n), received_at);
        if self.old {
            return Err(DropReason::UwbTooOld);
        }
        if !clock_n.settled() {
            return Err(DropReason::UwbClockUnsettled);
        }
        self.restarts = 0;
        let (pairs, found) = self.pairs(&packet, t_n);
        let wanted = usize::from(self.config.pairs_per_packet).min(found);
        if wanted == 0 {
            // The first one has nothing to be paired with.
            return Err(match self.paired {
                true => DropReason::UwbNoPair,
                false => DropReason::UwbClockUnsettled,
            });
        }
        self.paired = true;
        for pair in pairs.get(..wanted).unwrap_or_default() {
            let Some(pos_r) = self.anchor(pair.id).pos_E_m else { continue };
            let stretch = clock_n.skew() * pair.sent_after_ticks as f64;
            let distance_diff_m =
                ((pair.age_ticks - pair.sent_after_ticks) as f64 - stretch) * TICK_M;
            let limit_m = (pos_n - pos_r).norm() + self.config.impossible_margin_m;
            if distance_diff_m.abs() > limit_m {
                drops.add(DropReason::UwbImpossible, 1);
                continue;
            }
            let heard_r = tag_time(t_n - pair.age_ticks);
            let valid_at = self.tag_clock.host(heard_r).unwrap_or(received_at).min(received_at);
            out.push(Tdoa {
                valid_at: valid_at.offset_us(-self.latency_us),
                received_at,
                anchor_a: AnchorId(pair.id),
                anchor_b: AnchorId(packet.source),
                distance_diff_m,
                std_m: None,
            });
        }
        Ok(())
    }

    /// Partners of a packet, the most recently heard first: the error of K grows with their age.
    fn pairs(&self, packet: &Packet, t_n: i64) -> ([Pair; MAX_REMOTES], usize) {
        let mut pairs = [Pair { age_ticks: 0, id: 0, sent_after_ticks: 0 }; MAX_REMOTES];
        let mut len = 0usize;
        for remote in packet.remotes.get(..packet.remotes_len).unwrap_or_default() {
            let anchor = self.anchor(remote.id);
            let Some(t_r) = anchor.clock.last_arrival() else { continue };
            let age_ticks = t_n - t_r;
            let since_rx = i64::from(packet.tx.wrapping_sub(remote.rx).cast_signed());
            let fits = remote.id != packet.source
                && anchor.clock.settled()
                && remote.counter & COUNTER_MASK == anchor.counter
                && (1..=MAX_PAIR_AGE_TICKS).contains(&age_ticks)
                && since_rx > 0;
            let Some(tof) = remote.tof.filter(|tof| fits && *tof != 0) else { continue };
            let pair =
                Pair { age_ticks, id: remote.id, sent_after_ticks: i64::from(tof) + since_rx };
            // Insertion sort: at most eight.
            let mut at = len;
            while let Some(before) = at.checked_sub(1).and_then(|i| pairs.get(i).copied())
                && before.age_ticks > age_ticks
            {
                pairs[at] = before;
                at -= 1;
            }
            pairs[at] = pair;
            len += 1;
        }
        (pairs, len)
    }

    /// Unwraps a 40-bit tag time. `None` if it contradicts the stream so far; two packets that
    /// contradict it but not one another begin a new stream, where the tag may have rebooted, or where packets are
    /// missing: what was never heard before, and goes forward or has nothing before it for as long as a reboot takes.
    fn unwrap(&mut self, raw: u64, received_at: HostTime) -> Option<i64> {
        const WRAP: i64 = 1 << RX_BITS;
        let raw_ticks = raw.cast_signed();
        let forward = |from: i64| (raw_ticks - from).rem_euclid(WRAP);
        let Some((now, now_at)) = self.now else {
            // One wrap ahead, so that nothing of this becomes negative.
            return Some(WRAP + raw_ticks);
        };
        let pause_us = received_at.seconds_since(now_at) * 1e6;
        let ahead = forward(now);
        if ahead <= MAX_GAP_TICKS && pause_us < MAX_PAUSE_US {
            self.suspect = None;
            return Some(now + ahead);
        }
        let witness = self.suspect.replace(raw)?;
        if forward(witness.cast_signed()) > MAX_GAP_TICKS {
            return None;
        }
        self.suspect = None;
        // As many wraps as the host's clock says; if the map agrees, the tag ran on.
        let ticks_passed = pause_us * (TICK_HZ * 1e-6);
        let wraps = ((ticks_passed - ahead as f64) / WRAP as f64).round().max(0.0);
        let t = now + ahead + wraps as i64 * WRAP;
        // A tag that rebooted does not go on where it stopped; if it should seem so, its anchors' clocks contradict.
        if (1..=MAX_GAP_TICKS).contains(&ahead) && wraps == 0.0 {
            return Some(t);
        }
        let late_s = self.tag_clock.host(tag_time(t)).map(|at| received_at.seconds_since(at));
        let ran_on = late_s.is_some_and(|late_s| SAME_TIME_S.contains(&late_s));
        let missing =
            self.echo.is_over() && (ahead < WRAP / 2 || pause_us >= REBOOT_SILENCE_S * 1e6);
        if !ran_on && !missing && !self.may_be_elsewhere {
            return None;
        }
        for anchor in self.anchors.iter_mut() {
            anchor.clock.reset();
        }
        if !ran_on {
            self.tag_clock.reset();
        }
        Some(t)
    }
}

/// Tag time of unwrapped ticks.
fn tag_time(ticks: i64) -> TagTime {
    // Never negative: the first packet begins one wrap ahead.
    TagTime::from_us((ticks as f64 * (1e6 / TICK_HZ)) as u64)
}

fn reason_of(loss: SnifferLoss) -> (DropReason, u64) {
    match loss {
        SnifferLoss::GarbageBytes(n) => (DropReason::TagGarbageByte, n as u64),
        SnifferLoss::BadLength => (DropReason::TagBadLength, 1),
        SnifferLoss::UnknownType => (DropReason::TagUnknownType, 1),
        SnifferLoss::BadPayload => (DropReason::TagBadPayload, 1),
        SnifferLoss::BadSource => (DropReason::TagBadSource, 1),
    }
}

/// Brings both protocols into one form.
#[inline]
fn read(frame: &SnifferFrame<'_>) -> Option<Packet> {
    let source = frame.source;
    let mut remotes = [Remote::default(); MAX_REMOTES];
    if frame.payload.first() == Some(&tdoa2::TYPE) {
        let packet = Tdoa2Packet::decode(frame.payload).ok()?;
        let own = usize::from(source);
        for (i, remote) in remotes.iter_mut().enumerate() {
            // The own entry, and one without a time (0), get no distance: they pair with nobody.
            let heard = i != own && packet.times[i] != 0;
            *remote = Remote {
                id: i as u8, // below 8
                counter: packet.counters[i],
                rx: packet.times[i],
                tof: heard.then_some(packet.tofs[i]),
            };
        }
        Some(Packet {
            source,
            counter: packet.counters.get(own)? & COUNTER_MASK,
            tx: *packet.times.get(own)?,
            remotes,
            remotes_len: MAX_REMOTES,
            tells_position: packet.position.is_some(),
        })
    } else {
        let packet = Tdoa3Packet::decode(frame.payload).ok()?;
        let heard = packet.remotes.as_slice();
        remotes.get_mut(..heard.len())?.copy_from_slice(heard);
        Some(Packet {
            source,
            counter: packet.counter & COUNTER_MASK,
            tx: packet.tx,
            remotes,
            remotes_len: heard.len(),
            tells_position: packet.position.is_some(),
        })
    }
}
