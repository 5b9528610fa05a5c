//! What `haltere ctl` does: a variant an action, and an arm of `run` each.

use std::time::Duration;

use haltere_dialect::mav::haltere::{MavCmd, MavMissionType};
use haltere_dialect::signing::SigningKey;
use serde_json::json;

use super::callers::Wanted;
use super::mission::read_plan;
use super::plan_file::PlanFile;
use super::station::{GroundStation, Mode};
use super::transfer::name_of;
use super::{CtlError, named};

/// What `haltere ctl` does.
#[derive(Debug, Clone, PartialEq, clap::Subcommand)]
pub enum Action {
    /// Arms.
    Arm,
    /// Disarms, on the floor.
    Disarm,
    /// Arms if needed, takes off to a height in metres and waits until it is there.
    Takeoff {
        /// Height above the floor, m.
        #[arg(value_parser = height)]
        height_m: f64,
    },
    /// Flies to a point and waits until it is there.
    #[command(allow_negative_numbers = true)]
    Goto {
        /// Room north, m.
        #[arg(value_parser = metres)]
        north_m: f64,
        /// Room east, m.
        #[arg(value_parser = metres)]
        east_m: f64,
        /// Height, m.
        #[arg(value_parser = height)]
        height_m: f64,
    },
    /// Stays where it is.
    Hold,
    /// Uploads a mission file, starts it and waits until it is flown.
    Mission {
        /// TOML file with `[[item]]` tables, QGroundControl's `.plan` (its fence and rally points are uploaded too), or
        /// `.waypoints`.
        file: std::path::PathBuf,
    },
    /// Prints a mission file as the items that a station uploads, as JSON; speaks to no vehicle.
    Items {
        /// As for `mission`.
        file: std::path::PathBuf,
    },
    /// Starts a flight that the vehicle knows by name (built in, or a file of its missions) and waits
    /// until it is flown. Without a name: prints the names.
    Program {
        /// As the vehicle names it.
        name: Option<String>,
    },
    /// Lands and waits until it has landed.
    Land,
    /// Prints what the vehicle tells about itself.
    Status {
        /// Prints as JSON.
        #[arg(long)]
        json: bool,
    },
}

/// Longest flight of a mission, s: the battery lasts 4 to 6 minutes (VEHICLE.md).
const MISSION_TIMEOUT: Duration = Duration::from_secs(600);

/// Texts of an answer come behind it, within this time.
const TEXTS_WITHIN: Duration = Duration::from_millis(300);

/// Counters of links and of losses, which come one at a time, and their interval while all are wanted, µs.
const HALTERE_LINK_ID: u32 = 54105;
const HALTERE_DROPS_ID: u32 = 54104;
const ROUND_US: f64 = 20_000.0;

/// Names of the programs that the vehicle knows, in the order of their numbers from 1.
fn program_names(station: &mut GroundStation) -> Result<Vec<String>, CtlError> {
    station.command(MavCmd::MAV_CMD_USER_4, [0.0; 7])?;
    station.listen(TEXTS_WITHIN)?;
    let name_of = |text: &String| {
        let (number, name) = text.strip_prefix("program ")?.split_once(": ")?;
        number.parse::<u16>().ok().map(|_| name.to_owned())
    };
    Ok(station.take_texts().iter().filter_map(name_of).collect())
}

/// Loads a program as the mission; the number of its items.
fn load_program(
    station: &mut GroundStation,
    name: &str,
    names: &[String],
) -> Result<usize, CtlError> {
    let Some(index) = names.iter().position(|known| known == name) else {
        let why = format!("no such program on the vehicle; it knows: {}", names.join(", "));
        return Err(CtlError::MissionFile { file: name.to_owned(), why });
    };
    let mut params = [0.0; 7];
    params[0] = (index + 1) as f32;
    station.command(MavCmd::MAV_CMD_USER_4, params)?;
    station.listen(TEXTS_WITHIN)?;
    let count =
        |text: &String| text.split_once("mission of ")?.1.split(' ').next()?.parse::<usize>().ok();
    station.take_texts().iter().find_map(count).ok_or_else(|| CtlError::MissionFile {
        file: name.to_owned(),
        why: "the vehicle does not say how long it is".to_owned(),
    })
}

/// Starts the mission in force and waits for its last item; with `lands`, until it stands.
fn fly_mission(
    station: &mut GroundStation,
    items: usize,
    lands: bool,
    say: &mut impl FnMut(&str),
) -> Result<(), CtlError> {
    station.set_mode(Mode::Mission)?;
    if !station.vehicle().armed {
        station.arm()?;
    }
    let last = items.saturating_sub(1) as u16;
    let mut told = None;
    // That it is armed may be heard after the order was answered.
    let mut flies = false;
    let mut heard = Vec::new();
    let done =
        station.wait_hearing("the end of the mission", MISSION_TIMEOUT, |vehicle, texts| {
            for text in texts.drain(..) {
                say(&text);
                heard.push(text);
            }
            if vehicle.reached != told {
                told = vehicle.reached;
                let done = told.map_or(0, |seq| seq.saturating_add(1));
                say(&format!("item {done} of {items} done"));
            }
            flies |= vehicle.armed;
            let is_done = vehicle.reached >= Some(last);
            (is_done || (flies && !vehicle.armed)).then_some(is_done)
        })?;
    if !done {
        return Err(CtlError::Ended { reached: told, items, texts: heard });
    }
    if lands { station.wait_down() } else { Ok(()) }
}

/// A coordinate or height that somebody types, m.
fn metres(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(value) if (-MOST_M..=MOST_M).contains(&value) => Ok(value),
        _ => Err(format!("a number of metres is due, {} to {MOST_M}", -MOST_M)),
    }
}

fn height(text: &str) -> Result<f64, String> {
    metres(text)
        .ok()
        .filter(|m| *m > 0.0)
        .ok_or_else(|| format!("a height in metres is due, above 0, up to {MOST_M}"))
}

/// Beyond every room, m.
const MOST_M: f64 = 1000.0;

/// Where vehicles are looked for if nobody says where.
pub const USUAL: &str = "udpin:127.0.0.1:14550";

/// Who is to be spoken to.
#[derive(Debug, Default)]
pub struct Target {
    /// Where; `None`: [`USUAL`].
    pub to: Option<String>,
    /// Which of those there.
    pub wanted: Wanted,
    /// With this key.
    pub key: Option<SigningKey>,
}

impl Target {
    fn connect(self, brief: bool) -> Result<GroundStation, CtlError> {
        let address = self.to.as_deref().unwrap_or(USUAL);
        GroundStation::find(address, self.key, &self.wanted, brief)
    }
}

/// Runs one action. Progress goes to `say`; what is not the vehicle's answer, to `note`.
pub fn run(
    target: Target,
    action: &Action,
    mut say: impl FnMut(&str),
    mut note: impl FnMut(&str),
) -> Result<(), CtlError> {
    let mission = match action {
        Action::Items { file } => {
            let plan = read_plan(file)?;
            plan.remarks.iter().for_each(|remark| note(remark));
            say(&format!("{:#}", plan.json()));
            return Ok(());
        }
        Action::Mission { file } => Some(read_plan(file)?),
        _ => None,
    };
    let mut station = target.connect(matches!(action, Action::Status { .. }))?;
    let vehicle = station.chosen().as_ref().map(named).unwrap_or_default();
    if !matches!(action, Action::Status { .. }) {
        note(&format!("speaks to {vehicle}"));
    }
    match action {
        // Answered above.
        Action::Items { .. } => {}
        Action::Arm => station.arm()?,
        Action::Disarm => station.disarm()?,
        Action::Hold => station.set_mode(Mode::Hold)?,
        Action::Land => station.land()?,
        Action::Takeoff { height_m } => {
            if !station.vehicle().armed {
                station.arm()?;
            }
            station.takeoff(*height_m)?;
        }
        Action::Goto { north_m, east_m, height_m } => {
            station.goto(*north_m, *east_m, *height_m)?;
        }
        Action::Mission { .. } => {
            fly_file(&mut station, &mission.unwrap_or_default(), &mut say, &mut note)?;
        }
        Action::Program { name } => {
            let names = program_names(&mut station)?;
            match name {
                None => names.iter().for_each(|name| say(name)),
                Some(name) => {
                    let items = load_program(&mut station, name, &names)?;
                    say(&format!("{name}: {items} items in force"));
                    // All of them end on the floor.
                    fly_mission(&mut station, items, true, &mut say)?;
                }
            }
        }
        Action::Status { json } => status(&mut station, &vehicle, *json, &mut say)?,
    }
    for text in station.take_texts() {
        say(&text);
    }
    for other in station.others() {
        note(&format!("another vehicle spoke here and was not listened to: {}", named(&other)));
    }
    Ok(())
}

/// Uploads what a file holds, and flies its mission.
fn fly_file(
    station: &mut GroundStation,
    file: &PlanFile,
    say: &mut impl FnMut(&str),
    note: &mut impl FnMut(&str),
) -> Result<(), CtlError> {
    file.remarks.iter().for_each(|remark| note(remark));
    // A part that the file does not have stays as it is on the vehicle. The fence first: the mission is judged
    // by it, and where it is refused the fence before is put back.
    let lists = [
        (MavMissionType::MAV_MISSION_TYPE_FENCE, &file.fence[..]),
        (MavMissionType::MAV_MISSION_TYPE_RALLY, &file.rally[..]),
        (MavMissionType::MAV_MISSION_TYPE_MISSION, &file.mission[..]),
    ];
    let lists: Vec<_> = lists.into_iter().filter(|(_, items)| !items.is_empty()).collect();
    station.upload_plans(&lists, &mut *note)?;
    for (kind, items) in &lists {
        match kind {
            MavMissionType::MAV_MISSION_TYPE_MISSION => {
                say(&format!("{} items accepted", items.len()));
            }
            kind => say(&format!("{}: {} items accepted", name_of(*kind), items.len())),
        }
    }
    if file.mission.is_empty() {
        note("the file holds no mission: nothing is flown");
        return Ok(());
    }
    fly_mission(station, file.mission.len(), file.lands(), say)
}

/// Tells what the vehicle tells about itself; `vehicle`: it in words.
fn status(
    station: &mut GroundStation,
    vehicle: &str,
    json: bool,
    say: &mut impl FnMut(&str),
) -> Result<(), CtlError> {
    // One round of the slow streams, and of every link and loss in turn.
    station.set_interval(HALTERE_LINK_ID, ROUND_US)?;
    station.set_interval(HALTERE_DROPS_ID, ROUND_US)?;
    station.listen(Duration::from_secs(2))?;
    for id in [HALTERE_LINK_ID, HALTERE_DROPS_ID] {
        station.set_interval(id, 0.0)?;
    }
    if json {
        let mut told = station.vehicle().json();
        told["texts"] = station.take_texts().into();
        if let Some(chosen) = station.chosen() {
            told["vehicle"] = json!({
                "system": chosen.system,
                "address": chosen.from.map(|from| from.to_string()),
                "words": vehicle,
            });
        }
        say(&format!("{told:#}"));
    } else {
        say(&format!("vehicle:  {vehicle}"));
        station.vehicle().lines().iter().for_each(|line| say(line));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use haltere_dialect::mav::haltere::{
        COMMAND_ACK_DATA, HEARTBEAT_DATA, MISSION_ITEM_REACHED_DATA, MavAutopilot, MavMessage,
        MavModeFlag, STATUSTEXT_DATA,
    };
    use haltere_dialect::mav_stream::{MavSplitter, encode};
    use std::net::UdpSocket;
    use std::time::Instant;

    fn beat(armed: bool) -> MavMessage {
        let base_mode =
            if armed { MavModeFlag::MAV_MODE_FLAG_SAFETY_ARMED } else { MavModeFlag::empty() };
        let autopilot = MavAutopilot::MAV_AUTOPILOT_GENERIC as u8;
        MavMessage::HEARTBEAT(HEARTBEAT_DATA { autopilot, base_mode, ..Default::default() })
    }

    fn text(words: &str) -> MavMessage {
        MavMessage::STATUSTEXT(STATUSTEXT_DATA { text: words.into(), ..Default::default() })
    }

    /// The texts of a flight were printed when it was over, the last item before the take-off.
    #[test]
    fn regress_texts_of_a_mission_come_as_they_are_said() {
        let vehicle = UdpSocket::bind("127.0.0.1:0").unwrap();
        let to = vehicle.local_addr().unwrap();
        let reached = |seq| MavMessage::MISSION_ITEM_REACHED(MISSION_ITEM_REACHED_DATA { seq });
        let flight = [
            text("take-off height reached"),
            reached(0),
            text("on the way"),
            reached(1),
            text("landed"),
            beat(false),
        ];
        let flies = std::thread::spawn(move || {
            let (mut splitter, mut buffer, mut sequence) = (MavSplitter::new(), [0; 2048], 0_u8);
            let mut flight = flight.into_iter();
            let mut begun = false;
            loop {
                let Ok((n, from)) = vehicle.recv_from(&mut buffer) else { return };
                splitter.push(&buffer[..n]);
                let mut answers = vec![beat(true)];
                while let Some(Ok(frame)) = splitter.next() {
                    if let Ok(MavMessage::COMMAND_LONG(asked)) = frame.decode() {
                        begun = true;
                        let command = asked.command;
                        answers.push(MavMessage::COMMAND_ACK(COMMAND_ACK_DATA {
                            command,
                            ..Default::default()
                        }));
                    }
                }
                if begun && answers.len() == 1 {
                    let Some(next) = flight.next() else { return };
                    answers = vec![next];
                }
                for answer in answers {
                    let mut bytes = Vec::new();
                    encode(&mut bytes, 1, 1, sequence, &answer);
                    sequence = sequence.wrapping_add(1);
                    vehicle.send_to(&bytes, from).unwrap();
                }
            }
        });
        let mut station = GroundStation::connect(&format!("udpout:{to}")).unwrap();
        let mut said = Vec::new();
        let error =
            fly_mission(&mut station, 3, false, &mut |line: &str| said.push(line.to_owned()));
        assert_eq!(
            said,
            [
                "take-off height reached",
                "item 1 of 3 done",
                "on the way",
                "item 2 of 3 done",
                "landed"
            ]
        );
        let error = error.unwrap_err().to_string();
        assert!(error.contains("after item 2 of 3") && error.contains("landed"), "{error}");
        drop(station);
        // Whoever plays the vehicle waits for more; that ends with this program.
        drop(flies);
    }

    /// Who only asks how it stands waited for ten seconds.
    #[test]
    fn regress_status_says_soon_that_nobody_is_there() {
        let free = UdpSocket::bind("127.0.0.1:0").unwrap().local_addr().unwrap();
        let target = Target { to: Some(format!("udpin:{free}")), ..Target::default() };
        let began = Instant::now();
        let status = Action::Status { json: false };
        let error = run(target, &status, |_| {}, |_| {}).unwrap_err().to_string();
        assert!(error.contains("no heartbeat of a vehicle within 2 s"), "{error}");
        assert!(began.elapsed() < Duration::from_secs(8), "{:?}", began.elapsed());
    }
}
