//! The parameter protocol: list, read, set, hash.
//!
//! Sources: the guide's "Parameter Protocol" page, PARAM_ERROR of common.xml, and what clients do
//! (STATIONS.md, What each client asks for): QGroundControl lists to component 0 and asks for missing ones by index,
//! with the identity `px4` it asks for `_HASH_CHECK` first and stops a list by setting it.

use haltere_dialect::mav::haltere::{
    MavMessage, MavParamError, MavParamType, PARAM_ERROR_DATA, PARAM_EXT_ACK_DATA,
    PARAM_EXT_SET_DATA, PARAM_REQUEST_READ_DATA, PARAM_SET_DATA, PARAM_VALUE_DATA, ParamAck,
};

use haltere_dialect::mav::name_of;

use haltere_core::control::margins;
use haltere_core::keys::When;
use haltere_core::time::HostTime;

use super::budget::Budget;
use super::crc32::crc32;
use super::files::{FileFault, FileTask};
use super::param_pack::{Query, pack};
use super::parameter_table::{Kind, Parameter};
use super::{Purpose, parameter_table as table};
use crate::config::PilotConfig;
use crate::flight::modes::Mode;
use crate::input::LinkId;
use crate::out::Out;
use crate::out::voice::Severity;
use crate::stations::Stations;
use crate::stations::mission_transfer::Client;

/// Name of the value that says whether a client's copy is still right.
const HASH_NAME: &str = "_HASH_CHECK";
/// `param_index` of a value that is in no list.
const NO_INDEX: u16 = u16::MAX;
/// A PARAM_VALUE on the wire, bytes: header 10, payload 25, checksum 2.
const VALUE_BYTES: usize = 37;
/// Lists under way at once: one a link.
const MOST_LISTS: usize = 64;

/// A list that is being sent.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Listing {
    link: LinkId,
    next: u16,
}

impl Listing {
    /// Sends as many as the budget allows; `false`: the list is over.
    fn send(&mut self, count: u16, budget: &mut Budget, mut send: impl FnMut(u16)) -> bool {
        while self.next < count && budget.take(VALUE_BYTES) {
            send(self.next);
            self.next += 1;
        }
        self.next < count
    }
}

/// State of the service.
#[derive(Debug)]
pub(crate) struct Parameters {
    /// As set. What needs a restart differs from what is in force.
    pub(crate) wanted: PilotConfig,
    lists: Vec<Listing>,
}

impl Parameters {
    pub fn new(config: &PilotConfig) -> Self {
        Self { wanted: config.clone(), lists: Vec::new() }
    }

    /// All of them as one packed file.
    pub fn packed(&self, px4: bool, query: Query) -> Vec<u8> {
        pack(&self.wanted, px4, query)
    }

    /// Whether no list is being sent.
    pub fn is_idle(&self) -> bool {
        self.lists.is_empty()
    }

    fn stop_list(&mut self, link: LinkId) {
        self.lists.retain(|list| list.link != link);
    }

    /// Hash over names and values in the order of names, as QGroundControl computes it from its copy.
    fn hash(&self, px4: bool) -> u32 {
        let mut all: Vec<_> = table::all().take(table::count(px4)).collect();
        all.sort_by_key(|p| p.name);
        all.iter().fold(0, |crc, p| {
            crc32(&p.value(&self.wanted).to_le_bytes(), crc32(p.name.as_bytes(), crc))
        })
    }
}

/// The name in a field: up to the first zero.
fn text_of(field: &[u8]) -> String {
    let end = field.iter().position(|c| *c == 0).unwrap_or(field.len());
    String::from_utf8_lossy(field.get(..end).unwrap_or_default()).into_owned()
}

fn id_of(name: &str) -> [u8; 16] {
    let mut id = [0; 16];
    for (slot, byte) in id.iter_mut().zip(name.bytes()) {
        *slot = byte;
    }
    id
}

/// A refusal of the protocol, and a sentence for people.
type Refusal = (MavParamError, String);

impl Out {
    pub(crate) fn parameter_not_kept(&mut self, at: HostTime, name: &str, fault: FileFault) {
        let text = format!("{name} is lost at a restart: {}", fault.words());
        self.say(at, Severity::Warning, text);
    }

    fn send_parameter_error(
        &mut self,
        link: LinkId,
        (target_system, target_component): (u8, u8),
        param_index: i16,
        name: &str,
        error: MavParamError,
    ) {
        let message = MavMessage::PARAM_ERROR(PARAM_ERROR_DATA {
            param_index,
            target_system,
            target_component,
            param_id: id_of(name).into(),
            error,
        });
        self.message(link, &message);
    }
}

/// Whether a client spares itself the list: its copy is right.
pub(crate) fn spares_the_list(m: &PARAM_SET_DATA) -> bool {
    m.param_id.starts_with(HASH_NAME.as_bytes())
}

/// The answer to a long value.
pub(crate) fn ext_ack(m: &PARAM_EXT_SET_DATA, result: ParamAck) -> MavMessage {
    MavMessage::PARAM_EXT_ACK(PARAM_EXT_ACK_DATA {
        param_id: m.param_id,
        param_value: m.param_value,
        param_type: m.param_type,
        param_result: result as u8,
    })
}

/// A value that is to be put in force.
pub(crate) struct Change {
    parameter: &'static Parameter,
    exact: f64,
}

impl Change {
    pub(crate) fn put_in(&self, config: &mut PilotConfig) {
        self.parameter.set(config, self.exact);
    }
}

impl Stations {
    /// PARAM_REQUEST_LIST.
    pub(crate) fn parameter_list(&mut self, link: LinkId) {
        let parameters = &mut self.services.parameters;
        parameters.stop_list(link);
        if parameters.lists.len() < MOST_LISTS {
            parameters.lists.push(Listing { link, next: 0 });
        }
    }

    /// Goes on with the list of a link.
    pub(crate) fn parameter_tick(&mut self, link: LinkId, budget: &mut Budget, out: &mut Out) {
        let lists = &mut self.services.parameters.lists;
        let Some(index) = lists.iter().position(|list| list.link == link) else { return };
        let mut list = lists.swap_remove(index);
        let count = table::count(self.is_px4(link)) as u16;
        if list.send(count, budget, |index| self.send_parameter(link, index, out)) {
            self.services.parameters.lists.push(list);
        }
    }

    /// PARAM_REQUEST_READ.
    pub(crate) fn parameter_read(
        &mut self,
        link: LinkId,
        peer: (u8, u8),
        m: &PARAM_REQUEST_READ_DATA,
        out: &mut Out,
    ) {
        let count = table::count(self.is_px4(link));
        let name = text_of(&*m.param_id);
        let index = if m.param_index >= 0 {
            Some(usize::from(m.param_index.unsigned_abs()))
        } else if name == HASH_NAME {
            self.send_hash(link, out);
            return;
        } else {
            table::find(&name).map(|(index, _)| index)
        };
        match index.filter(|index| *index < count) {
            Some(index) => self.send_parameter(link, index as u16, out),
            None => {
                let error = MavParamError::MAV_PARAM_ERROR_DOES_NOT_EXIST;
                out.send_parameter_error(link, peer, m.param_index, &name, error);
            }
        }
    }

    fn send_parameter(&mut self, link: LinkId, index: u16, out: &mut Out) {
        let Some(parameter) = table::at(usize::from(index)) else { return };
        let message = MavMessage::PARAM_VALUE(PARAM_VALUE_DATA {
            param_value: parameter.value(&self.services.parameters.wanted),
            param_count: table::count(self.is_px4(link)) as u16,
            param_index: index,
            param_id: id_of(parameter.name).into(),
            param_type: MavParamType::MAV_PARAM_TYPE_REAL32 as u8,
        });
        out.message(link, &message);
    }

    fn send_hash(&mut self, link: LinkId, out: &mut Out) {
        let px4 = self.is_px4(link);
        let hash = self.services.parameters.hash(px4);
        let message = MavMessage::PARAM_VALUE(PARAM_VALUE_DATA {
            // The bits of the number, as PX4 sends it and QGroundControl reads it.
            param_value: f32::from_bits(hash),
            param_count: table::count(px4) as u16,
            param_index: NO_INDEX,
            param_id: id_of(HASH_NAME).into(),
            param_type: MavParamType::MAV_PARAM_TYPE_UINT32 as u8,
        });
        out.message(link, &message);
    }
}

impl Stations {
    /// PARAM_SET. `Some`: what is to be put in force.
    pub(crate) fn parameter_set(
        &mut self,
        at: HostTime,
        mode: Mode,
        Client { link, peer }: Client,
        m: &PARAM_SET_DATA,
        out: &mut Out,
    ) -> Option<Change> {
        let name = text_of(&*m.param_id);
        if name == HASH_NAME {
            // "My copy is right, spare me the list."
            self.services.parameters.stop_list(link);
            return None;
        }
        let count = table::count(self.is_px4(link));
        let Some((index, parameter)) = table::find(&name).filter(|(index, _)| *index < count)
        else {
            let error = MavParamError::MAV_PARAM_ERROR_DOES_NOT_EXIST;
            out.send_parameter_error(link, peer, -1, &name, error);
            out.say(at, Severity::Warning, format!("no parameter {name}"));
            return None;
        };
        let result = if m.param_type == MavParamType::MAV_PARAM_TYPE_REAL32 as u8 {
            self.set_parameter(at, mode, parameter, m.param_value, out)
        } else {
            let why = format!(
                "{name}: its type is REAL32, not {}",
                name_of::<MavParamType>(m.param_type)
            );
            Err((MavParamError::MAV_PARAM_ERROR_TYPE_MISMATCH, why))
        };
        match result {
            Ok((changed, change)) => {
                // Everybody's copy is to be right, under each name of the value.
                for n in 0..self.grounds.len() {
                    let link = self.grounds[n].link;
                    if out.is_open(link) {
                        self.send_parameter(link, index as u16, out);
                    }
                }
                for other in aliases(changed).filter(|other| *other != index) {
                    for n in 0..self.grounds.len() {
                        let link = self.grounds[n].link;
                        if out.is_open(link) && other < table::count(self.is_px4(link)) {
                            self.send_parameter(link, other as u16, out);
                        }
                    }
                }
                change
            }
            Err((error, why)) => {
                out.send_parameter_error(link, peer, index as i16, &name, error);
                // Clients that do not know PARAM_ERROR read the refusal from the old value.
                self.send_parameter(link, index as u16, out);
                out.say(at, Severity::Warning, format!("parameter refused: {why}"));
                None
            }
        }
    }

    /// Checks a value and keeps it; the parameter that it belongs to, and what is to be put in force.
    fn set_parameter(
        &mut self,
        at: HostTime,
        mode: Mode,
        parameter: &'static Parameter,
        value: f32,
        out: &mut Out,
    ) -> Result<(&'static Parameter, Option<Change>), Refusal> {
        let parameter = match parameter.kind {
            Kind::Alias(of) => table::find(of).map_or(parameter, |(_, p)| p),
            Kind::Fixed(own) if own == value => return Ok((parameter, None)),
            Kind::Fixed(own) => {
                let why = format!("{} = {own} is fixed: {}", parameter.name, parameter.doc);
                return Err((MavParamError::MAV_PARAM_ERROR_READ_ONLY, why));
            }
            _ => parameter,
        };
        let name = parameter.name;
        let exact = parameter
            .checked(value)
            .map_err(|why| (MavParamError::MAV_PARAM_ERROR_VALUE_OUT_OF_RANGE, why))?;
        let before = &self.services.parameters.wanted;
        if parameter.value(before) == value {
            return Ok((parameter, None));
        }
        let mut wanted = before.clone();
        parameter.set(&mut wanted, exact);
        // Rules that join several values; what was wrong before is not this value's fault.
        let old = table::problems(before);
        if let Some(line) =
            table::problems(&wanted).lines().iter().find(|line| !old.lines().contains(line))
        {
            let error = MavParamError::MAV_PARAM_ERROR_VALUE_OUT_OF_RANGE;
            return Err((error, format!("{name} = {value}: {line}")));
        }
        if parameter.when == When::OnFloor && mode.has_thrust() {
            let why = format!("{name} cannot change in flight: land first");
            return Err((MavParamError::MAV_PARAM_ERROR_PERMISSION_DENIED, why));
        }
        // On the floor a set may be wrong while it is being changed: arming looks at it again.
        if mode != Mode::Disarmed
            && wanted.control != self.services.parameters.wanted.control
            && let Some(why) = margins::refusal(&wanted.control)
        {
            let error = MavParamError::MAV_PARAM_ERROR_VALUE_OUT_OF_RANGE;
            return Err((error, format!("{name} = {value} cannot be flown: {why}")));
        }
        self.services.parameters.wanted = wanted;
        let task = FileTask::KeepParameter { name, value: exact };
        if let Err((fault, _)) = self.services.desk.ask(task, Purpose::Parameter(name), at) {
            out.parameter_not_kept(at, name, fault);
        }
        if parameter.when == When::Restart {
            out.say(at, Severity::Info, format!("{name} = {value}: in force after a restart"));
            return Ok((parameter, None));
        }
        out.say(at, Severity::Info, format!("{name} = {value}"));
        Ok((parameter, Some(Change { parameter, exact })))
    }
}

/// Indices of the names of a value.
fn aliases(of: &'static Parameter) -> impl Iterator<Item = usize> {
    table::all().enumerate().filter_map(|(index, p)| {
        (p.name == of.name || matches!(p.kind, Kind::Alias(name) if name == of.name))
            .then_some(index)
    })
}

#[cfg(test)]
mod tests {
    use super::super::budget::Bucket;
    use super::*;

    /// The bound of the issue: 1000 parameters in less than a second. At 100 steps a second.
    #[test]
    fn prop_a_thousand_are_listed_in_less_than_a_second() {
        let mut list = Listing { link: LinkId::Ground(0), next: 0 };
        let mut bucket = Bucket::default();
        let (mut sent, mut steps) = (Vec::new(), 0);
        while list.send(1000, &mut bucket.step(None, true), |index| sent.push(index)) {
            steps += 1;
        }
        assert!(sent.iter().copied().eq(0..1000));
        assert!(steps < 95, "{steps} steps of 10 ms");
    }

    #[test]
    fn prop_a_slow_line_is_not_flooded() {
        // 57600 baud carry 5760 bytes/s; half of it is ours.
        let mut list = Listing { link: LinkId::Ground(0), next: 0 };
        let mut bucket = Bucket::default();
        let mut sent = 0;
        for _ in 0..1000 {
            list.send(10_000, &mut bucket.step(Some(5760.0), true), |_| sent += 1);
        }
        let bytes_per_s = f64::from(sent) * VALUE_BYTES as f64 / 10.0;
        assert!((2500.0..=2900.0).contains(&bytes_per_s), "{bytes_per_s}");
    }
}
