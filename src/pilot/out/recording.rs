//! Whether what happens is recorded: glue tells it, people hear of it.
//!
//! A log that stops ends no flight. It is told to every station, also to one that comes later, takes the bit of
//! the log in SYS_STATUS away, and stands among the arming checks: as a warning, or as a refusal where
//! `flight.log_required` is set.

use haltere_core::time::HostTime;

use super::Out;
use super::voice::Severity;
use crate::input::LinkId;

/// Longest reason that is passed on, characters: what glue says is text of its own, but of any length.
const LONGEST_REASON: usize = 200;

/// How the recording stands.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[repr(u8)]
pub enum Recording {
    /// Nobody records, and nobody was asked to: `record.enabled = false`, or a core in memory.
    #[default]
    Off,
    /// Everything is recorded.
    Runs,
    /// Stopped on the floor, to leave room for flights: the next one is recorded.
    Waits,
    /// A flight that began now would not be recorded.
    Stopped,
}

impl Recording {
    /// Number in logs.
    pub fn number(self) -> u8 {
        self as u8
    }

    /// The state with this number.
    pub fn from_number(number: u8) -> Option<Self> {
        [Self::Off, Self::Runs, Self::Waits, Self::Stopped]
            .into_iter()
            .find(|s| s.number() == number)
    }
}

/// What was told last.
#[derive(Debug, Default)]
pub(crate) struct Told {
    pub state: Recording,
    why: String,
}

impl Told {
    /// What people are told while it does not run.
    pub fn words(&self) -> Option<String> {
        let why = &self.why;
        match self.state {
            Recording::Off | Recording::Runs => None,
            Recording::Waits => Some(format!("log waits for a flight: {why}")),
            Recording::Stopped => Some(format!("without log: {why}")),
        }
    }
}

impl Out {
    /// Glue has told how the recording stands.
    pub(crate) fn recording_told(&mut self, at: HostTime, state: Recording, why: &str) {
        let before = self.recording.state;
        self.recording = Told { state, why: why.chars().take(LONGEST_REASON).collect() };
        // That it stops is told by the supervisor's list.
        if state == Recording::Runs && matches!(before, Recording::Waits | Recording::Stopped) {
            let missing = if why.is_empty() { String::new() } else { format!("; {why}") };
            self.say(at, Severity::Info, format!("log goes on{missing}"));
        }
    }

    /// For a station that speaks for the first time: it was not there when it was told.
    pub(crate) fn tell_recording(&mut self, at: HostTime, link: LinkId) {
        let Some(text) = self.recording.words() else { return };
        if self.may_echo(at) {
            self.say_to(at, link, Severity::Warning, &text);
        }
    }

    /// What stands in the way of a log of the next flight.
    pub(crate) fn recording_misses(&self) -> Option<String> {
        (self.recording.state == Recording::Stopped).then(|| self.recording.words()).flatten()
    }
}

#[cfg(test)]
mod tests {
    use haltere_dialect::mav::haltere::MavSysStatusSensor as S;

    use super::*;
    use crate::Pilot;
    use crate::config::PilotConfig;
    use crate::flight::at_rest::{LOG, Look};
    use crate::input::Input;
    use haltere_core::frames::Vec3;
    use haltere_core::measure::AnchorId;
    use haltere_core::survey::Survey;
    use haltere_core::topics::Topic;

    fn pilot(log_required: bool) -> Pilot {
        let corner = |i: u8| {
            let far = |bit: u8, size_m: f64| if i & bit != 0 { size_m } else { 0.0 };
            (AnchorId(i), Vec3::new(far(1, 10.0), far(2, 10.0), -far(4, 7.0)))
        };
        let survey = Survey::new(&(0..8).map(corner).collect::<Vec<_>>()).unwrap();
        let mut config = PilotConfig::default();
        config.flight.log_required = log_required;
        Pilot::new(config, survey, HostTime::from_us(1_000_000))
    }

    /// Tells it, lets a second pass, and gives what people were told.
    fn told(pilot: &mut Pilot, from_s: u64, state: Recording, why: &str) -> Vec<String> {
        let at = |ms: u64| HostTime::from_us(1_000_000 * (from_s + 1) + ms * 1000);
        pilot.drain_topics(|_| {});
        pilot.handle(at(1), Input::Recording { state, why });
        for ms in (10..1000).step_by(10) {
            pilot.handle(at(ms), Input::Wake);
        }
        let mut texts = Vec::new();
        pilot.drain_topics(|topic| {
            if let Topic::Text(text) = topic {
                texts.push(text.text);
            }
        });
        texts.retain(|text| text.contains("log"));
        texts
    }

    #[test]
    fn regress_a_log_that_stops_is_told_and_shown_and_goes_on() {
        let mut pilot = pilot(false);
        let is_healthy =
            |pilot: &Pilot| !pilot.flight.supervisor.unhealthy.contains(S::MAV_SYS_STATUS_LOGGING);
        assert!(told(&mut pilot, 0, Recording::Runs, "").is_empty());
        assert!(is_healthy(&pilot));
        let why = "150 MB free in logs, 200 MB needed";
        let stopped = [format!("without log: {why}")];
        assert_eq!(told(&mut pilot, 1, Recording::Stopped, why), stopped);
        assert!(!is_healthy(&pilot));
        // It is told to whoever arms, and keeps nobody from it.
        let now = HostTime::from_us(3_000_000);
        let fits = Look::Fits(String::new());
        assert_eq!((LOG.look)(&pilot.sight(now)), Look::Told(stopped[0].clone()));
        let missing = ["log goes on; 7 entries are missing"];
        assert_eq!(told(&mut pilot, 3, Recording::Runs, "7 entries are missing"), missing);
        assert!(is_healthy(&pilot) && (LOG.look)(&pilot.sight(now)) == fits);
        // On the bench: the next flight is recorded, so nobody is warned of it.
        let waits = told(&mut pilot, 4, Recording::Waits, "0.9 GB free");
        assert_eq!(waits, ["log waits for a flight: 0.9 GB free"]);
        assert!(!is_healthy(&pilot) && (LOG.look)(&pilot.sight(now)) == fits);
    }

    #[test]
    fn regress_nothing_arms_without_a_log_where_one_is_required() {
        let mut pilot = pilot(true);
        let now = HostTime::from_us(9_000_000);
        let fits = Look::Fits(String::new());
        assert_eq!((LOG.look)(&pilot.sight(now)), fits, "nobody records");
        told(&mut pilot, 1, Recording::Stopped, "no room");
        let refusal = "without log: no room: make room, or set flight.log_required = false";
        assert_eq!(pilot.sight(now).refusal(&LOG).as_deref(), Some(refusal));
        told(&mut pilot, 2, Recording::Waits, "little room");
        assert_eq!((LOG.look)(&pilot.sight(now)), fits);
    }
}
