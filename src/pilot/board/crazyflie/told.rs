//! What the board has told, in our frames and on the host's clock.

use haltere_dialect::crtp::loco::AnchorPosition;

use haltere_core::frames::{B, E, Rot};
use haltere_core::measure::{BaroSample, BatterySample, ImuSample, ServoOutput, Tdoa};
use haltere_core::time::HostTime;

use super::setup::ANCHORS;

/// One thing that it told.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Told {
    Imu(ImuSample),
    Attitude {
        valid_at: HostTime,
        attitude: Rot<E, B>,
    },
    Battery(BatterySample),
    Servos(ServoOutput),
    Baro(BaroSample),
    Tdoa(Tdoa),
    /// Where the anchors say they are.
    Anchors([Option<AnchorPosition>; ANCHORS as usize]),
    /// A row was so old when it came, s.
    Age(f64),
    /// A question was answered after so long, s.
    Trip(f64),
    /// The setpoint in force, and thrust.
    Target(Rot<E, B>, f64),
    /// Whether it is armed by us; where it arms by itself, whether our thrust reaches it.
    Armed(bool),
    /// Of our order.
    ArmAnswer {
        arm: bool,
        accepted: bool,
        why: String,
    },
    /// Its clock began anew.
    Restarted,
    /// So many rows were lost.
    Lost(u64),
    /// What the link has to tell people.
    Notice {
        warning: bool,
        text: String,
    },
    /// What the board has to tell them, by MAVLink's severity.
    Text {
        severity: u8,
        text: String,
    },
}

impl Told {
    /// A warning of the link.
    pub fn warning(text: impl Into<String>) -> Self {
        Self::Notice { warning: true, text: text.into() }
    }
}
