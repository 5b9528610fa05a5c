//! Whether the board is in our mode, for as long as control is held, and the way back to it.
//!
//! Both firmwares drop setpoints silently in any other mode, so only `HEARTBEAT.custom_mode` counts,
//! never the acknowledgement of a mode command.

use haltere_core::time::HostTime;

use super::profile::ControlMode;

/// A retake is given up after this time, µs.
const RETAKE_US: i64 = 6_000_000;
/// Setpoints must have streamed for so long before a mode is asked for again in the air, s (PX4's
/// documentation: 1 s).
const STREAM_S: f64 = 1.2;

/// What has changed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Change {
    /// Another mode has been in force for longer than its grace; its number.
    Lost(u32),
    /// It was away within the grace and is back; the mode it was in.
    CameBack(u32),
    /// Our mode is in force again after it was lost.
    Regained,
    /// It was asked for and did not come.
    NotGranted,
}

/// Follows the mode.
#[derive(Debug, Default)]
pub(crate) struct Control {
    custom_mode: Option<u32>,
    ours_since: Option<HostTime>,
    away_since: Option<HostTime>,
    lost: bool,
    retake: Option<(HostTime, HostTime)>,
}

impl Control {
    /// The mode in the newest heartbeat.
    pub fn custom_mode(&self) -> Option<u32> {
        self.custom_mode
    }

    /// Since when the heartbeat shows our mode.
    pub fn ours_since(&self) -> Option<HostTime> {
        self.ours_since
    }

    /// Whether the board was told to be ours and is not, however shortly.
    pub fn is_away(&self) -> bool {
        self.away_since.is_some()
    }

    /// Whether it has been away for longer than the grace.
    pub fn is_lost(&self) -> bool {
        self.lost
    }

    /// Whether setpoints should stream because the mode is being asked for.
    pub fn is_retaking(&self) -> bool {
        self.retake.is_some()
    }

    /// Asks for the mode again, in the air.
    pub fn retake(&mut self, at: HostTime) {
        let first = at.offset_us((STREAM_S * 1e6) as i64);
        self.retake.get_or_insert((first, at.offset_us(RETAKE_US)));
    }

    /// Control is not held any more: nothing can be lost.
    pub fn let_go(&mut self) {
        (self.away_since, self.lost, self.retake) = (None, false, None);
    }

    /// A heartbeat. `held`: we count on the mode.
    pub fn heartbeat(
        &mut self,
        at: HostTime,
        mode: &ControlMode,
        custom_mode: u32,
        held: bool,
    ) -> Option<Change> {
        let was = self.custom_mode.replace(custom_mode);
        if custom_mode & mode.mask == mode.value {
            self.ours_since.get_or_insert(at);
            self.retake = None;
            let away = self.away_since.take().is_some();
            return match (std::mem::take(&mut self.lost), away) {
                (true, _) => Some(Change::Regained),
                (false, true) => was.map(Change::CameBack),
                (false, false) => None,
            };
        }
        self.ours_since = None;
        if held {
            self.away_since.get_or_insert(at);
        }
        None
    }

    /// What time brings; `true`: the mode is to be asked for.
    pub fn tick(&mut self, at: HostTime, mode: &ControlMode) -> (bool, Option<Change>) {
        if let Some((next, give_up)) = self.retake {
            if at > give_up {
                self.retake = None;
                return (false, Some(Change::NotGranted));
            }
            if at >= next {
                let again_us = (mode.ask_again_s * 1e6) as i64;
                self.retake = Some((at.offset_us(again_us), give_up));
                return (true, None);
            }
        }
        let over = self.away_since.is_some_and(|t| at.seconds_since(t) >= mode.grace_s);
        if over && !self.lost {
            self.lost = true;
            return (false, self.custom_mode.map(Change::Lost));
        }
        (false, None)
    }
}

#[cfg(test)]
mod tests {
    use super::super::profile::Firmware;
    use super::*;

    fn at(ms: u64) -> HostTime {
        HostTime::from_us(1_000_000 + ms * 1000)
    }

    #[test]
    fn prop_a_short_absence_is_forgiven_and_a_long_one_is_a_loss() {
        let mode = Firmware::Px4.control_mode().unwrap();
        let (ours, land) = (6 << 16, 4 << 16 | 6 << 24);
        let mut control = Control::default();
        assert_eq!(control.heartbeat(at(0), mode, ours, true), None);
        assert_eq!(control.heartbeat(at(1000), mode, land, true), None);
        assert!(control.is_away() && control.ours_since().is_none());
        assert_eq!(control.tick(at(1500), mode), (false, None));
        assert_eq!(control.heartbeat(at(2000), mode, ours, true), Some(Change::CameBack(land)));
        control.heartbeat(at(3000), mode, land, true);
        assert_eq!(control.tick(at(5600), mode), (false, Some(Change::Lost(land))));
        assert_eq!(control.tick(at(5700), mode), (false, None), "told once");
        // Asked for again: not before the stream is old enough.
        control.retake(at(6000));
        assert_eq!(control.tick(at(6500), mode), (false, None));
        assert_eq!(control.tick(at(7300), mode), (true, None));
        assert_eq!(control.heartbeat(at(7900), mode, ours, false), Some(Change::Regained));
        assert!(!control.is_retaking());
    }

    #[test]
    fn prop_on_the_floor_any_mode_is_fine_and_a_retake_ends() {
        let mode = Firmware::ArduPilot.control_mode().unwrap();
        let mut control = Control::default();
        control.heartbeat(at(0), mode, 0, false);
        assert_eq!(control.tick(at(9000), mode), (false, None));
        control.retake(at(9000));
        let mut asked = 0;
        let mut ended = 0;
        for ms in (9000..20_000).step_by(10) {
            let (ask, change) = control.tick(at(ms), mode);
            asked += u32::from(ask);
            ended += u32::from(change == Some(Change::NotGranted));
        }
        assert!((3..=6).contains(&asked) && ended == 1, "{asked} {ended}");
    }
}
