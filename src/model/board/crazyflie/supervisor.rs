//! Whether the motors may run: the board's supervisor, with the times at which it was seen to change its mind.
//!
//! Seen with crazyflie-firmware 2a18fc29 in its configurations `cf2`, `bolt` and `flapper`: one step each 40 ms, so
//! that a disarm in the air of a board that arms by itself reads 0x204, 0x207, 0x206, 0x20E, 0x21E within 0.24 s.

use haltere_dialect::crtp::supervisor::SupervisorBits as Bits;

/// Time between two looks, µs: 25 Hz.
const LOOK_US: u64 = 40_000;
/// A setpoint older than this is flown level, µs …
pub(super) const LEVEL_US: u64 = 500_000;
/// … and one older than this cuts the motors and locks the board, µs.
pub(super) const CUT_US: u64 = 2_000_000;
/// Without thrust for so long it has landed, µs.
const LANDED_US: u64 = 2_000_000;
/// Where arming is asked for: armed and not flying for so long, or landed for so long, it disarms, µs.
const NOT_FLYING_US: u64 = 30_000_000;
const LANDED_DISARM_US: u64 = 3_000_000;
/// Tumbled: specific force along body up below the first for the second, g and µs (those of the Flapper; the other
/// configurations have limits of their own, which nobody here has seen).
const TUMBLED: [(f64, u64); 2] = [(0.0, 2_000_000), (-0.5, 200_000)];

/// Which build of the firmware.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Build {
    /// Of the Flapper: arms by itself.
    #[default]
    Flapper,
    /// Of a Crazyflie 2.x: arms by itself.
    Cf2,
    /// Of a Bolt: wants to be armed.
    Bolt,
}

impl Build {
    /// Whether it arms by itself.
    pub fn auto_arms(self) -> bool {
        self != Self::Bolt
    }
}

/// Where it is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum At {
    /// Just started or disarmed: checks are to come.
    Unchecked,
    /// It would let itself be armed.
    Checked,
    /// Armed, and not yet ready.
    Arming,
    Ready,
    Flying,
    /// Setpoints are old: level.
    Level,
    /// Motors cut in the air.
    Falling,
    Crashed,
    Locked,
}

/// What it looks at.
pub(super) struct Look {
    /// Since the board's start, µs.
    pub now_us: u64,
    /// Of the newest setpoint, µs.
    pub age_us: u64,
    /// The mixer is told to give thrust.
    pub thrust: bool,
    /// Specific force along body up, g.
    pub up_g: f64,
    pub deck_fault: bool,
}

/// The supervisor.
pub(super) struct Supervisor {
    build: Build,
    at: At,
    armed: bool,
    tumbled: bool,
    tumbling_us: [u64; 2],
    deck_fault: bool,
    stopped: bool,
    next_us: u64,
    /// When there was thrust last, and since when it is where it is, µs.
    thrust_us: Option<u64>,
    since_us: u64,
}

impl Supervisor {
    pub fn new(build: Build) -> Self {
        Self {
            build,
            at: At::Unchecked,
            armed: false,
            tumbled: false,
            tumbling_us: [0; 2],
            deck_fault: false,
            stopped: false,
            next_us: LOOK_US,
            thrust_us: None,
            since_us: 0,
        }
    }

    /// Motors obey setpoints.
    pub fn can_fly(&self) -> bool {
        matches!(self.at, At::Ready | At::Flying | At::Level) && self.armed && !self.stopped
    }

    /// Tilt and yaw rate of setpoints are not obeyed any more, their thrust is.
    pub fn is_level(&self) -> bool {
        self.at == At::Level
    }

    pub fn is_armed(&self) -> bool {
        self.armed
    }

    pub fn is_tumbled(&self) -> bool {
        self.tumbled
    }

    /// `(done, armed)`.
    pub fn arm(&mut self, arm: bool) -> (bool, bool) {
        let done = if arm { self.armed || self.at == At::Checked } else { true };
        if done {
            self.armed = arm;
        }
        (done, self.armed)
    }

    /// `(done, recovered)`: where it has crashed and stands upright again.
    pub fn recover(&mut self) -> (bool, bool) {
        let done = self.at == At::Crashed && !self.tumbled;
        if done {
            self.at = At::Unchecked;
        }
        (done || self.at != At::Crashed, self.at != At::Crashed)
    }

    /// Cuts at once; the lock follows.
    pub fn emergency_stop(&mut self) {
        (self.stopped, self.armed) = (true, false);
    }

    /// It has crashed into something.
    pub fn crash(&mut self) {
        if self.at != At::Locked {
            (self.at, self.armed) = (At::Crashed, false);
        }
    }

    pub fn bits(&self) -> Bits {
        let mut bits = Bits::PLANNER_FINISHED;
        bits.set(Bits::CAN_BE_ARMED, self.at == At::Checked);
        bits.set(Bits::ARMED, self.armed);
        bits.set(Bits::AUTO_ARM, self.build.auto_arms());
        bits.set(Bits::CAN_FLY, self.can_fly());
        bits.set(Bits::FLYING, matches!(self.at, At::Flying | At::Level) && self.armed);
        bits.set(Bits::TUMBLED, self.tumbled);
        bits.set(Bits::LOCKED, self.at == At::Locked);
        bits.set(Bits::CRASHED, self.at == At::Crashed);
        bits.set(Bits::DECK_FAULT, self.deck_fault);
        bits
    }

    /// Looks, where it is time for it. `true`: it has just locked itself.
    pub fn look(&mut self, look: &Look) -> bool {
        if look.now_us < self.next_us {
            return false;
        }
        self.next_us += LOOK_US;
        self.deck_fault = look.deck_fault;
        if look.thrust {
            self.thrust_us = Some(look.now_us);
        }
        for ((limit_g, _), below_us) in TUMBLED.iter().zip(&mut self.tumbling_us) {
            *below_us = if look.up_g < *limit_g { *below_us + LOOK_US } else { 0 };
        }
        self.tumbled =
            TUMBLED.iter().zip(self.tumbling_us).any(|((_, most_us), us)| us >= *most_us);
        let before = self.at;
        self.at = self.next(look);
        if self.at != before {
            self.since_us = look.now_us;
        }
        if matches!(self.at, At::Falling | At::Locked | At::Crashed | At::Unchecked) {
            self.armed = false;
        }
        self.at == At::Locked && before != At::Locked
    }

    fn next(&mut self, look: &Look) -> At {
        let in_air = matches!(self.at, At::Flying | At::Level);
        if self.stopped {
            return At::Locked;
        }
        match self.at {
            At::Locked | At::Crashed => self.at,
            // Disarmed in the air; anything else that cuts there locks.
            At::Falling if look.deck_fault || look.age_us >= CUT_US => At::Locked,
            At::Falling => At::Unchecked,
            _ if in_air && self.tumbled && self.at == At::Level => At::Locked,
            _ if in_air && self.tumbled => At::Crashed,
            _ if in_air && (!self.armed || look.deck_fault || look.age_us >= CUT_US) => At::Falling,
            At::Flying if look.age_us >= LEVEL_US => At::Level,
            At::Level if look.age_us < LEVEL_US => At::Flying,
            At::Level => At::Level,
            At::Flying if self.since_thrust_us(look) > LANDED_US => At::Ready,
            At::Flying => At::Flying,
            _ if self.tumbled || look.deck_fault => At::Unchecked,
            At::Unchecked => {
                self.armed = false;
                At::Checked
            }
            At::Checked if self.armed => At::Arming,
            At::Checked => At::Checked,
            At::Arming => At::Ready,
            At::Ready if !self.armed => At::Unchecked,
            At::Ready if look.thrust => At::Flying,
            At::Ready if !self.build.auto_arms() && self.is_idle(look) => At::Unchecked,
            At::Ready => At::Ready,
        }
    }

    /// What follows a look at once: it arms by itself.
    pub fn arm_by_itself(&mut self) {
        if self.at == At::Checked && self.build.auto_arms() {
            self.armed = true;
        }
    }

    fn since_thrust_us(&self, look: &Look) -> u64 {
        self.thrust_us.map_or(u64::MAX, |at_us| look.now_us.saturating_sub(at_us))
    }

    fn is_idle(&self, look: &Look) -> bool {
        let most_us = if self.thrust_us.is_some() { LANDED_DISARM_US } else { NOT_FLYING_US };
        look.now_us.saturating_sub(self.since_us) >= most_us
    }
}
