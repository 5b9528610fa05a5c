//! Rows of spans over time: what was in force when. Modes, limits that were touched, anchors heard.

use std::fmt::Write as _;

use super::svg::escape;
use super::ticks::ticks;

/// How a span or a mark is shown: classes of `page.css`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Kind {
    /// As it should be, or nothing going on.
    Quiet,
    /// One of a family of equals: 0 to 5.
    Family(u8),
    /// Worth a look.
    Warn,
    /// Wrong.
    Bad,
}

impl Kind {
    fn class(self) -> String {
        match self {
            Kind::Quiet => "kq".into(),
            Kind::Family(n) => format!("k{}", n % 6),
            Kind::Warn => "kw".into(),
            Kind::Bad => "kb".into(),
        }
    }
}

/// One span of a row.
pub(super) struct Stretch {
    /// Begin and end, s.
    pub x: [f64; 2],
    /// How it is shown.
    pub kind: Kind,
    /// Strength of its colour, 0 to 1.
    pub strength: f64,
    /// Written on it when there is room; empty: nothing.
    pub name: String,
    /// Shown when the pointer rests on it.
    pub hint: String,
}

/// One row.
#[derive(Default)]
pub(super) struct Lane {
    /// Written on its left.
    pub name: String,
    /// What fills it.
    pub stretches: Vec<Stretch>,
    /// Moments: when, how shown, what is said when the pointer rests on it.
    pub marks: Vec<(f64, Kind, String)>,
}

const WIDTH_PX: f64 = 1100.0;
const LEFT_PX: f64 = 92.0;
const RIGHT_PX: f64 = 12.0;
const TOP_PX: f64 = 24.0;
const BOTTOM_PX: f64 = 34.0;
const TICK_X_PX: f64 = 70.0;
/// Width of a character of the small font, pixels.
const CHAR_PX: f64 = 6.1;

/// Draws rows of `row_px` pixels over `x` seconds; nothing without a row.
pub(super) fn render(title: &str, lanes: &[Lane], x: [f64; 2], row_px: f64) -> String {
    if lanes.is_empty() {
        return String::new();
    }
    let [low, high] = [x[0], x[1].max(x[0] + 1e-3)];
    let (left, right) = (LEFT_PX, WIDTH_PX - RIGHT_PX);
    let bottom = TOP_PX + row_px * lanes.len() as f64;
    let height = bottom + BOTTOM_PX;
    let px = |s: f64| left + (s.clamp(low, high) - low) / (high - low) * (right - left);
    let t = escape(title);
    let mut svg = String::new();
    let _ = write!(
        svg,
        "<figure class=\"wide\"><svg class=\"plot\" viewBox=\"0 0 {WIDTH_PX} {height}\" role=\"img\" \
         aria-label=\"{t}\" data-box=\"{left},{TOP_PX},{},{}\" data-x=\"{low},{high}\" data-y=\"0,1\" \
         data-time><text class=\"title\" x=\"0\" y=\"14\">{t}</text><g class=\"gx\">",
        right - left,
        bottom - TOP_PX
    );
    for (at, label) in ticks(low, high, (right - left) / TICK_X_PX) {
        let _ = write!(
            svg,
            "<line class=\"grid\" x1=\"{0:.1}\" x2=\"{0:.1}\" y1=\"{TOP_PX}\" y2=\"{bottom}\"/>\
             <text class=\"tick mid\" x=\"{0:.1}\" y=\"{1}\">{label}</text>",
            px(at),
            bottom + 14.0
        );
    }
    svg.push_str("</g>");
    for (i, lane) in lanes.iter().enumerate() {
        let top = TOP_PX + row_px * i as f64;
        let middle = top + row_px / 2.0 + 3.5;
        let _ = write!(
            svg,
            "<text class=\"tick end\" x=\"{}\" y=\"{middle:.1}\">{}</text>",
            left - 6.0,
            escape(&lane.name)
        );
        for stretch in lane.stretches.iter().filter(|s| s.x[1] > low && s.x[0] < high) {
            draw(&mut svg, stretch, [px(stretch.x[0]), px(stretch.x[1])], top, row_px);
        }
        for (at, kind, hint) in lane.marks.iter().filter(|m| m.0 >= low && m.0 <= high) {
            let _ = write!(
                svg,
                "<g data-at=\"{0:.1}\"><title>{1}</title><rect class=\"{2}\" x=\"{3:.1}\" \
                 y=\"{4:.1}\" width=\"4\" height=\"{5:.1}\"/></g>",
                px(*at),
                escape(hint),
                kind.class(),
                px(*at) - 2.0,
                top + 2.0,
                row_px - 4.0
            );
        }
    }
    let _ = write!(
        svg,
        "<path class=\"axis\" d=\"M{left} {TOP_PX}V{bottom}H{right}\"/>\
         <text class=\"tick mid\" x=\"{}\" y=\"{}\">time, s</text><g class=\"hover\"></g></svg></figure>",
        (left + right) / 2.0,
        bottom + 29.0
    );
    svg
}

fn draw(svg: &mut String, stretch: &Stretch, [a, b]: [f64; 2], top: f64, row_px: f64) {
    let _ = write!(
        svg,
        "<g data-span=\"{a:.1},{b:.1}\">{}<rect class=\"{}\" x=\"{a:.1}\" y=\"{:.1}\" width=\"{:.1}\" \
         height=\"{:.1}\" fill-opacity=\"{:.2}\"/>",
        if stretch.hint.is_empty() {
            String::new()
        } else {
            format!("<title>{}</title>", escape(&stretch.hint))
        },
        stretch.kind.class(),
        top + 1.0,
        // What lasted for a moment is to be seen too.
        (b - a).max(1.0),
        row_px - 2.0,
        stretch.strength.clamp(0.0, 1.0)
    );
    if !stretch.name.is_empty() {
        let width = CHAR_PX * stretch.name.chars().count() as f64 + 4.0;
        let _ = write!(
            svg,
            "<text class=\"lane mid\" data-width=\"{width:.0}\" x=\"{:.1}\" y=\"{:.1}\"{}>{}</text>",
            (a + b) / 2.0,
            top + row_px / 2.0 + 3.5,
            if b - a < width { " visibility=\"hidden\"" } else { "" },
            escape(&stretch.name)
        );
    }
    svg.push_str("</g>");
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prop_moments_are_seen_and_names_are_escaped() {
        let lane = Lane {
            name: "a<b".into(),
            stretches: vec![Stretch {
                x: [1.0, 1.000001],
                kind: Kind::Bad,
                strength: 2.0,
                name: "x<y".into(),
                hint: "why & how".into(),
            }],
            marks: vec![(99.0, Kind::Warn, "outside".into())],
        };
        let svg = render("t", &[lane], [0.0, 10.0], 16.0);
        assert!(svg.contains("a&lt;b") && svg.contains("x&lt;y") && svg.contains("why &amp; how"));
        assert!(svg.contains("width=\"1.0\"") && !svg.contains("outside"), "{svg}");
        assert!(render("t", &[], [0.0, 1.0], 16.0).is_empty());
        assert!(!render("t", &[Lane::default()], [3.0, 3.0], 16.0).contains("NaN"));
    }
}
