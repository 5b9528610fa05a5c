//! `haltere-lab speed`: what a flight and a message cost in processor time, and what follows of it for a bank and for many machines.
//!
//! Each figure is the best of several runs: whatever else the machine does only adds. Two builds are compared on one machine, one
//! after the other and again, by their ratio.

use std::hint::black_box;
use std::time::Duration;

use anyhow::{Result, ensure};
use haltere::cli::{print, print_json};
use haltere_core::frames::Vec3;
use haltere_dialect::mav::haltere::{HIGHRES_IMU_DATA, HighresImuUpdatedFlags, MavMessage};
use haltere_dialect::mav_stream::{self, MavSplitter};
use haltere_gap::bank::fly::fly_observed_into;
use haltere_gap::bank::jitter::jittered;
use haltere_gap::bank::make_bank::BankSize;
use haltere_gap::bank::{library, missions};
use haltere_gap::flight::statistics::statistics_of;
use haltere_gap::flight::trace::Trace;
use haltere_gap::nominal::Nominal;
use haltere_gap::scene::Scene;
use haltere_model::Plant;
use haltere_model::lockstep::{Lockstep, fly_unsampled};
use rustix::time::{ClockId, clock_gettime};
use serde::Serialize;

/// Messages that are read at once: an hour of a board's.
const MESSAGES: usize = 1_000_000;

/// `haltere-lab speed`
#[derive(Debug, clap::Args)]
pub struct Options {
    /// Runs of each, of which the best counts.
    #[arg(long, default_value_t = 5, value_parser = clap::value_parser!(u32).range(1..))]
    runs: u32,
    /// Prints as JSON.
    #[arg(long)]
    json: bool,
}

/// What was measured, on one core.
#[derive(Debug, Serialize)]
struct Speed {
    /// Simulated length of the diagnostic flight, from the start of the simulator to its end, s.
    flight_s: f64,
    /// Processor time of it in lockstep where nobody listens, s.
    closed_loop_s: f64,
    /// The same for a bank: with its records, s …
    recorded_s: f64,
    /// … and its statistics, s.
    statistics_s: f64,
    /// A message of MAVLink taken out of its stream, checked and decoded, s.
    message_s: f64,
    /// Flights of a full bank: without effect, and draws.
    healthy: usize,
    draws: usize,
    effects: usize,
    /// Draws of the effect that has most: it is flown in one piece.
    most_draws: usize,
}

/// Measures and prints.
pub fn run(options: &Options) -> Result<()> {
    let speed = measure(options.runs)?;
    if options.json { print_json(&speed) } else { print(&speed.table()) }
}

fn measure(runs: u32) -> Result<Speed> {
    let scene = Scene::lab().map_err(anyhow::Error::new)?;
    let items = missions::diagnostic(&scene);
    let nominal = Nominal::of_scene(&scene);
    let plant = jittered(scene.plant(1)).map_err(anyhow::Error::new)?;
    let [north_m, east_m] = scene.start_NE_m;
    let start_E_m = Vec3::new(north_m, east_m, 0.0);
    let mut flight_s = 0.0;
    let closed_loop_s = best_s(runs, || {
        let world = Plant::new(plant.clone()).map_err(anyhow::Error::new)?;
        let world = Lockstep::in_world(world, scene.pilot.clone(), &scene.survey, None);
        let mut world = world.without_streams().without_topics();
        let limit_s = |mission: &haltere_pilot::Mission| {
            1.2 * mission.length_s(start_E_m, &scene.pilot.flight)
        };
        fly_unsampled(&mut world, &items, limit_s, |_| {})?;
        flight_s = world.t_us() as f64 * 1e-6;
        Ok(())
    })?;
    let mut trace = Trace::new(scene.survey.clone());
    let recorded_s = best_s(runs, || {
        Ok(fly_observed_into(&mut trace, &scene, &items, plant.clone(), scene.pilot.clone())?)
    })?;
    let statistics_s = best_s(runs, || {
        statistics_of(&trace, &nominal)?;
        Ok(())
    })?;
    let message_s = message_s(runs)?;
    let (size, library) = (BankSize::default(), library::standard());
    let draws = library.iter().map(|spec| size.draws_of(spec));
    Ok(Speed {
        flight_s,
        closed_loop_s,
        recorded_s,
        statistics_s,
        message_s,
        healthy: size.seeds + size.jitter,
        draws: draws.clone().sum(),
        effects: library.len(),
        most_draws: draws.max().unwrap_or(0),
    })
}

/// The longest message that comes often: samples of a board's IMU.
fn message_s(runs: u32) -> Result<f64> {
    let mut one = Vec::new();
    let sample = HIGHRES_IMU_DATA {
        zacc: -9.81,
        fields_updated: HighresImuUpdatedFlags::all(),
        ..Default::default()
    };
    mav_stream::encode(&mut one, 1, 1, 0, &MavMessage::HIGHRES_IMU(sample));
    let all_s = best_s(runs, || {
        let (mut splitter, mut read) = (MavSplitter::new(), 0);
        for _ in 0..MESSAGES {
            splitter.push(black_box(&one));
            while let Some(Ok(frame)) = splitter.next() {
                read += usize::from(black_box(frame.decode()).is_ok());
            }
        }
        ensure!(read == MESSAGES, "{read} of {MESSAGES} messages were read");
        Ok(())
    })?;
    Ok(all_s / MESSAGES as f64)
}

/// Least processor time of some runs, s.
fn best_s(runs: u32, mut run: impl FnMut() -> Result<()>) -> Result<f64> {
    let now = || {
        let t = clock_gettime(ClockId::ThreadCPUTime);
        Duration::new(t.tv_sec.unsigned_abs(), u32::try_from(t.tv_nsec).unwrap_or(0))
    };
    let mut best = Duration::MAX;
    for _ in 0..runs {
        let begin = now();
        run()?;
        best = best.min(now().saturating_sub(begin));
    }
    Ok(best.as_secs_f64())
}

impl Speed {
    /// A flight of a bank, s.
    fn observed_s(&self) -> f64 {
        self.recorded_s + self.statistics_s
    }

    fn table(&self) -> String {
        let Self { flight_s, closed_loop_s, recorded_s, statistics_s, message_s, .. } = *self;
        let times = |s: f64| format!("{:.0} ms, {:.0} × real time", s * 1e3, flight_s / s);
        let bank_s = self.observed_s() * (self.healthy + self.draws) as f64;
        // Both stages of a bank on more machines than it has parts (docs/CAMPAIGNS.md).
        let least_s = self.observed_s() * (1 + self.most_draws) as f64;
        format!(
            "| on one core | processor time |\n|---|---|\n\
             | a message of MAVLink | {:.0} ns, {:.1} million a second |\n\
             | closed loop, {flight_s:.0} s of flight, nobody listens | {} |\n\
             | the same recorded, as for a bank | {} |\n\
             | its statistics | {:.0} ms |\n\
             | full bank, {} healthy flights and {} draws, none drawn again | {bank_s:.0} s |\n\
             | the same on {} parts and more, the longest chain of it | {least_s:.0} s |\n",
            message_s * 1e9,
            1e-6 / message_s,
            times(closed_loop_s),
            times(recorded_s),
            statistics_s * 1e3,
            self.healthy,
            self.draws,
            self.healthy.max(self.effects),
        )
    }
}
