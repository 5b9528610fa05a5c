//! The Crazyradio: found on USB, set up, and one packet after the other sent and answered.
//!
//! The first generation and "Crazyradio 2.0" alike (crazyradio2-firmware c0d2c17,
//! `docs/development/compatible-usb-protocol.md`). Tried against a simulated one, not on hardware.

use std::time::Duration;

use super::exchange::{Answer, MOST_ANSWER};
use crate::live::usb_device::{Usb, UsbDevice, devices};
use haltere_pilot::settings::{MOST_CHANNEL, RadioPlace, RadioRate};

/// Numbers on USB, and those of its bootloader.
const VENDOR: u16 = 0x1915;
const PRODUCT: u16 = 0x7777;
const BOOTLOADER: u16 = 0x0101;
/// The oldest firmware that is promised, as USB tells it, 0.50: from there on all that is asked of it is documented.
const OLDEST: u16 = 0x0050;
/// From here on it is a Crazyradio 2.0, without 250 kbit/s and with fewer channels.
const SECOND: u16 = 0x0500;
const MOST_CHANNEL_OF_SECOND: u8 = 100;

/// Requests.
const CHANNEL: u8 = 0x01;
const ADDRESS: u8 = 0x02;
const RATE: u8 = 0x03;
const POWER: u8 = 0x04;
const REPEAT_DELAY: u8 = 0x05;
const REPEATS: u8 = 0x06;
const ACKNOWLEDGE: u8 = 0x10;
const CARRIER: u8 = 0x20;
/// 0 dBm, the strongest.
const FULL_POWER: u16 = 3;
/// So long that an acknowledgement of 32 bytes has come.
const DELAY_FOR_32: u16 = 0xA0;
/// As Bitcraze's clients have it: with more a lost packet keeps a newer setpoint waiting.
const MOST_REPEATS: u16 = 3;
/// Nothing to say; asks for an answer.
const POLL: [u8; 1] = [0xFF];

/// An answer comes within this, or the dongle is taken for gone: three repetitions are over within 10 ms.
const ANSWER: Duration = Duration::from_millis(100);
/// What an earlier program asked for has come within this.
const OLD_ANSWER: Duration = Duration::from_millis(5);
const MOST_OLD_ANSWERS: usize = 8;

/// The dongle, set up.
pub struct Crazyradio<U = UsbDevice> {
    usb: U,
    version: u16,
}

/// A Crazyradio that is plugged in.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Found {
    /// Firmware as USB tells it.
    pub version: u16,
}

impl Found {
    /// Why it is not used.
    pub fn refusal(self) -> Option<String> {
        (self.version < OLDEST).then(|| {
            format!(
                "Crazyradio has firmware {}: flash the dongle, not the vehicle or the anchors, with {} or later",
                words(self.version),
                words(OLDEST)
            )
        })
    }
}

impl std::fmt::Display for Found {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let name = if is_second(self.version) { "Crazyradio 2.0" } else { "Crazyradio" };
        write!(f, "{name}, firmware {}", words(self.version))
    }
}

fn words(version: u16) -> String {
    format!("{:x}.{:02x}", version >> 8, version & 0xFF)
}

/// What somebody has built calls itself 99.
fn is_second(version: u16) -> bool {
    (SECOND..0x9900).contains(&version)
}

/// Every Crazyradio that is plugged in. `Err`: why none can be used.
pub fn find() -> Result<Vec<Found>, String> {
    let all = devices(VENDOR, PRODUCT)?;
    if all.is_empty() {
        return Err(if devices(VENDOR, BOOTLOADER)?.is_empty() {
            "no Crazyradio is on USB (1915:7777): plug it in"
        } else {
            "the Crazyradio is in its bootloader: pull it out and put it in again"
        }
        .to_owned());
    }
    Ok(all.iter().map(|device| Found { version: device.device_version() }).collect())
}

impl Crazyradio {
    /// Opens the dongle that is meant, for this place.
    pub fn open(place: &RadioPlace) -> Result<Self, String> {
        let count = find()?.len();
        let all = devices(VENDOR, PRODUCT)?;
        let info = all.get(usize::from(place.dongle)).ok_or_else(|| {
            format!("Crazyradio {} is not on USB, {count} are: they count from 0", place.dongle)
        })?;
        let name = format!("Crazyradio {}", place.dongle);
        let version = info.device_version();
        if let Some(why) = (Found { version }).refusal() {
            return Err(why);
        }
        Self::set_up(UsbDevice::open(info, &name)?, version, place)
    }
}

impl<U: Usb> Crazyradio<U> {
    /// Sets up a device that is open.
    pub(super) fn set_up(usb: U, version: u16, place: &RadioPlace) -> Result<Self, String> {
        if let Some(why) = (Found { version }).refusal() {
            return Err(why);
        }
        let mut radio = Self { usb, version };
        radio.ask(CARRIER, 0, &[])?;
        radio.ask(POWER, FULL_POWER, &[])?;
        radio.ask(REPEAT_DELAY, DELAY_FOR_32, &[])?;
        radio.ask(REPEATS, MOST_REPEATS, &[])?;
        radio.ask(ACKNOWLEDGE, 1, &[])?;
        radio.ask(ADDRESS, 0, &place.address)?;
        radio.tune(place.channel, place.rate)?;
        // What was asked for by a program that ended is nobody's answer.
        for _ in 0..MOST_OLD_ANSWERS {
            if radio.usb.read(&mut [0; MOST_ANSWER], OLD_ANSWER)?.is_none() {
                break;
            }
        }
        Ok(radio)
    }

    fn ask(&mut self, request: u8, value: u16, data: &[u8]) -> Result<(), String> {
        let asked = self.usb.request(request, value, 0, data);
        asked.map_err(|why| format!("refuses request {request:#04x}: {why}"))
    }

    fn tune(&mut self, channel: u8, rate: RadioRate) -> Result<(), String> {
        if is_second(self.version) && (rate == RadioRate::K250 || channel > MOST_CHANNEL_OF_SECOND)
        {
            return Err(format!(
                "a Crazyradio 2.0 has 1M and 2M and channels 0 to {MOST_CHANNEL_OF_SECOND}: set the vehicle to one of \
                 these with cfclient"
            ));
        }
        self.ask(RATE, rate as u16, &[])?;
        self.ask(CHANNEL, channel.into(), &[])
    }

    /// Sends a packet and waits for the answer: its status byte, and what came with it. `Err`: it is gone.
    pub(super) fn exchange(
        &mut self,
        packet: &[u8],
        answer: &mut [u8; MOST_ANSWER],
    ) -> Result<usize, String> {
        self.usb.write(packet)?;
        // An answer that comes later would be taken for the next one's: begun anew instead.
        self.usb.read(answer, ANSWER)?.ok_or_else(|| "does not answer".to_owned())
    }

    /// The device behind it.
    #[cfg(test)]
    pub(super) fn usb(&mut self) -> &mut U {
        &mut self.usb
    }

    /// Channels and rates at which somebody answers at this address.
    pub fn scan(&mut self, address: [u8; 5]) -> Result<Vec<(u8, RadioRate)>, String> {
        self.ask(ADDRESS, 0, &address)?;
        let is_second = is_second(self.version);
        let last = if is_second { MOST_CHANNEL_OF_SECOND } else { MOST_CHANNEL };
        let mut found = Vec::new();
        for rate in RadioRate::ALL.into_iter().rev() {
            if is_second && rate == RadioRate::K250 {
                continue;
            }
            for channel in 0..=last {
                self.tune(channel, rate)?;
                let mut answer = [0; MOST_ANSWER];
                let got = self.exchange(&POLL, &mut answer)?;
                if Answer::read(answer.get(..got).unwrap_or_default()).acknowledged {
                    found.push((channel, rate));
                }
            }
        }
        Ok(found)
    }
}
