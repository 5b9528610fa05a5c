//! The board by a Crazyradio: one thread that sends, hears, and waits for a dongle that was pulled out.

mod dongle;
mod exchange;
#[cfg(test)]
mod tests;

pub use dongle::{Crazyradio, Found, find};

use std::time::{Duration, Instant};

use self::exchange::{Answer, Exchange, MOST_ANSWER, Quality};
use super::clock;
use super::inbox::Inbox;
use super::mailbox::Mailbox;
use super::names::Names;
use super::packets;
use super::usb_device::Usb;
use haltere_core::time::HostTime;
use haltere_dialect::crtp::packet::Packet;
use haltere_pilot::settings::RadioPlace;

/// Wait before a dongle is looked for again.
const RETRY: Duration = Duration::from_millis(500);
/// Without anything to say the vehicle is asked again after this: it can only answer.
const POLL: Duration = Duration::from_millis(1);
/// How the link is, is looked at so often, s.
const LOOK_S: f64 = 1.0;
/// A link of which so few packets are acknowledged is told, and told again when it is better than this.
const POOR: f64 = 0.7;
const GOOD: f64 = 0.9;

/// Serves the board until the output or the companion ends.
pub(super) fn serve(place: &RadioPlace, inbox: &Inbox, output: Mailbox) {
    serve_with(|| Crazyradio::open(place), place, inbox, output);
}

fn serve_with<U: Usb>(
    mut open: impl FnMut() -> Result<Crazyradio<U>, String>,
    place: &RadioPlace,
    inbox: &Inbox,
    mut output: Mailbox,
) {
    let (mut told, mut names) = (String::new(), Names::usual());
    while !inbox.stopped() {
        match open() {
            Ok(dongle) => {
                tracing::info!("Crazyradio {} opened, radio:{place}", place.dongle);
                told.clear();
                inbox.up();
                let Some(why) = talk(dongle, inbox, &mut output, &mut names) else { return };
                tracing::warn!("Crazyradio {}: {why}; waiting for it to come back", place.dongle);
                inbox.down();
            }
            Err(why) if why != told => {
                tracing::warn!("{why}; trying again until it works");
                told = why;
            }
            Err(_) => {}
        }
        if !output.lose(inbox, Instant::now() + RETRY) {
            return;
        }
    }
}

/// Until the dongle is gone, which is told; `None`: the companion ends.
fn talk<U: Usb>(
    mut dongle: Crazyradio<U>,
    inbox: &Inbox,
    output: &mut Mailbox,
    names: &mut Names,
) -> Option<String> {
    let (mut exchange, mut view) = (Exchange::default(), View::default());
    loop {
        if !exchange.is_busy() {
            output.wait_for(POLL);
        }
        let now = clock::now();
        let goes_on = exchange.waiting.take_from(output, inbox, names, now) && !inbox.stopped();
        let owes = exchange.owes() && exchange.is_heard(now);
        if !goes_on && !owes {
            return None;
        }
        match turn(&mut dongle, &mut exchange, clock::now) {
            Ok(Some((at, packet))) => {
                packets::hand_in(inbox, names, at, packet.bytes());
            }
            Ok(None) => {}
            Err(why) => return Some(why),
        }
        if let Some(line) = view.look(now, &mut exchange) {
            tracing::warn!("{line}");
        }
    }
}

/// One packet over the air, and what came with its answer.
fn turn(
    dongle: &mut Crazyradio<impl Usb>,
    exchange: &mut Exchange,
    clock: impl Fn() -> HostTime,
) -> Result<Option<(HostTime, Packet)>, String> {
    let (packet, len) = exchange.next(clock());
    let mut answer = [0; MOST_ANSWER];
    let got = dongle.exchange(packet.get(..len).unwrap_or_default(), &mut answer)?;
    let at = clock();
    let answer = Answer::read(answer.get(..got).unwrap_or_default());
    Ok(exchange.answered(at, answer).map(|packet| (at, packet)))
}

/// A dongle and its vehicle without a core behind them, for who asks a few questions.
pub struct Talk {
    dongle: Crazyradio,
    exchange: Exchange,
}

impl Talk {
    /// Opens the dongle.
    pub fn open(place: &RadioPlace) -> Result<Self, String> {
        Ok(Self { dongle: Crazyradio::open(place)?, exchange: Exchange::default() })
    }

    /// One packet over the air, this one where there is one; what came.
    pub fn turn(&mut self, packet: Option<&Packet>) -> Result<Option<Packet>, String> {
        if let Some(packet) = packet {
            self.exchange.waiting.put(clock::now(), packet.bytes());
        }
        let came = turn(&mut self.dongle, &mut self.exchange, clock::now)?;
        Ok(came.map(|(_, packet)| packet))
    }
}

/// How the link was told to be.
#[derive(Debug, Default)]
struct View {
    since: Option<HostTime>,
    is_poor: bool,
}

impl View {
    /// A line for people, when it has changed.
    fn look(&mut self, now: HostTime, exchange: &mut Exchange) -> Option<String> {
        let since = *self.since.get_or_insert(now);
        if now.seconds_since(since) < LOOK_S {
            return None;
        }
        self.since = Some(now);
        let Quality { sent, acknowledged, repeated, setpoints } = exchange.quality();
        let share = f64::from(acknowledged) / f64::from(sent.max(1));
        let is_poor = share < if self.is_poor { GOOD } else { POOR };
        if std::mem::replace(&mut self.is_poor, is_poor) == is_poor {
            return None;
        }
        Some(if acknowledged == 0 {
            "radio: the vehicle does not answer: switch it on, look at channel, rate and address"
                .to_owned()
        } else {
            format!(
                "radio: {:.0} % of {sent} packets in a second answered, {repeated} repeated, {setpoints} setpoints taken",
                share * 100.0
            )
        })
    }
}
