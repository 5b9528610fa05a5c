//! Flights that a station can load by name: those of the diagnosis, those of the fits, and mission
//! files, all placed in the volume of the configuration.

use std::cell::RefCell;
use std::path::Path;

use haltere_dialect::mav::haltere::MISSION_ITEM_INT_DATA;

use super::judge::{Judged, Judging};
use crate::fit::programs::{Options, Program, plan};
use crate::sources::Loaded;
use crate::store::Programs;
use haltere_gap::missions;
use haltere_gap::scene::Scene;
use haltere_model::Vehicle;
use haltere_model::room::Room;
use haltere_pilot::Envelope;
use haltere_pilot::mission_file::MissionFile;
use haltere_pilot::services::{Judgement, encode_plan};
use haltere_pilot::settings::DiagnosisConfig;

/// What the default hover of the thrust program leaves above the warning voltage, V.
const ABOVE_LOW_V: f64 = 0.1;

/// Standard flights of the diagnosis.
const DIAGNOSTIC: &str = "diagnostic";
const PLAIN: &str = "plain";
const HELD_OUT: &str = "held-out";

const FITS: [Program; 7] = [
    Program::Drag,
    Program::Thrust,
    Program::Ground,
    Program::Trim,
    Program::Lag,
    Program::Imu,
    Program::Anchors,
];

/// Built-in programs of one configuration.
pub(super) struct BuiltIn {
    scene: Scene,
    envelope: Envelope,
    options: Options,
    diagnosis: DiagnosisConfig,
    judging: RefCell<Option<Judging>>,
}

impl BuiltIn {
    /// In the volume of a configuration.
    pub(super) fn new(loaded: &Loaded) -> anyhow::Result<Self> {
        let pilot = loaded.config.pilot();
        let envelope = Envelope::of(&pilot, &loaded.survey);
        let volume = &envelope.volume;
        let middle = |[low, high]: [f64; 2]| 0.5 * (low + high);
        let scene = Scene {
            room: Room {
                north_m: volume.north_m,
                east_m: volume.east_m,
                ceiling_m: volume.height_m,
            },
            start_NE_m: [middle(volume.north_m), middle(volume.east_m)],
            survey: loaded.survey.clone(),
            vehicle: Vehicle::default(),
            pilot: pilot.clone(),
            until_s: None,
        };
        let options = Options {
            until_v: pilot.limits.battery_low_v + ABOVE_LOW_V,
            gear_m: pilot.flight.gear_height_m,
            ..Options::default()
        };
        let diagnosis = loaded.config.diagnosis.clone();
        Ok(Self { scene, envelope, options, diagnosis, judging: RefCell::default() })
    }
}

fn fit_name(program: Program) -> String {
    format!("fit-{}", program.name())
}

fn wire(mission: &MissionFile) -> Vec<u8> {
    let items: Vec<MISSION_ITEM_INT_DATA> =
        mission.items.iter().zip(0..).map(|(item, seq)| item.to_wire(seq, 0, 0)).collect();
    encode_plan(&items)
}

/// What judges the flights of a program. The plain and the held-out flight are there to judge others by.
fn judged(name: &str) -> Option<Judged> {
    if name == DIAGNOSTIC {
        return Some(Judged::Gap);
    }
    FITS.into_iter().find(|p| fit_name(*p) == name).map(|p| Judged::Fit(p.name()))
}

impl Programs for BuiltIn {
    fn names(&self) -> Vec<String> {
        let fits = FITS.into_iter().map(fit_name);
        [DIAGNOSTIC, PLAIN, HELD_OUT].map(str::to_owned).into_iter().chain(fits).collect()
    }

    fn built_in(&self, name: &str) -> Result<Vec<u8>, String> {
        let mission = match name {
            DIAGNOSTIC => missions::diagnostic_file(&self.scene),
            PLAIN => missions::plain_file(&self.scene),
            HELD_OUT => missions::held_out_file(&self.scene),
            other => {
                let program = FITS.into_iter().find(|p| fit_name(*p) == other);
                let program = program.ok_or("no such program")?;
                plan(program, &self.envelope, &self.options)?.mission
            }
        };
        Ok(wire(&mission))
    }

    fn judge(&self, name: &str, log: &Path) -> Option<Result<Judgement, String>> {
        let judged = judged(name)?;
        let mut judging = self.judging.borrow_mut();
        let looked = match &mut *judging {
            Some(judging) => judging.look(),
            None => Judging::start(judged, log, &self.diagnosis).map(|started| {
                *judging = Some(started);
                Judgement::Running { percent: 0, what: "begins".to_owned() }
            }),
        };
        if !matches!(looked, Ok(Judgement::Running { .. })) {
            *judging = None;
        }
        Some(looked)
    }

    fn stop_judging(&self) {
        *self.judging.borrow_mut() = None;
    }

    fn parse(&self, name: &str, text: &str) -> Result<Vec<u8>, String> {
        MissionFile::parse(text)
            .map(|mission| wire(&mission))
            .map_err(|why| format!("{name}: {why}"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use haltere_pilot::services::decode_plan;
    use haltere_pilot::settings::Config;

    #[test]
    fn prop_every_program_that_fits_the_room_is_a_plan() {
        let anchors = concat!(env!("CARGO_MANIFEST_DIR"), "/config/anchors.toml");
        let survey = crate::sources::read_anchors(anchors.as_ref()).unwrap();
        let loaded = Loaded {
            config: Config::default(),
            survey,
            files: Vec::new(),
            notes: Vec::new(),
            lost: None,
            stations_unasked: false,
        };
        let programs = BuiltIn::new(&loaded).unwrap();
        assert_eq!(programs.names().len(), 10);
        for name in programs.names() {
            match programs.built_in(&name) {
                Ok(bytes) => assert!(decode_plan(&bytes).unwrap().len() > 2, "{name}"),
                // A small room has no place for steps; the reason says so.
                Err(why) => assert!(why.len() > 20, "{name}: {why}"),
            }
        }
        let text =
            "[[item]]\ncommand = \"takeoff\"\nheight_m = 1.0\n[[item]]\ncommand = \"land\"\n";
        let plan = programs.parse("a.toml", text).unwrap();
        assert_eq!(decode_plan(&plan).unwrap().len(), 2);
        assert!(programs.parse("b.toml", "nonsense").unwrap_err().starts_with("b.toml: "));
    }
}
