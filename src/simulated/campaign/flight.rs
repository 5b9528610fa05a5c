//! Flies one planned flight in lockstep, brings its faults in, and looks at the truth at every step.
//!
//! A fault is brought in where it belongs: the plant breaks, the companion's computer stands still, or somebody
//! at the station orders something.

use std::collections::{BTreeSet, VecDeque};
use std::fs::File;
use std::io::{BufWriter, Write as _};
use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};

use anyhow::{Context, Result, anyhow, bail};
use haltere_core::checks::Problems;
use haltere_core::survey::Survey;
use haltere_core::time::HostTime;
use haltere_dialect::mav::haltere::MavMessage;
use haltere_log::written;
use haltere_model::board::Outside;
use haltere_model::lockstep::{Ground, HOST_START_US, Lockstep, STEP_US, make_ready, start};
use haltere_model::rotorcraft::Rotorcraft;
use haltere_model::{Plant, Truth};
use haltere_pilot::Mode;
use haltere_pilot::mission_file::{Command as ItemCommand, Item};

use super::draw::grain;
use super::judge::Judge;
use super::operator::{Operator, Scene};
use super::plan::Plan;
use super::row::{Outcome, Row};
use super::takeoff::TakeOff;
use crate::report::truth::{HEADER, TruthRow};
use crate::simulated::faults::{Mishap, Part, Phase, Told};
use crate::tape::Tape;

/// On the floor and disarmed for this long: it is over, µs.
const REST_US: u64 = 1_000_000;
/// So long after a crash it is over, µs.
const AFTER_CRASH_US: u64 = 1_500_000;
/// So long a companion is watched after a pause, µs.
const AFTER_PAUSE_US: u64 = 5_000_000;
/// A vehicle that is so far outside is not waited for, m.
const FAR_OUTSIDE_M: f64 = 30.0;
/// Steps between two looks at estimate and setpoint: the control period.
const CONTROL_STEPS: u64 = 5;
/// Texts of the companion that are kept, the last ones.
const TEXTS: usize = 6;
/// Off the floor by so much the climb has begun, m.
const CLIMB_M: f64 = 0.1;

/// In a landing below this the touch-down has begun, m.
const TOUCHDOWN_M: f64 = 0.15;

/// Where the log and the truth of a flight go.
pub struct Keep<'a> {
    /// The log; the truth stands beside it as CSV.
    pub log: &'a Path,
}

/// A fault that waits: for a phase, then for a time.
struct Waiting {
    phase: Phase,
    at_s: f64,
    for_s: Option<f64>,
    mishap: Mishap,
}

/// A Crazyflie's firmware in another program.
pub struct Firmware {
    /// It.
    pub program: Box<dyn Outside>,
    /// On what it flies; `None`: on wings.
    pub rotors: Option<Rotorcraft>,
}

/// Flies it. An error is something that no flight should come to: a plan that cannot be built.
pub fn fly(plan: &Plan, keep: Option<&Keep<'_>>) -> Result<Row> {
    fly_by(plan, keep, None)
}

/// The same; where there is one, such a firmware is the board.
pub fn fly_by(plan: &Plan, keep: Option<&Keep<'_>>, firmware: Option<Firmware>) -> Result<Row> {
    let mut plant = Plant::new(plan.scenario.plant(plan.vehicle.clone())?)
        .map_err(|problems| anyhow!("{problems}"))?;
    if let Some(Firmware { program, rotors }) = firmware {
        plant.fly_by(program, rotors).map_err(|problems| anyhow!("{problems}"))?;
    }
    let survey = plan.scenario.told_survey()?;
    let mut kept = keep.map(|keep| Kept::begin(keep, plan, &survey)).transpose()?;
    let listener = kept.as_ref().map(|kept| kept.tape.listener());
    let mut world = Lockstep::in_world(plant, plan.config.pilot(), &survey, listener);
    // Whatever has its time comes at it, while the vehicle is made ready as well.
    let refusal = Arc::new(Mutex::new(None));
    let (mut timed, told) = (plan.scenario.timed_faults().into_iter().peekable(), refusal.clone());
    world = world.with_happenings(Box::new(move |t_us, plant: &mut Plant| {
        while let Some((_, fault)) = timed.next_if(|(at_s, _)| at_s * 1e6 <= t_us as f64) {
            if let Err(why) = plant.inject(fault) {
                *told.lock().unwrap_or_else(PoisonError::into_inner) = Some(why);
            }
        }
    }));
    world = match &kept {
        Some(kept) => world.with_tap(kept.tape.tap()),
        None => world.without_topics(),
    };
    let row = Flight::new(plan).fly(&mut world, kept.as_mut());
    drop(world); // it holds the tape
    if let Some(Kept { tape, truth }) = kept {
        tape.end()?;
        truth.end()?;
    }
    if let Some(why) = refusal.lock().unwrap_or_else(PoisonError::into_inner).take() {
        bail!("fault refused: {why}");
    }
    row
}

struct Flight<'a> {
    plan: &'a Plan,
    judge: Judge,
    row: Row,
    waiting: Vec<Waiting>,
    /// Faults of a phase that has begun: time (µs of simulated time) and fault.
    due: VecDeque<(u64, Mishap)>,
    /// The companion's computer stands still until then, µs of simulated time.
    paused_until_us: u64,
    /// The flight is not over before this time, µs.
    awaited_until_us: u64,
    /// Where it stood at the start, room north and east, m.
    home: [f64; 2],
    /// When the first fault with a fixed time comes, µs of simulated time.
    first_timed_us: Option<u64>,
    start_us: u64,
    reached: u16,
    items_flown: BTreeSet<u16>,
    phases_begun: Vec<Phase>,
    modes: Vec<Mode>,
    errors: [Mean; 2],
    fault_us: Option<u64>,
    rest_since_us: Option<u64>,
}

#[derive(Default)]
struct Mean {
    sum: f64,
    count: u64,
    worst: f64,
}

impl Mean {
    fn add(&mut self, value: f64) {
        self.sum += value;
        self.count += 1;
        self.worst = self.worst.max(value);
    }

    fn pair(&self) -> (Option<f64>, Option<f64>) {
        if self.count == 0 {
            return (None, None);
        }
        (Some(grain(self.sum / self.count as f64)), Some(grain(self.worst)))
    }
}

fn seconds(us: u64) -> f64 {
    us as f64 * 1e-6
}

impl<'a> Flight<'a> {
    fn new(plan: &'a Plan) -> Self {
        let waiting = plan
            .scenario
            .faults
            .iter()
            .filter_map(|entry| {
                let phase = entry.phase?;
                let mishap = entry.to_mishap("fault", &mut Problems::new())?;
                Some(Waiting { phase, at_s: entry.at_s, for_s: entry.for_s, mishap })
            })
            .collect();
        // What was told wrongly is there from the start.
        let told_s = (plan.scenario.told != Told::default()).then_some(0.0);
        let blank = Row::blank(plan.index, plan.seed, plan.drawn.clone());
        let row = Row { fault_s: told_s, ..blank };
        let of_takeoff = |item: &&Item| item.command == ItemCommand::Takeoff;
        let takeoffs = plan.mission.items.iter().filter(of_takeoff).count();
        Self {
            plan,
            judge: Judge::new(takeoffs, plan.scenario.faults.iter().any(|f| f.part == Part::Gear)),
            row,
            waiting,
            due: VecDeque::new(),
            paused_until_us: 0,
            awaited_until_us: 0,
            home: plan.scenario.start.position_m,
            first_timed_us: plan
                .scenario
                .timed_faults()
                .first()
                .map(|(at_s, _)| (at_s * 1e6) as u64),
            start_us: 0,
            reached: 0,
            items_flown: BTreeSet::new(),
            phases_begun: Vec::new(),
            modes: Vec::new(),
            errors: [Mean::default(), Mean::default()],
            fault_us: None,
            rest_since_us: None,
        }
    }

    fn fly(mut self, world: &mut Lockstep, mut kept: Option<&mut Kept>) -> Result<Row> {
        let mut ground = Ground::new();
        let items: Vec<_> = self
            .plan
            .mission
            .items
            .iter()
            .zip(0..)
            .map(|(item, seq)| item.to_wire(seq, 0, 0))
            .collect();
        let begun = match self.plan.take_off {
            TakeOff::Mission => start(world, &mut ground, &items),
            _ => make_ready(world, &mut ground, &items),
        };
        if let Err(error) = begun {
            self.row.why = error.to_string();
            self.row.said = last(&ground.texts);
            return Ok(self.row);
        }
        let mut operator = Operator::new(ground);
        operator.take_off(self.plan.take_off, self.home);
        self.start_us = world.t_us();
        self.row.lowest_supply_v = world.truth().supply_v;
        let end_us = self.start_us + (self.plan.limit_s * 1e6) as u64;
        let mut finished = false;
        for step in 1.. {
            self.inject(world, &mut operator)?;
            if world.t_us() < self.paused_until_us {
                world.stall_until(world.t_us() + STEP_US);
            } else {
                world.step();
            }
            if let Some(kept) = kept.as_deref_mut() {
                kept.tape.topics(world.host_now(), world.pilot_mut());
            }
            let truth = world.truth();
            self.judge.see(&self.plan.fence, &truth);
            self.row.lowest_supply_v = self.row.lowest_supply_v.min(truth.supply_v);
            self.watch_modes(world, &truth);
            if step % CONTROL_STEPS == 0 {
                // Nobody reads a station while the companion's computer stands still.
                if world.t_us() >= self.paused_until_us {
                    let taken = operator.act(world, &self.scene(&truth));
                    self.judge.forbidden.extend(taken);
                }
                while let Some(seq) = operator.ground.take(|m| match m {
                    MavMessage::MISSION_ITEM_REACHED(r) => Some(r.seq + 1),
                    _ => None,
                }) {
                    self.reached = seq;
                    self.items_flown.insert(seq);
                }
                self.measure(world, &truth);
                if let Some(kept) = kept.as_deref_mut() {
                    kept.truth.push(&truth)?;
                }
            }
            if self.is_over(world, &truth) {
                finished = true;
                break;
            }
            if world.t_us() >= end_us {
                break;
            }
        }
        operator.ground.listen(world);
        Ok(self.result(world, finished, &operator.ground.texts))
    }

    /// The first fault that comes in the flight; one from before counts as there at its begin.
    fn note_fault(&mut self, world: &Lockstep) {
        let now_us = world.t_us();
        if self.fault_us.is_none() {
            self.fault_us = Some(now_us);
            self.row.fault_s = Some(grain(seconds(now_us.saturating_sub(self.start_us))));
            world.pilot().mode().name().clone_into(&mut self.row.fault_mode);
        }
    }

    /// Brings in what is due now.
    fn inject(&mut self, world: &mut Lockstep, operator: &mut Operator) -> Result<()> {
        let now_us = world.t_us();
        if self.first_timed_us.is_some_and(|at_us| at_us <= now_us) {
            self.note_fault(world);
        }
        while let Some(place) = self.due.iter().position(|(at_us, _)| *at_us <= now_us) {
            let Some((_, mishap)) = self.due.remove(place) else { break };
            self.note_fault(world);
            match mishap {
                Mishap::Plant(fault) => {
                    world
                        .plant_mut()
                        .inject(fault)
                        .map_err(|why| anyhow!("fault refused: {why}"))?;
                }
                Mishap::Pause(length_s) => {
                    self.paused_until_us = now_us + (length_s * 1e6) as u64;
                    self.awaited_until_us = self.paused_until_us + AFTER_PAUSE_US;
                }
                Mishap::Order(order) => operator.order(order),
            }
        }
        Ok(())
    }

    fn scene<'s>(&'s self, truth: &'s Truth) -> Scene<'s> {
        let Plan { fence, mission, .. } = self.plan;
        let (reached, home) = (self.reached, self.home);
        Scene { truth, volume: fence, mission: &mission.items, reached, home }
    }

    fn phase(&self, mode: Mode, truth: &Truth) -> Option<Phase> {
        Some(match mode {
            Mode::Spool => Phase::Spool,
            Mode::Takeoff if truth.height_m > CLIMB_M => Phase::Climb,
            Mode::Hold => Phase::Hover,
            Mode::Mission => {
                match self.plan.mission.items.get(usize::from(self.reached))?.command {
                    ItemCommand::Delay => Phase::Hover,
                    ItemCommand::Waypoint => Phase::Waypoints,
                    _ => return None,
                }
            }
            Mode::Goto => Phase::Waypoints,
            Mode::Return => Phase::Return,
            Mode::Land | Mode::Descend if self.judge.has_flown && truth.height_m < TOUCHDOWN_M => {
                Phase::Touchdown
            }
            Mode::Land => Phase::Landing,
            _ => return None,
        })
    }

    fn watch_modes(&mut self, world: &Lockstep, truth: &Truth) {
        let mode = world.pilot().mode();
        if self.modes.last() != Some(&mode) {
            self.modes.push(mode);
            if let Some(fault_us) = self.fault_us
                && self.row.reacted_after_s.is_none()
            {
                self.row.reacted_after_s =
                    Some(grain(seconds(truth.t_us.saturating_sub(fault_us))));
            }
        }
        let Some(phase) = self.phase(mode, truth) else { return };
        if self.phases_begun.contains(&phase) {
            return;
        }
        self.phases_begun.push(phase);
        let (now, later) =
            std::mem::take(&mut self.waiting).into_iter().partition(|w| w.phase == phase);
        self.waiting = later;
        for Waiting { at_s, for_s, mishap, .. } in now {
            let at_us = truth.t_us + (at_s * 1e6) as u64;
            let end =
                for_s.and_then(|for_s| Some((at_us + (for_s * 1e6) as u64, mishap.mended()?)));
            self.due.push_back((at_us, mishap));
            self.due.extend(end);
        }
    }

    fn measure(&mut self, world: &Lockstep, truth: &Truth) {
        if !self.judge.airborne {
            return;
        }
        let pilot = world.pilot();
        let [estimate, tracking] = &mut self.errors;
        estimate.add((pilot.estimate().pos_E_m - truth.pos_E_m).norm());
        if pilot.mode().is_flying() && pilot.mode() != Mode::Land {
            let wanted = pilot.control_record().pos_setpoint_E_m;
            let off = |axis: usize| wanted[axis].map_or(0.0, |at| at - truth.pos_E_m[axis]);
            tracking.add((0..3).map(|axis| off(axis).powi(2)).sum::<f64>().sqrt());
        }
    }

    fn is_over(&mut self, world: &Lockstep, truth: &Truth) -> bool {
        if let Some((at_us, _)) = self.judge.crash
            && truth.t_us > at_us + AFTER_CRASH_US
        {
            return true;
        }
        // What a paused companion does when it goes on belongs to the flight.
        let awaited = truth.t_us < self.awaited_until_us;
        // A Crazyflie that arms itself stays armed: there it counts that the companion had it in hand and let it go.
        let given_back = self.plan.scenario.companion_board().is_some()
            && self.modes.len() > 1
            && world.pilot().mode() == Mode::Disarmed;
        let rests = truth.on_ground && (!truth.armed || given_back) && !awaited;
        if !rests {
            self.rest_since_us = None;
        }
        let since_us = *self.rest_since_us.get_or_insert(truth.t_us);
        // A mission that has just begun stands armed; one that was refused its arming does not.
        (rests && truth.t_us - since_us >= REST_US) || self.judge.outside_m > FAR_OUTSIDE_M
    }

    fn result(mut self, world: &Lockstep, finished: bool, texts: &[String]) -> Row {
        let after = |us: u64| Some(grain(seconds(us.saturating_sub(self.start_us))));
        let (judge, row) = (&self.judge, &mut self.row);
        row.left_s = judge.left_us.and_then(after);
        row.crashed_s = judge.crash.as_ref().and_then(|(us, _)| after(*us));
        row.again_s = judge.again_us.and_then(after);
        row.outside_m = grain(judge.outside_m);
        row.items = self.plan.mission.items.len() as u64;
        row.items_flown = self.items_flown.len() as u64;
        row.flown_s = grain(seconds(world.t_us() - self.start_us));
        row.airborne_s = grain(seconds(judge.airborne_steps * STEP_US));
        row.tilt_worst_deg = grain(judge.tilt_deg);
        row.contact_mps = grain(judge.contact_mps);
        row.contacts = judge.contacts;
        row.lowest_supply_v = grain(row.lowest_supply_v);
        (row.estimate_mean_m, row.estimate_worst_m) = self.errors[0].pair();
        (row.tracking_mean_m, row.tracking_worst_m) = self.errors[1].pair();
        row.modes = self.modes.iter().map(|m| m.name()).collect::<Vec<_>>().join(">");
        for drops in world.pilot().drops() {
            for (reason, count) in drops.iter() {
                *row.drops.entry(reason.name().to_owned()).or_default() += count;
            }
        }
        row.said = last(texts);
        // What came first counts.
        let mut went_wrong = vec![
            (row.left_s, Outcome::Left, format!("{:.2} m outside at worst", row.outside_m)),
            (
                row.again_s,
                Outcome::Again,
                format!("up to {:.2} m again after touch-down", judge.again_m),
            ),
        ];
        if let Some((_, how)) = &judge.crash {
            went_wrong.push((row.crashed_s, Outcome::Crashed, how.clone()));
        }
        let first = went_wrong
            .into_iter()
            .filter_map(|(at_s, outcome, how)| Some((at_s?, outcome, how)))
            .min_by(|a, b| a.0.total_cmp(&b.0));
        (row.outcome, row.why) = if let Some((_, outcome, how)) = first {
            (outcome, how)
        } else if !finished {
            let mode = world.pilot().mode().name();
            (Outcome::Unfinished, format!("still {mode} after {:.0} s", row.flown_s))
        } else if !judge.lifted {
            (Outcome::NotTakenOff, "never off the floor".to_owned())
        } else {
            (Outcome::Landed, String::new())
        };
        self.row
    }
}

fn last(texts: &[String]) -> Vec<String> {
    texts[texts.len().saturating_sub(TEXTS)..].to_vec()
}

/// What is kept of a flight.
struct Kept {
    tape: Tape,
    truth: TruthCsv,
}

impl Kept {
    fn begin(keep: &Keep<'_>, plan: &Plan, survey: &Survey) -> Result<Self> {
        let tape = Tape::begin(keep.log, &plan.config, survey)?;
        Ok(Self { tape, truth: TruthCsv::create(keep.log)? })
    }
}

/// Ending of a log's truth.
pub const TRUTH: &str = "truth.csv";

/// Truth beside a log, 100 lines a second, as `haltere report --truth` reads it.
struct TruthCsv {
    path: std::path::PathBuf,
    out: BufWriter<File>,
}

impl TruthCsv {
    fn create(log: &Path) -> Result<Self> {
        let path = log.with_extension(TRUTH);
        let file = written::growing(&path, &[log])?;
        let mut out = BufWriter::new(file);
        writeln!(out, "{HEADER}").with_context(|| path.display().to_string())?;
        Ok(Self { path, out })
    }

    fn push(&mut self, truth: &Truth) -> Result<()> {
        let row = TruthRow::of(truth, HostTime::from_us(HOST_START_US + truth.t_us));
        row.write(&mut self.out).with_context(|| self.path.display().to_string())
    }

    fn end(mut self) -> Result<()> {
        self.out.flush().with_context(|| self.path.display().to_string())
    }
}
