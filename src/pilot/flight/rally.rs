//! Rally points: places to return to beside home. A return flies to whichever is nearest.

use haltere_dialect::mav::haltere::{MISSION_ITEM_INT_DATA, MavCmd, MavMissionResult};
use haltere_dialect::mav::name_of;

use super::fence::Fence;
use super::mission::Volume;
use super::mission_items::Refusal;

/// Most rally points.
pub const MOST_POINTS: usize = 20;

/// Checks items, with their places in the room.
pub fn check(
    items: &[MISSION_ITEM_INT_DATA],
    places: &[[f64; 2]],
    volume: &Volume,
    fence: &Fence,
) -> Result<(), Refusal> {
    for (item, [north, east]) in items.iter().zip(places.iter().copied()) {
        let seq = item.seq;
        if item.command != MavCmd::MAV_CMD_NAV_RALLY_POINT as u16 {
            let why = format!(
                "rally item {seq}: {} not supported",
                name_of::<MavCmd>(item.command),
                seq = seq.saturating_add(1)
            );
            return Err((MavMissionResult::MAV_MISSION_UNSUPPORTED, why));
        }
        let pos = haltere_core::frames::Vec3::new(north, east, 0.0);
        if !volume.contains_over(pos) || !fence.contains([north, east]) {
            let why = format!(
                "rally item {seq}: N {north:.2} E {east:.2} m is outside the limits or the fence",
                seq = seq.saturating_add(1)
            );
            return Err((MavMissionResult::MAV_MISSION_INVALID, why));
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prop_points_outside_and_other_commands_are_refused() {
        let volume = Volume { north_m: [-5.0, 5.0], east_m: [-5.0, 5.0], height_m: 3.0 };
        let try_at = |command: MavCmd, place| {
            let command = command as u16;
            let item = MISSION_ITEM_INT_DATA { seq: 4, command, ..Default::default() };
            check(&[item], &[place], &volume, &Fence::default())
        };
        let rally = MavCmd::MAV_CMD_NAV_RALLY_POINT;
        assert!(try_at(rally, [1.0, -1.0]).is_ok());
        assert!(try_at(rally, [9.0, 0.0]).unwrap_err().1.contains("item 5: N 9.00"));
        assert!(try_at(MavCmd::MAV_CMD_NAV_WAYPOINT, [0.0, 0.0]).is_err());
    }
}
