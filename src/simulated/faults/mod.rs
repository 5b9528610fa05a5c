//! Failures of a scenario, `[[fault]]`: what breaks, how, and when.

mod order;
mod told;
mod words;

pub use order::{Order, Shape, Unit, Way, failure_number};
pub use told::Told;
pub use words::{Event, LineName, Part, Phase, SensorName, State, Voice, Wing};

use std::collections::BTreeMap;

use haltere_core::checks::Problems;
use haltere_core::frames::{B, E, Rot, Vec3};
use haltere_model::effects::EffectSet;
use haltere_model::faults::{Misreading, TagReplay};
use haltere_model::gust::Gust;
use haltere_model::line_noise::LineNoise;
use haltere_model::tag::MOST_REPLAY_S;
use haltere_model::{Fault, Plant};
use serde::{Deserialize, Serialize};

/// One failure.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FaultAt {
    /// Simulated time, s; with `phase` the time since that part of the flight began.
    #[serde(default)]
    pub at_s: f64,
    /// Part of the flight in which it happens. Absent: whatever is flown.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub phase: Option<Phase>,
    /// It is mended after this time, s. Absent: it stays.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub for_s: Option<f64>,
    /// What breaks.
    pub part: Part,
    /// How; `healthy` mends it.
    #[serde(default = "off")]
    pub state: State,
    /// Which wing; absent: both.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub wing: Option<Wing>,
    /// Share of thrust that a broken wing keeps.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub gain: Option<f64>,
    /// Voltage that the battery loses, V.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub drop_v: Option<f64>,
    /// Mode that somebody else puts the board into, by its own number.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mode: Option<u32>,
    /// Which anchor.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub anchor: Option<u8>,
    /// Which line.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub line: Option<LineName>,
    /// Share of the deliveries on a line that is lost.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub lost: Option<f64>,
    /// Share that is late, by `late_s`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub late: Option<f64>,
    /// By how much, s.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub late_s: Option<f64>,
    /// Share that comes twice.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub twice: Option<f64>,
    /// Share that is overtaken by the delivery behind it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub swapped: Option<f64>,
    /// Share of which bytes are damaged.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub damaged: Option<f64>,
    /// Share in whose place the first one since the fault began comes again.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub frozen: Option<f64>,
    /// Peak of a gust: room north, east, down, m/s.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub gust_mps: Option<[f64; 3]>,
    /// How long a gust, a pause or a fade lasts, s.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub length_s: Option<f64>,
    /// Effect that switches on, by its id; `healthy` switches it off.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub effect: Option<String>,
    /// Values of its parameters.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub values: BTreeMap<String, f64>,
    /// What a sensor reads of the true value, by axis (of the body).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub scale: Option<[f64; 3]>,
    /// Which sensor misreads.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sensor: Option<SensorName>,
    /// What each axis reads: 1 to 3 for x, y, z, below 0 with the other sign.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub axes: Option<[i8; 3]>,
    /// How the sensor is mounted: turned by roll, pitch and yaw, degrees.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub turn_deg: Option<[f64; 3]>,
    /// What is added, in the unit of the sensor.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub offset: Option<[f64; 3]>,
    /// Length of the stretch that a tag says again, s.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub window_s: Option<f64>,
    /// Whether its receive times go on meanwhile.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub times_go_on: Option<bool>,
    /// How many heartbeats.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub count: Option<u32>,
    /// How much a second board says.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub voice: Option<Voice>,
    /// Voltage of a second pack, V.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub pack_v: Option<f64>,
    /// By how much the board's heading is off, clockwise, degrees.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub angle_deg: Option<f64>,
    /// What happens to a Crazyflie.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub event: Option<Event>,
    /// What a station orders to fail.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub unit: Option<Unit>,
    /// In which mode a place is that the fence forbids.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub way: Option<Way>,
    /// What a fence across the way looks like.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub shape: Option<Shape>,
}

/// What happens; whoever flies it brings it in where it belongs.
#[derive(Debug, Clone, PartialEq)]
pub enum Mishap {
    /// Something breaks in the vehicle, in the room or on a wire.
    Plant(Fault),
    /// The companion's computer stands still for so long, s. What came meanwhile is then there at once.
    Pause(f64),
    /// Somebody at a station orders this.
    Order(Order),
}

impl Mishap {
    /// What mends it. `None`: it passes by itself, or has no state to go back to.
    pub fn mended(&self) -> Option<Mishap> {
        match self {
            Mishap::Plant(fault) => fault.mended().map(Mishap::Plant),
            Mishap::Pause(_) | Mishap::Order(_) => None,
        }
    }
}

fn off() -> State {
    State::Off
}

/// Breaks or mends something, now. It was checked when it was read; an effect that cannot switch is told.
pub fn happen(fault: Fault, plant: &mut Plant) {
    tracing::info!("fault at {:.3} s: {fault:?}", plant.t_us() as f64 * 1e-6);
    if let Err(why) = plant.inject(fault) {
        tracing::warn!("fault refused: {why}");
    }
}

impl FaultAt {
    /// As the plant takes it; what does not happen in the plant is refused.
    pub fn to_fault(&self, key: &str, problems: &mut Problems) -> Option<Fault> {
        match self.to_mishap(key, problems)? {
            Mishap::Plant(fault) => Some(fault),
            // It has a phase: that is asked for.
            Mishap::Pause(_) | Mishap::Order(_) => None,
        }
    }

    /// What happens; says what is missing or out of range.
    pub fn to_mishap(&self, key: &str, problems: &mut Problems) -> Option<Mishap> {
        problems.range(format_args!("{key}.at_s"), self.at_s, 0.0..=36_000.0, "s");
        if let Some(for_s) = self.for_s {
            problems.range(format_args!("{key}.for_s"), for_s, 0.001..=36_000.0, "s");
        }
        if let Some(order) = self.order(key, problems) {
            if self.phase.is_none() {
                problems.say(format!(
                    "{key}.phase is missing: a pause and a station's order are for a campaign, which knows what is \
                     being flown"
                ));
            }
            return Some(order);
        }
        self.plant_fault(key, problems).map(Mishap::Plant)
    }

    /// What happens to the companion or at a station; `None` for what breaks in the plant.
    fn order(&self, key: &str, problems: &mut Problems) -> Option<Mishap> {
        Some(match self.part {
            Part::Pause => {
                let length_s = need(self.length_s, key, "length_s", problems).unwrap_or_default();
                problems.range(format_args!("{key}.length_s"), length_s, 0.0..=60.0, "s");
                Mishap::Pause(length_s)
            }
            Part::InjectFailure => {
                let unit = need(self.unit, key, "unit", problems).unwrap_or(Unit::Motor);
                Mishap::Order(Order::InjectFailure { unit, kind: self.state.kind() })
            }
            Part::Fence => {
                let way = need(self.way, key, "way", problems).unwrap_or(Way::Goto);
                let shape = self.shape.unwrap_or(Shape::Circle);
                Mishap::Order(Order::FenceAcross { way, shape })
            }
            Part::Outside => {
                let way = need(self.way, key, "way", problems).unwrap_or(Way::Goto);
                if !matches!(way, Way::Goto | Way::Offboard) {
                    problems.say(format!("{key}.way: a place is asked for by goto or offboard"));
                }
                Mishap::Order(Order::Outside { way })
            }
            Part::Home => Mishap::Order(Order::ForbiddenHome),
            _ => return None,
        })
    }

    /// What breaks in the plant.
    fn plant_fault(&self, key: &str, problems: &mut Problems) -> Option<Fault> {
        let (kind, broken) = (self.state.kind(), self.state != State::Healthy);
        let mut silent = || {
            if !matches!(self.state, State::Off | State::Healthy) {
                problems.say(format!("{key}.state: this part can be \"off\" or \"healthy\""));
            }
            self.state == State::Off
        };
        Some(match self.part {
            Part::Accelerometer => Fault::Accelerometer(kind),
            Part::Gyroscope => Fault::Gyroscope(kind),
            Part::Barometer => Fault::Barometer(kind),
            Part::Servos => Fault::Servos(kind),
            Part::BoardLink => Fault::BoardLink(kind),
            Part::ToBoard => Fault::ToBoard(kind),
            Part::BoardReboot => Fault::BoardReboot,
            Part::BoardMode => Fault::BoardMode(need(self.mode, key, "mode", problems)?),
            Part::Tag => Fault::TagSilent(silent()),
            Part::Anchor => {
                let silent = silent();
                Fault::AnchorSilent { anchor: need(self.anchor, key, "anchor", problems)?, silent }
            }
            Part::Battery => {
                let drop_v = need(self.drop_v, key, "drop_v", problems)?;
                problems.range(format_args!("{key}.drop_v"), drop_v, 0.0..=10.0, "V");
                Fault::BatteryDrop(drop_v)
            }
            Part::Wing => {
                let gain = need(self.gain, key, "gain", problems)?;
                problems.range(format_args!("{key}.gain"), gain, 0.0..=2.0, "");
                let wing = self.wing.map(|wing| usize::from(wing == Wing::Right));
                Fault::WingThrust { wing, gain }
            }
            Part::Line => {
                let line = need(self.line, key, "line", problems)?.id();
                let noise = self.noise();
                noise.check(key, problems);
                if noise.is_quiet() && self.state != State::Healthy {
                    problems.say(format!(
                        "{key}: a line needs one or more of lost, late (with late_s), twice, swapped, \
                         damaged, frozen above 0; or state = \"healthy\""
                    ));
                }
                Fault::LineNoise { line, noise }
            }
            Part::Gust => {
                let peak = need(self.gust_mps, key, "gust_mps", problems)?;
                let length_s = need(self.length_s, key, "length_s", problems)?;
                let gust = Gust { peak_E_mps: Vec3::from_array(peak), length_s };
                gust.check(key, problems);
                Fault::Gust(gust)
            }
            Part::Effect => {
                let id = need(self.effect.clone(), key, "effect", problems)?;
                let values: Vec<_> = self.values.iter().map(|(k, v)| (k.clone(), *v)).collect();
                let named: Vec<_> = values.iter().map(|(k, v)| (k.as_str(), *v)).collect();
                if let Err(more) = EffectSet::none().with(&id, &named) {
                    more.lines().iter().for_each(|line| problems.say(format!("{key}: {line}")));
                    return None;
                }
                match self.state {
                    State::Healthy => Fault::EffectOff(id),
                    _ => Fault::EffectOn { id, values },
                }
            }
            Part::AccelerometerScale if !broken => Fault::accelerometer_scale([1.0; 3]),
            Part::AccelerometerScale => {
                let scale = need(self.scale, key, "scale", problems)?;
                for (i, gain) in scale.into_iter().enumerate() {
                    problems.range(format_args!("{key}.scale[{i}]"), gain, -10.0..=10.0, "");
                }
                Fault::accelerometer_scale(scale)
            }
            Part::Misread => {
                let sensor = need(self.sensor, key, "sensor", problems)?.sensor();
                Fault::Misread(
                    sensor,
                    if broken { self.misreading(key, problems) } else { Misreading::NONE },
                )
            }
            Part::TagReplay if !broken => Fault::TagReplay(None),
            Part::TagReplay => {
                let window_s = need(self.window_s, key, "window_s", problems)?;
                problems.range(format_args!("{key}.window_s"), window_s, 0.1..=MOST_REPLAY_S, "s");
                let times_go_on = self.times_go_on.unwrap_or(false);
                Fault::TagReplay(Some(TagReplay { window_s, times_go_on }))
            }
            Part::FalseHeartbeat => Fault::FalseBeats(self.count.unwrap_or(1)),
            Part::SecondBoard => {
                let voice = self.voice.unwrap_or(Voice::Everything);
                Fault::SecondBoard(broken.then_some(voice.second()))
            }
            Part::SecondPack if !broken => Fault::SecondPack(None),
            Part::SecondPack => {
                let pack_v = need(self.pack_v, key, "pack_v", problems)?;
                problems.range(format_args!("{key}.pack_v"), pack_v, 0.0..=60.0, "V");
                Fault::SecondPack(Some(pack_v))
            }
            Part::Heading if !broken => Fault::HeadingOff(0.0),
            Part::Heading => {
                let angle_deg = need(self.angle_deg, key, "angle_deg", problems)?;
                problems.range(format_args!("{key}.angle_deg"), angle_deg, -180.0..=180.0, "deg");
                Fault::HeadingOff(angle_deg.to_radians())
            }
            Part::Gear => Fault::GearLeg(silent()),
            Part::Crazyflie => self.event(broken, key, problems)?,
            // Those are orders.
            Part::Pause | Part::InjectFailure | Part::Fence | Part::Outside | Part::Home => {
                return None;
            }
        })
    }

    /// What happens to a Crazyflie.
    fn event(&self, broken: bool, key: &str, problems: &mut Problems) -> Option<Fault> {
        let event = need(self.event, key, "event", problems)?;
        let (mut for_s, mut off_m) = (0.0, [0.0; 3]);
        if event == Event::Fade {
            for_s = need(self.length_s, key, "length_s", problems)?;
            problems.range(format_args!("{key}.length_s"), for_s, 0.0..=600.0, "s");
        }
        if event == Event::AnchorsOff && broken {
            off_m = need(self.offset, key, "offset", problems)?;
            for off in off_m {
                problems.range(format_args!("{key}.offset"), off, -100.0..=100.0, "m");
            }
        }
        Some(Fault::Crazyflie(event.fault(broken, for_s, off_m)))
    }

    /// Scale of what the axes read of the vehicle as it is turned, and the offset.
    fn misreading(&self, key: &str, problems: &mut Problems) -> Misreading {
        let axes = self.axes.unwrap_or([1, 2, 3]);
        if axes.iter().any(|axis| !(1..=3).contains(&axis.unsigned_abs())) {
            problems.say(format!("{key}.axes = {axes:?}: each is 1, 2 or 3, or that below 0"));
            return Misreading::NONE;
        }
        let [roll, pitch, yaw] = self.turn_deg.unwrap_or_default().map(f64::to_radians);
        let turned = Rot::<E, B>::from_euler_rad(roll, pitch, yaw).matrix().transpose();
        let scale = self.scale.unwrap_or([1.0; 3]);
        let matrix = std::array::from_fn(|i| {
            let row = usize::from(axes[i].unsigned_abs()) - 1;
            std::array::from_fn(|j| scale[i] * f64::from(axes[i].signum()) * turned[(row, j)])
        });
        let misreading = Misreading { matrix, offset: self.offset.unwrap_or_default() };
        misreading.check(key, problems);
        if misreading == Misreading::NONE {
            problems.say(format!(
                "{key}: a misreading needs one or more of scale, axes, turn_deg, offset"
            ));
        }
        misreading
    }

    fn noise(&self) -> LineNoise {
        if self.state == State::Healthy {
            return LineNoise::default();
        }
        let share = |value: Option<f64>| value.unwrap_or_default();
        LineNoise {
            lost: share(self.lost),
            late: share(self.late),
            late_s: share(self.late_s),
            twice: share(self.twice),
            swapped: share(self.swapped),
            damaged: share(self.damaged),
            frozen: share(self.frozen),
        }
    }
}

fn need<T>(value: Option<T>, key: &str, field: &str, problems: &mut Problems) -> Option<T> {
    if value.is_none() {
        problems.say(format!("{key}.{field} is missing, this part needs it"));
    }
    value
}
