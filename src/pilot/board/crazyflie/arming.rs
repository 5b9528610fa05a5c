//! Armed or not, and the orders that change it.
//!
//! A build that wants to be armed is ordered to. One that arms by itself is hot as soon as its checks pass, and a disarm
//! in the air stops its motors for 0.2 s only (seen with crazyflie-firmware 2a18fc29): there armed means that our thrust
//! is passed on, the gate is open. Without it zeros are sent. A disarm shuts the gate at once; a board that was armed is
//! disarmed when it has seen that it does not fly any more: older firmware locks itself otherwise.

use haltere_dialect::crtp::ToBoard;
use haltere_dialect::crtp::localization::Localization;
use haltere_dialect::crtp::platform::PlatformRequest;
use haltere_dialect::crtp::supervisor::{SupervisorBits as Bits, SupervisorRequest};

use haltere_core::time::HostTime;

use super::told::Told;

/// First protocol with a port of the supervisor (578a53fc).
const PORT_9: u32 = 12;
/// An order is sent again after this, µs, and given up after that, s.
const AGAIN_US: i64 = 400_000;
const PATIENCE_S: f64 = 5.0;
/// A board that cannot fly for so long is not armed any more, s: twice the 0.2 s after which one armed itself again.
const GONE_S: f64 = 0.4;
/// Motors that still turn so long after a forced disarm are not ours to stop, s.
const STILL_TURNS_S: f64 = 0.5;

#[derive(Debug, Clone, Copy)]
struct Order {
    arm: bool,
    force: bool,
    since: HostTime,
    next_at: HostTime,
    tries: u32,
}

/// Gate and order.
#[derive(Debug, Default)]
pub(crate) struct Arming {
    /// Our thrust is passed on.
    open: bool,
    order: Option<Order>,
    bits: Option<(Bits, HostTime)>,
    could_fly_at: Option<HostTime>,
    /// A forced disarm, and whether it has been looked after.
    forced_at: Option<HostTime>,
    /// It flies, or may still think so, by our thrust.
    ours: bool,
}

impl Arming {
    /// Whether our thrust is passed on.
    pub fn is_open(&self) -> bool {
        self.open
    }

    /// Whether setpoints may be sent: not into a flight that somebody else began.
    pub fn may_send(&self) -> bool {
        self.ours || self.bits.is_some_and(|(bits, _)| !bits.contains(Bits::FLYING))
    }

    /// Newest bits.
    pub fn bits(&self) -> Option<Bits> {
        self.bits.map(|(bits, _)| bits)
    }

    /// Whether it flies by our thrust, as far as is known.
    pub fn flies(&self) -> bool {
        self.open && self.bits().is_some_and(|bits| bits.contains(Bits::FLYING))
    }

    pub fn is_under_way(&self) -> bool {
        self.order.is_some()
    }

    /// It has restarted, or is another one: nothing of it is known.
    pub fn forget(&mut self) {
        *self = Self { order: self.order, ..Self::default() };
    }

    /// It is disarmed, whoever did it.
    pub fn shut(&mut self) {
        self.open = false;
    }

    /// An order.
    pub fn begin(&mut self, arm: bool, force: bool, at: HostTime) {
        if !arm {
            self.open = false;
            self.forced_at = force.then_some(at);
        }
        self.order = Some(Order { arm, force, since: at, next_at: at, tries: 0 });
    }

    /// Bits of a row.
    pub fn look(&mut self, at: HostTime, bits: Bits, told: &mut Vec<Told>) {
        let before = self.bits().unwrap_or_default();
        self.bits = Some((bits, at));
        if bits.contains(Bits::CAN_FLY) {
            self.could_fly_at = Some(at);
        } else if self.open && before.contains(Bits::CAN_FLY | Bits::AUTO_ARM) {
            told.push(Told::warning(
                "board stopped its motors: somebody disarmed it, or it cut them",
            ));
        }
        self.ours = self.open || (self.ours && bits.contains(Bits::FLYING));
        for (bit, severity, text) in BAD {
            if bits.contains(bit) && !before.contains(bit) {
                told.push(Told::Text { severity, text: text.to_owned() });
            }
        }
        told.push(Told::Armed(self.says_armed(at, bits)));
    }

    fn says_armed(&self, at: HostTime, bits: Bits) -> bool {
        if bits.contains(Bits::AUTO_ARM) {
            let lately = |t| at.seconds_since(t) < GONE_S;
            self.open && self.could_fly_at.is_some_and(lately)
        } else {
            bits.contains(Bits::ARMED)
        }
    }

    /// The board's answer to an order.
    pub fn answered(&mut self, done: bool) {
        if let (Some(order), false) = (&mut self.order, done) {
            // It is asked again, for as long as its checks may take.
            order.next_at = order.next_at.offset_us(AGAIN_US);
        }
    }

    /// What is due: the order to be sent.
    pub fn tick(
        &mut self,
        at: HostTime,
        protocol: Option<u32>,
        turns: bool,
        told: &mut Vec<Told>,
    ) -> Option<ToBoard<'static>> {
        if self.forced_at.is_some_and(|t| at.seconds_since(t) > STILL_TURNS_S) {
            self.forced_at = None;
            if turns {
                let text = "motors still turn after a forced disarm: emergency stop, the board is locked until it \
                            is switched off and on";
                told.push(Told::warning(text));
                return Some(ToBoard::Localization(Localization::EmergencyStop));
            }
        }
        let (order, bits) = (self.order?, self.bits().unwrap_or_default());
        let auto = bits.contains(Bits::AUTO_ARM);
        let done = match (order.arm, auto) {
            (true, true) => bits.contains(Bits::CAN_FLY),
            (true, false) => bits.contains(Bits::ARMED | Bits::CAN_FLY),
            (false, true) => true,
            (false, false) => !bits.contains(Bits::ARMED),
        };
        if done || at.seconds_since(order.since) > PATIENCE_S {
            self.open = done && order.arm;
            self.ours |= self.open;
            self.order = None;
            let why = if done { String::new() } else { self.why_not(order.arm, bits) };
            told.push(Told::Armed(self.says_armed(at, bits)));
            told.push(Told::ArmAnswer { arm: order.arm, accepted: done, why });
            return None;
        }
        let waits = !order.arm && !order.force && bits.contains(Bits::FLYING);
        if auto || waits || at < order.next_at {
            return None;
        }
        self.order =
            Some(Order { next_at: at.offset_us(AGAIN_US), tries: order.tries + 1, ..order });
        // Every firmware knows the older order still: where the newer one is not answered it follows.
        let newer = protocol.is_some_and(|number| number >= PORT_9) && order.tries % 2 == 0;
        Some(if newer {
            ToBoard::Supervisor(SupervisorRequest::Arm(order.arm))
        } else {
            ToBoard::Platform(PlatformRequest::Arm(order.arm))
        })
    }

    fn why_not(&self, arm: bool, bits: Bits) -> String {
        match refusal(bits) {
            Some(why) if arm => why.to_owned(),
            _ if arm => "board does not arm: look at its console with cfclient".to_owned(),
            _ => "board stays armed".to_owned(),
        }
    }

    /// Why it must not be armed.
    pub fn refusal(&self) -> Option<&'static str> {
        let Some(bits) = self.bits() else {
            return Some("board does not tell its supervisor's state yet");
        };
        if bits.contains(Bits::FLYING) && !self.ours {
            return Some("board flies, but not by us");
        }
        refusal(bits)
    }
}

/// What ends or forbids a flight: the bit, its severity when it appears, its words.
const BAD: [(Bits, u8, &str); 4] = [
    (Bits::LOCKED, 2, "locked, motors stay off: switch the board off and on"),
    (Bits::CRASHED, 2, "has crashed, motors stay off: stand it upright, then switch it off and on"),
    (Bits::TUMBLED, 4, "lies on its side or back: stand it upright"),
    (
        Bits::DECK_FAULT,
        2,
        "a deck does not answer, motors are cut: look at the Loco deck, then switch the board off and on",
    ),
];

fn refusal(bits: Bits) -> Option<&'static str> {
    if let Some((_, _, text)) = BAD.iter().find(|(bit, _, _)| bits.contains(*bit)) {
        return Some(text);
    }
    let ready = if bits.contains(Bits::AUTO_ARM) {
        bits.contains(Bits::CAN_FLY)
    } else {
        bits.intersects(Bits::CAN_BE_ARMED | Bits::ARMED)
    };
    (!ready)
        .then_some("board is not ready, its own checks have not passed: stand it level and still")
}
