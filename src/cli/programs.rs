//! Flights that a station can load by name: those of the diagnosis, those of the fits, and mission
//! files, all placed in the volume of the configuration.

use haltere_dialect::mav::haltere::MISSION_ITEM_INT_DATA;

use crate::fit::programs::Options;
use crate::named_missions::{self, Place};
use crate::sources::Loaded;
use crate::store::Programs;
use haltere_gap::scene::Scene;
use haltere_model::Vehicle;
use haltere_model::room::Room;
use haltere_pilot::Envelope;
use haltere_pilot::mission_file::MissionFile;
use haltere_pilot::services::encode_plan;

/// Built-in programs of one configuration.
pub(super) struct BuiltIn {
    place: Place,
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
        let options = Options::of(&pilot);
        Ok(Self { place: Place { scene, envelope, options } })
    }
}

fn wire(mission: &MissionFile) -> Vec<u8> {
    let items: Vec<MISSION_ITEM_INT_DATA> =
        mission.items.iter().zip(0..).map(|(item, seq)| item.to_wire(seq, 0, 0)).collect();
    encode_plan(&items)
}

impl Programs for BuiltIn {
    fn names(&self) -> Vec<String> {
        named_missions::names()
    }

    fn built_in(&self, name: &str) -> Result<Vec<u8>, String> {
        self.place.mission(name).map(|mission| wire(&mission))
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
