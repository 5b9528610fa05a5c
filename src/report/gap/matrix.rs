//! The gap matrix as a drawing: channels by regime and time, anchors in a row of their own.
//!
//! Sign by hue and by the sign of the number, size by strength of the colour and by the number, not
//! visited by hatching: nothing hangs on red against green.

use std::fmt::Write as _;

use crate::report::svg::escape;
use haltere_gap::flight::cells::{Part, REGIMES, WINDOWS};
use haltere_gap::picture::matrix::{Matrix, Square};

/// Width and height of a cell, of the row labels, of the column labels, pixels.
const CELL_PX: [f64; 2] = [35.0, 24.0];
const LABEL_PX: f64 = 118.0;
const HEAD_PX: f64 = 128.0;
/// Gap between groups of columns.
const GAP_PX: f64 = 10.0;
/// Sigma at full strength of the colour.
const FULL: f64 = 10.0;
/// Sigma below which a number is not coloured: two of three null cells lie below one.
const QUIET: f64 = 2.0;

/// Style of this and the other drawings of the gap report.
pub(super) const STYLE: &str = "\
.cell{stroke:var(--rule);stroke-width:1}.plus{fill:#d55e00}.minus{fill:#0072b2}\
.num{font-size:10px;fill:var(--ink);text-anchor:middle}.own{paint-order:stroke;stroke:var(--bg);stroke-width:3px;font-weight:700}.fdr{fill:var(--ink)}\
.head{font-size:10.5px;fill:var(--soft)}.group{font-size:11px;font-weight:600;fill:var(--ink)}\
.node{fill:var(--bg);stroke:var(--ink);stroke-width:1.5}.bad.node{stroke-width:4}\
.path.plus{stroke:#d55e00}.path.minus{stroke:#0072b2}.arrow{stroke:var(--ink);stroke-width:1.6;fill:none}\
.legend{display:flex;gap:16px;flex-wrap:wrap;color:var(--soft);font-size:12.5px;align-items:center}";

/// Hatching of what was not visited. Its id may stand on a page once.
pub(super) const HATCH: &str = "<svg width=\"0\" height=\"0\" style=\"position:absolute;width:0\"><defs>\
<pattern id=\"hatch\" width=\"6\" height=\"6\" patternUnits=\"userSpaceOnUse\" patternTransform=\"rotate(45)\">\
<rect width=\"6\" height=\"6\" fill=\"#8882\"/><line x1=\"0\" x2=\"0\" y1=\"0\" y2=\"6\" stroke=\"#8889\" stroke-width=\"1.6\"/>\
</pattern></defs></svg>";

/// Columns in their groups.
fn columns() -> Vec<(String, &'static str, Part)> {
    let mut order = ["height", "speed", "yaw", "supply", "place"];
    order.sort_by_key(|kind| REGIMES.iter().position(|r| r.kind() == *kind));
    let mut out = Vec::new();
    for kind in order {
        for regime in REGIMES.into_iter().filter(|r| r.kind() == kind) {
            out.push((words(&format!("{regime:?}")), kind, Part::Regime(regime)));
        }
    }
    for w in 0..WINDOWS {
        let name = format!("{} of {WINDOWS}", w + 1);
        out.push((name, "time", Part::Window(w as u8)));
    }
    out
}

/// `NearCeiling` to "near ceiling".
pub(super) fn words(name: &str) -> String {
    let mut out = String::new();
    for c in name.chars() {
        if c.is_uppercase() && !out.is_empty() {
            out.push(' ');
        }
        out.extend(c.to_lowercase());
    }
    out
}

/// The drawing, with its note.
pub(super) fn draw(m: &Matrix) -> String {
    let columns = columns();
    let mut channels: Vec<&str> = Vec::new();
    for s in &m.squares {
        if !channels.contains(&s.channel.as_str()) {
            channels.push(&s.channel);
        }
    }
    let [w, h] = CELL_PX;
    let mut x = LABEL_PX;
    let mut places = Vec::new();
    let mut svg = String::new();
    let mut last = "";
    for (name, kind, _) in &columns {
        if *kind != last {
            if !last.is_empty() {
                x += GAP_PX;
            }
            let _ = write!(svg, "<text class=\"group\" x=\"{x:.0}\" y=\"12\">{kind}</text>");
            last = kind;
        }
        places.push(x);
        let (tx, ty) = (x + 0.6 * w, HEAD_PX - 6.0);
        let _ = write!(
            svg,
            "<text class=\"head\" transform=\"translate({tx:.0} {ty:.0}) rotate(-60)\">{}</text>",
            escape(name)
        );
        x += w;
    }
    let width = x + 4.0;
    let mut y = HEAD_PX;
    for channel in &channels {
        let _ = write!(
            svg,
            "<text class=\"head\" x=\"{:.0}\" y=\"{:.0}\" text-anchor=\"end\">{}</text>",
            LABEL_PX - 6.0,
            y + 16.0,
            escape(&words(channel))
        );
        for ((name, _, part), x) in columns.iter().zip(&places) {
            let own = m.squares.iter().find(|s| s.channel == *channel && s.part == *part);
            cell(&mut svg, *x, y, own, &format!("{channel}, {name}"));
        }
        y += h;
    }
    // Anchors have a row, and one channel.
    let anchors: Vec<(u8, &Square)> = m
        .squares
        .iter()
        .filter_map(|s| match s.part {
            Part::Anchor(id) => Some((id.0, s)),
            _ => None,
        })
        .collect();
    if !anchors.is_empty() {
        y += 2.0 * GAP_PX + 8.0;
        let _ = write!(
            svg,
            "<text class=\"head\" x=\"{:.0}\" y=\"{:.0}\" text-anchor=\"end\">uwb by anchor</text>",
            LABEL_PX - 6.0,
            y + 16.0
        );
        for (k, (id, square)) in anchors.iter().enumerate() {
            let x = LABEL_PX + k as f64 * w;
            let _ = write!(
                svg,
                "<text class=\"head\" x=\"{:.0}\" y=\"{:.0}\" text-anchor=\"middle\">{id}</text>",
                x + 0.5 * w,
                y - 4.0
            );
            cell(&mut svg, x, y, Some(square), &format!("anchor {id}"));
        }
        y += h;
    }
    let height = y + 6.0;
    format!(
        "<figure class=\"wide\"><svg viewBox=\"0 0 {width:.0} {height:.0}\" role=\"img\" aria-label=\"gap matrix\">{svg}</svg></figure>{}",
        note(m)
    )
}

fn note(m: &Matrix) -> String {
    let against = match m.references {
        0 => format!("{} simulated healthy flights", m.nulls),
        n => format!("{} simulated healthy flights and {n} accepted ones", m.nulls),
    };
    format!(
        "<p class=\"note\">Each number says by how many sigma a residual of this flight lies above (+, orange) or below \
         (−, blue) that of {against}: the stronger the colour the farther, up to {FULL:.0} sigma; none below {QUIET:.0}. \
         Hatched: this flight was not there, or too few of those were. A dot marks what stands out: of all dots at \
         most {:.0} % are chance, over {} cells. Under the pointer a cell shows its residual with unit and limit.</p>",
        100.0 * m.q,
        m.tested
    )
}

fn cell(svg: &mut String, x: f64, y: f64, square: Option<&Square>, name: &str) {
    let [w, h] = CELL_PX;
    let title = match square {
        Some(Square {
            mean: Some(mean),
            expected: Some(e),
            limit: Some(l),
            unit,
            t: Some(t),
            ..
        }) => {
            format!("{name}: {mean:.4} {unit}, expected {e:.4} ± {l:.4}; {t:+.1} sigma")
        }
        Some(Square { mean: Some(mean), unit, .. }) => {
            format!("{name}: {mean:.4} {unit}, not visited by enough null flights")
        }
        _ => format!("{name}: not visited"),
    };
    let _ = write!(svg, "<g><title>{}</title>", escape(&title));
    let rect = format!("x=\"{x:.0}\" y=\"{y:.0}\" width=\"{w}\" height=\"{h}\"");
    match square.and_then(|s| s.t.map(|t| (t, s.significant))) {
        None => {
            let _ = write!(svg, "<rect class=\"cell\" {rect} fill=\"url(#hatch)\"/>");
        }
        Some((t, significant)) => {
            let strength = ((t.abs() - QUIET) / (FULL - QUIET)).clamp(0.0, 1.0);
            let class = sign(t);
            let opacity = if t.abs() < QUIET { 0.0 } else { 0.12 + 0.68 * strength };
            let _ = write!(
                svg,
                "<rect class=\"cell {class}\" {rect} fill-opacity=\"{opacity:.2}\"/>\
                 <text class=\"num\" x=\"{:.1}\" y=\"{:.1}\">{}</text>",
                x + 0.5 * w - 2.0,
                y + 16.0,
                number(t)
            );
            if significant {
                let _ = write!(
                    svg,
                    "<circle class=\"fdr\" cx=\"{:.1}\" cy=\"{:.1}\" r=\"2.6\"/>",
                    x + w - 5.0,
                    y + 6.0
                );
            }
        }
    }
    svg.push_str("</g>");
}

/// Class of a sign: its colour, on every picture.
pub(super) fn sign(t: f64) -> &'static str {
    if t > 0.0 { "plus" } else { "minus" }
}

/// Short, with a sign that is as wide as the plus.
fn number(t: f64) -> String {
    let text =
        if t.abs() < 9.95 { format!("{t:+.1}") } else { format!("{:+.0}", t.clamp(-999.0, 999.0)) };
    text.replace('-', "\u{2212}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prop_every_regime_has_a_column_and_unknown_is_hatched() {
        assert_eq!(columns().len(), REGIMES.len() + WINDOWS);
        assert_eq!(words("NearCeiling"), "near ceiling");
        let mut svg = String::new();
        cell(&mut svg, 0.0, 0.0, None, "a<b");
        assert!(svg.contains("url(#hatch)") && svg.contains("a&lt;b: not visited"), "{svg}");
    }
}
