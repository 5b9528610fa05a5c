//! What must hold before a flight begins: every check with its reason, for people and as a list.

use haltere_core::estimate::Health;
use haltere_core::time::HostTime;

use super::Pilot;
use super::ending::ENDS;
use super::modes::Mode;

/// Tilt beyond which the vehicle does not stand on its gear, rad.
const ARM_TILT_RAD: f64 = 0.35;
/// A vehicle stands on a floor or on a table; higher by UWB, the survey is wrong, m. Of 28 flights in a room told 1.25
/// times too large all stood 1.2 to 1.4 m high by UWB (`haltere-sim campaign faults --only "survey: scaled by 1.25"`).
const STANDS_HIGHEST_M: f64 = 1.0;
/// Newest UWB, IMU and battery may be this old to arm, s.
const ARM_AGE_S: f64 = 0.5;
const ARM_BATTERY_AGE_S: f64 = 3.0;

/// What is answered to whoever wants a shadow to fly.
pub(super) const SHADOW_WORDS: &str = "haltere only watches (flight.shadow): arm by whoever flies";

/// What a check looks at.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Check {
    /// The inner-loop board: there, disarmed, with streams of the rates that were asked for.
    Board,
    /// The estimate.
    Estimate,
    /// Samples of the IMU.
    Imu,
    /// UWB measurements.
    Uwb,
    /// The vehicle stands on its gear.
    Attitude,
    /// The vehicle stands inside the fence.
    Fence,
    /// Voltage.
    Battery,
    /// Every anchor stands where the survey says, as far as the floor shows it.
    Anchors,
    /// Gains and limits of the controller, as a set.
    Gains,
    /// We are to fly at all.
    Shadow,
    /// What was kept over the restart could be read back.
    Kept,
    /// The flight will be recorded.
    Log,
}

impl Check {
    /// All of them, in the order in which they are made.
    pub const ALL: [Check; 12] = [
        Check::Board,
        Check::Estimate,
        Check::Imu,
        Check::Uwb,
        Check::Attitude,
        Check::Fence,
        Check::Battery,
        Check::Anchors,
        Check::Gains,
        Check::Shadow,
        Check::Kept,
        Check::Log,
    ];

    /// Name, what it looks at, and the texts of refusals, for the page.
    pub fn words(self) -> [&'static str; 3] {
        match self {
            Check::Board => [
                "board",
                "there, speaking within `limits.board_loss_s`, disarmed, streams at their rates, \
                 parameters and vehicle type as its firmware needs them, a line that is fast enough \
                 (docs/BOARDS.md)",
                "tag and board are exchanged, or one speaks on the other's line; no board found on its link; board \
                 silent for N s; board is already armed, but not by us: disarm it first; and what docs/BOARDS.md lists",
            ],
            Check::Estimate => [
                "estimate",
                "good: aligned, and within its own limits of age, sigma and doubt. At the take-off \
                 \"degraded\" is let pass. Not higher than 1 m above the floor of the survey, where no vehicle \
                 stands: a survey of the wrong scale says so, and a take-off by it would end before it began",
                "estimator not aligned: N of M anchors heard, keep the vehicle still and level; estimate \
                 degraded or lost, and why: no UWB measurement used for N s; position sigma N m; the floor \
                 hides the low anchors, position sigma N m; anchor N does not fit the others; N anchors heard, \
                 M needed to find a wrong one; N % of the UWB measurements do not fit; the anchors contradict \
                 one another, none of them alone is at fault: N, E or height may be N m off; most anchors read \
                 far worse than usual; stands N m above the floor by UWB, 1.0 m at most",
            ],
            Check::Imu => ["imu", "a sample within 0.5 s", "no IMU data from the board"],
            Check::Uwb => [
                "uwb",
                "a fused measurement within 0.5 s, `supervisor.anchors_least` anchors",
                "no UWB measurements; N of M anchors heard, K needed",
            ],
            Check::Attitude => {
                ["attitude", "tilt of at most 20 deg", "tilted: roll R, pitch P deg, at most 20"]
            }
            Check::Fence => [
                "fence",
                "inside of the fence that a station drew",
                "outside the fence at N n E e m",
            ],
            Check::Battery => [
                "battery",
                "a voltage within 3 s, at least `limits.battery_low_v`",
                "no battery voltage from the board; battery at V V, at least L V needed",
            ],
            Check::Anchors => [
                "anchors",
                "no anchor whose time differences miss those of all the others by \
                 `supervisor.anchor_misfit_m` along its line of sight; from half of that on it is only \
                 told. Looked at with 7 anchors or more, and not where the floor adds more than 1 m to \
                 the low ones, which is told; more than 2.5 m is no floor. Nor may another \
                 still be off by 0.6 m once the worst is left out, by 1 m where the floor adds more than 1 m",
                "anchor N does not fit the others: it reads D m too far (or too near); check its place in \
                 the survey and its line of sight; the floor adds N m to the low anchors, 2.5 m at most: check \
                 which anchors are low; several anchors do not fit one another, whichever is left out",
            ],
            Check::Gains => [
                "gains",
                "gains and limits as a set: each loop of the linear model in `control::margins` is stable, with \
                 6 dB and 30 deg to spare, and holds a place, at full and at empty battery; thrust can climb and \
                 sink. In the air a parameter that would break this is refused",
                "control.gains.NAME = V (default D): the forward (sideways, vertical) loop is unstable, has too \
                 small a margin, or does not hold a place; control.limits.thrust_max_frac (thrust_min_frac) = V",
            ],
            Check::Shadow => [
                "shadow",
                "`flight.shadow` is off: a shadow watches and never flies",
                "haltere only watches (flight.shadow): arm by whoever flies",
            ],
            Check::Kept => [
                "kept",
                "fence, rally points, mission and parameters that were kept over the restart are whole: a \
                 file that is damaged or empty is not none. What is missing is told to every station that \
                 comes",
                "fence (rally points, mission) not restored: why; upload it, or clear it. parameters not \
                 restored: why; set them, or reset them. fence, rally points and mission are still being read",
            ],
            Check::Log => [
                "log",
                "the flight will be recorded. Without `flight.log_required` this is a warning: it is told when somebody \
                 arms, and shown to stations that read events",
                "without log: N MB free in FOLDER, M MB needed: make room, or set flight.log_required = false",
            ],
        }
    }
}

impl Pilot {
    /// Whether arming may be asked of the board; the error is the first reason why not.
    pub(super) fn may_arm(&self, at: HostTime) -> Result<(), String> {
        if self.ending.is_some() {
            return Err(ENDS.to_owned());
        }
        if self.mode != Mode::Disarmed {
            return Err(format!("already {}", self.mode.name()));
        }
        Check::ALL.into_iter().try_for_each(|check| self.arming_check(check, at))
    }

    /// Whether the motors may turn: armed, and everything still holds that armed it. Between arming and
    /// take-off a vehicle may be carried away, or lose what it knows.
    pub(super) fn may_lift_off(&self, at: HostTime) -> Result<(), String> {
        if self.board.lateness().is_late() {
            return Err("link to the board is late".to_owned());
        }
        Check::ALL.into_iter().filter(|check| !matches!(check, Check::Board)).try_for_each(
            |check| match check {
                // For a moment it may be less than good; it may not be none.
                Check::Estimate if self.estimate.health == Health::Degraded => Ok(()),
                check => self.arming_check(check, at),
            },
        )
    }

    /// What a check finds that keeps nobody from flying.
    pub(super) fn arming_warning(&self, check: Check) -> Option<String> {
        match check {
            Check::Log if !self.config.flight.log_required => self.recording_misses(),
            _ => None,
        }
    }

    /// One check; the error is for people.
    pub(super) fn arming_check(&self, check: Check, at: HostTime) -> Result<(), String> {
        match check {
            Check::Board => self.check_lines().and_then(|()| self.check_board(at)),
            Check::Estimate => self.check_estimate(at),
            Check::Imu if !is_fresh(self.last_imu, at) => {
                Err("no IMU data from the board".to_owned())
            }
            Check::Uwb if !is_fresh(self.last_fused, at) => Err("no UWB measurements".to_owned()),
            Check::Uwb if self.anchors_alive(at) < self.anchors_needed() => Err(format!(
                "{} of {} anchors heard, {} needed",
                self.anchors_alive(at),
                self.survey.ids().len(),
                self.anchors_needed()
            )),
            Check::Imu | Check::Uwb => Ok(()),
            Check::Attitude => self.check_attitude(),
            Check::Fence => self.fence_forbids().map_or(Ok(()), Err),
            Check::Battery => self.check_battery(at),
            Check::Anchors => self.survey_check.refusal().map_or(Ok(()), Err),
            Check::Gains => self.gains_refusal.clone().map_or(Ok(()), Err),
            Check::Shadow if self.config.flight.shadow => Err(SHADOW_WORDS.to_owned()),
            Check::Shadow => Ok(()),
            Check::Kept => self.lost_forbids().map_or(Ok(()), Err),
            Check::Log if self.config.flight.log_required => {
                self.recording_misses().map_or(Ok(()), |why| {
                    Err(format!("{why}: make room, or set flight.log_required = false"))
                })
            }
            Check::Log => Ok(()),
        }
    }

    fn check_board(&self, at: HostTime) -> Result<(), String> {
        if self.board.is_armed() {
            return Err("board is already armed, but not by us: disarm it first".to_owned());
        }
        match self.board.silence_s(at) {
            Some(s) if s <= self.config.limits.board_loss_s => {}
            silent_s => return Err(self.board_missing(at, silent_s)),
        }
        if let Some(second) = self.second_board(at) {
            return Err(format!(
                "{second}: give each vehicle a port or a number of its own, or switch one off"
            ));
        }
        self.board.refusal(at).map_or(Ok(()), Err)
    }

    fn check_estimate(&self, at: HostTime) -> Result<(), String> {
        let estimate_m = -self.estimate.pos_E_m.z();
        let by_uwb_m = self.estimator.start_height_by_uwb_m().unwrap_or(estimate_m);
        let stands_m = by_uwb_m - self.config.flight.gear_height_m;
        match self.estimate.health {
            Health::Good if stands_m > STANDS_HIGHEST_M => Err(format!(
                "stands {stands_m:.1} m above the floor by UWB, {STANDS_HIGHEST_M:.1} m at most: put it on the \
                 floor, or mend the survey (heights count from the floor; places in metres)"
            )),
            Health::Good => Ok(()),
            Health::NotAligned => Err(format!(
                "estimator not aligned: {} of {} anchors heard, keep the vehicle still and level",
                self.uwb.anchors_heard().count(),
                self.survey.ids().len()
            )),
            health => {
                let word = if health == Health::Lost { "lost" } else { "degraded" };
                let why = self.estimator.misgiving(at).map_or(String::new(), |w| format!(": {w}"));
                Err(format!("estimate {word}{why}"))
            }
        }
    }

    fn check_attitude(&self) -> Result<(), String> {
        let [roll, pitch, _] = self.estimate.R_EB.euler_rad();
        if roll.abs().max(pitch.abs()) <= ARM_TILT_RAD {
            return Ok(());
        }
        Err(format!(
            "tilted: roll {:.0}, pitch {:.0} deg, at most {:.0}",
            roll.to_degrees(),
            pitch.to_degrees(),
            ARM_TILT_RAD.to_degrees()
        ))
    }

    fn check_battery(&self, at: HostTime) -> Result<(), String> {
        let least_v = self.config.limits.battery_low_v;
        match self.battery {
            Some(b) if at.seconds_since(b.received_at) < ARM_BATTERY_AGE_S => {
                if b.supply_v >= least_v {
                    return Ok(());
                }
                Err(format!("battery at {:.2} V, at least {least_v:.2} V needed", b.supply_v))
            }
            _ => Err("no battery voltage from the board".to_owned()),
        }
    }
}

fn is_fresh(newest: Option<HostTime>, at: HostTime) -> bool {
    newest.is_some_and(|t| at.seconds_since(t) < ARM_AGE_S)
}
