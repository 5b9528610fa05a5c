//! UWB: from the bytes of the tag to time differences of arrival.
//!
//! [`TdoaEngine`] reads the sniffer's stream and computes TDOA itself; [`MavTag`] takes them from a
//! tag that does so on board. Both put the tag's time on the host's clock with [`TagClock`].

mod anchor_clock;
mod echo;
mod engine;
mod mav_tag;
mod tag_clock;

#[cfg(test)]
mod air;
#[cfg(test)]
mod tests;

pub use engine::{AnchorHeard, TdoaEngine};
pub use mav_tag::{MavTag, from_uwb_tdoa};
pub use tag_clock::TagClock;

/// A tag that reboots is silent for at least so long, s: USB enumerates anew, and its text needs the command that asks
/// for binary. A time that goes back within a shorter pause is not that of a tag.
const REBOOT_SILENCE_S: f64 = 0.3;

haltere_core::keys! {
    /// Section `[uwb]` of the configuration.
    pub struct UwbConfig {
        /// Most time differences from one packet.
        ///
        /// Those with the most recently heard anchors come first. All of them share the noise of the same arrival, so more than two adds little. One is too few where anchors
        /// of one layer speak in turn, as in TDoA 2: height then hangs on the few pairs that join two layers.
        // In TDoA 2 only two pairs in eight corners join a low anchor to a high one: with one pair, height hangs on the
        // path bias of those two.
        // In the simulated hall, over 17 seeds, 0.042 m of height error with one, 0.031 m with
        // two, 0.029 m with three, 0.028 m with seven.
        pairs_per_packet: u8 = 2, [1.0..=7.0], UWB_PAIRS(181, Restart);
        /// A time difference may exceed the distance between its anchors by this much.
        ///
        /// Noise and bias at the end of the baseline.
        impossible_margin_m: f64 = 1.0, [0.1..=5.0, "m"], UWB_MARGIN(182, Restart);
        /// An arrival this far from where its anchor's clock predicts it is not used.
        ///
        /// Arrivals behind an obstacle come late by up to a metre and are left to the filter's gate.
        clock_gate_m: f64 = 1.5, [0.5..=10.0, "m"], UWB_CLOCK_GATE(183, Restart);
        /// Least time from the antenna to our read call.
        ///
        /// It cannot be seen in one-way stamps.
        tag_latency_s: f64 = 0.0, [0.0..=0.1, "s"], UWB_LATENCY(184, Restart);
    }
}
