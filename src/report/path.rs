//! Lines as SVG path data: few points, and few characters a point.
//!
//! Points are written relative to the one before, in tenths of a pixel; errors do not add up because
//! the difference is taken between rounded places.

use std::fmt::Write as _;

/// Finer than a pixel, so that a page that is zoomed in still shows what was there.
const COLUMNS_PER_PX: f64 = 3.0;
/// Farthest place, tenths of a pixel: far outside of every drawing.
const FARTHEST: f64 = 1e12;
/// Points of a map closer together than this are merged, pixels.
const MERGE_PX: f64 = 0.6;

/// Writes path data.
#[derive(Debug, Default)]
pub(super) struct Pen {
    data: String,
    at: Option<[i64; 2]>,
    /// Whether the last command was `l`, whose letter need not be repeated.
    lining: bool,
}

impl Pen {
    /// Goes there without drawing.
    pub(super) fn move_to(&mut self, p: [f64; 2]) {
        self.lining = false;
        self.step(p, "m");
    }

    /// Draws a line there.
    pub(super) fn line_to(&mut self, p: [f64; 2]) {
        let command = if self.lining { "" } else { "l" };
        self.lining = true;
        self.step(p, command);
    }

    /// Draws a dot there.
    pub(super) fn dot(&mut self, p: [f64; 2]) {
        self.move_to(p);
        self.data.push_str("h0");
    }

    pub(super) fn data(self) -> String {
        self.data
    }

    fn step(&mut self, p: [f64; 2], command: &str) {
        // Half of the range and less, so that the difference of two places fits: an axis of no length
        // puts points at infinity.
        let to = p.map(|v| (v * 10.0).round().clamp(-FARTHEST, FARTHEST) as i64);
        let [x, y] = self.at.unwrap_or_default();
        self.data.push_str(if self.at.is_none() { "M" } else { command });
        let (dx, dy) = (to[0] - x, to[1] - y);
        let bare = command.is_empty();
        if bare && dx >= 0 {
            self.data.push(' ');
        }
        tenths(&mut self.data, dx);
        if dy >= 0 {
            self.data.push(' ');
        }
        tenths(&mut self.data, dy);
        self.at = Some(to);
    }
}

/// A number of tenths in as few characters as SVG allows: 0, .3, -.3, 12, 12.5.
fn tenths(out: &mut String, value: i64) {
    let (sign, size) = (if value < 0 { "-" } else { "" }, value.unsigned_abs());
    let _ = match (size / 10, size % 10) {
        (0, 0) => write!(out, "0"),
        (0, tenth) => write!(out, "{sign}.{tenth}"),
        (whole, 0) => write!(out, "{sign}{whole}"),
        (whole, tenth) => write!(out, "{sign}{whole}.{tenth}"),
    };
}

fn column_of(x_px: f64) -> f64 {
    (x_px * COLUMNS_PER_PX).floor()
}

/// First, least, greatest and last point of every column of which a pixel has [`COLUMNS_PER_PX`].
pub(super) fn columns(points: impl Iterator<Item = [f64; 2]>) -> Vec<[f64; 2]> {
    let mut out: Vec<[f64; 2]> = Vec::new();
    let mut column: Vec<[f64; 2]> = Vec::new();
    let mut flush = |column: &mut Vec<[f64; 2]>| {
        if column.len() <= 4 {
            out.append(column);
            return;
        }
        let by_y = |a: &usize, b: &usize| column[*a][1].total_cmp(&column[*b][1]);
        let mut keep = [
            0,
            (0..column.len()).min_by(by_y).unwrap_or(0),
            (0..column.len()).max_by(by_y).unwrap_or(0),
            column.len() - 1,
        ];
        keep.sort_unstable();
        let mut last = usize::MAX;
        for i in keep {
            if i != last {
                out.push(column[i]);
                last = i;
            }
        }
        column.clear();
    };
    for p in points {
        if column.first().is_some_and(|first| column_of(first[0]) != column_of(p[0])) {
            flush(&mut column);
        }
        column.push(p);
    }
    flush(&mut column);
    out
}

/// Points at least [`MERGE_PX`] apart, and the last one.
pub(super) fn merged(points: impl Iterator<Item = [f64; 2]>) -> Vec<[f64; 2]> {
    let mut out: Vec<[f64; 2]> = Vec::new();
    let mut skipped = None;
    for p in points {
        let near = out.last().is_some_and(|l| (l[0] - p[0]).hypot(l[1] - p[1]) < MERGE_PX);
        if near {
            skipped = Some(p);
        } else {
            out.push(p);
            skipped = None;
        }
    }
    out.extend(skipped);
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prop_path_data_is_short_and_does_not_drift() {
        let mut pen = Pen::default();
        pen.move_to([12.0, 3.0]);
        for i in 1..=3 {
            pen.line_to([12.0 + 0.34 * f64::from(i), 3.0 - 0.2 * f64::from(i)]);
        }
        pen.dot([0.0, 7.0]);
        // 12.34, 12.68, 13.02 round to 12.3, 12.7, 13.0.
        assert_eq!(pen.data(), "M12 3l.3-.2 .4-.2 .3-.2m-13 4.6h0");
    }

    /// An axis of no length: points at both infinities, whose difference has no number.
    #[test]
    fn regress_places_at_infinity_can_be_drawn() {
        let mut pen = Pen::default();
        pen.move_to([f64::NEG_INFINITY, f64::MAX]);
        pen.line_to([f64::INFINITY, f64::MIN]);
        pen.line_to([f64::NAN, 0.0]);
        let data = pen.data();
        assert!(data.starts_with("M-100000000000 100000000000l200000000000-2"), "{data}");
    }

    #[test]
    fn prop_reduction_keeps_spikes_and_ends() {
        let mut points: Vec<[f64; 2]> = (0..10_000).map(|i| [f64::from(i) * 0.01, 1.0]).collect();
        points[5_005] = [50.05, 99.0];
        let out = columns(points.iter().copied());
        assert!(out.len() < 1300, "{}", out.len());
        assert!(out.contains(&[50.05, 99.0]));
        assert_eq!((out[0], out[out.len() - 1]), (points[0], points[9_999]));
    }
}
