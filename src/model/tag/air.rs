//! One UWB packet in the air: paths from its sender to the tag and to the other anchors.

use nalgebra::Vector3;

/// Most anchors a plant can hold.
pub const MAX_ANCHORS: usize = 16;

/// Path from the sender to another anchor.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Hop {
    /// Added to the straight path, m.
    pub extra_m: f64,
    /// Not heard there.
    pub lost: bool,
}

/// A packet in the air. Anchors go by index, ascending id.
#[derive(Debug, Clone)]
pub struct Packet {
    /// Anchor that sends.
    pub from: usize,
    /// Where it stands, Earth frame, m.
    pub from_E_m: Vector3<f64>,
    /// Tag antenna, Earth frame, m.
    pub tag_E_m: Vector3<f64>,
    /// Straight path to the tag, m.
    pub tag_range_m: f64,
    /// Added to it, m.
    pub tag_extra_m: f64,
    /// Not heard by the tag.
    pub tag_lost: bool,
    hops: [Hop; MAX_ANCHORS],
    anchors: usize,
}

impl Packet {
    /// Straight paths, nothing lost.
    pub fn new(from: usize, sites_E_m: &[Vector3<f64>], tag_E_m: Vector3<f64>) -> Self {
        let from_E_m = sites_E_m.get(from).copied().unwrap_or_default();
        Self {
            from,
            from_E_m,
            tag_E_m,
            tag_range_m: (tag_E_m - from_E_m).norm(),
            tag_extra_m: 0.0,
            tag_lost: false,
            hops: [Hop::default(); MAX_ANCHORS],
            anchors: sites_E_m.len().min(MAX_ANCHORS),
        }
    }

    /// Paths to all anchors; the sender's own entry means nothing.
    #[inline]
    pub fn anchor_hops(&mut self) -> &mut [Hop] {
        &mut self.hops[..self.anchors]
    }
}
