//! What the page shows, made of the core's records. No I/O, no clock: records in, JSON out.
//!
//! Coordinates leave here as north, east, height, in metres; angles in degrees: they are for people.

use std::collections::VecDeque;

use serde::Serialize;
use serde_json::{Value, json};

use super::anchors::Anchors;
use super::dilution::{self, Box3};
use haltere_core::estimate::{Estimate, Health};
use haltere_core::frames::{E, Vec3, survey_from_earth};
use haltere_core::measure::{AnchorId, BatterySample, OtherBattery, ServoOutput};
use haltere_core::survey::Survey;
use haltere_core::time::HostTime;
use haltere_core::topics::{ControlRecord, HealthRecord, ModeRecord, Topic};
use haltere_log::record::GlueState;
use haltere_pilot::{Envelope, PilotConfig};

/// Points of the trail that a new client is given, and their distance in time, µs: the last minute.
const TRAIL_POINTS: usize = 600;
const TRAIL_US: i64 = 100_000;
/// Events that are kept, and the longest text of one.
const EVENTS: usize = 200;
const EVENT_CHARS: usize = 300;
/// A control record older than this says nothing of now, µs.
const CONTROL_US: u64 = 300_000;
/// How much room around anchors and volume is shown, m.
const MARGIN_M: f64 = 0.5;
/// Steps in which the cuts of the dilution follow the vehicle, m.
const CUT_M: f64 = 0.5;
/// Height of the cut while no position is known, m.
const CUT_DEFAULT_M: f64 = 1.0;
/// Batteries that are not flown on, and what motors were told, are shown while they are as new as this, s.
const OTHERS_S: f64 = 5.0;
/// Severity of a change of mode among texts: notice.
const SEVERITY_NOTICE: u8 = 5;

/// Something that happened.
#[derive(Debug, Clone, PartialEq, Serialize)]
struct Event {
    t: f64,
    severity: u8,
    text: String,
    /// Whether it is a change of mode.
    mode: bool,
}

/// The state of everything that is shown.
#[derive(Debug)]
pub(super) struct Picture {
    survey: Survey,
    room: Box3,
    /// What does not change: anchors, volume, limits.
    fixed: Value,
    anchors: Anchors,
    estimate: Option<Estimate>,
    control: Option<ControlRecord>,
    battery: Option<BatterySample>,
    other_batteries: Vec<OtherBattery>,
    servos: Option<ServoOutput>,
    mode: Option<ModeRecord>,
    /// What is shown of losses and timing. The record itself goes back to the core.
    health: Value,
    /// When losses were told last, how many there were, and how many a second were added.
    thrown: (HostTime, u64, Option<f64>),
    mission: [u16; 2],
    glue: GlueState,
    /// Of UWB measurements since the last look: age when they were used, sum and worst, s.
    uwb_delay: (f64, f64, u32),
    trail: VecDeque<[f64; 3]>,
    trail_at: Option<HostTime>,
    events: VecDeque<Event>,
    news: Vec<Event>,
    start: Option<HostTime>,
    now: HostTime,
    /// What the cuts were last made for.
    cut: Option<(i64, i64, Vec<AnchorId>)>,
}

/// North, east, up.
fn place(at_E: Vec3<E>) -> [f64; 3] {
    let [east, north, up] = survey_from_earth(at_E).to_array();
    [north, east, up].map(|m| round(m, 3))
}

fn round(value: f64, digits: i32) -> f64 {
    let scale = 10_f64.powi(digits);
    // JSON has no NaN; serde_json writes null for it, which the page takes as unknown.
    (value * scale).round() / scale
}

/// Everything that was thrown away, of all links.
fn thrown(health: &HealthRecord) -> u64 {
    health
        .drops
        .iter()
        .flat_map(|(_, drops)| drops.iter())
        .fold(0, |all, (_, n)| all.saturating_add(n))
}

fn health_shown(health: &HealthRecord, survey: &Survey) -> Value {
    let ids = survey.ids().iter().enumerate().take(u16::BITS as usize);
    let left_out: Vec<u8> =
        ids.filter(|(n, _)| health.left_out >> n & 1 == 1).map(|(_, id)| id.0).collect();
    json!({ "misses": health.deadline_misses, "steps": health.control_steps, "uwb_age": health.uwb_age_s,
            "imu_age": health.imu_age_s, "clock": health.std_board_clock_s, "drops": thrown(health),
            "left_out": left_out })
}

/// A change of mode in the words of the core.
fn change(mode: &ModeRecord) -> String {
    format!("{}: {}", mode.mode, mode.cause)
}

fn health_name(health: Health) -> &'static str {
    match health {
        Health::NotAligned => "not aligned",
        Health::Good => "good",
        Health::Degraded => "degraded",
        Health::Lost => "lost",
    }
}

impl Picture {
    /// Before anything has happened.
    pub(super) fn new(pilot: &PilotConfig, survey: &Survey) -> Self {
        let volume = Envelope::of(pilot, survey).volume;
        let positions: Vec<(AnchorId, [f64; 3])> = survey
            .ids()
            .iter()
            .filter_map(|id| Some((*id, place(survey.position_E_m(*id)?))))
            .collect();
        let span = |axis: usize, also: [f64; 2]| {
            let all = positions.iter().map(|(_, at)| at[axis]).chain(also);
            let low = all.clone().fold(f64::INFINITY, f64::min);
            let high = all.fold(f64::NEG_INFINITY, f64::max);
            [low - MARGIN_M, high + MARGIN_M]
        };
        let height_m = span(2, [0.0, volume.height_m]);
        let room = Box3 {
            north_m: span(0, volume.north_m),
            east_m: span(1, volume.east_m),
            height_m: [height_m[0].max(-MARGIN_M), height_m[1]],
        };
        let anchors: Vec<Value> =
            positions.iter().map(|(id, at)| json!({ "id": id.0, "p": at })).collect();
        let fixed = json!({
            "version": env!("CARGO_PKG_VERSION"),
            "anchors": anchors,
            "volume": { "n": volume.north_m, "e": volume.east_m, "h": [0.0, volume.height_m] },
            "room": { "n": room.north_m, "e": room.east_m, "h": room.height_m },
            "battery": { "low": pilot.limits.battery_low_v, "critical": pilot.limits.battery_critical_v },
        });
        Self {
            survey: survey.clone(),
            room,
            fixed,
            anchors: Anchors::default(),
            estimate: None,
            control: None,
            battery: None,
            other_batteries: Vec::new(),
            servos: None,
            mode: None,
            health: Value::Null,
            thrown: (HostTime::from_us(0), 0, None),
            mission: [0; 2],
            glue: GlueState::default(),
            uwb_delay: (0.0, 0.0, 0),
            trail: VecDeque::with_capacity(TRAIL_POINTS),
            trail_at: None,
            events: VecDeque::with_capacity(EVENTS),
            news: Vec::new(),
            start: None,
            now: HostTime::from_us(0),
            cut: None,
        }
    }

    /// Takes in a record of the core.
    pub(super) fn topic(&mut self, at: HostTime, topic: &Topic) {
        self.start.get_or_insert(at);
        self.now = self.now.max(at);
        match topic {
            Topic::Estimate(estimate) => self.take_estimate(at, estimate),
            Topic::Uwb(record) => {
                self.anchors.take(at, record);
                if record.fused {
                    let delay_s = at.seconds_since(record.tdoa.valid_at).max(0.0);
                    let (sum, worst, n) = &mut self.uwb_delay;
                    (*sum, *worst, *n) = (*sum + delay_s, worst.max(delay_s), *n + 1);
                }
            }
            Topic::Control(control) => self.control = Some(*control),
            Topic::Battery(battery) => self.battery = Some(*battery),
            Topic::Health(health) => {
                self.health = health_shown(health, &self.survey);
                let (before, had, _) = self.thrown;
                let (has, since_s) = (thrown(health), at.seconds_since(before));
                let hz = (before.as_us() > 0 && since_s > 0.0)
                    .then(|| round(has.saturating_sub(had) as f64 / since_s, 1));
                self.thrown = (at, has, hz);
            }
            Topic::Mode(mode) => {
                self.mode = Some(mode.clone());
                self.event(at, SEVERITY_NOTICE, &change(mode), true);
            }
            // The core tells a change of mode in words too: once is enough, with the severity of the words.
            Topic::Text(text) if self.is_newest_change(&text.text) => {
                let newest = self.events.back_mut().into_iter().chain(self.news.last_mut());
                newest.for_each(|event| event.severity = text.severity);
            }
            Topic::Text(text) => self.event(at, text.severity, &text.text, false),
            Topic::Servos(servos) => self.servos = Some(*servos),
            Topic::OtherBattery(other) => self.take_other_battery(other),
            Topic::Imu(_)
            | Topic::BoardAttitude(_)
            | Topic::Baro(_)
            | Topic::Mag(_)
            | Topic::Reference(_)
            | Topic::Shadow(_) => {}
        }
    }

    /// Takes in how late the core is woken.
    pub(super) fn glue(&mut self, at: HostTime, glue: GlueState) {
        self.now = self.now.max(at);
        self.glue = glue;
    }

    /// Takes in how far the mission is.
    pub(super) fn mission(&mut self, progress: [u16; 2]) {
        self.mission = progress;
    }

    /// The newest of each pack; ids are of one byte, so there is an end to them.
    fn take_other_battery(&mut self, other: &OtherBattery) {
        match self.other_batteries.iter_mut().find(|known| known.id == other.id) {
            Some(known) => *known = *other,
            None => self.other_batteries.push(*other),
        }
    }

    fn take_estimate(&mut self, at: HostTime, estimate: &Estimate) {
        self.estimate = Some(*estimate);
        let due = self.trail_at.is_none_or(|last| at >= last.offset_us(TRAIL_US));
        if due && estimate.health != Health::NotAligned {
            self.trail_at = Some(at);
            if self.trail.len() == TRAIL_POINTS {
                self.trail.pop_front();
            }
            self.trail.push_back(place(estimate.pos_E_m));
        }
    }

    /// Whether a text says again what the newest event is.
    fn is_newest_change(&self, text: &str) -> bool {
        let same = |event: &Event| event.mode && event.text == text;
        self.events.back().is_some_and(same) && self.news.last().is_some_and(same)
    }

    fn event(&mut self, at: HostTime, severity: u8, text: &str, mode: bool) {
        let text = text.chars().take(EVENT_CHARS).collect();
        let event = Event { t: round(self.seconds(at), 2), severity, text, mode };
        if self.events.len() == EVENTS {
            self.events.pop_front();
        }
        self.events.push_back(event.clone());
        if self.news.len() < EVENTS {
            self.news.push(event);
        }
    }

    /// Since the first record, s.
    fn seconds(&self, at: HostTime) -> f64 {
        self.start.map_or(0.0, |start| at.seconds_since(start))
    }

    /// What a new client is told first: all that does not come again.
    pub(super) fn hello(&self) -> String {
        let mut hello = self.fixed.clone();
        hello["k"] = json!("hello");
        hello["trail"] = json!(self.trail);
        hello["events"] = json!(self.events);
        hello["cuts"] = json!(self.cuts_now());
        hello.to_string()
    }

    /// What moves.
    pub(super) fn frame(&self) -> String {
        let mut frame = json!({ "k": "f", "t": round(self.seconds(self.now), 3) });
        if let Some(estimate) = self.estimate.filter(|e| e.health != Health::NotAligned) {
            let [roll, pitch, yaw] = estimate.R_EB.euler_rad().map(|a| round(a.to_degrees(), 1));
            let std = estimate.std_pos_E_m.to_array().map(|s| round(s, 4));
            frame["p"] = json!(place(estimate.pos_E_m));
            frame["std"] = json!(std);
            frame["v"] = json!(place(estimate.vel_E_mps()));
            frame["att"] = json!([roll, pitch, yaw]);
            frame["dop"] = json!(self.dilution(estimate.pos_E_m).map(|d| round(d, 2)));
        }
        let health = self.estimate.map_or(Health::NotAligned, |e| e.health);
        frame["health"] = json!(health_name(health));
        let fresh = |c: &&ControlRecord| self.now.as_us().saturating_sub(c.at.as_us()) < CONTROL_US;
        if let Some(control) = self.control.as_ref().filter(fresh) {
            let [n, e, d] = control.pos_setpoint_E_m.map(|axis| axis.map(|m| round(m, 3)));
            frame["sp"] = json!([n, e, d.map(|d| -d)]);
            frame["vsp"] = json!(place(control.vel_setpoint_E_mps));
            frame["thrust"] = json!(round(control.thrust_frac, 3));
            let cut = control.saturation;
            frame["cut"] = json!(cut.velocity || cut.tilt || cut.thrust_high || cut.thrust_low);
        }
        if let Some(mode) = &self.mode {
            frame["mode"] = json!(mode.mode);
            frame["armed"] = json!(mode.armed);
        }
        frame.to_string()
    }

    /// What changes slowly. `lost`: records that the page was not given. Begins the next stretch.
    pub(super) fn slow(&mut self, lost: u64, clients: usize) -> String {
        self.anchors.forget(self.now);
        let (sum, worst, n) = std::mem::take(&mut self.uwb_delay);
        let age = |at: HostTime| round(self.now.seconds_since(at).max(0.0), 2);
        let battery = self.battery.map(|b| {
            json!({ "v": round(b.supply_v, 2), "a": b.current_a.map(|a| round(a, 2)),
                    "left": b.remaining_frac.map(|f| round(f, 3)), "age": age(b.received_at) })
        });
        let others = self.other_batteries.iter().filter(|o| age(o.sample.received_at) < OTHERS_S);
        let others: Vec<Value> =
            others.map(|o| json!({ "id": o.id, "v": round(o.sample.supply_v, 2) })).collect();
        let servos = self.servos.filter(|s| age(s.received_at) < OTHERS_S).map(|s| {
            s.outputs().iter().map(|told| round(f64::from(*told), 1)).collect::<Vec<f64>>()
        });
        json!({
            "k": "s",
            "anchors": self.anchors.quality(),
            "battery": battery,
            "others": others,
            "servos": servos,
            "health": self.health,
            "thrown_hz": self.thrown.2,
            "mission": self.mission,
            "late": { "worst": round(self.glue.worst_lateness_s, 4), "n": self.glue.late_wake_ups,
                      "of": self.glue.wake_ups },
            "uwb_delay": (n > 0).then(|| json!({ "mean": round(sum / f64::from(n), 4), "worst": round(worst, 4) })),
            "lost": lost,
            "clients": clients,
        })
        .to_string()
    }

    /// What happened since the last look.
    pub(super) fn news(&mut self) -> Option<String> {
        let news = std::mem::take(&mut self.news);
        (!news.is_empty()).then(|| json!({ "k": "e", "events": news }).to_string())
    }

    /// The dilution over the room, when it is another than at the last look.
    pub(super) fn cuts(&mut self) -> Option<String> {
        let cut = self.cut_now();
        if self.cut.as_ref() == Some(&cut) {
            return None;
        }
        self.cut = Some(cut);
        Some(json!({ "k": "d", "cuts": self.cuts_now() }).to_string())
    }

    /// Anchors that count: those that are heard, or all while none is.
    fn counted(&self) -> Vec<AnchorId> {
        let ids = self.survey.ids();
        let heard: Vec<_> = ids.iter().copied().filter(|id| self.anchors.hears(*id)).collect();
        if heard.is_empty() { ids.to_vec() } else { heard }
    }

    /// Where the cuts lie, in steps of [`CUT_M`], and of which anchors.
    fn cut_now(&self) -> (i64, i64, Vec<AnchorId>) {
        let middle = |[low, high]: [f64; 2]| 0.5 * (low + high);
        let aligned = self.estimate.filter(|e| e.health != Health::NotAligned);
        let here = aligned.map(|e| e.pos_E_m);
        let height_m = here.map_or(CUT_DEFAULT_M, |p| -p.z()).clamp(0.0, self.room.height_m[1]);
        let [south_m, north_m] = self.room.north_m;
        let north_m = here.map_or(middle([south_m, north_m]), |p| p.x()).clamp(south_m, north_m);
        let step = |m: f64| (m / CUT_M).round() as i64;
        (step(height_m), step(north_m), self.counted())
    }

    fn cuts_now(&self) -> dilution::Cuts {
        let (height, north, counted) = self.cut_now();
        let (height_m, north_m) = (height as f64 * CUT_M, north as f64 * CUT_M);
        dilution::cuts(&self.survey, &self.room, height_m, north_m, |id| counted.contains(&id))
    }

    fn dilution(&self, at_E_m: Vec3<E>) -> Option<f64> {
        let counted = self.counted();
        dilution::at(&self.survey, at_E_m, |id| counted.contains(&id))
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::super::anchors::tests::record;
    use super::*;
    use haltere_core::drops::{DropReason, Drops};
    use haltere_core::frames::Rot;
    use haltere_core::topics::TextRecord;

    fn picture() -> Picture {
        let corners: Vec<_> = (0..8_u8)
            .map(|id| {
                let pick = |bit: u8, far: f64| if id & bit != 0 { far } else { 0.0 };
                (AnchorId(id), Vec3::new(pick(1, 10.0), pick(2, 8.0), pick(4, -7.0)))
            })
            .collect();
        let survey = Survey::new(&corners).unwrap();
        let mut pilot = PilotConfig::default();
        pilot.limits.resolve(&survey);
        Picture::new(&pilot, &survey)
    }

    pub(in crate::watch) fn blank() -> Estimate {
        Estimate {
            at: at(0),
            pos_E_m: Vec3::zero(),
            vel_B_mps: Vec3::zero(),
            R_EB: Rot::identity(),
            rate_B_radps: Vec3::zero(),
            std_pos_E_m: Vec3::zero(),
            std_vel_B_mps: Vec3::zero(),
            std_att_B_rad: Vec3::zero(),
            uwb_noise_factor: 1.0,
            health: Health::NotAligned,
        }
    }

    fn health() -> HealthRecord {
        HealthRecord {
            at: at(0),
            drops: Vec::new().into(),
            deadline_misses: 0,
            control_steps: 1,
            uwb_age_s: None,
            imu_age_s: None,
            std_board_clock_s: None,
            left_out: 0,
        }
    }

    fn json(text: &str) -> Value {
        serde_json::from_str(text).unwrap()
    }

    fn at(ms: u64) -> HostTime {
        HostTime::from_us(100_000_000 + ms * 1000)
    }

    fn estimate(north_m: f64, height_m: f64) -> Topic {
        Topic::Estimate(Estimate {
            at: at(0),
            pos_E_m: Vec3::new(north_m, 2.0, -height_m),
            std_pos_E_m: Vec3::new(0.05, 0.06, 0.07),
            health: Health::Good,
            ..blank()
        })
    }

    #[test]
    fn prop_coordinates_leave_as_north_east_height() {
        let mut picture = picture();
        assert_eq!(json(&picture.frame())["health"], "not aligned");
        assert!(json(&picture.frame())["p"].is_null());
        picture.topic(at(0), &estimate(3.0, 1.25));
        let control = ControlRecord {
            at: at(10),
            pos_setpoint_E_m: [Some(4.0), None, Some(-1.5)],
            ..ControlRecord::default()
        };
        picture.topic(at(10), &Topic::Control(control));
        let frame = json(&picture.frame());
        assert_eq!(frame["p"], json!([3.0, 2.0, 1.25]));
        assert_eq!(frame["sp"], json!([4.0, null, 1.5]));
        assert_eq!(frame["std"], json!([0.05, 0.06, 0.07]));
        assert!(frame["dop"].as_f64().unwrap() > 0.5);
        // An old setpoint is none.
        picture.topic(at(1000), &estimate(3.0, 1.25));
        assert!(json(&picture.frame())["sp"].is_null());
        let hello = json(&picture.hello());
        assert_eq!(hello["anchors"][7]["p"], json!([10.0, 8.0, 7.0]));
        assert_eq!(hello["trail"].as_array().unwrap().len(), 2);
        assert_eq!(hello["cuts"]["height_m"], 1.5);
    }

    #[test]
    fn prop_events_and_trail_are_bounded_and_nothing_is_told_twice() {
        let mut picture = picture();
        for n in 0..2000_u64 {
            let text = TextRecord { at: at(n), severity: 4, text: "ä".repeat(2000) };
            picture.topic(at(n * 100), &Topic::Text(text));
            picture.topic(at(n * 100), &estimate(3.0, 1.0));
        }
        let hello = json(&picture.hello());
        assert_eq!(hello["events"].as_array().unwrap().len(), EVENTS);
        assert_eq!(hello["trail"].as_array().unwrap().len(), TRAIL_POINTS);
        assert!(picture.hello().len() < 400_000);
        assert_eq!(json(&picture.news().unwrap())["events"].as_array().unwrap().len(), EVENTS);
        assert_eq!(picture.news(), None);
        let mode = ModeRecord { at: at(0), mode: "hold", armed: true, cause: "\"<b>".into() };
        picture.topic(at(200_000), &Topic::Mode(mode));
        // The same in words, which say how grave it is; then something else.
        for text in ["hold: \"<b>", "hold: \"<b>", "other"] {
            let text = TextRecord { at: at(0), severity: 3, text: text.into() };
            picture.topic(at(200_000), &Topic::Text(text));
        }
        let news = json(&picture.news().unwrap());
        assert_eq!(news["events"].as_array().unwrap().len(), 2, "{news}");
        assert_eq!(news["events"][0]["text"], "hold: \"<b>");
        assert_eq!(
            (&news["events"][0]["severity"], &news["events"][0]["mode"]),
            (&json!(3), &json!(true))
        );
        assert_eq!(json(&picture.frame())["mode"], "hold");
    }

    #[test]
    fn prop_anchors_that_are_left_out_are_told_by_their_numbers() {
        let mut picture = picture();
        let third = picture.survey.ids()[2].0;
        // The last bit stands for no anchor of this survey.
        let health = HealthRecord { left_out: 0b100 | 1 << 15, ..health() };
        picture.topic(at(0), &Topic::Health(health));
        assert_eq!(json(&picture.slow(0, 1))["health"]["left_out"], json!([third]));
    }

    #[test]
    fn prop_progress_and_losses_of_now_are_told() {
        let mut picture = picture();
        let told = |picture: &mut Picture| json(&picture.slow(0, 1));
        assert!(told(&mut picture)["thrown_hz"].is_null());
        for (ms, garbage) in [(1000, 200), (3000, 230)] {
            let mut drops = Drops::default();
            drops.add(DropReason::TagGarbageByte, garbage);
            let health = HealthRecord { drops: vec![(0, drops)].into(), ..health() };
            picture.topic(at(ms), &Topic::Health(health));
        }
        picture.mission([3, 8]);
        let slow = told(&mut picture);
        assert_eq!((&slow["thrown_hz"], &slow["health"]["drops"]), (&json!(15.0), &json!(230)));
        assert_eq!(slow["mission"], json!([3, 8]));
    }

    #[test]
    fn prop_the_cuts_follow_the_vehicle_and_the_anchors_that_are_heard() {
        let mut picture = picture();
        assert!(picture.cuts().is_some());
        assert_eq!(picture.cuts(), None);
        picture.topic(at(0), &estimate(3.0, 1.0));
        let all = json(&picture.cuts().unwrap());
        picture.topic(at(20), &estimate(3.1, 1.1));
        assert_eq!(picture.cuts(), None);
        for n in 0..5 {
            picture.topic(at(30 + n), &Topic::Uwb(record(n as u8, n as u8 + 1, 0.1, true)));
        }
        let few = json(&picture.cuts().unwrap());
        let middle = 12 * 24 + 12;
        let value = |cuts: &Value| cuts["cuts"]["plan"][middle].as_f64().unwrap();
        assert!(value(&few) > value(&all), "{few} {all}");
        let slow = json(&picture.slow(3, 1));
        assert_eq!((&slow["lost"], slow["anchors"].as_array().unwrap().len()), (&json!(3), 6));
        assert!(slow["uwb_delay"]["mean"].as_f64().unwrap() > 0.0);
        assert!(json(&picture.slow(3, 1))["uwb_delay"].is_null());
    }
}
