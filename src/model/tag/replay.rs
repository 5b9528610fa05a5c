//! What the tag heard in the last seconds, said again and again: ranging that is alive and old.
//!
//! A buffer that nobody fills any more, or somebody who recorded the bytes. Each new reception is replaced by
//! the next kept one, in their order and then from the first again, so that the rate stays what it was.

use std::collections::VecDeque;

use crate::faults::TagReplay;
use crate::tag::Reception;
use crate::tag::clock::TICKS_PER_US;

/// Longest stretch that can be said again, s: what is kept of every flight.
pub const MOST_REPLAY_S: f64 = 10.0;

/// A reception that was kept.
#[derive(Debug, Clone)]
struct Kept {
    rx_ticks: i64,
    path_m: f64,
    source: u8,
    payload: Vec<u8>,
}

/// Memory of the tag.
#[derive(Debug, Clone, Default)]
pub(super) struct Memory {
    kept: VecDeque<Kept>,
    said: Option<Said>,
}

/// Where a replay is.
#[derive(Debug, Clone, Copy)]
struct Said {
    place: usize,
    /// What a lap adds to the receive times, ticks, and how much it is by now.
    lap_ticks: i64,
    added_ticks: i64,
}

/// Time as ticks of the tag's clock.
fn ticks(s: f64) -> i64 {
    (s * 1e6 * TICKS_PER_US) as i64
}

impl Memory {
    /// From now on what was kept is said again, or what is heard.
    pub fn set(&mut self, replay: Option<TagReplay>) {
        let newest = self.kept.back().map(|k| k.rx_ticks);
        self.said = replay.zip(newest).map(|(replay, newest)| {
            self.forget_before(newest - ticks(replay.window_s));
            let first = self.kept.front().map_or(newest, |k| k.rx_ticks);
            // One gap more than lies between first and last, so that the laps do not touch.
            let gap = (newest - first) / self.kept.len().max(1) as i64;
            let lap_ticks = if replay.times_go_on { newest - first + gap } else { 0 };
            Said { place: 0, lap_ticks, added_ticks: lap_ticks }
        });
    }

    /// Passes on what the tag says when it has heard `r`.
    pub fn pass(&mut self, r: &Reception<'_>, write: impl FnOnce(&Reception<'_>)) {
        let Some(said) = &mut self.said else {
            self.keep(r);
            return write(r);
        };
        let Some(k) = self.kept.get(said.place) else { return };
        let rx_ticks = k.rx_ticks + said.added_ticks;
        said.place += 1;
        if said.place == self.kept.len() {
            said.place = 0;
            said.added_ticks += said.lap_ticks;
        }
        write(&Reception { rx_ticks, path_m: k.path_m, source: k.source, payload: &k.payload });
    }

    fn keep(&mut self, r: &Reception<'_>) {
        // The buffer of what is forgotten takes what is new: in the steady state nothing is allocated.
        let mut payload = self.forget_before(r.rx_ticks - ticks(MOST_REPLAY_S)).unwrap_or_default();
        payload.clear();
        payload.extend_from_slice(r.payload);
        let &Reception { rx_ticks, path_m, source, .. } = r;
        self.kept.push_back(Kept { rx_ticks, path_m, source, payload });
    }

    fn forget_before(&mut self, oldest_ticks: i64) -> Option<Vec<u8>> {
        let mut buffer = None;
        while self.kept.front().is_some_and(|k| k.rx_ticks < oldest_ticks) {
            buffer = self.kept.pop_front().map(|k| k.payload);
        }
        buffer
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Receive times and senders that the tag says for receptions each 0.1 s, of which the replay begins with
    /// the tenth.
    fn said(replay: TagReplay) -> Vec<(f64, u8)> {
        let mut memory = Memory::default();
        let mut out = Vec::new();
        for n in 0..20u8 {
            if n == 10 {
                memory.set(Some(replay));
            }
            let rx_ticks = ticks(0.1) * i64::from(n);
            let r = Reception { rx_ticks, path_m: 1.0, source: n, payload: &[n] };
            memory.pass(&r, |r| {
                assert_eq!(r.payload, [r.source]);
                out.push((r.rx_ticks as f64 / ticks(0.1) as f64, r.source));
            });
        }
        out
    }

    #[test]
    fn prop_the_last_stretch_comes_again_and_again() {
        let again = said(TagReplay { window_s: 0.3, times_go_on: false });
        let sources: Vec<u8> = again.iter().map(|(_, source)| *source).collect();
        assert_eq!(sources[..10], [0, 1, 2, 3, 4, 5, 6, 7, 8, 9]);
        assert_eq!(sources[10..], [6, 7, 8, 9, 6, 7, 8, 9, 6, 7]);
        assert!(again.iter().all(|(t, source)| (t - f64::from(*source)).abs() < 1e-6), "{again:?}");
    }

    #[test]
    fn prop_times_may_go_on() {
        let again = said(TagReplay { window_s: 0.3, times_go_on: true });
        assert!(again.windows(2).all(|w| w[1].0 > w[0].0 + 0.5), "{again:?}");
        assert!(again.last().is_some_and(|(t, _)| (t - 19.0).abs() < 2.0), "{again:?}");
    }
}
