//! What is answered to clients without the rest of the core: echoes, and that there is no shell.

use haltere_dialect::mav::haltere::{
    MavMessage, PING_DATA, REQUEST_DATA_STREAM_DATA, SERIAL_CONTROL_DATA, SerialControlFlag,
    TIMESYNC_DATA,
};
use haltere_dialect::mav::known;

use haltere_core::time::HostTime;

use super::Stations;
use crate::input::LinkId;
use crate::out::Out;

/// What a shell says.
pub(crate) const NO_SHELL: &[u8] = b"haltere has no shell\r\n";
/// COMMAND_LONG and COMMAND_INT.
const COMMAND_LONG_ID: u32 = 76;
const COMMAND_INT_ID: u32 = 75;

/// Whether a message of this id carries a command.
pub(crate) fn is_command(msg_id: u32) -> bool {
    matches!(msg_id, COMMAND_LONG_ID | COMMAND_INT_ID)
}

impl Out {
    /// SERIAL_CONTROL: there is no shell, and whoever opens one reads so.
    pub(crate) fn refuse_shell(&mut self, link: LinkId, peer: (u8, u8), m: &SERIAL_CONTROL_DATA) {
        if m.flags.contains(SerialControlFlag::SERIAL_CONTROL_FLAG_REPLY) {
            return;
        }
        let mut data = [0; 70];
        data[..NO_SHELL.len()].copy_from_slice(NO_SHELL);
        let answer = MavMessage::SERIAL_CONTROL(SERIAL_CONTROL_DATA {
            device: m.device,
            flags: SerialControlFlag::SERIAL_CONTROL_FLAG_REPLY,
            count: NO_SHELL.len() as u8,
            data,
            target_system: peer.0,
            target_component: peer.1,
            ..Default::default()
        });
        self.message(link, &answer);
    }
    /// `false`: it is the answer to another's.
    pub(crate) fn echo_timesync(
        &mut self,
        at: HostTime,
        link: LinkId,
        peer: (u8, u8),
        m: &TIMESYNC_DATA,
    ) -> bool {
        if m.tc1 != 0 {
            return false;
        }
        let mut echo = m.clone();
        echo.tc1 = at.as_us().cast_signed().saturating_mul(1000);
        echo.target_system = peer.0;
        echo.target_component = peer.1;
        self.message(link, &MavMessage::TIMESYNC(echo));
        true
    }

    /// `false`: it is the answer to another's.
    pub(crate) fn echo_ping(&mut self, link: LinkId, peer: (u8, u8), m: &PING_DATA) -> bool {
        if m.target_system != 0 || m.target_component != 0 {
            return false;
        }
        let mut echo = m.clone();
        echo.target_system = peer.0;
        echo.target_component = peer.1;
        self.message(link, &MavMessage::PING(echo));
        true
    }
}

impl Stations {
    pub(crate) fn request_streams(
        &mut self,
        at: HostTime,
        link: LinkId,
        m: &REQUEST_DATA_STREAM_DATA,
        out: &mut Out,
    ) {
        let rate_hz = f64::from(m.req_message_rate);
        let group = known(m.req_stream_id);
        if let (Some(ground), Some(group)) = (self.ground_mut(link), group) {
            ground.streams.set_group(group, rate_hz, m.start_stop == 1, at);
            out.sends_events(link, ground.wants_events());
        }
    }
}
