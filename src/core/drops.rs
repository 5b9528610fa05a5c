//! Losses: everything that is thrown away has a reason and is counted.

/// Why bytes, a frame or a measurement were thrown away.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[repr(u8)]
pub enum DropReason {
    /// Bytes on the tag link that belong to no frame.
    TagGarbageByte,
    /// Sniffer frame whose two lengths differ or exceed the limit.
    TagBadLength,
    /// Sniffer frame with an unknown payload type.
    TagUnknownType,
    /// Sniffer frame whose payload has the wrong size for its type.
    TagBadPayload,
    /// Sniffer frame that claims an impossible sender.
    TagBadSource,
    /// Anchor that is not in the survey.
    UwbUnknownAnchor,
    /// Packet that no other anchor's packet could be paired with.
    UwbNoPair,
    /// Clock of the anchor not known yet.
    UwbClockUnsettled,
    /// Packet whose times contradict the anchor's clock.
    UwbClockJump,
    /// Repeated packet.
    UwbDuplicate,
    /// TDOA larger than the distance between its anchors allows.
    UwbImpossible,
    /// Rejected by the filter's gate.
    UwbGated,
    /// Measurement older than the filter can use.
    UwbTooOld,
    /// Bytes on a MAVLink link that belong to no frame.
    MavGarbageByte,
    /// MAVLink frame with a wrong checksum.
    MavBadChecksum,
    /// MAVLink frame whose id is in no dialect of ours.
    MavUnknownId,
    /// MAVLink frame that does not decode (an enum value we do not know).
    MavUndecodable,
    /// MAVLink frame that flags a feature we cannot read.
    MavIncompatible,
    /// Gap in the sequence numbers of a peer: frames lost before us.
    MavSequenceGap,
    /// Message from a system or component that is not our peer on that link.
    MavWrongPeer,
    /// Message that is well formed but asks nothing of us.
    MavIgnored,
    /// Field with a value that cannot be: NaN, a zero quaternion, an absurd voltage.
    BadValue,
    /// IMU sample that came too late or twice.
    ImuOutOfOrder,
    /// Magnetic field too far from the room's own.
    MagDisturbed,
    /// Input queue of the pilot was full, or that of a link's requests for logs.
    InputQueueFull,
    /// Queue to a link was full.
    OutputQueueFull,
    /// Queue of the recorder was full.
    RecorderQueueFull,
    /// Write to a link failed.
    LinkWriteFailed,
    /// Datagram or connection of a station for which its endpoint has no place.
    StationsFull,
    /// MAVLink frame without a signature on a link that demands one.
    MavUnsigned,
    /// MAVLink frame whose signature does not fit the key.
    MavBadSignature,
    /// Signed frame whose timestamp is not newer than the last one of its stream.
    MavReplayed,
    /// Signed frame that begins a stream more than a minute behind our time.
    MavStaleTime,
    /// `SETUP_SIGNING` from somebody who may not give us a key.
    SigningSetup,
    /// Request of a system that may look and not command.
    NotPermitted,
    /// Read or frame beyond what its link may bring in.
    RateLimited,
    /// Words for people that a client or the board caused too often.
    TextLimited,
    /// Queue of the watch page was full.
    WatchQueueFull,
    /// Line for people on standard error that nobody read.
    OutputLineLost,
    /// Sample of a sensor of which the board has several, and another one is flown on.
    OtherInstance,
    /// Frame for others that was passed on within the last second: it goes in a circle.
    MavAgain,
    /// Recording has stopped: no room on the disk, or it cannot be written.
    RecordingStopped,
    /// Bytes that the tag says before its first frame: the text of its start.
    TagStartByte,
    /// MAVLink frame of a board that has not said yet, by its heartbeat, that it is one.
    MavBeforeHeartbeat,
}

impl DropReason {
    /// All reasons, in the order of their numbers.
    pub const ALL: [DropReason; 44] = [
        DropReason::TagGarbageByte,
        DropReason::TagBadLength,
        DropReason::TagUnknownType,
        DropReason::TagBadPayload,
        DropReason::TagBadSource,
        DropReason::UwbUnknownAnchor,
        DropReason::UwbNoPair,
        DropReason::UwbClockUnsettled,
        DropReason::UwbClockJump,
        DropReason::UwbDuplicate,
        DropReason::UwbImpossible,
        DropReason::UwbGated,
        DropReason::UwbTooOld,
        DropReason::MavGarbageByte,
        DropReason::MavBadChecksum,
        DropReason::MavUnknownId,
        DropReason::MavUndecodable,
        DropReason::MavIncompatible,
        DropReason::MavSequenceGap,
        DropReason::MavWrongPeer,
        DropReason::MavIgnored,
        DropReason::BadValue,
        DropReason::ImuOutOfOrder,
        DropReason::MagDisturbed,
        DropReason::InputQueueFull,
        DropReason::OutputQueueFull,
        DropReason::RecorderQueueFull,
        DropReason::LinkWriteFailed,
        DropReason::StationsFull,
        DropReason::MavUnsigned,
        DropReason::MavBadSignature,
        DropReason::MavReplayed,
        DropReason::MavStaleTime,
        DropReason::SigningSetup,
        DropReason::NotPermitted,
        DropReason::RateLimited,
        DropReason::TextLimited,
        DropReason::WatchQueueFull,
        DropReason::OutputLineLost,
        DropReason::OtherInstance,
        DropReason::MavAgain,
        DropReason::RecordingStopped,
        DropReason::TagStartByte,
        DropReason::MavBeforeHeartbeat,
    ];

    /// Whether every healthy flight has some, at its start: nothing is lost by it.
    pub fn is_usual(self) -> bool {
        use DropReason as D;
        matches!(self, D::TagStartByte | D::UwbClockUnsettled | D::MavBeforeHeartbeat)
    }

    /// The reason of a [`name`](Self::name).
    pub fn named(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|reason| reason.name() == name)
    }

    /// How many, for people: what is usual is not called lost. `place` is the link.
    pub fn in_words(name: &str, count: u64, place: &str) -> String {
        match Self::named(name).is_some_and(Self::is_usual) {
            true => format!("unused on {place}, as at every start: {name} {count}"),
            false => format!("lost on {place}: {name} {count}"),
        }
    }

    /// Name in logs, reports and messages.
    pub fn name(self) -> &'static str {
        match self {
            DropReason::TagGarbageByte => "tag_garbage_byte",
            DropReason::TagBadLength => "tag_bad_length",
            DropReason::TagUnknownType => "tag_unknown_type",
            DropReason::TagBadPayload => "tag_bad_payload",
            DropReason::TagBadSource => "tag_bad_source",
            DropReason::UwbUnknownAnchor => "uwb_unknown_anchor",
            DropReason::UwbNoPair => "uwb_no_pair",
            DropReason::UwbClockUnsettled => "uwb_clock_unsettled",
            DropReason::UwbClockJump => "uwb_clock_jump",
            DropReason::UwbDuplicate => "uwb_duplicate",
            DropReason::UwbImpossible => "uwb_impossible",
            DropReason::UwbGated => "uwb_gated",
            DropReason::UwbTooOld => "uwb_too_old",
            DropReason::MavGarbageByte => "mav_garbage_byte",
            DropReason::MavBadChecksum => "mav_bad_checksum",
            DropReason::MavUnknownId => "mav_unknown_id",
            DropReason::MavUndecodable => "mav_undecodable",
            DropReason::MavIncompatible => "mav_incompatible",
            DropReason::MavSequenceGap => "mav_sequence_gap",
            DropReason::MavWrongPeer => "mav_wrong_peer",
            DropReason::MavIgnored => "mav_ignored",
            DropReason::BadValue => "bad_value",
            DropReason::ImuOutOfOrder => "imu_out_of_order",
            DropReason::OtherInstance => "other_instance",
            DropReason::MagDisturbed => "mag_disturbed",
            DropReason::InputQueueFull => "input_queue_full",
            DropReason::OutputQueueFull => "output_queue_full",
            DropReason::RecorderQueueFull => "recorder_queue_full",
            DropReason::RecordingStopped => "recording_stopped",
            DropReason::TagStartByte => "tag_start_byte",
            DropReason::MavBeforeHeartbeat => "mav_before_heartbeat",
            DropReason::LinkWriteFailed => "link_write_failed",
            DropReason::StationsFull => "stations_full",
            DropReason::MavUnsigned => "mav_unsigned",
            DropReason::MavBadSignature => "mav_bad_signature",
            DropReason::MavReplayed => "mav_replayed",
            DropReason::MavStaleTime => "mav_stale_time",
            DropReason::SigningSetup => "signing_setup",
            DropReason::NotPermitted => "not_permitted",
            DropReason::RateLimited => "rate_limited",
            DropReason::TextLimited => "text_limited",
            DropReason::WatchQueueFull => "watch_queue_full",
            DropReason::OutputLineLost => "output_line_lost",
            DropReason::MavAgain => "mav_again",
        }
    }
}

/// One counter per reason.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Drops {
    counts: [u64; DropReason::ALL.len()],
}

impl Default for Drops {
    fn default() -> Self {
        Self { counts: [0; DropReason::ALL.len()] }
    }
}

impl Drops {
    /// Counts `n` losses.
    pub fn add(&mut self, reason: DropReason, n: u64) {
        let slot = &mut self.counts[reason as usize];
        *slot = slot.saturating_add(n);
    }

    /// Losses for this reason so far.
    pub fn count(&self, reason: DropReason) -> u64 {
        self.counts[reason as usize]
    }

    /// Reasons that occurred.
    pub fn iter(&self) -> impl Iterator<Item = (DropReason, u64)> + '_ {
        DropReason::ALL.into_iter().map(|r| (r, self.count(r))).filter(|(_, n)| *n > 0)
    }

    /// Takes the losses of another counter in.
    pub fn merge(&mut self, other: &Drops) {
        for (reason, n) in other.iter() {
            self.add(reason, n);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prop_numbers_match_the_list() {
        for (i, reason) in DropReason::ALL.into_iter().enumerate() {
            assert_eq!(reason as usize, i);
            assert_eq!(DropReason::named(reason.name()), Some(reason));
        }
    }

    #[test]
    fn prop_what_is_usual_is_not_called_lost() {
        let words = |name| DropReason::in_words(name, 201, "tag");
        assert_eq!(words("tag_start_byte"), "unused on tag, as at every start: tag_start_byte 201");
        assert_eq!(words("tag_garbage_byte"), "lost on tag: tag_garbage_byte 201");
        assert_eq!(words("of_a_later_build"), "lost on tag: of_a_later_build 201");
    }
}
