//! The UWB system at time-stamp level: anchors with their own clocks that hear one another, and the
//! tag, a passive sniffer on a serial port.
//!
//! ```text
//! X_n   sending time, anchor n's clock, a multiple of 512 ticks as the radio demands
//! T_n = C_tag( X_n + ρ/c + A )      RX_mn = C_m( X_n + d_mn/c + A )      tof_mn = d_mn/c + A
//! ```
//! `C` clocks, `ρ`, `d` paths with whatever the effects add to them (m), `A` the antenna delays that
//! these devices leave in every time of flight (ticks). The tag's place is taken at the time of
//! reception. Source: INTERFACES.md section 1. Left out: collisions, ranging traffic, antenna
//! patterns.

pub mod air;
pub mod anchors;
pub mod clock;
mod port;
mod replay;

pub use anchors::Anchors;
pub use port::Port;
pub use replay::MOST_REPLAY_S;

use serde::{Deserialize, Serialize};

/// What is on the air and on the wire.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum TagProtocol {
    /// Anchors 0 to 7 in turn, sniffer bytes.
    #[default]
    Tdoa2,
    /// Any anchors at random times, sniffer bytes.
    Tdoa3,
    /// TDoA2 on the air, a tag that computes TDOA itself and sends `UWB_TDOA`.
    Mavlink,
}

/// One packet as the tag received it.
#[derive(Debug, Clone)]
pub struct Reception<'a> {
    /// Receive time, tag's clock, ticks, not wrapped.
    pub rx_ticks: i64,
    /// Path with everything that the effects added, m.
    pub path_m: f64,
    /// Id of the sender.
    pub source: u8,
    /// Payload.
    pub payload: &'a [u8],
}

#[cfg(test)]
mod tests;
