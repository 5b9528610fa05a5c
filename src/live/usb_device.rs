//! A device on USB with one pair of bulk endpoints: the Crazyradio, and a Crazyflie by its cable.

use std::time::Duration;

use nusb::transfer::{Buffer, Bulk, ControlOut, ControlType, In, Out, Recipient, TransferError};
use nusb::{DeviceInfo, Endpoint, Error, ErrorKind, Interface, MaybeFuture as _};

/// Endpoints of both devices (crazyradio2-firmware c0d2c17, `src/legacy_usb.c`; crazyflie-firmware 2a18fc29, `usb.c`).
const OUT: u8 = 0x01;
const IN: u8 = 0x81;
/// Longest wait for a device that takes or answers, a tenth of a setpoint's silence that the board notices.
const PATIENCE: Duration = Duration::from_millis(50);

/// What can be done with such a device.
pub trait Usb {
    /// A request of the maker's own.
    fn request(&mut self, request: u8, value: u16, index: u16, data: &[u8]) -> Result<(), String>;
    /// Writes one packet.
    fn write(&mut self, packet: &[u8]) -> Result<(), String>;
    /// Reads one packet; `None`: none has come in this time.
    fn read(&mut self, packet: &mut [u8], patience: Duration) -> Result<Option<usize>, String>;
}

/// Such a device, opened.
pub struct UsbDevice {
    interface: Interface,
    output: Endpoint<Bulk, Out>,
    input: Endpoint<Bulk, In>,
    spare: Option<Buffer>,
}

/// All devices with these numbers, in the order of the bus.
pub fn devices(vendor: u16, product: u16) -> Result<Vec<DeviceInfo>, String> {
    let all = nusb::list_devices().wait().map_err(|error| format!("USB: {error}"))?;
    let ours = |device: &DeviceInfo| device.vendor_id() == vendor && device.product_id() == product;
    Ok(all.filter(ours).collect())
}

impl UsbDevice {
    /// Opens it; `name` is what people call it.
    pub fn open(info: &DeviceInfo, name: &str) -> Result<Self, String> {
        let why = |error: Error| match error.kind() {
            ErrorKind::PermissionDenied => format!(
                "{name}: permission denied: install the udev rule of packaging/, be in the group dialout, and plug it in \
                 again"
            ),
            ErrorKind::Busy => format!("{name}: another program has it: end that one"),
            _ => format!("{name}: cannot be opened: {error}; plug it in again"),
        };
        let device = info.open().wait().map_err(why)?;
        let interface = device.claim_interface(0).wait().map_err(why)?;
        let output = interface.endpoint(OUT).map_err(why)?;
        let input = interface.endpoint(IN).map_err(why)?;
        Ok(Self { interface, output, input, spare: None })
    }
}

impl Usb for UsbDevice {
    fn request(&mut self, request: u8, value: u16, index: u16, data: &[u8]) -> Result<(), String> {
        let request = ControlOut {
            control_type: ControlType::Vendor,
            recipient: Recipient::Device,
            request,
            value,
            index,
            data,
        };
        self.interface.control_out(request, PATIENCE).wait().map_err(|error| error.to_string())
    }

    fn write(&mut self, packet: &[u8]) -> Result<(), String> {
        let mut buffer = self.spare.take().unwrap_or_else(|| Buffer::new(packet.len().max(64)));
        buffer.clear();
        if buffer.remaining_capacity() < packet.len() {
            return Err("a packet is too long".to_owned());
        }
        buffer.extend_from_slice(packet);
        let done = self.output.transfer_blocking(buffer, PATIENCE);
        self.spare = Some(done.buffer);
        done.status.map_err(|error| error.to_string())
    }

    fn read(&mut self, packet: &mut [u8], patience: Duration) -> Result<Option<usize>, String> {
        // What was asked for before and has not come is waited for: nothing is lost between two reads.
        if self.input.pending() == 0 {
            self.input.submit(Buffer::new(self.input.max_packet_size().max(1)));
        }
        let Some(done) = self.input.wait_next_complete(patience) else { return Ok(None) };
        match done.status {
            Ok(()) => {
                let got = done.buffer.get(..done.actual_len).unwrap_or_default();
                let len = got.len().min(packet.len());
                if let (Some(to), Some(from)) = (packet.get_mut(..len), got.get(..len)) {
                    to.copy_from_slice(from);
                }
                Ok(Some(len))
            }
            Err(TransferError::Cancelled) => Ok(None),
            Err(error) => Err(error.to_string()),
        }
    }
}
