//! Where a Crazyradio finds its Crazyflie: `0/80/2M/E7E7E7E7E7` is dongle, channel, rate and address.

use std::fmt;

/// Highest channel, MHz above 2400 (crazyradio2-firmware c0d2c17, `docs/development/compatible-usb-protocol.md`).
pub const MOST_CHANNEL: u8 = 125;
/// Digits of an address.
const DIGITS: usize = 10;

/// Place of a Crazyflie on the air, and the dongle that reaches it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct RadioPlace {
    /// Which of the dongles, from 0 in the order of the bus.
    pub dongle: u8,
    /// Channel, MHz above 2400.
    pub channel: u8,
    /// Bits in a second.
    pub rate: RadioRate,
    /// Address of the vehicle.
    pub address: [u8; 5],
}

/// Rate on the air.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RadioRate {
    /// 250 kbit/s.
    K250,
    /// 1 Mbit/s.
    M1,
    /// 2 Mbit/s.
    M2,
}

impl RadioRate {
    /// All rates, in the order of the dongle's numbers.
    pub const ALL: [Self; 3] = [Self::K250, Self::M1, Self::M2];

    fn word(self) -> &'static str {
        match self {
            Self::K250 => "250K",
            Self::M1 => "1M",
            Self::M2 => "2M",
        }
    }
}

impl RadioPlace {
    /// Where a Crazyflie is that nobody has changed.
    pub const FACTORY: Self =
        Self { dongle: 0, channel: 80, rate: RadioRate::M2, address: [0xE7; 5] };

    /// Reads it as Bitcraze's clients write it, with or without `//` before it. `Err`: what is wrong with it.
    pub(super) fn read(text: &str) -> Result<Self, &'static str> {
        let mut parts = text.strip_prefix("//").unwrap_or(text).split('/');
        let mut part = || parts.next().unwrap_or_default();
        let dongle = part().parse().map_err(|_| "the dongle is a number, 0 for the first")?;
        let channel = part().parse().ok().filter(|channel| *channel <= MOST_CHANNEL);
        let channel = channel.ok_or("the channel is 0 to 125")?;
        let rate = part();
        let rate = RadioRate::ALL.into_iter().find(|known| known.word() == rate);
        let rate = rate.ok_or("the rate is 250K, 1M or 2M")?;
        let digits = part();
        if digits.is_empty() || digits.len() > DIGITS || parts.next().is_some() {
            return Err("the address is 1 to 10 hexadecimal digits, and the last part");
        }
        let number = u64::from_str_radix(digits, 16).ok().filter(|_| !digits.starts_with('+'));
        let number = number.ok_or("the address is 1 to 10 hexadecimal digits")?;
        let [.., a, b, c, d, e] = number.to_be_bytes();
        Ok(Self { dongle, channel, rate, address: [a, b, c, d, e] })
    }
}

impl fmt::Display for RadioPlace {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}/{}/{}/", self.dongle, self.channel, self.rate.word())?;
        self.address.iter().try_for_each(|byte| write!(f, "{byte:02X}"))
    }
}
