//! Mission files, ours or a station's, by their place on the disk.

use std::path::Path;

use haltere_core::geo::LocalOrigin;
use haltere_log::intake;
use haltere_pilot::mission_file::MissionFile;

use super::CtlError;
use super::plan_file::PlanFile;

/// Longest mission file that is read, bytes.
const MOST_BYTES: u64 = 16 << 20;

fn mission_text(path: &Path) -> Result<String, CtlError> {
    intake::text(path, MOST_BYTES).map_err(|error| wrong(path, error.to_string()))
}

fn wrong(path: &Path, why: String) -> CtlError {
    CtlError::MissionFile { file: path.display().to_string(), why }
}

/// Reads and checks a mission file, ours or a station's, for who flies without a station: places on the globe become
/// places around `origin`. What of the file is not flown goes to `tell`.
pub fn read_mission(
    path: &Path,
    origin: &LocalOrigin,
    mut tell: impl FnMut(&str),
) -> Result<MissionFile, CtlError> {
    let text = mission_text(path)?;
    if !PlanFile::is_one(path, &text) {
        return MissionFile::parse(&text).map_err(|why| wrong(path, why));
    }
    let file = PlanFile::parse(&text).map_err(|why| wrong(path, why))?;
    let name = path.display();
    file.remarks.iter().for_each(|remark| tell(&format!("{name}: {remark}")));
    for (what, items) in [("fence", &file.fence), ("rally points", &file.rally)] {
        if !items.is_empty() {
            tell(&format!(
                "{name}: its {what} ({} items) are for a vehicle, not used here",
                items.len()
            ));
        }
    }
    file.to_mission(origin).map_err(|why| {
        let place = origin.place();
        let [lat, lon] = [place.lat_rad, place.lon_rad].map(f64::to_degrees);
        wrong(path, format!("{why}; the room's origin is at {lat:.5} {lon:.5} (ground.origin)"))
    })
}

/// Reads a mission file, ours or a station's, as what is uploaded.
pub fn read_plan(path: &Path) -> Result<PlanFile, CtlError> {
    let text = mission_text(path)?;
    let read = match PlanFile::is_one(path, &text) {
        true => PlanFile::parse(&text),
        false => MissionFile::parse(&text).map(|mission| PlanFile {
            mission: mission
                .items
                .iter()
                .zip(0..)
                .map(|(item, seq)| item.to_wire(seq, 0, 0))
                .collect(),
            ..PlanFile::default()
        }),
    };
    read.map_err(|why| wrong(path, why))
}
