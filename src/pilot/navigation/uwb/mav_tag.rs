//! A tag that computes TDOA itself and sends `UWB_TDOA`.

use haltere_dialect::mav::haltere::UWB_TDOA_DATA;

use super::{REBOOT_SILENCE_S, TagClock, UwbConfig};
use haltere_core::drops::{DropReason, Drops};
use haltere_core::measure::{AnchorId, Tdoa};
use haltere_core::survey::Survey;
use haltere_core::time::{HostTime, TagTime};

/// A tag's time that falls behind by more means a reboot, µs. Its messages come in order.
const REBOOT_US: u64 = 1_000_000;

/// A reordered or repeated message is at most this far behind in sequence.
const REORDERED: u16 = 64;

/// Later is no time, µs: 285 years, the last that `f64` counts in whole microseconds.
const LATEST_US: u64 = 1 << 53;

/// What must be remembered of such a tag.
#[derive(Debug, Clone, Default)]
pub struct MavTag {
    clock: TagClock,
    last: Option<(u16, u64)>,
    heard_at: Option<HostTime>,
    /// Whether the tag may have rebooted since the last message that was taken.
    may_be_elsewhere: bool,
    /// Whether the newest message's time or number was before the stream's.
    backwards: bool,
    /// Whether the newest message came far later than such messages once did.
    old: bool,
}

impl MavTag {
    /// Nothing heard yet.
    pub fn new() -> Self {
        Self::default()
    }

    /// The map from the tag's time to ours.
    pub fn clock(&self) -> &TagClock {
        &self.clock
    }

    /// The tag was connected anew: its time and numbers may begin elsewhere.
    pub fn reconnected(&mut self) {
        self.may_be_elsewhere = true;
        if std::mem::take(&mut self.old) {
            self.clock.reset();
        }
    }

    /// Whether what comes is old: nothing of it is used.
    pub fn is_old(&self) -> bool {
        self.old
    }

    /// Whether its time or numbers run backwards though it cannot have rebooted: nothing of it is used.
    pub fn is_played_again(&self) -> bool {
        self.backwards
    }

    /// Counts what the tag produced and we did not get; `Err` for a repeated message, and for a stream that goes
    /// backwards. Time and number of a tag go forward together, but where it has rebooted.
    fn follow(
        &mut self,
        sequence: u16,
        time_us: Option<u64>,
        received_at: HostTime,
        drops: &mut Drops,
    ) -> Result<(), DropReason> {
        let silent_s = self.heard_at.replace(received_at).map(|t| received_at.seconds_since(t));
        self.may_be_elsewhere |= silent_s.is_none_or(|s| s >= REBOOT_SILENCE_S);
        let (last_sequence, last_us) = self.last.unwrap_or((sequence.wrapping_sub(1), 0));
        let time_us = time_us.unwrap_or(last_us);
        let steps = sequence.wrapping_sub(last_sequence);
        let back = steps > u16::MAX / 2;
        let rebooted = self.may_be_elsewhere && last_us.saturating_sub(time_us) > REBOOT_US;
        let reordered = steps > u16::MAX - REORDERED && time_us <= last_us;
        if !rebooted && (steps == 0 || reordered) {
            return Err(DropReason::UwbDuplicate);
        }
        self.backwards = (time_us < last_us || back) && !self.may_be_elsewhere;
        if self.backwards {
            return Err(DropReason::UwbClockJump);
        }
        if rebooted {
            self.clock.reset();
        } else if !back {
            drops.add(DropReason::MavSequenceGap, u64::from(steps.saturating_sub(1)));
        }
        self.may_be_elsewhere = false;
        self.last = Some((sequence, time_us));
        Ok(())
    }
}

/// The measurement in a `UWB_TDOA`. Gaps of its sequence are added to `drops` here; the reason of
/// a refusal is for the caller to count.
pub fn from_uwb_tdoa(
    tag: &mut MavTag,
    config: &UwbConfig,
    survey: &Survey,
    received_at: HostTime,
    message: &UWB_TDOA_DATA,
    drops: &mut Drops,
) -> Result<Tdoa, DropReason> {
    let sane_time = message.time_usec <= LATEST_US;
    let time_us = sane_time.then_some(message.time_usec);
    tag.follow(message.sequence, time_us, received_at, drops)?;
    let distance_diff_m = f64::from(message.distance_diff);
    let std_m = Some(f64::from(message.std)).filter(|std_m| !std_m.is_nan());
    let bad_std = std_m.is_some_and(|std_m| !(std_m > 0.0 && std_m.is_finite()));
    if !distance_diff_m.is_finite() || bad_std || !sane_time {
        return Err(DropReason::BadValue);
    }
    let (anchor_a, anchor_b) = (AnchorId(message.anchor_a), AnchorId(message.anchor_b));
    if anchor_a == anchor_b {
        return Err(DropReason::BadValue);
    }
    let (Some(a), Some(b)) = (survey.position_E_m(anchor_a), survey.position_E_m(anchor_b)) else {
        return Err(DropReason::UwbUnknownAnchor);
    };
    if distance_diff_m.abs() > (b - a).norm() + config.impossible_margin_m {
        return Err(DropReason::UwbImpossible);
    }
    let time = TagTime::from_us(message.time_usec);
    tag.clock.observe(time, received_at);
    tag.old = tag.clock.is_old(time, received_at);
    if tag.old {
        return Err(DropReason::UwbTooOld);
    }
    let latency_us = (config.tag_latency_s * 1e6).round() as i64;
    let valid_at = tag.clock.host(time).unwrap_or(received_at).min(received_at);
    Ok(Tdoa {
        valid_at: valid_at.offset_us(-latency_us),
        received_at,
        anchor_a,
        anchor_b,
        distance_diff_m,
        std_m,
    })
}

#[cfg(test)]
mod tests {
    use super::super::air;
    use super::*;

    #[test]
    fn prop_gaps_are_counted_and_nonsense_refused() {
        let (config, survey) = (UwbConfig::default(), air::survey());
        let mut tag = MavTag::new();
        let mut drops = Drops::default();
        let good = UWB_TDOA_DATA {
            time_usec: 5_000_000,
            distance_diff: 0.5,
            std: f32::NAN,
            sequence: u16::MAX,
            anchor_a: 0,
            anchor_b: 7,
        };
        let mut take = |message: UWB_TDOA_DATA, at_us| {
            let at = HostTime::from_us(at_us);
            from_uwb_tdoa(&mut tag, &config, &survey, at, &message, &mut drops)
        };
        let first = take(good.clone(), 1_000).unwrap();
        assert_eq!((first.std_m, first.distance_diff_m), (None, 0.5));
        assert_eq!((first.anchor_a, first.anchor_b), (AnchorId(0), AnchorId(7)));
        assert_eq!(take(good.clone(), 1_010), Err(DropReason::UwbDuplicate));
        let mut next = 0u16;
        let mut check = |change: &dyn Fn(&mut UWB_TDOA_DATA), reason| {
            let mut message = good.clone();
            message.time_usec += 2_000 * (u64::from(next) + 1);
            message.sequence = next;
            next += 1;
            change(&mut message);
            assert_eq!(take(message, 1_010 + 2_000 * u64::from(next)).map(|_| ()), reason);
        };
        check(&|m| m.distance_diff = f32::NAN, Err(DropReason::BadValue));
        check(&|m| m.std = -1.0, Err(DropReason::BadValue));
        check(&|m| m.anchor_b = 0, Err(DropReason::BadValue));
        check(&|m| m.time_usec = 1 << 60, Err(DropReason::BadValue));
        check(&|m| m.anchor_b = 77, Err(DropReason::UwbUnknownAnchor));
        check(&|m| m.distance_diff = 99.0, Err(DropReason::UwbImpossible));
        // Gap of ten, then a reboot: no gap.
        check(&|m| m.sequence += 10, Ok(()));
        check(&|m| (m.sequence, m.time_usec) = (0, 100), Err(DropReason::UwbDuplicate));
        assert_eq!(drops.count(DropReason::MavSequenceGap), 10);
    }

    /// Replayed bytes: the same messages again, with and without times that somebody makes to grow.
    #[test]
    fn regress_a_stream_that_is_played_again_is_not_taken() {
        for (times_grow, numbers_grow) in [(false, false), (true, false), (false, true)] {
            let (config, survey) = (UwbConfig::default(), air::survey());
            let (mut tag, mut drops) = (MavTag::new(), Drops::default());
            let mut take = |tag: &mut MavTag, n: u64, lap: u64, host_ms: u64| {
                let again = |grow: bool| if grow { lap * 500 } else { 0 };
                let message = UWB_TDOA_DATA {
                    time_usec: 9_000_000 + 2_000 * (n + again(times_grow)),
                    distance_diff: 0.5,
                    std: f32::NAN,
                    sequence: (n + again(numbers_grow)) as u16,
                    anchor_a: 0,
                    anchor_b: 7,
                };
                let at = HostTime::from_us(1_000_000 + 1_000 * host_ms);
                from_uwb_tdoa(tag, &config, &survey, at, &message, &mut drops).is_ok()
            };
            assert!((0..500).all(|n| take(&mut tag, n, 0, 2 * n)));
            for lap in 1..4 {
                let taken =
                    (0..400).filter(|n| take(&mut tag, *n, lap, 1_000 * lap + 2 * n)).count();
                assert_eq!(taken, 0, "times grow {times_grow}, numbers grow {numbers_grow}");
                assert!(tag.is_played_again());
            }
            // A tag that was connected anew may begin anywhere.
            tag.reconnected();
            assert!(take(&mut tag, 0, 0, 4_500));
        }
    }
}
