//! After a pause in which the board gave up on our setpoints: nobody here knows where the vehicle is.
//!
//! A program that was stopped, a computer that stood still or a cable that was out: the board has levelled and sunk by
//! itself meanwhile, and may stand on the floor with its motors running. What we know is from before. The samples that
//! waited to be read are from its beginning, and look as if they came now. So the vehicle comes down without the
//! estimate, with no more than hover thrust, until UWB and IMU *measured after the pause* make a good estimate again;
//! and where it may stand already, the floor is felt for at once, from a thrust that does not lift it off.
//! A fall counts as flying only until it was made up for: a hop of 2 cm ends with one as well. What may have come to stand
//! keeps that thrust when place and height are heard anew.
//!
//! How far it may have sunk: `v t + ½ a t²`, with the speed v that it had, from the board's time-out on.

use haltere_core::time::HostTime;

use super::Flight;
use super::modes::Mode;
use super::supervisor::Descent;
use crate::navigation::Navigation;
use crate::view::Around;
use crate::wish::Wish;

/// Acceleration with which a board that gave up may sink, m/s²: 0.82 of the thrust that hovers (the generic board) leave
/// 1.8, and drag is left out.
const SINKS_MPS2: f64 = 2.0;
/// Lower than this it may stand, m: near the floor multipath biases the height by up to half a metre.
const MAY_STAND_BELOW_M: f64 = 0.8;
/// A barometer that says so much after the pause says that it does not, m: multipath and draughts move pressure and its
/// zero by half a metre each.
const BARO_SAYS_AIR_M: f64 = 1.2;
/// Thrust that does not lift a standing vehicle off, as a share of the base: the ground effect adds a fifth at most.
const STANDING_SHARE: f64 = 0.75;
/// What is sent at most so near the floor, over the thrust that hovers, where no fall has just shown that it flies …
const LOW_SHARE: f64 = 0.82;
/// … within this time, s.
const FLIES_S: f64 = 0.3;
/// The vertical velocity is known again when one sigma of it is below this, m/s: a third of what nothing known is.
const STD_VEL_MPS: f64 = 0.5;
/// What ends within this time of a pause and is no longer than it by more is the same one, s.
const SAME_S: f64 = 0.2;
/// UWB and IMU as new as this are heard, s …
const NEW_S: f64 = 0.1;
/// … and have to be for this long, s. A descent becomes a landing 0.3 s after that, and a filter that knew nothing has
/// its velocity again after 0.2 s of UWB.
const HEARD_FOR_S: f64 = 0.1;
/// Sinking speed after a pause, m/s, at most: the largest with which such a descent may begin. Too large brakes, with no
/// more than hover thrust.
const SINK_MOST_MPS: f64 = 1.5;

/// What is known after a pause.
#[derive(Debug, Default)]
pub(crate) struct Resumption {
    /// When the pause ended, while place and height have not been heard anew; and its length, s.
    pause: Option<(HostTime, f64)>,
    /// The lowest height that it may have sunk to meanwhile, m, and its speed then, m/s.
    lowest_m: f64,
    sink_mps: f64,
    /// When the newest fused UWB was true.
    uwb_at: Option<HostTime>,
    /// Height by the barometer after the pause, m.
    baro_m: Option<f64>,
    /// Since when everything is heard anew.
    heard_since: Option<HostTime>,
}

impl Resumption {
    /// Whether place and height have not been heard anew, and how long the pause was, s.
    pub fn pending_s(&self) -> Option<f64> {
        self.pause.map(|(_, pause_s)| pause_s)
    }

    /// Whether it may be so near the floor that it stands.
    fn may_stand(&self) -> bool {
        self.pause.is_some()
            && self.lowest_m < MAY_STAND_BELOW_M
            && self.baro_m.is_none_or(|m| m < BARO_SAYS_AIR_M)
    }

    /// Whether something was measured before or in the pause from which it has just come back.
    pub fn is_before_its_end(&self, valid_at: HostTime) -> bool {
        self.pause.is_some_and(|(end, _)| valid_at <= end)
    }

    /// A measurement was fused that was true at this time.
    pub fn uwb(&mut self, valid_at: HostTime) {
        self.uwb_at = self.uwb_at.max(Some(valid_at));
    }

    /// Where a descent begins, as far as it was measured after the pause: height above the floor, m, and sinking speed, m/s.
    pub fn descends_from(&self, known_m: f64) -> Option<(f64, f64)> {
        self.pause.map(|_| (self.baro_m.unwrap_or(known_m), self.sink_mps))
    }
}

impl Flight {
    /// A barometric height above the floor, m. The first after a pause is the newest height that was measured: a descent
    /// goes on from there.
    pub(crate) fn resume_at_height(&mut self, valid_at: HostTime, height_m: f64) {
        let after = self.resumption.pause.is_some_and(|(end, _)| valid_at > end);
        if after && self.resumption.baro_m.replace(height_m).is_none() && self.mode == Mode::Descend
        {
            self.supervisor.descent = Descent::begin(height_m, self.resumption.sink_mps);
        }
    }

    /// Thrust with which a vehicle stays down that may stand since a pause.
    pub(crate) fn standing_ceiling_frac(&self) -> Option<f64> {
        self.resumption.may_stand().then_some(STANDING_SHARE * self.control.thrust_base_frac)
    }

    /// The board may not have heard us for so long.
    pub(crate) fn note_pause(&mut self, around: &Around<'_>, pause_s: f64, wishes: &mut Vec<Wish>) {
        let at = around.at;
        let alone_s = pause_s - around.board.link.gives_up_s();
        // Our own pause and the board's silence are one, and are found one after the other.
        let known =
            |(end, s): (HostTime, f64)| at.seconds_since(end) < SAME_S && pause_s < s + SAME_S;
        if !self.mode.has_thrust() || alone_s < 0.0 || self.resumption.pause.is_some_and(known) {
            return;
        }
        let (known_m, sink_mps) = match self.mode {
            Mode::Descend => (self.supervisor.descent.height_m, self.supervisor.descent.sink_mps),
            _ => (self.last_height_m, self.last_sink_mps),
        };
        let sink_mps = sink_mps.max(0.0);
        let longest_s = self.resumption.pending_s().map_or(pause_s, |s| s.max(pause_s));
        self.resumption = Resumption {
            pause: Some((at, longest_s)),
            lowest_m: known_m - sink_mps * alone_s - 0.5 * SINKS_MPS2 * alone_s * alone_s,
            sink_mps: (sink_mps + SINKS_MPS2 * alone_s).min(SINK_MOST_MPS),
            uwb_at: self.resumption.uwb_at,
            ..Resumption::default()
        };
        wishes.push(Wish::ForgetFall);
        if self.mode == Mode::Descend {
            self.supervisor.descent = Descent::begin(known_m, self.resumption.sink_mps);
        }
    }

    /// Follows what is heard after a pause.
    pub(crate) fn watch_resumption(&mut self, around: &Around<'_>, wishes: &mut Vec<Wish>) {
        let at = around.at;
        let Some((end, _)) = self.resumption.pause else { return };
        let new = |t: Option<HostTime>| t.is_some_and(|t| t > end && at.seconds_since(t) < NEW_S);
        let heard = new(self.resumption.uwb_at)
            && new(around.navigation.last_imu)
            && around.navigation.estimate_is_back(around.estimate)
            && around.estimate.std_vel_B_mps.z() < STD_VEL_MPS;
        if !heard {
            self.resumption.heard_since = None;
        } else if at.seconds_since(*self.resumption.heard_since.get_or_insert(at)) > HEARD_FOR_S {
            if self.mode == Mode::Descend && self.resumption.may_stand() {
                // Whatever is heard, what may have come to stand meanwhile does not lift off again.
                wishes.push(Wish::StayDownNearFloor);
            }
            self.resumption = Resumption::default();
        }
    }

    /// Largest thrust over the one that hovers.
    pub(crate) fn most_share(&self, at: HostTime, navigation: &Navigation) -> f64 {
        let fell = navigation.touch.fell_at.is_some_and(|t| at.seconds_since(t) < FLIES_S);
        // A hop ends with a fall as well, and the floor with what made up for it.
        let flies = fell && navigation.touch.sinks_still();
        if self.resumption.pause.is_none() {
            f64::INFINITY
        } else if self.resumption.may_stand() && !flies {
            LOW_SHARE
        } else {
            1.0
        }
    }
}
