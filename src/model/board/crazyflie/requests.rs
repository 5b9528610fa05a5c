//! What it is asked and ordered, and its answers, port by port.

use haltere_dialect::crtp::link::{Link as Carrier, SOURCE};
use haltere_dialect::crtp::localization::{Localization, LppShortAnswer};
use haltere_dialect::crtp::loco;
use haltere_dialect::crtp::memory::{MemoryAnswer, MemoryInfo, MemoryRequest};
use haltere_dialect::crtp::packet::{CrtpError, Packet, Place};
use haltere_dialect::crtp::parameter::{PERSISTENT, ParameterAnswer, ParameterRequest};
use haltere_dialect::crtp::platform::{PlatformAnswer, PlatformRequest};
use haltere_dialect::crtp::refusal::Refusal;
use haltere_dialect::crtp::setpoint::Setpoint;
use haltere_dialect::crtp::supervisor::{SupervisorAnswer, SupervisorRequest};
use haltere_dialect::crtp::toc::TocRequest;
use haltere_dialect::crtp::value::{Kind, Value};
use haltere_dialect::crtp::{FromBoard, ToBoard};

use super::blocks::{self, Blocks};
use super::table::{self, PARAMETERS};
use super::{Build, Crazyflie};

/// As the release of 2026.08 says, and the one before the supervisor's port.
const PROTOCOL: u32 = 12;
const PROTOCOL_BEFORE: u32 = 11;
const FIRMWARE: &str = "2026.08";
const FIRMWARE_BEFORE: &str = "2025.12";
/// Type and size of its memories, as it told them.
const MEMORIES: [(u8, u32); 3] = [(0x12, 0x1000), (0x15, 0x1000), (loco::TYPE, 0x11000)];
const LOCO_MEMORY: u8 = 2;
/// Type of a manual setpoint, and what is behind it: three angles, thrust, a flag.
const MANUAL: u8 = 11;
const MANUAL_LEN: usize = 15;

const NO_ENTRY: u8 = 2;
const NO_ACCESS: u8 = 5;
const READ_ONLY: u8 = 13;
const OTHER_TYPE: u8 = 22;

fn refusal(number: u8) -> Option<Refusal> {
    blocks::refused(number).err()
}

impl Crazyflie {
    /// One packet of its client.
    pub(super) fn obey(&mut self, packet: &Packet) {
        let message = match ToBoard::decode(packet) {
            Ok(message) => message,
            Err(error) => return self.strange(packet, error),
        };
        match message {
            ToBoard::Link(Carrier::Echo(bytes)) => self.say(&FromBoard::Link(Carrier::Echo(bytes))),
            ToBoard::Link(Carrier::Source(_)) => {
                self.say(&FromBoard::Link(Carrier::Source(&SOURCE)));
            }
            ToBoard::Link(_) => {}
            ToBoard::Toc(of, TocRequest::Info) => {
                self.say(&FromBoard::Toc(of, table::info(of, self.other_table)));
            }
            ToBoard::Toc(of, TocRequest::Item(id)) => {
                self.say(&FromBoard::Toc(of, table::tell(of, id, self.other_table)));
            }
            ToBoard::Log(order) => {
                let (now_us, mut made) = (self.clock_us(), std::mem::take(&mut self.blocks));
                let outcome = made.obey(&order, now_us, |id| self.value(id).is_some());
                self.blocks = made;
                self.say(&FromBoard::Log(outcome));
            }
            ToBoard::Parameter(request) => self.parameter(request),
            ToBoard::Setpoint(Setpoint::Attitude { roll_deg, pitch_deg, yaw, thrust }) => {
                self.commander.attitude(self.now_us, [roll_deg, pitch_deg, yaw], thrust);
            }
            ToBoard::Setpoint(Setpoint::Stop) => self.commander.stop(self.now_us),
            ToBoard::Setpoint(Setpoint::Yield(_)) => {}
            ToBoard::Localization(Localization::EmergencyStop) => self.supervisor.emergency_stop(),
            ToBoard::Localization(Localization::LppShort(anchor, _)) => {
                self.say(&FromBoard::Localization(LppShortAnswer { anchor, taken: true }));
            }
            ToBoard::Localization(_) => {}
            ToBoard::Memory(request) => self.memory(request),
            ToBoard::Supervisor(_) if self.no_port_9 => {}
            ToBoard::Supervisor(request) => self.order(request),
            ToBoard::Platform(request) => self.platform(request),
        }
    }

    /// What our codec does not know and the board does.
    fn strange(&mut self, packet: &Packet, error: CrtpError) {
        match (packet.place(), error, packet.payload()) {
            (Ok(Place::Setpoint), CrtpError::UnknownCommand(MANUAL), [_, rest @ ..]) => {
                let Some((angles, [t0, t1, _])) = rest.split_at_checked(MANUAL_LEN - 3) else {
                    // A known type of another length is an assertion: the board stops.
                    return self.supervisor.emergency_stop();
                };
                let (parts, _) = angles.as_chunks::<4>();
                let part = |n: usize| parts.get(n).map_or(0.0, |part| f32::from_le_bytes(*part));
                let thrust = u16::from_le_bytes([*t0, *t1]);
                self.commander.manual(self.now_us, [part(0), part(1), part(2)], thrust);
            }
            (Ok(Place::LogControl), CrtpError::UnknownCommand(command), [_, rest @ ..]) => {
                let block = rest.first().copied().unwrap_or_default();
                self.say(&FromBoard::Log(Blocks::unknown(command, block)));
            }
            _ => {}
        }
    }

    fn place_of(&self, id: u16) -> Option<usize> {
        let place = usize::from(id).checked_sub(usize::from(self.other_table))?;
        (place < PARAMETERS.len()).then_some(place)
    }

    fn parameter(&mut self, request: ParameterRequest<'_>) {
        match request {
            ParameterRequest::Read(id) => {
                let known = self.place_of(id).and_then(|n| {
                    let (kind, value) = (PARAMETERS.get(n)?.kind, *self.parameters.get(n)?);
                    Some((kind, kind.write(value)?))
                });
                let value = known.as_ref().and_then(|(kind, raw)| raw.get(..kind.width()));
                let Some(none) = refusal(NO_ENTRY) else { return };
                let answer = ParameterAnswer::Read(id, value.ok_or(none));
                self.say(&FromBoard::Parameter(answer));
            }
            ParameterRequest::Write(id, bytes) => {
                let Some(n) = self.place_of(id) else {
                    return self
                        .say(&FromBoard::Parameter(ParameterAnswer::Written(id, &[NO_ENTRY])));
                };
                let kind = PARAMETERS[n].kind;
                // A read-only one is not even answered, nor is what is too short.
                let value = bytes.get(..kind.width()).and_then(|bytes| kind.read(bytes));
                let Some(value) = value.filter(|_| !PARAMETERS[n].is_read_only()) else { return };
                self.set(n, value);
                self.say(&FromBoard::Parameter(ParameterAnswer::Written(id, bytes)));
            }
            ParameterRequest::SetByName { group, name, kind, value } => {
                let outcome = self.set_by_name(group, name, kind, value);
                let outcome = outcome.or_else(blocks::refused);
                let answer = ParameterAnswer::SetByName { group, name, outcome };
                self.say(&FromBoard::Parameter(answer));
            }
            ParameterRequest::ExtendedType(id) => {
                let known = self.place_of(id).filter(|n| PARAMETERS[*n].is_extended());
                let Some(none) = refusal(NO_ENTRY) else { return };
                let answer =
                    ParameterAnswer::ExtendedType(id, known.map(|_| PERSISTENT).ok_or(none));
                self.say(&FromBoard::Parameter(answer));
            }
        }
    }

    fn set_by_name(&mut self, group: &str, name: &str, kind: Kind, value: Value) -> Result<(), u8> {
        let place = PARAMETERS.iter().position(|p| p.group == group && p.name == name);
        let n = place.ok_or(NO_ENTRY)?;
        if PARAMETERS[n].kind != kind {
            return Err(OTHER_TYPE);
        }
        if PARAMETERS[n].is_read_only() {
            return Err(READ_ONLY);
        }
        self.set(n, value);
        Ok(())
    }

    fn set(&mut self, n: usize, value: Value) {
        self.parameters[n] = value;
        if (PARAMETERS[n].group, PARAMETERS[n].name) == ("stabilizer", "stop") && value.f64() != 0.0
        {
            self.supervisor.emergency_stop();
        }
    }

    fn memory(&mut self, request: MemoryRequest) {
        match request {
            MemoryRequest::Count => {
                self.say(&FromBoard::Memory(MemoryAnswer::Count(MEMORIES.len() as u8)));
            }
            MemoryRequest::Info(n) => {
                let info = MEMORIES.get(usize::from(n));
                let info = info.map(|(kind, size)| MemoryInfo {
                    kind: *kind,
                    size: *size,
                    serial: &[0; 8],
                });
                self.say(&FromBoard::Memory(MemoryAnswer::Info(n, info)));
            }
            MemoryRequest::Read { memory, address, len } => {
                let bytes = match memory {
                    LOCO_MEMORY => {
                        self.loco.read(address, len.into(), self.now_us).ok_or(NO_ACCESS)
                    }
                    0 | 1 => Ok(vec![0; len.into()]),
                    _ => Err(NO_ENTRY),
                };
                let outcome = match &bytes {
                    Ok(bytes) => Ok(bytes.as_slice()),
                    Err(number) => match refusal(*number) {
                        Some(refusal) => Err(refusal),
                        None => return,
                    },
                };
                self.say(&FromBoard::Memory(MemoryAnswer::Read { memory, address, outcome }));
            }
        }
    }

    fn order(&mut self, request: SupervisorRequest) {
        let answer = match request {
            SupervisorRequest::Bits => SupervisorAnswer::Bits(self.supervisor.bits()),
            SupervisorRequest::Arm(arm) => {
                let (done, armed) = self.supervisor.arm(arm);
                SupervisorAnswer::Arm { done, armed }
            }
            SupervisorRequest::Recover => {
                let (done, recovered) = self.supervisor.recover();
                SupervisorAnswer::Recover { done, recovered }
            }
            SupervisorRequest::EmergencyStop => return self.supervisor.emergency_stop(),
        };
        self.say(&FromBoard::Supervisor(answer));
    }

    fn platform(&mut self, request: PlatformRequest) {
        let before = self.no_port_9;
        let answer = match request {
            PlatformRequest::Protocol => {
                PlatformAnswer::Protocol(if before { PROTOCOL_BEFORE } else { PROTOCOL })
            }
            PlatformRequest::Firmware => {
                PlatformAnswer::Firmware(if before { FIRMWARE_BEFORE } else { FIRMWARE })
            }
            PlatformRequest::Device => PlatformAnswer::Device(match self.settings.build {
                Build::Cf2 => "CF21",
                Build::Flapper | Build::Bolt => "CB11",
            }),
            PlatformRequest::Arm(arm) => {
                let (done, armed) = self.supervisor.arm(arm);
                PlatformAnswer::Arm { done, armed }
            }
            PlatformRequest::Recover => {
                let (done, recovered) = self.supervisor.recover();
                PlatformAnswer::Recover { done, recovered }
            }
        };
        self.say(&FromBoard::Platform(answer));
    }
}
