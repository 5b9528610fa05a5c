//! For tests: a core in a room with eight anchors, and a station that speaks to it.

use haltere_core::frames::Vec3;
use haltere_core::measure::AnchorId;
use haltere_core::survey::Survey;
use haltere_core::time::HostTime;
use haltere_dialect::mav::haltere::MavMessage;
use haltere_dialect::mav_stream::{self, MavSplitter};

use crate::Pilot;
use crate::config::PilotConfig;
use crate::input::{Input, LinkId};

/// Who speaks: a ground station.
pub(crate) const STATION: (u8, u8) = (255, 190);

/// A core, and what its first station hears.
pub(crate) struct Bench {
    pub pilot: Pilot,
    pub now: HostTime,
    heard: MavSplitter,
    sequence: u8,
    /// Systems that it has heard.
    pub heard_from: std::collections::BTreeSet<u8>,
}

impl Bench {
    pub fn new(config: PilotConfig) -> Self {
        let corner = |i: u8| {
            let far = |bit: u8, size_m: f64| if i & bit != 0 { size_m } else { 0.0 };
            (AnchorId(i), Vec3::new(far(1, 10.0), far(2, 10.0), -far(4, 7.0)))
        };
        let survey = Survey::new(&(0..8).map(corner).collect::<Vec<_>>()).unwrap();
        let now = HostTime::from_us(1_000_000);
        let mut pilot = Pilot::new(config, survey, now);
        for n in 0..pilot.stations.grounds.len() as u8 {
            pilot.handle(now, Input::LinkUp { link: LinkId::Ground(n) });
        }
        pilot.drain_output(|_, _| {});
        Self { pilot, now, heard: MavSplitter::new(), sequence: 0, heard_from: Default::default() }
    }

    /// What the first station hears at once when it says this.
    pub fn says(&mut self, message: &MavMessage) -> Vec<MavMessage> {
        let mut bytes = Vec::new();
        mav_stream::encode(&mut bytes, STATION.0, STATION.1, self.sequence, message);
        self.sequence = self.sequence.wrapping_add(1);
        self.pilot.handle(self.now, Input::Bytes { link: LinkId::Ground(0), bytes: &bytes });
        self.hears()
    }

    /// What the first station hears while so much time passes.
    pub fn run(&mut self, seconds: f64) -> Vec<MavMessage> {
        let end = self.now.offset_us((seconds * 1e6) as i64);
        let mut heard = Vec::new();
        while self.pilot.next_deadline() <= end {
            self.now = self.pilot.next_deadline();
            self.pilot.handle(self.now, Input::Wake);
            heard.extend(self.hears());
        }
        self.now = end;
        heard
    }

    fn hears(&mut self) -> Vec<MavMessage> {
        let splitter = &mut self.heard;
        let mut heard = Vec::new();
        self.pilot.drain_output(|link, bytes| {
            if link == LinkId::Ground(0) {
                splitter.push(bytes);
            }
        });
        while let Some(next) = splitter.next() {
            let Ok(frame) = next else { continue };
            self.heard_from.insert(frame.header.system_id);
            heard.extend(frame.decode().ok());
        }
        heard
    }
}
