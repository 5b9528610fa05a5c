//! One packet of CRTP: a header that says where it goes, and at most 30 bytes.
//!
//! | offset | bits | field |
//! |---|---|---|
//! | 0 | 7-4 | port |
//! | 0 | 3-2 | the link's own: counters of a safe radio link, else set |
//! | 0 | 1-0 | channel |
//! | 1 | | payload |
//!
//! There is no checksum and no sequence number: whatever carries packets keeps them whole. Source: crazyflie-firmware
//! 2a18fc29, `src/modules/interface/crtp.h`.

use num_derive::FromPrimitive;
use num_traits::FromPrimitive as _;

/// Most bytes behind the header (`crtp.h`, `CRTP_MAX_DATA_SIZE`).
pub const MAX_PAYLOAD: usize = 30;
/// Most bytes of a packet.
pub const MAX_PACKET: usize = 1 + MAX_PAYLOAD;

/// Bits of the header that belong to the link. Its receiver must not look at them (`crtp.h`, `CRTP_IS_NULL_PACKET`);
/// we set them, as cflib does, so that what we send does not depend on where it came from.
const LINK_BITS: u8 = 0x0C;

/// Ports and their channels, as the header names them: port in the high half, channel in the low one (`crtp.h`,
/// `CRTPPort`; the channels are those of each port's page in `docs/functional-areas/crtp/`).
#[derive(Debug, Clone, Copy, PartialEq, Eq, FromPrimitive)]
#[repr(u8)]
pub enum Place {
    /// Text that the board prints.
    Console = 0x00,
    /// Table of parameters.
    ParameterToc = 0x20,
    /// Parameters read by id.
    ParameterRead = 0x21,
    /// Parameters written by id.
    ParameterWrite = 0x22,
    /// All else about parameters.
    ParameterMisc = 0x23,
    /// Attitude and thrust.
    Attitude = 0x30,
    /// List of memories.
    MemoryInfo = 0x40,
    /// Memories read.
    MemoryRead = 0x41,
    /// Table of log variables.
    LogToc = 0x50,
    /// Log blocks made, started, deleted.
    LogControl = 0x51,
    /// Rows of log blocks.
    LogData = 0x52,
    /// Position from outside.
    ExternalPosition = 0x60,
    /// All else about localization.
    Localization = 0x61,
    /// Setpoints that name their type.
    Setpoint = 0x70,
    /// What is said about setpoints.
    SetpointMeta = 0x71,
    /// State of the supervisor.
    SupervisorInfo = 0x90,
    /// Orders to the supervisor.
    SupervisorCommand = 0x91,
    /// Orders to the platform.
    PlatformCommand = 0xD0,
    /// Versions of the platform.
    PlatformVersion = 0xD1,
    /// Comes back as it was sent.
    LinkEcho = 0xF0,
    /// Is answered by a full packet.
    LinkSource = 0xF1,
    /// Is thrown away.
    LinkSink = 0xF2,
    /// Says nothing.
    LinkNull = 0xF3,
}

/// Why bytes are no message that we know.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum CrtpError {
    /// There is no header, or more than a packet holds.
    BadLength,
    /// This port and channel are none we know, or nobody speaks there in this direction.
    UnknownPlace,
    /// The place is known, the command, its first byte, is not.
    UnknownCommand(u8),
    /// The rest has not the length or structure of its command.
    BadPayload,
}

/// One packet, without allocation.
#[derive(Clone, Copy, PartialEq, Eq)]
pub struct Packet {
    /// The header, then the payload; zeros behind its end.
    bytes: [u8; MAX_PACKET],
    len: usize,
}

impl std::fmt::Debug for Packet {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Packet({:02x?})", self.bytes())
    }
}

impl Packet {
    /// With nothing behind its header yet.
    pub fn new(place: Place) -> Self {
        let mut bytes = [0; MAX_PACKET];
        bytes[0] = place as u8 | LINK_BITS;
        Self { bytes, len: 1 }
    }

    /// What a link delivered as one packet, of any port. The link's bits are forgotten.
    pub fn read(wire: &[u8]) -> Result<Self, CrtpError> {
        let mut bytes = [0; MAX_PACKET];
        let (Some(to), false) = (bytes.get_mut(..wire.len()), wire.is_empty()) else {
            return Err(CrtpError::BadLength);
        };
        to.copy_from_slice(wire);
        bytes[0] |= LINK_BITS;
        Ok(Self { bytes, len: wire.len() })
    }

    /// What a link sends.
    pub fn bytes(&self) -> &[u8] {
        self.bytes.get(..self.len).unwrap_or_default()
    }

    /// What is behind the header.
    pub fn payload(&self) -> &[u8] {
        self.bytes.get(1..self.len).unwrap_or_default()
    }

    /// Where it goes, or comes from.
    pub fn place(&self) -> Result<Place, CrtpError> {
        Place::from_u8(self.bytes[0] & !LINK_BITS).ok_or(CrtpError::UnknownPlace)
    }

    /// Adds to the payload; `false`, and nothing added, where it would be too long.
    pub fn push(&mut self, more: &[u8]) -> bool {
        let end = self.len + more.len();
        let Some(to) = self.bytes.get_mut(self.len..end) else { return false };
        to.copy_from_slice(more);
        self.len = end;
        true
    }
}
