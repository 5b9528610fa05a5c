//! The tag's serial port: commands in, boot text and frames out.

use haltere_dialect::lps::{RX_BITS, sniffer, text};
use haltere_dialect::mav::haltere::{MavMessage, UWB_TDOA_DATA};
use haltere_dialect::mav_stream;

use crate::faults::TagReplay;
use crate::tag::clock::TICKS_PER_US;
use crate::tag::replay::Memory;
use crate::tag::{Reception, TagProtocol};

/// What the device says at its start; its exact words matter to nobody, that they come does.
const BOOT_TEXT: &[u8] = b"\r\n====================\r\n\
SYSTEM\t: CPU-ID: simulated\r\n\
CONFIG\t: EEPROM configuration found\r\n\
CONFIG\t: Mode is Sniffer\r\n\
TEST\t: Initialize UWB  [OK]\r\n\
SYSTEM\t: Node started ...\r\n\
SYSTEM\t: Press 'h' for help.\r\n";
/// System and component of the tag that speaks MAVLink.
const TAG_SYSTEM: u8 = 1;
const TAG_COMPONENT: u8 = 180; // MAV_COMP_ID_USER range ends there: nobody else's

/// The port.
#[derive(Debug, Clone)]
pub struct Port {
    protocol: TagProtocol,
    binary: bool,
    dead: bool,
    /// The whole tag is without power.
    pub silent: bool,
    sequence: u16,
    last: Option<(u8, f64)>,
    memory: Memory,
}

impl Port {
    /// Just powered; the boot text goes to `out`.
    pub fn new(protocol: TagProtocol, out: &mut Vec<u8>) -> Self {
        let mut port = Self {
            protocol,
            binary: false,
            dead: false,
            silent: false,
            sequence: 0,
            last: None,
            memory: Memory::default(),
        };
        port.boot(out);
        port
    }

    /// The host has opened the port: the boot text once more. The output format stays as it was.
    pub fn opened(&mut self, out: &mut Vec<u8>) {
        self.boot(out);
    }

    /// Single-character commands.
    pub fn command(&mut self, bytes: &[u8], out: &mut Vec<u8>) {
        if self.protocol == TagProtocol::Mavlink {
            return;
        }
        for byte in bytes {
            match byte {
                b'b' => self.binary = true,
                b'd' => {
                    self.binary = false;
                    self.boot(out);
                }
                // Firmware update: the node leaves its program and says no more.
                b'u' => self.dead = true,
                _ => {}
            }
        }
    }

    /// What it heard last comes again and again, or what it hears.
    pub fn replay(&mut self, replay: Option<TagReplay>) {
        self.memory.set(replay);
    }

    /// Writes what the tag says of one reception.
    pub fn write(&mut self, r: &Reception<'_>, out: &mut Vec<u8>) {
        if self.dead || self.silent {
            return;
        }
        let mut memory = std::mem::take(&mut self.memory);
        memory.pass(r, |r| self.put(r, out));
        self.memory = memory;
    }

    fn put(&mut self, r: &Reception<'_>, out: &mut Vec<u8>) {
        if self.protocol == TagProtocol::Mavlink {
            self.write_mavlink(r, out);
            return;
        }
        let frame = sniffer::SnifferFrame {
            rx_ticks: r.rx_ticks.cast_unsigned() & ((1 << RX_BITS) - 1),
            source: r.source,
            destination: 0xFF,
            payload: r.payload,
        };
        if self.binary {
            sniffer::encode(out, &frame);
        } else {
            text::encode(out, &frame);
        }
    }

    fn write_mavlink(&mut self, r: &Reception<'_>, out: &mut Vec<u8>) {
        if let Some((anchor_a, path_a_m)) = self.last.filter(|(a, _)| *a != r.source) {
            self.sequence = self.sequence.wrapping_add(1);
            let message = MavMessage::UWB_TDOA(UWB_TDOA_DATA {
                time_usec: (r.rx_ticks as f64 / TICKS_PER_US) as u64,
                distance_diff: (r.path_m - path_a_m) as f32,
                std: f32::NAN,
                sequence: self.sequence,
                anchor_a,
                anchor_b: r.source,
            });
            let frame_number = self.sequence as u8; // MAVLink counts on 8 bits
            mav_stream::encode(out, TAG_SYSTEM, TAG_COMPONENT, frame_number, &message);
        }
        self.last = Some((r.source, r.path_m));
    }

    fn boot(&mut self, out: &mut Vec<u8>) {
        if self.protocol != TagProtocol::Mavlink && !self.dead && !self.silent {
            out.extend_from_slice(BOOT_TEXT);
        }
    }
}
