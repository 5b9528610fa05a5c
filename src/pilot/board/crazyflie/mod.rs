//! The link to a Crazyflie or a Flapper's own board over CRTP: its pure parts.
//!
//! Packets come and go as a length byte (1 to 31) and the packet, in any chunking, so that they are recorded and replayed
//! as any bytes are. What these parts tell is in our frames and on the host's clock.

mod arming;
mod asked;
mod axes;
mod blocks;
mod board_time;
mod joined;
mod link;
mod setup;
mod tdoa;
mod told;
mod trips;

pub(crate) use link::Crazyflie;
pub(crate) use told::Told;
