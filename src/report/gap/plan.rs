//! Floor plan with anchors, the strip of time, and the signature.

use std::fmt::Write as _;

use super::matrix::{sign, words};
use crate::report::svg::{Mark, Pin, Plot, Series, Span, Tone, escape};
use haltere_gap::picture::onset::Onset;
use haltere_gap::picture::{FloorPlan, Node, Picture, Signature, Strip};

/// Longer side of the room, and the border around it, pixels.
const ROOM_PX: f64 = 380.0;
const BORDER_PX: f64 = 62.0;
/// Length of an arrow, pixels per m/s².
const ARROW_PX: f64 = 60.0;
/// Longest arrow.
const LONGEST_PX: f64 = 70.0;
/// Sigma from which anchors and paths are drawn as loud.
const LOUD: f64 = 3.0;
/// Paths that are drawn.
const PATHS: usize = 6;
/// Sigma at full strength of the colour.
const FULL: f64 = 10.0;

/// Name of simulated flights with the effects that the verdict names.
const WITH_NAMED: &str = "simulated with what was named";

/// The plan with its note.
pub(super) fn plan(p: &FloorPlan) -> String {
    let (ns, ew) = (p.north_m[1] - p.north_m[0], p.east_m[1] - p.east_m[0]);
    let scale = ROOM_PX / ns.max(ew).max(0.1);
    let (w, h) = (ew * scale + 2.0 * BORDER_PX, ns * scale + 2.0 * BORDER_PX);
    let x = |east: f64| BORDER_PX + (east - p.east_m[0]) * scale;
    let y = |north: f64| BORDER_PX + (p.north_m[1] - north) * scale;
    let mut svg = String::new();
    for place in &p.places {
        let [x0, x1, y0, y1] =
            [x(place.east_m[0]), x(place.east_m[1]), y(place.north_m[1]), y(place.north_m[0])];
        let rect = format!(
            "x=\"{x0:.1}\" y=\"{y0:.1}\" width=\"{:.1}\" height=\"{:.1}\"",
            x1 - x0,
            y1 - y0
        );
        match place.uwb_t {
            None => {
                let _ = write!(
                    svg,
                    "<g><title>not visited</title><rect class=\"cell\" {rect} fill=\"url(#hatch)\"/></g>"
                );
            }
            Some(t) => {
                let opacity =
                    if t.abs() < 2.0 { 0.0 } else { 0.1 + 0.6 * (t.abs() / FULL).min(1.0) };
                let _ = write!(
                    svg,
                    "<g><title>UWB residual {t:+.1} sigma</title><rect class=\"cell {}\" {rect} \
                     fill-opacity=\"{opacity:.2}\"/><text class=\"num\" x=\"{:.1}\" y=\"{:.1}\">{t:+.1}{}</text></g>",
                    sign(t),
                    0.5 * (x0 + x1),
                    y1 - 6.0,
                    if place.significant { " ●" } else { "" }
                );
            }
        }
        if let (Some([north, east]), Some(t)) = (place.force_NE_mps2, place.force_t) {
            let length = north.hypot(east);
            if length > 0.0 && t >= 2.0 {
                let px = (ARROW_PX * length).min(LONGEST_PX) / length;
                arrow(
                    &mut svg,
                    [0.5 * (x0 + x1), 0.5 * (y0 + y1)],
                    [east * px, -north * px],
                    &format!("force {length:.2} m/s², {t:.1} sigma"),
                );
            }
        }
    }
    let _ = write!(
        svg,
        "<rect x=\"{BORDER_PX}\" y=\"{BORDER_PX}\" width=\"{:.1}\" height=\"{:.1}\" class=\"axis\"/>",
        ew * scale,
        ns * scale
    );
    paths(&mut svg, p, &x, &y);
    // Names after all marks: none lies under a neighbour.
    for draw in [anchor, name] {
        for node in &p.anchors {
            draw(&mut svg, p, node, spot(p, node, &x, &y));
        }
    }
    let _ = write!(
        svg,
        "<text class=\"head\" x=\"{:.0}\" y=\"14\" text-anchor=\"middle\">north {:.1} m</text>\
         <text class=\"head\" x=\"{:.0}\" y=\"{:.0}\" text-anchor=\"middle\">{:.1} m from west to east</text>",
        0.5 * w,
        p.north_m[1],
        0.5 * w,
        h - 6.0,
        ew
    );
    format!(
        "<figure style=\"max-width:{w:.0}px\"><svg viewBox=\"0 0 {w:.0} {h:.0}\" role=\"img\" \
         aria-label=\"floor plan\">{svg}</svg></figure><p class=\"note\">From above. Squares: by how many sigma UWB is \
         off at that place, coloured as above; hatched: not visited. Anchors: a circle hangs high, a square stands \
         low; a heavy one measures too long (+) or too short by what stands beside it, from {LOUD} sigma. Lines: only \
         between these two anchors something is off. Arrows: a push that healthy flights do not feel, {ARROW_PX:.0} px for \
         1 m/s².</p>"
    )
}

fn high(p: &FloorPlan, node: &Node) -> bool {
    let heights: Vec<f64> = p.anchors.iter().map(|a| a.position_m[2]).collect();
    let (low, top) =
        heights.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), v| (a.min(*v), b.max(*v)));
    node.position_m[2] > 0.5 * (low + top)
}

/// High anchors are drawn farther out than low ones: they often share a corner.
fn spot(p: &FloorPlan, node: &Node, x: &impl Fn(f64) -> f64, y: &impl Fn(f64) -> f64) -> [f64; 2] {
    let [north, east, _] = node.position_m;
    let out = if high(p, node) { 34.0 } else { 10.0 };
    let side = |v: f64, [low, high]: [f64; 2]| if v > 0.5 * (low + high) { 1.0 } else { -1.0 };
    [x(east) + out * side(east, p.east_m), y(north) - 0.5 * out * side(north, p.north_m)]
}

fn is_loud(node: &Node) -> bool {
    node.t.is_some_and(|t| t.abs() >= LOUD)
}

fn anchor(svg: &mut String, p: &FloorPlan, node: &Node, [x, y]: [f64; 2]) {
    let class = if is_loud(node) { "node bad" } else { "node" };
    let text = match (node.node_m, node.t) {
        (Some(m), Some(t)) => format!("anchor {}: {m:+.3} m, {t:+.1} sigma", node.id),
        _ => format!("anchor {}: not measured", node.id),
    };
    let mark = if high(p, node) {
        format!("<circle class=\"{class}\" cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"9\"/>")
    } else {
        let (a, b) = (x - 8.0, y - 8.0);
        format!("<rect class=\"{class}\" x=\"{a:.1}\" y=\"{b:.1}\" width=\"16\" height=\"16\"/>")
    };
    let _ = write!(
        svg,
        "<g><title>{}</title>{mark}<text class=\"num\" x=\"{x:.1}\" y=\"{:.1}\">{}</text></g>",
        escape(&text),
        y + 3.5,
        node.id
    );
}

/// What is said beside an anchor: outside of a high one, inside of a low one, which often share a corner.
fn name(svg: &mut String, p: &FloorPlan, node: &Node, [x, y]: [f64; 2]) {
    let label = match node.node_m {
        Some(m) if is_loud(node) => format!("{m:+.2} m"),
        Some(_) => return,
        None => "?".to_owned(),
    };
    let [north, east, _] = node.position_m;
    let is_north = north > 0.5 * (p.north_m[0] + p.north_m[1]);
    let is_east = east > 0.5 * (p.east_m[0] + p.east_m[1]);
    let (dx, dy, from) = match (high(p, node), is_north, is_east) {
        (true, true, _) => (0.0, -14.0, "middle"),
        (true, false, _) => (0.0, 22.0, "middle"),
        (false, _, true) => (-12.0, 3.5, "end"),
        (false, _, false) => (12.0, 3.5, "start"),
    };
    let _ = write!(
        svg,
        "<text class=\"num own\" style=\"text-anchor:{from}\" x=\"{:.1}\" y=\"{:.1}\">{label}</text>",
        x + dx,
        y + dy
    );
}

fn paths(svg: &mut String, p: &FloorPlan, x: &impl Fn(f64) -> f64, y: &impl Fn(f64) -> f64) {
    let mut loud: Vec<_> = p
        .paths
        .iter()
        .filter_map(|path| Some((path, path.t.filter(|t| t.abs() >= LOUD)?)))
        .collect();
    loud.sort_by(|a, b| b.1.abs().total_cmp(&a.1.abs()));
    for (path, t) in loud.into_iter().take(PATHS) {
        let end = |id: u8| p.anchors.iter().find(|a| a.id == id).map(|node| spot(p, node, x, y));
        let (Some(a), Some(b)) = (end(path.anchors[0]), end(path.anchors[1])) else { continue };
        let _ = write!(
            svg,
            "<g><title>path {} to {}: {:+.3} m, {t:+.1} sigma</title><line class=\"path {}\" x1=\"{:.1}\" y1=\"{:.1}\" \
             x2=\"{:.1}\" y2=\"{:.1}\" stroke-width=\"{:.1}\" stroke-opacity=\".55\"/></g>",
            path.anchors[0],
            path.anchors[1],
            path.loop_m,
            sign(t),
            a[0],
            a[1],
            b[0],
            b[1],
            (0.5 * t.abs()).clamp(1.5, 6.0)
        );
    }
}

fn arrow(svg: &mut String, [x, y]: [f64; 2], [dx, dy]: [f64; 2], title: &str) {
    let length = dx.hypot(dy).max(1e-9);
    let (ux, uy) = (dx / length, dy / length);
    let (tip_x, tip_y) = (x + dx, y + dy);
    let wing = |side: f64| {
        let (px, py) = (-uy * side, ux * side);
        format!("{:.1} {:.1}", tip_x - 6.0 * ux + 3.5 * px, tip_y - 6.0 * uy + 3.5 * py)
    };
    let _ = write!(
        svg,
        "<g><title>{}</title><path class=\"arrow\" d=\"M{x:.1} {y:.1}L{tip_x:.1} {tip_y:.1}M{}L{tip_x:.1} {tip_y:.1}L{}\"/></g>",
        escape(title),
        wing(1.0),
        wing(-1.0)
    );
}

/// The strongest residual over time, with the onset.
pub(super) fn strip(p: &Picture) -> String {
    let Some(s) = &p.strip else { return String::new() };
    let Strip { label, real, band, fitted } = s;
    let label = with_unit(label);
    let line = |values: &mut dyn Iterator<Item = Option<f64>>| -> Vec<[f64; 2]> {
        values.enumerate().map(|(t, v)| [t as f64, v.unwrap_or(f64::NAN)]).collect()
    };
    let series = |name: &str, tone, mark, points| Series { name: name.into(), tone, mark, points };
    let mut all = vec![
        series(
            "95 of 100 healthy flights",
            Tone::Family(5),
            Mark::Dashed,
            line(&mut band.iter().map(|b| b.map(|b| b[0]))),
        ),
        series("", Tone::Family(5), Mark::Dashed, line(&mut band.iter().map(|b| b.map(|b| b[1])))),
    ];
    if fitted.iter().any(Option::is_some) {
        all.push(series(WITH_NAMED, Tone::Estimate, Mark::Line, line(&mut fitted.iter().copied())));
    }
    all.push(series("this flight", Tone::Truth, Mark::Line, line(&mut real.iter().copied())));
    let plot = Plot {
        title: format!("The residual that stands out most, over time: {label}"),
        x_label: "time since the first thrust, s".into(),
        y_label: label,
        series: all,
        spans: onset_span(&p.onset, real.len()),
        pins: Vec::<Pin>::new(),
        size_px: [1060.0, 240.0],
        ..Plot::default()
    };
    format!(
        "<div class=\"wide\">{}</div><p class=\"note\">It began: {}{}. Told by the residuals {}.</p>",
        plot.render(),
        escape(&p.onset.words()),
        if p.onset.at_s.is_some() { "; shaded after that" } else { "" },
        escape(&p.onset.lines.iter().map(|line| words(line)).collect::<Vec<_>>().join(", "))
    )
}

/// `AttitudePitch, rad` to "attitude pitch, rad".
fn with_unit(label: &str) -> String {
    match label.split_once(", ") {
        Some((name, unit)) => format!("{}, {unit}", words(name)),
        None => words(label),
    }
}

fn onset_span(onset: &Onset, length: usize) -> Vec<Span> {
    let Some(at) = onset.at_s else { return Vec::new() };
    vec![Span { name: "gap".into(), x: [at, length as f64] }]
}

/// Residual over what it depends on.
pub(super) fn signature(s: &Signature) -> String {
    let series = |name: &str, tone, mark, points: &[[f64; 2]]| Series {
        name: name.into(),
        tone,
        mark,
        points: points.to_vec(),
    };
    let mut all = vec![
        series("this flight", Tone::Truth, Mark::Dots, &s.real),
        series("healthy", Tone::Command, Mark::Dashed, &s.nominal),
    ];
    if !s.fitted.is_empty() {
        all.push(series(WITH_NAMED, Tone::Estimate, Mark::Line, &s.fitted));
    }
    let plot = Plot {
        title: String::new(),
        x_label: s.regressor.into(),
        y_label: with_unit(&s.label),
        series: all,
        size_px: [520.0, 300.0],
        ..Plot::default()
    };
    format!(
        "{}<p class=\"note\">One dot for each second: the residual beside what it goes with most. Correlation on this \
         flight {:+.2}: 0 none, 1 a line.</p>",
        plot.render(),
        s.correlation
    )
}
