//! Configuration of the companion: what may be written, and what is wrong with it. Where it comes from is a matter of
//! `sources`. Every key has a row in its section.

mod address;
mod anchors;
mod differences;
mod document;
mod ground;
mod note;
mod radio;
mod read;
mod sections;
mod signing;
#[cfg(test)]
mod tests;
mod watch;

pub use address::{Address, AddressError, HostPort};
pub use anchors::parse_anchors;
pub use differences::Difference;
pub use document::{DocumentedKey, commented, configuration_page, reference};
pub use ground::{EndpointConfig, GroundConfig};
pub use note::Note;
pub use radio::{MOST_CHANNEL, RadioPlace, RadioRate};
pub use read::{Read, read_config, read_recorded, surplus};
pub use sections::{
    AnchorsConfig, BoardConfig, RecordConfig, StoreConfig, TagConfig, TagPort, TimingConfig,
};
pub use signing::{Doors, SigningConfig};
pub use watch::{WatchAddress, WatchConfig};

use crate::config::{BoardProfile, FlightConfig, LimitsConfig, PilotConfig, TagProtocol};
use crate::flight::supervisor::SupervisorConfig;
use crate::navigation::uwb::UwbConfig;
use haltere_core::checks::Problems;
use haltere_core::control::ControlConfig;
use haltere_core::estimator::EstimatorConfig;
use haltere_core::survey::Survey;

haltere_core::keys! {
    /// Everything that can be configured, one field per section.
    pub struct Config {} sections {
        /// The UWB tag.
        tag: TagConfig;
        /// The inner-loop board.
        board: BoardConfig;
        /// Ground stations, where they are and who we are to them.
        ground: GroundConfig;
        /// The key of MAVLink signatures.
        signing: SigningConfig;
        /// The survey.
        anchors: AnchorsConfig;
        /// Flight logs.
        record: RecordConfig;
        /// What is kept over a restart.
        store: StoreConfig;
        /// The page that shows the flight live.
        watch: WatchConfig;
        /// How hard the companion insists on its deadlines.
        timing: TimingConfig;
        /// How the vehicle takes off, moves and lands.
        flight: FlightConfig;
        /// The volume that setpoints may not leave, the battery, and silences.
        limits: LimitsConfig;
        /// From when on something is wrong, and what is then done where there is a choice: docs/SAFETY.md.
        supervisor: SupervisorConfig;
        /// From the bytes of the tag to time differences of arrival.
        uwb: UwbConfig;
        /// The filter.
        estimator: EstimatorConfig;
        /// The controller.
        control: ControlConfig;
    } rules links;
}

impl Config {
    /// Adds all that is wrong to `problems`, and what only a flight to come must keep: a log was flown with what it holds.
    pub fn check_to_fly(&self, problems: &mut Problems) {
        self.check("", problems);
        self.limits.check_pack("limits", &self.control.voltage, problems);
    }

    /// Two links cannot share a port or a device, and signatures need a key.
    fn links(&self, _: &str, problems: &mut Problems) {
        let mut taken = vec![("board.address".to_owned(), self.board.address.resource())];
        if let TagPort::Device(path) = &self.tag.port {
            taken.push(("tag.port".to_owned(), path.display().to_string()));
        }
        for (i, endpoint) in self.ground.endpoints.iter().enumerate() {
            taken.push((format!("ground.endpoints[{i}]"), endpoint.address.resource()));
        }
        if let Some(address) = self.watch.address.get() {
            taken.push(("watch.address".to_owned(), address.resource()));
        }
        for (i, (key, resource)) in taken.iter().enumerate() {
            if let Some((other, _)) = taken[..i].iter().find(|(_, r)| r == resource) {
                problems.say(format!(
                    "{key}: {resource} is taken by {other}; give each link a port or device of \
                     its own"
                ));
            }
        }
        self.check_signing(problems);
        self.check_crazyflie(problems);
    }

    /// Profile, address and tag of a Crazyflie belong together.
    fn check_crazyflie(&self, problems: &mut Problems) {
        let is_one = self.board.profile == BoardProfile::Crazyflie;
        let speaks = self.board.address.is_crazyflie();
        if is_one != speaks {
            problems.say(format!(
                "board.address = \"{}\": radio:, crtpusb: and crtpudp: go with board.profile = \"crazyflie\", which has no others",
                self.board.address
            ));
        }
        if self.tag.protocol == TagProtocol::Crazyflie && !is_one {
            problems.say(
                "tag.protocol = \"crazyflie\": the Loco deck of a board, with board.profile = \"crazyflie\" alone",
            );
        }
        if is_one && self.flight.shadow {
            problems.say(
                "flight.shadow: nobody can watch beside another client of a Crazyflie, whose log blocks would go",
            );
        }
        let ground = self.ground.endpoints.iter().enumerate();
        for (i, of) in ground.filter(|(_, of)| of.address.is_crazyflie()) {
            problems.say(format!(
                "ground.endpoints[{i}]: {} leads to a Crazyflie, not to a station",
                of.address
            ));
        }
    }

    /// The part that the pilot core is told.
    pub fn pilot(&self) -> PilotConfig {
        PilotConfig {
            tag_protocol: self.tag.protocol,
            board_profile: self.board.profile,
            board_set_parameters: self.board.set_parameters,
            board_north_offset_rad: self.board.north_offset_deg.to_radians(),
            system_id: self.ground.system_id,
            endpoints: self.ground.for_pilot(),
            routing: self.ground.routing,
            origin: self.ground.origin,
            store: self.store.is_on(),
            flight: self.flight.clone(),
            limits: self.limits.clone(),
            supervisor: self.supervisor.clone(),
            uwb: self.uwb.clone(),
            estimator: self.estimator.clone(),
            control: self.control.clone(),
        }
    }

    /// Takes over what a station may have changed in the core's part.
    pub fn take_over(&mut self, pilot: PilotConfig) {
        self.ground.system_id = pilot.system_id;
        self.flight = pilot.flight;
        self.limits = pilot.limits;
        self.supervisor = pilot.supervisor;
        self.uwb = pilot.uwb;
        self.estimator = pilot.estimator;
        self.control = pilot.control;
    }

    /// The whole configuration as a TOML file.
    pub fn to_toml(&self) -> String {
        // Plain tables of plain values: there is nothing that TOML cannot hold.
        toml::to_string(self).unwrap_or_default()
    }

    /// The same for the log of a flight, with the volume that was flown in: what a build makes of the anchors
    /// may change.
    pub fn to_log(&self, survey: &Survey) -> String {
        let mut flown = self.clone();
        flown.limits.resolve(survey);
        flown.to_toml()
    }

    /// From a TOML file of a user in memory. `name` stands in messages.
    pub fn from_toml(name: &str, text: &str) -> Result<Self, Problems> {
        read_config(name, text).map(|read| read.config)
    }

    /// As it stands in the head of a log, which may be of an older build: keys that are no more are read
    /// without a word. `name` stands in messages.
    pub fn as_recorded(name: &str, text: &str) -> Result<Self, Problems> {
        read_recorded(name, text).map(|read| read.config)
    }
}
