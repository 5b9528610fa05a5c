//! From a flight log to a [`Flight`].

use std::collections::BTreeMap;

use crate::report::flight::{Flight, GlueRow, ModeRow};
use haltere_core::drops::{DropReason, Drops};
use haltere_core::estimate::{Estimate, Health};
use haltere_core::frames::{B, E, Rot};
use haltere_core::measure::{
    AnchorId, BatterySample, BoardAttitude, ImuSample, OtherBattery, ReferencePose, ServoOutput,
    Tdoa,
};
use haltere_core::time::HostTime;
use haltere_core::topics::{HealthRecord, ModeRecord, TextRecord, Topic, UwbRecord};
use haltere_dialect::mav::haltere::MavMessage;
use haltere_dialect::mav_stream::MavSplitter;
use haltere_log::record::back::{control, vec3};
use haltere_log::record::{Decoded, Entry, FlightPart, LogEnd, LogReader, RawInput, pb, utc_text};
use haltere_pilot::LinkId;

/// MISSION_CURRENT and MISSION_ITEM_REACHED.
const OF_MISSION: [u32; 2] = [42, 46];

/// Reads every decoded topic of a log; says how the log ends.
pub fn read(log: &LogReader) -> (Flight, LogEnd) {
    read_part(log, FlightPart::whole())
}

/// The same of a part of it.
pub fn read_part(log: &LogReader, mut part: FlightPart) -> (Flight, LogEnd) {
    let session = log.session();
    let mut flight = Flight {
        survey: Some(session.survey.clone()),
        started: Some(session.pilot_started_at),
        ..Flight::default()
    };
    let mut stations: BTreeMap<LinkId, MavSplitter> = BTreeMap::new();
    let mut entries = log.entries();
    for entry in entries.by_ref().filter(|entry| part.holds(entry)) {
        match entry {
            Entry::Decoded(decoded) => flight.add_decoded(decoded),
            Entry::Input { at, input: RawInput::Wake, .. } => flight.wakes.push(at),
            Entry::Output { at, link, bytes, .. } if matches!(link, LinkId::Ground(_)) => {
                flight.add_told(at, &bytes, stations.entry(link).or_default());
            }
            _ => {}
        }
    }
    let end = entries.end();
    (flight, end)
}

/// Who flew what, when, for how long.
pub fn facts(log: &LogReader, flight: &Flight) -> Vec<(String, String)> {
    let session = log.session();
    let build = &session.build;
    let mut facts = vec![("started".to_owned(), utc_text(session.started_unix_us))];
    let mut add = |name: &str, value: String| facts.push((name.to_owned(), value));
    if let Some((from, to)) = flight.ends() {
        add("recorded", format!("{:.1} s", to.seconds_since(from)));
    }
    let volts = |b: &BatterySample| format!("{:.2} V", b.supply_v);
    if let (Some(first), Some(last)) = (flight.battery.first(), flight.battery.last()) {
        let least = flight.battery.iter().min_by(|a, b| a.supply_v.total_cmp(&b.supply_v));
        add(
            "battery",
            format!("{} to {}, least {}", volts(first), volts(last), volts(least.unwrap_or(last))),
        );
    }
    for (id, [least_v, most_v]) in flight.other_packs() {
        let name = format!("battery {id}, not flown on");
        add(&name, format!("{least_v:.2} to {most_v:.2} V"));
    }
    let rejected = flight.judged().filter(|r| !r.fused).count();
    if !flight.uwb.is_empty() {
        let share = 100.0 * rejected as f64 / flight.judged().count().max(1) as f64;
        let known = if flight.judged().next().is_some() {
            format!("{share:.1} % rejected")
        } else {
            "none of them judged: the filter was never aligned".to_owned()
        };
        add("ranging", format!("{} measurements, {known}", flight.uwb.len()));
    }
    if let Some(health) = flight.health.last() {
        add(
            "control steps",
            format!("{}, {} of them late", health.control_steps, health.deadline_misses),
        );
    }
    let commit = if build.git_commit.is_empty() { "no commit" } else { &build.git_commit };
    add("program", format!("haltere {} ({commit}), {}", build.program_version, build.target));
    add("processor", build.processor.clone());
    facts
}

impl Flight {
    /// Takes what the core tells, as it tells it: for a log that was recorded without decoded topics and
    /// is lived through again.
    pub fn add_topic(&mut self, topic: Topic) {
        match topic {
            Topic::Imu(imu) => self.imu.push(imu),
            Topic::Uwb(uwb) => self.uwb.push(uwb),
            Topic::Estimate(estimate) => self.estimates.push(estimate),
            Topic::Control(control) => self.controls.push(control),
            Topic::Battery(battery) => self.battery.push(battery),
            Topic::OtherBattery(other) => self.other_batteries.push(other),
            Topic::Servos(servos) => self.servos.push(servos),
            Topic::BoardAttitude(board) => self.board_attitudes.push(board),
            Topic::Baro(_) | Topic::Mag(_) | Topic::Shadow(_) => {}
            Topic::Reference(reference) => self.references.push(reference),
            Topic::Mode(ModeRecord { at, mode, armed, cause }) => {
                self.modes.push(ModeRow { at, mode: mode.to_owned(), armed, cause });
            }
            Topic::Text(text) => self.texts.push(text),
            Topic::Health(health) => self.health.push(health),
        }
    }

    /// What stations were told of the mission. Each of them is told the same.
    fn add_told(&mut self, at: HostTime, bytes: &[u8], station: &mut MavSplitter) {
        station.push(bytes);
        while let Some(found) = station.next() {
            let Some(frame) = found.ok().filter(|f| OF_MISSION.contains(&f.header.msg_id)) else {
                continue;
            };
            match frame.decode() {
                Ok(MavMessage::MISSION_ITEM_REACHED(m))
                    if self.reached.last() != Some(&(at, m.seq)) =>
                {
                    self.reached.push((at, m.seq));
                }
                Ok(MavMessage::MISSION_CURRENT(m))
                    if self.mission_items.last().is_none_or(|(_, items)| *items != m.total) =>
                {
                    self.mission_items.push((at, m.total));
                }
                _ => {}
            }
        }
    }

    fn add_decoded(&mut self, decoded: Decoded) {
        match decoded {
            Decoded::Baro(_) | Decoded::Mag(_) | Decoded::Shadow(_) => {}
            Decoded::Imu(m) => self.imu.push(ImuSample {
                valid_at: HostTime::from_us(m.valid_at_us),
                received_at: HostTime::from_us(m.received_at_us),
                acc_B_mps2: vec3(m.acc_b_mps2),
                rate_B_radps: vec3(m.rate_b_radps),
            }),
            Decoded::Uwb(m) => self.uwb.push(UwbRecord {
                tdoa: Tdoa {
                    valid_at: HostTime::from_us(m.valid_at_us),
                    received_at: HostTime::from_us(m.received_at_us),
                    anchor_a: anchor(m.anchor_a),
                    anchor_b: anchor(m.anchor_b),
                    distance_diff_m: m.distance_diff_m,
                    std_m: m.std_m,
                },
                innovation_m: m.innovation_m,
                var_innovation_m2: m.var_innovation_m2,
                test_ratio: m.test_ratio,
                fused: m.fused,
            }),
            Decoded::Estimate(m) => self.estimates.push(estimate(&m)),
            Decoded::Control(m) => self.controls.push(control(&m)),
            Decoded::Battery(m) => self.battery.push(BatterySample {
                received_at: HostTime::from_us(m.received_at_us),
                supply_v: m.supply_v,
                current_a: m.current_a,
                remaining_frac: m.remaining_frac,
            }),
            Decoded::OtherBattery(m) => self.other_batteries.push(OtherBattery {
                id: u8::try_from(m.id).unwrap_or(u8::MAX),
                function: u8::try_from(m.function).unwrap_or(0),
                sample: BatterySample {
                    received_at: HostTime::from_us(m.received_at_us),
                    supply_v: m.supply_v,
                    current_a: m.current_a,
                    remaining_frac: m.remaining_frac,
                },
            }),
            Decoded::Servos(m) => self.servos.push(ServoOutput::new(
                HostTime::from_us(m.received_at_us),
                u8::try_from(m.port).unwrap_or(u8::MAX),
                m.output,
            )),
            Decoded::BoardAttitude(m) => {
                if let Some(attitude) = rotation(m.q_board) {
                    self.board_attitudes.push(BoardAttitude {
                        valid_at: HostTime::from_us(m.valid_at_us),
                        received_at: HostTime::from_us(m.received_at_us),
                        attitude,
                    });
                }
            }
            Decoded::Reference(m) => self.references.push(ReferencePose {
                valid_at: HostTime::from_us(m.valid_at_us),
                received_at: HostTime::from_us(m.received_at_us),
                pos_E_m: vec3(m.pos_e_m),
                attitude: rotation(m.q_eb),
            }),
            Decoded::Mode(m) => self.modes.push(ModeRow {
                at: HostTime::from_us(m.at_us),
                mode: m.mode,
                armed: m.armed,
                cause: m.cause,
            }),
            Decoded::Text(m) => self.texts.push(TextRecord {
                at: HostTime::from_us(m.at_us),
                severity: u8::try_from(m.severity).unwrap_or(u8::MAX),
                text: m.text,
            }),
            Decoded::Health(m) => self.health.push(HealthRecord {
                at: HostTime::from_us(m.at_us),
                drops: drops(&m.drops).into(),
                deadline_misses: m.deadline_misses,
                control_steps: m.control_steps,
                uwb_age_s: m.uwb_age_s,
                imu_age_s: m.imu_age_s,
                std_board_clock_s: m.std_board_clock_s,
                left_out: u16::try_from(m.left_out).unwrap_or(0),
            }),
            Decoded::Glue(m) => self.glue.push(GlueRow {
                at: HostTime::from_us(m.at_us),
                wake_ups: m.wake_ups,
                late_wake_ups: m.late_wake_ups,
                worst_lateness_s: m.worst_lateness_s,
            }),
        }
    }
}

fn anchor(id: u32) -> AnchorId {
    AnchorId(u8::try_from(id).unwrap_or(u8::MAX))
}

fn rotation(q: Option<pb::Quaternion>) -> Option<Rot<E, B>> {
    q.and_then(|q| Rot::from_wxyz([q.w, q.x, q.y, q.z]))
}

fn estimate(m: &pb::Estimate) -> Estimate {
    Estimate {
        at: HostTime::from_us(m.at_us),
        pos_E_m: vec3(m.pos_e_m),
        vel_B_mps: vec3(m.vel_b_mps),
        R_EB: rotation(m.q_eb).unwrap_or_else(Rot::identity),
        rate_B_radps: vec3(m.rate_b_radps),
        std_pos_E_m: vec3(m.std_pos_e_m),
        std_vel_B_mps: vec3(m.std_vel_b_mps),
        std_att_B_rad: vec3(m.std_att_b_rad),
        uwb_noise_factor: m.uwb_noise_factor,
        health: match m.health() {
            pb::estimate::Health::NotAligned => Health::NotAligned,
            pb::estimate::Health::Good => Health::Good,
            pb::estimate::Health::Degraded => Health::Degraded,
            pb::estimate::Health::Lost => Health::Lost,
        },
    }
}

/// Reasons that this build does not know are left out: the log is of another version.
fn drops(messages: &[pb::Drop]) -> Vec<(u8, Drops)> {
    let mut links: Vec<(u8, Drops)> = Vec::new();
    for message in messages {
        let reason = DropReason::ALL.into_iter().find(|r| r.name() == message.reason);
        let (Some(reason), Ok(link)) = (reason, u8::try_from(message.link)) else { continue };
        match links.iter_mut().find(|(l, _)| *l == link) {
            Some((_, drops)) => drops.add(reason, message.count),
            None => {
                let mut drops = Drops::default();
                drops.add(reason, message.count);
                links.push((link, drops));
            }
        }
    }
    links
}
