//! `haltere-sim lockstep`: simulator and companion's core in one program, on simulated time.
//!
//! The core and the plant are those of `fly` and `serve`, and the same bytes pass between them; threads,
//! sockets and serial lines in between are left out, so that time can run as fast as the computer, or as a
//! script, permits. With `--speed 0` it passes only when the script says so: two runs of one script are
//! then equal to the last byte.

mod log;
mod wire;

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use anyhow::{Result, anyhow, bail};
use haltere::report::truth::TruthRow;
use haltere::rig::stop::Stop;
use haltere::simulated::faults::happen;
use haltere::simulated::scenario::Scenario;
use haltere::sources::{self, Loaded, Sources};
use haltere::store::{NoPrograms, Store};
use haltere::watch::{Feed, Watch};
use haltere_core::time::HostTime;
use haltere_model::lockstep::{HOST_START_US, Lockstep, STEP_US};
use haltere_model::{Fault, Plant, Vehicle};
use haltere_pilot::{Input, LinkId};
use serde_json::json;

use self::log::Tape;
use self::wire::Wires;
use crate::endpoint::{keep_time, plant};
use crate::lateness::Lateness;
use crate::orders::{self, Next, Order, Orders};
use crate::truth_file::TruthFile;

/// `haltere-sim lockstep`
#[derive(Debug, clap::Args)]
pub struct Options {
    /// Configuration of the companion, as for `haltere fly`, anchors included; may be given several times.
    /// Default: a vehicle in the scenario's room, which speaks as the simulators of PX4 and ArduPilot do, to clients
    /// that listen at udpin:127.0.0.1:14550, and at udpin:127.0.0.1:14540, where it claims a receiver, as MAVSDK
    /// wants it; where another vehicle speaks to one of these ports, to the next that is free.
    #[arg(long, value_name = "FILE")]
    config: Vec<PathBuf>,
    /// One value of it, for example control.version=raw.
    #[arg(long, value_name = "KEY=VALUE")]
    set: Vec<String>,
    /// Scenario file, or the name of a built-in one (`haltere-sim print scenario`); without it the vehicle stands in the middle of a 10 × 10 × 7 m hall.
    #[arg(long, value_name = "FILE")]
    scenario: Option<PathBuf>,
    /// Seed of the random numbers; wins over the scenario.
    #[arg(long, value_name = "N")]
    seed: Option<u64>,
    /// Vehicle file, or the name of a built-in one (`haltere-sim print vehicle`).
    #[arg(long, value_name = "FILE")]
    vehicle: Option<PathBuf>,
    /// Simulated seconds a second, 0.01 to 1000. 0: time passes only by orders `{"run_s": 0.02}` on standard
    /// input.
    #[arg(long, value_name = "X", default_value_t = 1.0)]
    speed: f64,
    /// Ends after this simulated time, s; else a signal ends it.
    #[arg(long, value_name = "S")]
    duration: Option<f64>,
    /// File for truth, 100 lines a simulated second.
    #[arg(long, value_name = "FILE")]
    truth: Option<PathBuf>,
    /// Takes orders of a script on standard input, one JSON object a line, and answers on standard output:
    /// {"fault": {"part": "anchor", "anchor": 3}}, {"truth": true}. Ends when standard input ends. Implied by
    /// --speed 0.
    #[arg(long)]
    orders: bool,
}

/// Speeds that make sense.
const SPEEDS: std::ops::RangeInclusive<f64> = 0.01..=1000.0;
/// Period of the loop, host time.
const TICK: Duration = Duration::from_millis(1);
/// Sockets are looked at each so much simulated time where a script keeps the time, µs.
const LOOK_US: u64 = 10_000;
/// A loop that is later than this gives the lost time up.
const GIVE_UP: Duration = Duration::from_millis(250);
/// Period of truth rows, µs of simulated time.
const TRUTH_US: u64 = 10_000;
/// How often it is looked whether to end while a script says nothing.
const PATIENCE: Duration = Duration::from_millis(100);
/// Endpoints where the configuration names none.
const ENDPOINTS: &str = r#"ground.endpoints=["udpout:127.0.0.1:14550", { address = "udpout:127.0.0.1:14540", gps = "origin+gps" }]"#;

/// Runs until a signal, the end of `--duration` or that of standard input.
pub fn run(options: &Options) -> Result<()> {
    let paced = options.speed != 0.0;
    if paced && !SPEEDS.contains(&options.speed) {
        bail!("--speed {}: allowed 0, or {} to {}", options.speed, SPEEDS.start(), SPEEDS.end());
    }
    let stop = Stop::on_signals()?;
    let mut scenario = Scenario::load(options.scenario.as_deref())?;
    scenario.seed = options.seed.unwrap_or(scenario.seed);
    let loaded = configuration(options, &scenario)?;
    let pilot = loaded.config.pilot();
    let wires = Wires::open(&loaded.config.ground, &pilot)?;
    let world = plant(options.vehicle.as_deref(), &scenario)?;
    let mut session = Session::start(options, &loaded, wires, world, &scenario)?;
    let orders = (options.orders || !paced).then(Orders::listen).transpose()?;
    orders::answer(&json!({
        "ground": session.wires.addresses(),
        "log": session.tape.path(),
        "truth": options.truth,
        "seed": scenario.seed,
        "speed": options.speed,
    }));
    if paced {
        // Clients that wait by the clock would else find less time passed on a busy computer.
        keep_time(options.speed);
        session.pace(options.speed, &stop, orders.as_ref());
    } else if let Some(orders) = orders {
        session.follow(&stop, &orders);
    }
    session.finish()
}

/// That of files, or one for the scenario alone.
fn configuration(options: &Options, scenario: &Scenario) -> Result<Loaded> {
    let refused = |problems| anyhow!("the configuration is refused:\n{problems}");
    let loaded = if options.config.is_empty() {
        let gear_m = Vehicle::default().body.gear_m;
        // What the user sets comes later and wins.
        let mut overrides = vec![
            ENDPOINTS.to_owned(),
            format!("flight.gear_height_m={gear_m:?}"),
            format!("estimator.rest_height_m={gear_m:?}"),
            "store.directory=\"\"".to_owned(),
            format!("board.north_offset_deg={:?}", scenario.told.north_offset_deg(0.0)),
        ];
        if let Some([profile, address]) = scenario.companion_board() {
            overrides.push(format!("board.profile={profile:?}"));
            overrides.push(format!("board.address={address:?}"));
            overrides.push(format!("tag.protocol={:?}", scenario.companion_protocol()));
        }
        if let Some(origin) = &scenario.origin {
            overrides.push(format!("ground.origin={}", toml::Value::try_from(origin)?));
        }
        overrides.extend(options.set.iter().cloned());
        let config = sources::load(&Sources::new(Vec::new(), overrides)).map_err(refused)?;
        Loaded {
            config,
            survey: scenario.told_survey()?,
            files: Vec::new(),
            notes: Vec::new(),
            lost: None,
        }
    } else {
        Loaded::load(&Sources::new(options.config.clone(), options.set.clone())).map_err(refused)?
    };
    if loaded.config.ground.for_pilot().iter().any(|endpoint| endpoint.signs) {
        bail!(
            "ground.signing: the doors that check signatures are not part of lockstep; use `serve` and `fly`"
        );
    }
    Ok(loaded)
}

/// World, core and what leads out of them.
struct Session {
    lockstep: Lockstep,
    wires: Wires,
    tape: Tape,
    watch: Watched,
    truth: Option<TruthFile>,
    truth_due_us: u64,
    /// Time, s, and what breaks or is mended.
    faults: std::iter::Peekable<std::vec::IntoIter<(f64, Fault)>>,
    until_us: u64,
    /// Of who keeps the time by the clock.
    lateness: Lateness,
}

impl Session {
    fn start(
        options: &Options,
        loaded: &Loaded,
        wires: Wires,
        world: Plant,
        scenario: &Scenario,
    ) -> Result<Self> {
        let config = &loaded.config;
        let pilot = config.pilot();
        let inputs: Vec<&Path> = options
            .config
            .iter()
            .chain(&options.scenario)
            .chain(&options.vehicle)
            .map(|file| &**file)
            .collect();
        let tape = Tape::start(loaded)?;
        let links = u8::try_from(pilot.ground_links().count()).unwrap_or(u8::MAX);
        let mut lockstep =
            Lockstep::without_stations(world, pilot, &loaded.survey, Some(tape.listener()))
                .with_tap(tape.tap());
        if config.store.is_on() {
            let store = Store::new(
                &config.store.directory,
                &config.record.directory,
                tape.path().as_deref(),
                Box::new(NoPrograms),
            );
            lockstep = lockstep
                .with_disk(Box::new(move |task| store.work(task).map_err(|(fault, _)| fault)));
        }
        // The others come when somebody speaks.
        for link in (0..links).filter(|n| wires.is_open(*n)) {
            lockstep.input(Input::LinkUp { link: LinkId::Ground(link) });
        }
        Ok(Self {
            lockstep,
            wires,
            tape,
            watch: Watched::start(loaded)?,
            truth: options
                .truth
                .as_deref()
                .map(|path| TruthFile::create(path, &inputs))
                .transpose()?,
            truth_due_us: 0,
            faults: scenario.fixed_faults()?.into_iter().peekable(),
            lateness: Lateness::default(),
            until_us: options.duration.map_or(u64::MAX, |s| (s.max(0.0) * 1e6) as u64),
        })
    }

    /// Time passes at a constant speed, as far as the computer keeps up.
    fn pace(&mut self, speed: f64, stop: &Stop, orders: Option<&Orders>) {
        let mut began = Instant::now();
        let mut next = began;
        while !stop.asked() && self.lockstep.t_us() < self.until_us {
            next += TICK;
            std::thread::sleep(next.saturating_duration_since(Instant::now()));
            let late = Instant::now().saturating_duration_since(next);
            self.lateness.note(u64::try_from(late.as_micros()).unwrap_or(u64::MAX));
            if late > GIVE_UP {
                began += late;
                next += late;
            }
            let due_us = (next.saturating_duration_since(began).as_secs_f64() * speed * 1e6) as u64;
            self.run_until(due_us);
            if let Some(orders) = orders {
                loop {
                    match orders.next() {
                        Next::Order(order) => self.obey(order, false),
                        Next::None => break,
                        Next::Ended => return,
                    }
                }
            }
        }
    }

    /// Time passes as a script says.
    fn follow(&mut self, stop: &Stop, orders: &Orders) {
        while !stop.asked() && self.lockstep.t_us() < self.until_us {
            match orders.wait(PATIENCE) {
                Next::Order(order) => self.obey(order, true),
                Next::None => {}
                Next::Ended => return,
            }
        }
    }

    fn obey(&mut self, order: Order, follows: bool) {
        match order {
            Order::Fault(fault) => orders::inject(self.lockstep.plant_mut(), fault),
            Order::Truth => {
                orders::tell_truth(&TruthRow::of(&self.lockstep.truth(), self.lockstep.host_now()))
            }
            Order::Late => orders::answer(&self.lateness.json()),
            Order::Run(us) if follows => {
                let until_us = self.lockstep.t_us().saturating_add(us);
                while self.lockstep.t_us() < until_us {
                    self.run_until(until_us.min(self.lockstep.t_us() + LOOK_US));
                }
                orders::answer(&json!({ "t_s": self.lockstep.t_us() as f64 * 1e-6 }));
            }
            Order::Run(_) => orders::refuse(&anyhow!(
                "run_s: time passes by itself here; --speed 0 leaves it to the script"
            )),
        }
    }

    /// What stations sent goes in, time passes, what is for them goes out.
    fn run_until(&mut self, t_us: u64) {
        self.wires.receive(&mut self.lockstep);
        while self.lockstep.t_us() + STEP_US <= t_us {
            self.lockstep.step();
            let now_us = self.lockstep.t_us();
            while let Some((_, fault)) =
                self.faults.next_if(|(at_s, _)| at_s * 1e6 <= now_us as f64)
            {
                happen(fault, self.lockstep.plant_mut());
            }
            if let Some(truth) = &mut self.truth
                && now_us >= self.truth_due_us
            {
                self.truth_due_us = now_us - now_us % TRUTH_US + TRUTH_US;
                truth.push(TruthRow::of(&self.lockstep.truth(), self.lockstep.host_now()));
            }
        }
        let now: HostTime = self.lockstep.host_now();
        self.tape.topics(now, self.lockstep.pilot_mut(), &mut self.watch.feed);
        self.wires.send(&mut self.lockstep);
    }

    fn finish(self) -> Result<()> {
        let Self { lockstep, tape, truth, watch, .. } = self;
        watch.finish();
        let t_s = lockstep.t_us() as f64 * 1e-6;
        drop(lockstep);
        let log = tape.finish()?;
        let lost_rows = truth.map_or(Ok(0), TruthFile::finish)?;
        tracing::info!(
            t_s,
            truth_lost_rows = lost_rows,
            "ended; log: {}",
            log.as_deref().unwrap_or("none")
        );
        Ok(())
    }
}

/// The watch page, where the configuration asks for one. Its times are simulated ones.
struct Watched {
    feed: Feed,
    ends: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Watched {
    fn start(loaded: &Loaded) -> Result<Self> {
        let ends = Arc::<AtomicBool>::default();
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
        let unix = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
        let start_us = i64::try_from(HOST_START_US)?;
        let unix_us = i64::try_from(unix.as_micros()).unwrap_or(i64::MAX);
        let opened = runtime.block_on(Watch::open(loaded, unix_us - start_us))?;
        let Some((watch, feed)) = opened else {
            return Ok(Self { feed: Feed::off(), ends, thread: None });
        };
        let thread = Some(watch.start(ends.clone())?);
        Ok(Self { feed, ends, thread })
    }

    fn finish(self) {
        self.ends.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread {
            let _ = thread.join();
        }
    }
}
