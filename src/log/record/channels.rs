//! Channels of a log: their names, their message types, and the decoded messages they hold.

use std::collections::BTreeMap;

use mcap::records::Metadata;
use prost::Message as _;

use super::pb;
use haltere_core::time::HostTime;
use haltere_pilot::LinkId;

/// Name of the channel of raw input of a link.
pub(super) fn input_channel(link: LinkId) -> String {
    format!("/in/{}", link_name(link))
}

/// Name of the channel of raw output of a link.
pub(super) fn output_channel(link: LinkId) -> String {
    format!("/out/{}", link_name(link))
}

/// Its name in channels and for people.
pub fn link_name(link: LinkId) -> String {
    match link {
        LinkId::Tag => "tag".into(),
        LinkId::Board => "board".into(),
        LinkId::Ground(n) => format!("ground/{n}"),
    }
}

/// The link of `/in/…` or `/out/…` without its first part.
pub fn link_from_name(name: &str) -> Option<LinkId> {
    match name {
        "tag" => Some(LinkId::Tag),
        "board" => Some(LinkId::Board),
        _ => name.strip_prefix("ground/")?.parse().ok().map(LinkId::Ground),
    }
}

/// Channels that are no raw bytes, beside the decoded ones.
pub(super) const CONFIG: (&str, &str) = ("/config", "haltere.Session");
pub(super) const EVENT: (&str, &str) = ("/in/event", "haltere.LinkEvent");
pub(super) const PEER: (&str, &str) = ("/in/peer", "haltere.LinkPeer");
pub(super) const LOST: (&str, &str) = ("/in/lost", "haltere.Lost");
pub(super) const FILE: (&str, &str) = ("/in/file", "haltere.FileAnswer");
pub(super) const CALENDAR: (&str, &str) = ("/in/calendar", "haltere.Calendar");
pub(super) const END_ASKED: (&str, &str) = ("/in/end", "haltere.EndAsked");
pub(super) const RECORDING: (&str, &str) = ("/in/recording", "haltere.RecordingState");
pub(super) const WAKE: (&str, &str) = ("/wake", "haltere.Wake");
pub(super) const HOLE: (&str, &str) = ("/hole", "haltere.Hole");
pub(super) const CLOSING: (&str, &str) = ("/closing", "haltere.Closing");
/// All of them.
pub(super) const FIXED: [(&str, &str); 11] =
    [CONFIG, EVENT, PEER, LOST, FILE, CALENDAR, END_ASKED, RECORDING, WAKE, HOLE, CLOSING];
/// Message type of raw bytes.
pub(super) const RAW_BYTES: &str = "haltere.RawBytes";

/// Whether it holds inputs or outputs of the core.
pub(super) fn is_raw(name: &str) -> bool {
    name == WAKE.0 || name.starts_with("/in/") || name.starts_with("/out/")
}

/// Whether it holds what the core tells of itself, or the glue around it.
pub(super) fn is_decoded(name: &str) -> bool {
    Decoded::CHANNELS.iter().any(|(channel, _)| *channel == name)
}

/// Message type of a channel of ours.
pub(super) fn schema_of(channel: &str) -> Option<&'static str> {
    FIXED
        .iter()
        .chain(Decoded::CHANNELS)
        .find(|(name, _)| *name == channel)
        .map(|(_, schema)| *schema)
        .or_else(|| {
            let raw = channel.strip_prefix("/in/").or_else(|| channel.strip_prefix("/out/"))?;
            link_from_name(raw).map(|_| RAW_BYTES)
        })
}

/// Names of the channels so far, as metadata: read where the chunk with their own records is bad.
pub(super) fn to_metadata<'a>(ids: impl Iterator<Item = (&'a str, u16)>) -> Metadata {
    let mut told: BTreeMap<String, String> =
        ids.map(|(name, id)| (id.to_string(), name.to_owned())).collect();
    told.insert(CHECKSUM.into(), checksum(&told).to_string());
    Metadata { name: CHANNELS.into(), metadata: told }
}

/// And back. `None`: it says something else, or is damaged.
pub(super) fn from_metadata(metadata: &Metadata) -> Option<BTreeMap<u16, String>> {
    let mut told = metadata.metadata.clone();
    let sum = told.remove(CHECKSUM).filter(|_| metadata.name == CHANNELS)?;
    if checksum(&told).to_string() != sum {
        return None;
    }
    told.into_iter().map(|(id, name)| Some((id.parse().ok()?, name))).collect()
}

/// Metadata have no checksum of their own.
fn checksum(told: &BTreeMap<String, String>) -> u32 {
    let mut crc = flate2::Crc::new();
    for (id, name) in told {
        crc.update(format!("{id}={name}\n").as_bytes());
    }
    crc.sum()
}

const CHANNELS: &str = "haltere.channels";
const CHECKSUM: &str = "crc32";

macro_rules! decoded {
    ($($variant:ident $channel:literal $at:ident;)*) => {
        /// A decoded message.
        #[derive(Debug, Clone, PartialEq)]
        pub enum Decoded {
            $(
                #[doc = concat!("`", $channel, "`")]
                $variant(pb::$variant),
            )*
        }

        impl Decoded {
            /// Every decoded channel with the name of its message type.
            pub const CHANNELS: &[(&str, &str)] =
                &[$(($channel, concat!("haltere.", stringify!($variant))),)*];

            /// Name of its channel.
            pub fn channel(&self) -> &'static str {
                match self {
                    $(Decoded::$variant(_) => $channel,)*
                }
            }

            /// The time it stands at in the log.
            pub fn at(&self) -> HostTime {
                HostTime::from_us(match self {
                    $(Decoded::$variant(message) => message.$at,)*
                })
            }

            /// Its message as protobuf, in place of what `out` held.
            pub fn encode(&self, out: &mut Vec<u8>) {
                out.clear();
                // Cannot fail: a Vec grows.
                let _ = match self {
                    $(Decoded::$variant(message) => message.encode(out),)*
                };
            }

            /// `None`: no such channel among the decoded ones.
            pub(super) fn decode(
                channel: &str,
                data: &[u8],
            ) -> Option<Result<Self, prost::DecodeError>> {
                match channel {
                    $($channel => Some(pb::$variant::decode(data).map(Decoded::$variant)),)*
                    _ => None,
                }
            }
        }
    };
}

/// State of the glue around the core, for the log.
#[derive(Debug, Clone, Copy, Default)]
pub struct GlueState {
    /// Wake-ups so far.
    pub wake_ups: u64,
    /// Wake-ups later than half a control period.
    pub late_wake_ups: u64,
    /// Largest lateness of a wake-up, s.
    pub worst_lateness_s: f64,
}

impl Decoded {
    /// State of the glue as it stands in a log.
    pub fn from_glue(at: HostTime, state: &GlueState) -> Self {
        Decoded::Glue(pb::Glue {
            at_us: at.as_us(),
            wake_ups: state.wake_ups,
            late_wake_ups: state.late_wake_ups,
            worst_lateness_s: state.worst_lateness_s,
        })
    }
}

decoded! {
    Imu "/imu" received_at_us;
    Uwb "/uwb" received_at_us;
    Estimate "/estimate" at_us;
    Control "/control" at_us;
    Shadow "/shadow" at_us;
    Battery "/battery" received_at_us;
    OtherBattery "/other_battery" received_at_us;
    Servos "/servos" received_at_us;
    BoardAttitude "/board_attitude" received_at_us;
    Baro "/baro" received_at_us;
    Mag "/mag" received_at_us;
    Reference "/reference" received_at_us;
    Mode "/mode" at_us;
    Text "/text" at_us;
    Health "/health" at_us;
    Glue "/glue" at_us;
}
