//! The board by the USB cable of a Crazyflie: bulk packets both ways, one thread. Not tried on hardware.

use std::time::{Duration, Instant};

use nusb::DeviceInfo;

use super::clock;
use super::inbox::Inbox;
use super::mailbox::Mailbox;
use super::names::Names;
use super::packets::{self, Next, Waiting};
use super::usb_device::{Usb, UsbDevice, devices};
use haltere_core::drops::DropReason;
use haltere_dialect::crtp::packet::Packet;

/// Numbers of a Crazyflie, which a Loco node and half of all flight controllers share: the name decides.
const VENDOR: u16 = 0x0483;
const PRODUCT: u16 = 0x5740;
const NAME: &str = "Crazyflie";
/// Request that turns CRTP over USB on or off (crazyflie-firmware 2a18fc29, `usb.c`).
const CRTP: u8 = 0x01;
/// What is to be sent waits at most this long for what comes.
const LOOK: Duration = Duration::from_millis(1);
const RETRY: Duration = Duration::from_millis(500);
const MOST_BYTES: usize = 64;

/// Serves the board until the output or the companion ends.
pub(super) fn serve(inbox: &Inbox, mut output: Mailbox) {
    let (mut told, mut names) = (String::new(), Names::usual());
    while !inbox.stopped() {
        match open() {
            Ok(device) => {
                tracing::info!("Crazyflie on USB opened");
                told.clear();
                inbox.up();
                let Some(why) = talk(device, inbox, &mut output, &mut names) else { return };
                tracing::warn!("Crazyflie on USB: {why}; waiting for it to come back");
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

/// The first Crazyflie that is plugged in.
pub fn find() -> Result<DeviceInfo, String> {
    let is_named =
        |device: &DeviceInfo| device.product_string().is_some_and(|name| name.starts_with(NAME));
    let named = devices(VENDOR, PRODUCT)?.into_iter().find(is_named);
    named.ok_or_else(|| "no Crazyflie is on USB (0483:5740, Crazyflie): plug it in".to_owned())
}

fn open() -> Result<UsbDevice, String> {
    UsbDevice::open(&find()?, "Crazyflie on USB")
}

/// A Crazyflie on its cable without a core behind it, for who asks a few questions.
pub struct Talk(UsbDevice);

impl Talk {
    /// Opens it.
    pub fn open() -> Result<Self, String> {
        let mut device = open()?;
        device.request(CRTP, 1, 1, &[])?;
        Ok(Self(device))
    }

    /// Sends a packet, where there is one; what comes within that time.
    pub fn turn(
        &mut self,
        packet: Option<&Packet>,
        patience: Duration,
    ) -> Result<Option<Packet>, String> {
        if let Some(packet) = packet {
            self.0.write(packet.bytes())?;
        }
        let mut bytes = [0; MOST_BYTES];
        let came = self.0.read(&mut bytes, patience)?;
        Ok(came.and_then(|len| Packet::read(bytes.get(..len)?).ok()))
    }
}

impl Drop for Talk {
    fn drop(&mut self) {
        // A vehicle that is left on this would not hear its radio.
        let _ = self.0.request(CRTP, 0, 1, &[]);
    }
}

/// Until it is gone, which is told; `None`: the companion ends.
fn talk(
    mut device: impl Usb,
    inbox: &Inbox,
    output: &mut Mailbox,
    names: &mut Names,
) -> Option<String> {
    if let Err(why) = device.request(CRTP, 1, 1, &[]) {
        return Some(format!("does not speak CRTP: {why}"));
    }
    let (mut waiting, mut bytes) = (Waiting::default(), [0; MOST_BYTES]);
    loop {
        let goes_on = waiting.take_from(output, inbox, names, clock::now()) && !inbox.stopped();
        while let Some(Next::Setpoint(packet) | Next::Request(packet)) = waiting.next(clock::now())
        {
            if let Err(why) = device.write(packet.bytes()) {
                inbox.lost(DropReason::LinkWriteFailed);
                return Some(why);
            }
        }
        if !goes_on {
            // A vehicle that is left on this would not hear its radio.
            let _ = device.request(CRTP, 0, 1, &[]);
            return None;
        }
        match device.read(&mut bytes, LOOK) {
            Ok(Some(len)) => {
                packets::hand_in(inbox, names, clock::now(), bytes.get(..len).unwrap_or_default());
            }
            Ok(None) => {}
            Err(why) => return Some(why),
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;
    use std::sync::atomic::{AtomicBool, Ordering::Relaxed};

    use super::super::inbox::{What, input_queues};
    use super::super::mailbox::{Outgoing, mailbox};
    use super::super::pool::Pool;
    use super::super::shared::{Shared, Waits};
    use super::*;
    use haltere_pilot::LinkId;

    /// Says what it has heard, where it was told to speak.
    struct Mirror(Arc<AtomicBool>, Option<Vec<u8>>);

    impl Usb for Mirror {
        fn request(&mut self, request: u8, on: u16, _: u16, _: &[u8]) -> Result<(), String> {
            assert_eq!(request, CRTP);
            self.0.store(on == 1, Relaxed);
            Ok(())
        }

        fn write(&mut self, packet: &[u8]) -> Result<(), String> {
            assert!(self.0.load(Relaxed));
            self.1 = Some(packet.to_vec());
            Ok(())
        }

        fn read(&mut self, packet: &mut [u8], _: Duration) -> Result<Option<usize>, String> {
            std::thread::sleep(LOOK);
            let told = self.1.take();
            if let Some(told) = &told {
                packet[..told.len()].copy_from_slice(told);
            }
            Ok(told.map(|told| told.len()))
        }
    }

    #[test]
    fn prop_packets_go_both_ways_and_the_radio_has_the_vehicle_back_at_the_end() {
        let shared = Arc::new(Shared::default());
        let (entrance, arrivals) = input_queues();
        let inbox = Inbox::new(LinkId::Board, &entrance, None, shared.clone());
        let (slot, mut output) = mailbox(4).unwrap();
        let is_on = Arc::new(AtomicBool::new(false));
        let mirror = Mirror(is_on.clone(), None);
        let thread =
            std::thread::spawn(move || talk(mirror, &inbox, &mut output, &mut Names::below(None)));
        let piece = [3, 0xFF, 1, 2];
        let bytes = Pool::new(1, 1, 8).lend(&piece).unwrap();
        let link = LinkId::Board;
        let waits = Waits::new(&shared, link);
        slot.put(Outgoing { link, to: None, bytes, _waits: waits }).unwrap();
        let came = arrivals.devices.recv_timeout(Duration::from_secs(10)).unwrap();
        assert!(matches!(&came.what, What::Bytes(bytes, _) if **bytes == piece), "{came:?}");
        assert!(is_on.load(Relaxed));
        drop(slot);
        assert_eq!(thread.join().unwrap(), None);
        assert!(!is_on.load(Relaxed));
    }
}
