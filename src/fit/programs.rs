//! Flights that show what a fit needs, as missions that any ground station can upload.
//!
//! Every program is placed in the volume of a configuration and checked against it as the vehicle
//! itself will: what would be refused there is left out here, with the reason.

use super::steady::LEAST_POINTS;
use haltere_core::control::TiltAxis;
use haltere_pilot::mission_file::{Command, DoubletAxis, Item, MissionFile};
use haltere_pilot::{Envelope, PilotConfig, TiltStep};

/// Distance of a turning point to the edge of the volume, m: a wing span, and the error of the
/// estimate near a wall.
const FROM_FENCE_M: f64 = 0.9;
/// Height of what is not about height, m, if the volume is that high.
const HEIGHT_M: f64 = 1.2;
/// Height of angle steps, m: a step may lose 0.6 m, and the floor must not carry.
const STEP_HEIGHT_M: f64 = 2.5;
/// Room above and below a step, m.
const STEP_ROOM_M: f64 = 0.8;
/// Angles of the source, degrees, largest first: the thrust reserve falls with the battery.
const PITCH_DEG: [f64; 5] = [52.0, 45.0, 33.0, 22.0, 12.0];
const ROLL_DEG: [f64; 5] = [52.0, 47.0, 33.0, 22.0, 12.0];
/// Hover after the steps, s: the noise of the speed is learned from it. After, because the steepest
/// angles need the fullest battery.
const NOISE_S: f64 = 30.0;
/// Longest hold of a step, s: many time constants; the room ends most of them before.
const STEP_S: f64 = 4.0;
/// Rungs of the ladder, landing gear to floor, m: the lowest that the source flew, two in the steep part of the law, and
/// two in free air, so that four are left where the vehicle came to stand on the lowest.
pub const RUNGS_M: [f64; 5] = [0.33, 0.45, 0.65, 0.9, 1.2];
/// Time on a rung, s: five rungs in the time in which the source, with more than a minute each, had four.
pub const RUNG_S: f64 = 56.0;
/// Below this the vehicle may come to stand on the floor, where ranging alone sees the height too high, m: docs/STATIONS.md,
/// *Low heights*.
const MAY_STAND_M: f64 = 0.5;
/// Time on the highest rung again, s: it shows what drifted meanwhile.
const AGAIN_S: f64 = 20.0;
/// Time of the trimming hover, s.
const TRIM_S: f64 = 40.0;
/// Time of the hover that shows the wing beat, s.
const IMU_S: f64 = 40.0;
/// Speed on the legs between, m/s.
const LEG_MPS: f64 = 1.0;
/// Distance at which a point counts as reached, m.
const REACHED_M: f64 = 0.5;
/// Doublets: amplitude in degrees and length of each half, s; small and large, short and long, so
/// that delay, lag and a dead band can be told apart.
const DOUBLETS: [[f64; 2]; 4] = [[8.6, 0.5], [8.6, 0.25], [12.0, 0.4], [5.0, 0.3]];
const DOUBLET_ROUNDS: usize = 3;
const DOUBLET_REST_S: f64 = 1.6;

/// What is flown.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Program {
    /// Angle steps to both sides.
    Drag,
    /// Hover until a voltage.
    Thrust,
    /// Hover at a ladder of heights.
    Ground,
    /// The trimming hover.
    Trim,
    /// Doublets in roll and pitch.
    Lag,
    /// Rest and hover.
    Imu,
    /// Through the whole volume.
    Anchors,
}

impl Program {
    /// Name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Program::Drag => "drag",
            Program::Thrust => "thrust",
            Program::Ground => "ground",
            Program::Trim => "trim",
            Program::Lag => "lag",
            Program::Imu => "imu",
            Program::Anchors => "anchors",
        }
    }

    /// What to tell whoever lacks its data.
    pub fn advice(self) -> String {
        format!(
            "what shows it is `haltere fit program {0} > fly-{0}.toml`, flown by `haltere ctl mission fly-{0}.toml` \
             (simulated: `haltere-sim fly fly-{0}.toml`)",
            self.name()
        )
    }
}

/// What the default hover of the thrust program leaves above the warning voltage, V.
const ABOVE_LOW_V: f64 = 0.1;

/// What a user may change.
#[derive(Debug, Clone, PartialEq)]
pub struct Options {
    /// Axes of the angle steps.
    pub axes: Vec<TiltAxis>,
    /// Angles, degrees; empty: those of the source.
    pub angles_deg: Vec<f64>,
    /// Steps may exceed the configured tilt limit.
    pub beyond_limit: bool,
    /// Rungs of the ladder above the floor, m; empty: [`RUNGS_M`].
    pub heights_m: Vec<f64>,
    /// Time on a rung, s.
    pub rung_s: f64,
    /// Voltage that ends the long hover, V.
    pub until_v: f64,
    /// Height of the landing gear's feet below the tracked point, m.
    pub gear_m: f64,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            axes: vec![TiltAxis::Pitch, TiltAxis::Roll],
            angles_deg: Vec::new(),
            beyond_limit: false,
            heights_m: Vec::new(),
            rung_s: RUNG_S,
            // The warning of two cells, and what a hover's sag takes.
            until_v: 6.6,
            gear_m: 0.0,
        }
    }
}

impl Options {
    /// As this companion would have them.
    pub fn of(pilot: &PilotConfig) -> Self {
        Self {
            until_v: pilot.limits.battery_low_v + ABOVE_LOW_V,
            gear_m: pilot.flight.gear_height_m,
            ..Self::default()
        }
    }
}

/// A program ready to fly.
#[derive(Debug, Clone, PartialEq)]
pub struct Planned {
    /// The mission.
    pub mission: MissionFile,
    /// What was left out and why, and what to know before flying.
    pub notes: Vec<String>,
    /// How long it takes, about, s.
    pub length_s: f64,
}

impl Planned {
    /// As a mission file, notes in front as comments.
    pub fn toml(&self, program: Program) -> Result<String, toml::ser::Error> {
        let mut text =
            format!("# haltere fit program {}: about {:.0} s\n", program.name(), self.length_s);
        for note in &self.notes {
            text.push_str(&format!("# {note}\n"));
        }
        Ok(text + "\n" + &toml::to_string(&self.mission)?)
    }
}

/// Plans a program. The error says what the volume does not allow.
pub fn plan(program: Program, envelope: &Envelope, options: &Options) -> Result<Planned, String> {
    let mut plan = Plan::new(envelope)?;
    match program {
        Program::Drag => plan.drag(options)?,
        Program::Thrust => {
            plan.takeoff(plan.height_m);
            plan.go(plan.middle, plan.height_m, 5.0);
            if options.until_v < envelope.battery_critical_v {
                return Err(format!(
                    "--until {} V, at least limits.battery_critical_v = {} V",
                    options.until_v, envelope.battery_critical_v
                ));
            }
            plan.push(Item { supply_v: Some(options.until_v), ..Item::new(Command::UntilVoltage) });
            plan.length_s += 240.0;
            plan.notes.push(format!(
                "begin with a full battery: the fit knows nothing of voltages it has not seen; ends at \
                 {} V",
                options.until_v
            ));
            plan.notes.push(
                "the companion flies home when the battery is needed for that; to empty it further, \
                 `supervisor.battery_home = \"tell\"`, near the place of take-off"
                    .into(),
            );
        }
        Program::Ground => plan.ground(options)?,
        Program::Trim => plan.hover(TRIM_S),
        Program::Lag => plan.lag(),
        Program::Imu => {
            plan.hover(IMU_S);
            plan.notes.push("let it rest for 5 s before arming: bias is taken from there".into());
        }
        Program::Anchors => plan.anchors()?,
    }
    plan.push(Item::new(Command::Land));
    plan.length_s += 12.0;
    Ok(Planned {
        mission: MissionFile { items: plan.items },
        notes: plan.notes,
        length_s: plan.length_s,
    })
}

struct Plan<'a> {
    envelope: &'a Envelope,
    middle: [f64; 2],
    height_m: f64,
    place: [f64; 3],
    items: Vec<Item>,
    notes: Vec<String>,
    length_s: f64,
}

impl<'a> Plan<'a> {
    fn new(envelope: &'a Envelope) -> Result<Self, String> {
        let volume = &envelope.volume;
        for (name, [low, high]) in [("north", volume.north_m), ("east", volume.east_m)] {
            if high - low < 2.0 * FROM_FENCE_M + 0.5 {
                return Err(format!(
                    "the volume is {:.1} m wide to the {name}, at least {:.1} m needed; widen \
                     limits.{name}_m or the anchors",
                    high - low,
                    2.0 * FROM_FENCE_M + 0.5
                ));
            }
        }
        let middle = [volume.north_m, volume.east_m].map(|[low, high]| 0.5 * (low + high));
        let height_m = HEIGHT_M.min(volume.height_m - 0.3).max(0.5);
        Ok(Self {
            envelope,
            middle,
            height_m,
            place: [middle[0], middle[1], height_m],
            items: Vec::new(),
            notes: Vec::new(),
            length_s: 10.0,
        })
    }

    fn push(&mut self, item: Item) {
        self.items.push(item);
    }

    fn takeoff(&mut self, height_m: f64) {
        self.push(Item { height_m: Some(height_m), ..Item::new(Command::Takeoff) });
        self.push(Item { speed_mps: Some(LEG_MPS), ..Item::new(Command::Speed) });
        self.push(Item { yaw_deg: Some(0.0), ..Item::new(Command::Yaw) });
    }

    fn go(&mut self, [north, east]: [f64; 2], height_m: f64, hold_s: f64) {
        let to = [north, east, height_m];
        let way_m: f64 =
            to.iter().zip(self.place).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt();
        self.length_s += way_m / LEG_MPS + 2.0 + hold_s;
        self.place = to;
        self.push(Item {
            hold_s: Some(hold_s),
            acceptance_m: Some(REACHED_M),
            ..Item::waypoint(north, east, height_m)
        });
    }

    fn wait(&mut self, duration_s: f64) {
        self.length_s += duration_s;
        self.push(Item { duration_s: Some(duration_s), ..Item::new(Command::Delay) });
    }

    fn hover(&mut self, hold_s: f64) {
        self.takeoff(self.height_m);
        self.go(self.middle, self.height_m, hold_s);
    }

    fn drag(&mut self, options: &Options) -> Result<(), String> {
        let top_m = self.envelope.volume.height_m;
        let height_m = STEP_HEIGHT_M.min(top_m - STEP_ROOM_M);
        if height_m < 2.0 * STEP_ROOM_M {
            return Err(format!(
                "angle steps need a volume of at least {:.1} m height, limits.height_m or the highest \
                 anchor is {top_m:.1} m",
                3.0 * STEP_ROOM_M
            ));
        }
        self.takeoff(height_m);
        let mut flown = 0;
        let mut angles = Vec::new();
        for axis in &options.axes {
            angles.push((*axis, self.angles(*axis, options)));
        }
        let rounds = angles.iter().map(|(_, angles)| angles.len()).max().unwrap_or(0);
        for round in 0..rounds {
            for (axis, angles) in &angles {
                let Some(angle_deg) = angles.get(round).copied() else { continue };
                self.step_pair(*axis, angle_deg, height_m, options.beyond_limit);
                flown += 1;
            }
        }
        if flown == 0 {
            return Err(format!("no angle step can be flown here: {}", self.notes.join("; ")));
        }
        self.go(self.middle, height_m, NOISE_S);
        self.notes.push(
            "keep people out of the volume: a step gathers up to some m/s and ends by itself before \
             the fence"
                .into(),
        );
        Ok(())
    }

    /// Angles of the steps that can be flown here, degrees, largest first. Of the source's, those beyond the limit become
    /// one at the limit, and where fewer are left than a law of lean over speed needs, others come between them.
    fn angles(&mut self, axis: TiltAxis, options: &Options) -> Vec<f64> {
        let source = if axis == TiltAxis::Pitch { PITCH_DEG } else { ROLL_DEG };
        let limit_deg = self.envelope.tilt_limit_deg();
        let allowed = |deg: f64| if options.beyond_limit { deg } else { deg.min(limit_deg) };
        let mut wanted: Vec<f64> = match &options.angles_deg[..] {
            [] => source.into_iter().map(allowed).collect(),
            asked => asked.to_vec(),
        };
        wanted.dedup();
        let mut angles = Vec::new();
        for angle_deg in wanted {
            match self.can_step(axis, angle_deg, options.beyond_limit) {
                Ok(()) => angles.push(angle_deg),
                Err(why) => self.notes.push(format!("left out: {why}")),
            }
        }
        if options.angles_deg.is_empty() && (2..LEAST_POINTS).contains(&angles.len()) {
            let between: Vec<f64> = angles.windows(2).map(|two| 0.5 * (two[0] + two[1])).collect();
            angles.extend(between);
            angles.sort_by(|a, b| b.total_cmp(a));
        }
        angles
    }

    /// Why a step cannot be flown here.
    fn can_step(&self, axis: TiltAxis, angle_deg: f64, beyond_limit: bool) -> Result<(), String> {
        let flag = f64::from(u8::from(beyond_limit));
        let number = f64::from(u8::from(axis == TiltAxis::Pitch));
        let name = if axis == TiltAxis::Pitch { "pitch" } else { "roll" };
        let said = |why: String| format!("{name} {angle_deg} deg: {why}");
        let step = TiltStep::from_params([number, angle_deg, STEP_S, flag], 0.0).map_err(said)?;
        step.check(self.envelope).map_err(said)?;
        let [low, high] = self.along(axis);
        step.check_from(self.envelope, high - low - FROM_FENCE_M).map_err(said)
    }

    /// The volume along the way of a step, m.
    fn along(&self, axis: TiltAxis) -> [f64; 2] {
        match axis {
            TiltAxis::Pitch => self.envelope.volume.north_m,
            TiltAxis::Roll => self.envelope.volume.east_m,
        }
    }

    /// One angle to one side and back to the other.
    fn step_pair(&mut self, axis: TiltAxis, angle_deg: f64, height_m: f64, beyond_limit: bool) {
        let along = usize::from(axis == TiltAxis::Roll);
        let [low, high] = self.along(axis);
        for towards in [1.0, -1.0] {
            let mut from = self.middle;
            from[along] = if towards > 0.0 { low + FROM_FENCE_M } else { high - FROM_FENCE_M };
            self.go(from, height_m, 1.0);
            // Nose down flies north, right side down flies east.
            let sign = if axis == TiltAxis::Pitch { -towards } else { towards };
            self.push(Item {
                axis: Some(if along == 0 { DoubletAxis::Pitch } else { DoubletAxis::Roll }),
                angle_deg: Some(sign * angle_deg),
                duration_s: Some(STEP_S),
                beyond_limit: beyond_limit.then_some(true),
                ..Item::new(Command::Tilt)
            });
            self.length_s += STEP_S + 2.0;
            self.place = [self.middle[0], self.middle[1], height_m];
        }
    }

    fn ground(&mut self, options: &Options) -> Result<(), String> {
        let rungs: Vec<f64> =
            if options.heights_m.is_empty() { RUNGS_M.to_vec() } else { options.heights_m.clone() };
        let top_m = self.envelope.volume.height_m;
        for rung_m in &rungs {
            let height_m = rung_m + options.gear_m;
            if !(0.2..=top_m).contains(&height_m) {
                return Err(format!(
                    "rung {rung_m} m above the floor is {height_m:.2} m in the room, allowed 0.2 to \
                     {top_m:.1} m"
                ));
            }
        }
        self.takeoff(self.height_m);
        // Highest, lowest, second highest, … and the highest again: what drifts with the time of the flight (battery,
        // motors) must not look like height. Those on which it may come to stand, which ends the flight, come last.
        let mut order = Vec::with_capacity(rungs.len());
        let mut sorted = rungs.clone();
        sorted.sort_by(f64::total_cmp);
        let (low, high) = sorted.split_at(sorted.partition_point(|rung_m| *rung_m < MAY_STAND_M));
        let mut left: std::collections::VecDeque<f64> = high.iter().copied().collect();
        while let Some(high) = left.pop_back() {
            order.push(high);
            order.extend(left.pop_front());
        }
        for rung_m in &order {
            self.go(self.middle, rung_m + options.gear_m, options.rung_s);
        }
        if let Some(top) = order.first() {
            self.go(self.middle, top + options.gear_m, AGAIN_S);
        }
        for rung_m in low.iter().rev() {
            self.go(self.middle, rung_m + options.gear_m, options.rung_s);
        }
        self.go(self.middle, self.height_m, 1.0);
        if self.length_s > 240.0 {
            self.notes.push(
                "longer than a battery of four minutes: the vehicle lands by itself when it is empty; \
                 fly the rest with --heights and give both logs to the fit"
                    .into(),
            );
        }
        self.notes.push(
            "ranging alone sees the height near the floor half a metre wrong at times: the lowest rung \
             may touch down and stand, which ends the flight: it comes last; with motion capture or a good \
             barometer it does not"
                .into(),
        );
        self.notes.push("an even floor, nothing below, doors shut".into());
        Ok(())
    }

    fn lag(&mut self) {
        self.takeoff(self.height_m);
        self.go(self.middle, self.height_m, 2.0);
        for _ in 0..DOUBLET_ROUNDS {
            for axis in [DoubletAxis::Roll, DoubletAxis::Pitch] {
                for [amplitude, half_s] in DOUBLETS {
                    self.push(Item {
                        axis: Some(axis),
                        amplitude: Some(amplitude),
                        half_s: Some(half_s),
                        ..Item::new(Command::Doublet)
                    });
                    self.length_s += 2.0 * half_s;
                    self.wait(DOUBLET_REST_S);
                }
            }
        }
    }

    fn anchors(&mut self) -> Result<(), String> {
        let volume = &self.envelope.volume;
        let top_m = (volume.height_m - 0.5).min(4.0);
        if top_m < 1.0 {
            return Err(format!(
                "anchors need heights from 0.5 to at least 1 m, the volume is {:.1} m high",
                volume.height_m
            ));
        }
        let sides = [volume.north_m, volume.east_m]
            .map(|[low, high]| [low + FROM_FENCE_M, high - FROM_FENCE_M]);
        let corner = |n: usize, e: usize| [sides[0][n], sides[1][e]];
        self.takeoff(self.height_m);
        for height_m in [0.6, 0.5 * (0.6 + top_m), top_m] {
            for place in [corner(0, 0), corner(1, 0), corner(1, 1), corner(0, 1), self.middle] {
                self.go(place, height_m, 0.5);
            }
        }
        self.go(self.middle, self.height_m, 1.0);
        Ok(())
    }
}
