//! Small plots as inline SVG: axes with round ticks, lines, dots, bands, shaded spans.
//!
//! Colours are CSS classes of the page (`report/page.css`), so one drawing serves light, dark and
//! paper. A line that has far more points than pixels is reduced to the least and the greatest value of
//! each column: spikes stay visible. What `page.js` needs to zoom and to show values under the pointer
//! stands in `data-` attributes.

use std::fmt::Write as _;

use super::path::{Pen, columns, merged};
use super::ticks::{decades, ticks};

/// Colour of a series. Hues of Okabe and Ito (2008), told apart by colour-blind eyes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Tone {
    /// What really was.
    Truth,
    /// What the filter believed.
    Estimate,
    /// What was asked for.
    Command,
    /// One of a family of equals: 0 to 5.
    Family(u8),
}

impl Tone {
    fn class(self) -> String {
        match self {
            Tone::Truth => "t".into(),
            Tone::Estimate => "e".into(),
            Tone::Command => "c".into(),
            Tone::Family(n) => format!("f{}", n % 6),
        }
    }
}

/// How a series is drawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Mark {
    /// Solid line.
    Line,
    /// Dashed line, for what is asked rather than measured.
    Dashed,
    /// Dashed line that may leave the plot: axes are not scaled to it.
    Bound,
    /// One dot a point.
    Dots,
}

/// One named set of points. A point that is not finite breaks the line.
#[derive(Debug, Clone, PartialEq)]
pub struct Series {
    /// Name in the legend.
    pub name: String,
    /// Colour.
    pub tone: Tone,
    /// Line or dots.
    pub mark: Mark,
    /// Points, x then y, in plot units.
    pub points: Vec<[f64; 2]>,
}

/// A labelled point, such as an anchor.
#[derive(Debug, Clone, PartialEq)]
pub struct Pin {
    /// Label beside it.
    pub name: String,
    /// Where, in plot units.
    pub at: [f64; 2],
}

/// A shaded span of x with a name, such as a mode of flight.
#[derive(Debug, Clone, PartialEq)]
pub struct Span {
    /// Name, written at the top when there is room and shown on hover.
    pub name: String,
    /// Begin and end, in plot units.
    pub x: [f64; 2],
}

/// A horizontal line with a name, such as a limit.
#[derive(Debug, Clone, PartialEq)]
pub struct Limit {
    /// Name, written on the line.
    pub name: String,
    /// Where, in plot units.
    pub y: f64,
}

/// A vertical line with a name.
#[derive(Debug, Clone, PartialEq)]
pub struct Upright {
    /// Name, written at its top.
    pub name: String,
    /// Where, in plot units.
    pub x: f64,
}

/// One drawing.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Plot {
    /// Heading.
    pub title: String,
    /// Label of the horizontal axis, with unit.
    pub x_label: String,
    /// Label of the vertical axis, with unit.
    pub y_label: String,
    /// What is drawn, back to front.
    pub series: Vec<Series>,
    /// Points with names.
    pub pins: Vec<Pin>,
    /// Shaded spans behind everything.
    pub spans: Vec<Span>,
    /// Lines across.
    pub limits: Vec<Limit>,
    /// Same scale on both axes: maps.
    pub equal: bool,
    /// Size of the drawing, pixels.
    pub size_px: [f64; 2],
    /// Smallest extent of the vertical axis, so that noise does not fill the plot.
    pub least_height: f64,
    /// Ends of the horizontal axis; `None` takes those of the data.
    pub x_range: Option<[f64; 2]>,
    /// The vertical axis is scaled to what lies between these places of x; `None`, or nothing there: to everything.
    pub scaled_to: Option<[f64; 2]>,
    /// Instead of round ticks: place, label and second label.
    pub categories: Vec<(f64, String, String)>,
    /// Lines from bottom to top with names, such as a frequency.
    pub uprights: Vec<Upright>,
    /// Values of y are decimal logarithms: the axis shows powers of ten.
    pub decades: bool,
    /// The horizontal axis is time since the start of the companion: zooming into one such plot of a
    /// page zooms all.
    pub shared_time: bool,
}

/// Room for labels around the drawing area, pixels.
const LEFT_PX: f64 = 52.0;
const RIGHT_PX: f64 = 12.0;
const TOP_PX: f64 = 30.0;
const BOTTOM_PX: f64 = 38.0;
/// Aim for one tick this often, pixels.
const TICK_X_PX: f64 = 70.0;
const TICK_Y_PX: f64 = 34.0;
/// Dots kept of a series; more would only make the page slow.
const MOST_DOTS: usize = 1500;
/// Dots on an axis stand out of the drawing by half of their width, pixels.
const DOT_PX: f64 = 3.5;
/// So many dots or fewer are drawn large.
const FEW_DOTS: usize = 60;
/// Width of a character of the small font, pixels: for legend and span labels.
const CHAR_PX: f64 = 6.1;
/// The same of the title.
const TITLE_CHAR_PX: f64 = 7.2;
/// Key of a legend entry and the gaps around it, pixels.
const LEGEND_KEY_PX: f64 = 34.0;
/// From one row of the legend to the next, pixels.
const LEGEND_ROW_PX: f64 = 15.0;
/// Height of the name on a limit, pixels.
const LIMIT_NAME_PX: f64 = 12.0;
/// Head room for the names of spans, pixels.
const SPAN_NAME_PX: f64 = 15.0;

/// A linear map from data to pixels.
#[derive(Clone, Copy)]
struct Scale {
    low: f64,
    high: f64,
    from_px: f64,
    to_px: f64,
}

impl Scale {
    fn px(&self, value: f64) -> f64 {
        self.from_px + (value - self.low) / (self.high - self.low) * (self.to_px - self.from_px)
    }
}

impl Plot {
    /// The drawing as one `<svg>` element; a plot without a point says so.
    pub fn render(&self) -> String {
        let [width, height] = self.size_px;
        let mut svg = String::new();
        let (Some(xs), Some(ys)) = (self.extent(0), self.extent(1)) else {
            let _ = write!(
                svg,
                "<figure><svg viewBox=\"0 0 {width} {height}\" role=\"img\" aria-label=\"{t}\">\
                 <text class=\"title\" x=\"{LEFT_PX}\" y=\"16\">{t}</text>\
                 <text class=\"tick mid\" x=\"{}\" y=\"{}\">no data in this log</text></svg></figure>",
                width / 2.0,
                height / 2.0,
                t = escape(&self.title),
            );
            return svg;
        };
        let (x, y) = self.scales(xs, ys);
        let _ = write!(
            svg,
            "<figure><svg class=\"plot\" viewBox=\"0 0 {width} {height}\" role=\"img\" \
             aria-label=\"{t}\" data-box=\"{},{},{},{}\" data-x=\"{},{}\" data-y=\"{},{}\"{}{}{}>\
             <text class=\"title\" x=\"{LEFT_PX}\" y=\"16\">{t}</text>",
            x.from_px,
            y.to_px,
            x.to_px - x.from_px,
            y.from_px - y.to_px,
            x.low,
            x.high,
            y.low,
            y.high,
            if self.equal { " data-equal" } else { "" },
            if self.decades { " data-decades" } else { "" },
            if self.shared_time { " data-time" } else { "" },
            t = escape(&self.title),
        );
        self.draw_spans(&mut svg, &x, &y);
        self.draw_axes(&mut svg, &x, &y);
        for limit in self.limits.iter().filter(|l| l.y >= y.low && l.y <= y.high) {
            let at = y.px(limit.y);
            // Of two names that would cover one another the upper one stands higher.
            let under = self.limits.iter().filter(|l| *l != limit).map(|l| y.px(l.y) - at);
            let under = under.filter(|gap| (0.0..LIMIT_NAME_PX).contains(gap)).reduce(f64::min);
            let name_at = at - 3.0 - under.map_or(0.0, |gap| LIMIT_NAME_PX - gap);
            let _ = write!(
                svg,
                "<g data-y=\"{at:.1}\"><line class=\"limit\" x1=\"{}\" x2=\"{}\" y1=\"{at:.1}\" y2=\"{at:.1}\"/>\
                 <text class=\"tick end\" x=\"{}\" y=\"{:.1}\">{}</text></g>",
                x.from_px,
                x.to_px,
                x.to_px - 3.0,
                name_at,
                escape(&limit.name)
            );
        }
        for upright in self.uprights.iter().filter(|u| u.x >= x.low && u.x <= x.high) {
            let at = x.px(upright.x);
            let fits = at + 3.0 + width_px(&upright.name) < width;
            let (class, beside) = if fits { ("tick", at + 3.0) } else { ("tick end", at - 3.0) };
            let _ = write!(
                svg,
                "<g data-at=\"{at:.1}\"><line class=\"limit\" x1=\"{at:.1}\" x2=\"{at:.1}\" \
                 y1=\"{}\" y2=\"{}\"/><text class=\"{class}\" x=\"{beside:.1}\" y=\"{}\">{}</text></g>",
                y.to_px,
                y.from_px,
                y.to_px + 11.0,
                escape(&upright.name)
            );
        }
        // Plots of one size are cut at one box: the name says which.
        let [left, top] = [x.from_px, y.to_px];
        let _ = write!(
            svg,
            "<clipPath id=\"b{width}-{height}-{top}\"><rect x=\"{left}\" y=\"{}\" width=\"{}\" height=\"{}\"/>\
             </clipPath><g clip-path=\"url(#b{width}-{height}-{top})\">",
            top - DOT_PX,
            x.to_px - left + DOT_PX,
            y.from_px - top + 2.0 * DOT_PX
        );
        for series in &self.series {
            self.draw_series(&mut svg, series, &x, &y);
        }
        svg.push_str("</g>");
        for pin in &self.pins {
            let [px, py] = [x.px(pin.at[0]), y.px(pin.at[1])];
            // A name that would leave the drawing stands on the other side.
            let fits = px + 7.0 + width_px(&pin.name) < width;
            let (class, beside) = if fits { ("tick", px + 7.0) } else { ("tick end", px - 7.0) };
            let _ = write!(
                svg,
                "<g data-pin=\"{px:.1},{py:.1}\"><path class=\"pin\" d=\"M{px:.1} {:.1}l5 8h-10z\"/>\
                 <text class=\"{class}\" x=\"{beside:.1}\" y=\"{:.1}\">{}</text></g>",
                py - 5.0,
                py + 4.0,
                escape(&pin.name)
            );
        }
        self.draw_legend(&mut svg);
        svg.push_str("<g class=\"hover\"></g></svg></figure>");
        svg
    }

    /// Least and greatest finite value on an axis.
    fn extent(&self, axis: usize) -> Option<[f64; 2]> {
        let fixed = if axis == 0 { self.x_range } else { None };
        let all = [f64::NEG_INFINITY, f64::INFINITY];
        let range = match self.scaled_to.filter(|_| axis == 1) {
            Some(within) => self.range(axis, within, false).or_else(|| self.range(axis, all, true)),
            None => self.range(axis, all, false).or_else(|| self.range(axis, all, true)),
        };
        range.map(|range| fixed.unwrap_or(range))
    }

    /// The same of what lies between two places of x, with bounds or without.
    fn range(&self, axis: usize, [from, to]: [f64; 2], bounds: bool) -> Option<[f64; 2]> {
        let series = self.series.iter().filter(|s| bounds || s.mark != Mark::Bound);
        let points = series.flat_map(|s| &s.points).chain(self.pins.iter().map(|p| &p.at));
        let inside =
            points.filter(|p| p.iter().all(|c| c.is_finite()) && p[0] >= from && p[0] <= to);
        inside.map(|p| [p[axis]; 2]).reduce(|[low, high], [v, _]| [low.min(v), high.max(v)])
    }

    fn scales(&self, xs: [f64; 2], ys: [f64; 2]) -> (Scale, Scale) {
        let [width, height] = self.size_px;
        let (right, bottom) = (width - RIGHT_PX, height - BOTTOM_PX);
        let top = self.top_px();
        let least = if self.least_height > 0.0 { self.least_height } else { 1e-6 };
        let mut ys = widened(ys, least, 0.06);
        if !self.spans.is_empty() {
            let free_px = (bottom - top - SPAN_NAME_PX).max(1.0);
            ys[1] += (ys[1] - ys[0]) * SPAN_NAME_PX / free_px;
        }
        let mut xs = if self.equal { widened(xs, least, 0.06) } else { widened(xs, 1e-6, 0.0) };
        if self.equal {
            let (px_x, px_y) = (right - LEFT_PX, bottom - top);
            let per_px = ((xs[1] - xs[0]) / px_x).max((ys[1] - ys[0]) / px_y);
            xs = widened(xs, per_px * px_x, 0.0);
            ys = widened(ys, per_px * px_y, 0.0);
        }
        (
            Scale { low: xs[0], high: xs[1], from_px: LEFT_PX, to_px: right },
            Scale { low: ys[0], high: ys[1], from_px: bottom, to_px: top },
        )
    }

    fn draw_spans(&self, svg: &mut String, x: &Scale, y: &Scale) {
        for (i, span) in self.spans.iter().enumerate() {
            let a = x.px(span.x[0].max(x.low));
            let b = x.px(span.x[1].min(x.high));
            if b <= a {
                continue;
            }
            let _ = write!(
                svg,
                "<g data-span=\"{a:.1},{b:.1}\"><title>{}</title><rect class=\"span{}\" x=\"{a:.1}\" y=\"{}\" width=\"{:.1}\" \
                 height=\"{:.1}\"/>",
                escape(&span.name),
                i % 2,
                y.to_px,
                b - a,
                y.from_px - y.to_px
            );
            if b - a > width_px(&span.name) {
                let _ = write!(
                    svg,
                    "<text class=\"tick mid faint\" x=\"{:.1}\" y=\"{}\">{}</text>",
                    (a + b) / 2.0,
                    y.to_px + 11.0,
                    escape(&span.name)
                );
            }
            svg.push_str("</g>");
        }
    }

    fn draw_axes(&self, svg: &mut String, x: &Scale, y: &Scale) {
        let (left, right, top, bottom) = (x.from_px, x.to_px, y.to_px, y.from_px);
        for (at, label, second) in &self.categories {
            let px = x.px(*at);
            let _ = write!(
                svg,
                "<text class=\"tick mid\" x=\"{px:.1}\" y=\"{}\">{}</text>\
                 <text class=\"tick mid faint\" x=\"{px:.1}\" y=\"{}\">{}</text>",
                bottom + 14.0,
                escape(label),
                bottom + 28.0,
                escape(second)
            );
        }
        let round = self.categories.is_empty();
        svg.push_str("<g class=\"gx\">");
        let wanted = if round { (right - left) / TICK_X_PX } else { 0.0 };
        for (at, label) in ticks(x.low, x.high, wanted).into_iter().filter(|_| round) {
            let px = x.px(at);
            let _ = write!(
                svg,
                "<line class=\"grid\" x1=\"{px:.1}\" x2=\"{px:.1}\" y1=\"{top}\" y2=\"{bottom}\"/>\
                 <text class=\"tick mid\" x=\"{px:.1}\" y=\"{}\">{label}</text>",
                bottom + 14.0
            );
        }
        svg.push_str("</g><g class=\"gy\">");
        let marks = if self.decades {
            decades(y.low, y.high)
        } else {
            ticks(y.low, y.high, (bottom - top) / TICK_Y_PX)
        };
        for (at, label) in marks {
            let px = y.px(at);
            let _ = write!(
                svg,
                "<line class=\"grid\" x1=\"{left}\" x2=\"{right}\" y1=\"{px:.1}\" y2=\"{px:.1}\"/>\
                 <text class=\"tick end\" x=\"{}\" y=\"{:.1}\">{label}</text>",
                left - 5.0,
                px + 3.5
            );
        }
        svg.push_str("</g>");
        let _ = write!(
            svg,
            "<path class=\"axis\" d=\"M{left} {top}V{bottom}H{right}\"/>\
             <text class=\"tick mid\" x=\"{}\" y=\"{}\">{}</text>\
             <text class=\"tick mid\" transform=\"translate(11 {}) rotate(-90)\">{}</text>",
            (left + right) / 2.0,
            bottom + 30.0,
            escape(&self.x_label),
            (top + bottom) / 2.0,
            escape(&self.y_label)
        );
    }

    fn draw_series(&self, svg: &mut String, series: &Series, x: &Scale, y: &Scale) {
        let class = series.tone.class();
        let name = escape(&series.name);
        let inside = |p: &&[f64; 2]| p[0] >= x.low && p[0] <= x.high && p[1].is_finite();
        let to_px = |p: &[f64; 2]| [x.px(p[0]), y.px(p[1])];
        let mut pen = Pen::default();
        let kind = match series.mark {
            Mark::Dots => {
                let step = series.points.len().div_ceil(MOST_DOTS).max(1);
                for p in series.points.iter().filter(inside).step_by(step) {
                    pen.dot(to_px(p));
                }
                kind_of(series)
            }
            Mark::Line | Mark::Dashed | Mark::Bound => {
                for run in series.points.split(|p| !p.iter().all(|c| c.is_finite())) {
                    let run: Vec<[f64; 2]> = if self.equal {
                        merged(run.iter().map(to_px))
                    } else {
                        columns(run.iter().filter(inside).map(to_px))
                    };
                    for (i, p) in run.into_iter().enumerate() {
                        if i == 0 {
                            pen.move_to(p);
                        } else {
                            pen.line_to(p);
                        }
                    }
                }
                kind_of(series)
            }
        };
        let data = pen.data();
        let _ = write!(svg, "<path class=\"{kind} {class}\" data-name=\"{name}\" d=\"{data}\"/>");
    }

    /// Names of the series in rows, each with the place of its left end: beside the title as far as there is room,
    /// the rest below.
    fn legend(&self) -> Vec<Vec<(f64, &Series)>> {
        let right = self.size_px[0] - RIGHT_PX;
        let title_end = LEFT_PX + TITLE_CHAR_PX * self.title.chars().count() as f64;
        let mut rows = vec![Vec::new()];
        let mut at = right;
        for series in self.series.iter().rev().filter(|s| !s.name.is_empty()) {
            let wide = width_px(&series.name) + LEGEND_KEY_PX;
            let least = if rows.len() == 1 { title_end } else { 0.0 };
            if at - wide < least {
                rows.push(Vec::new());
                at = right;
            }
            at -= wide;
            rows.last_mut().into_iter().for_each(|row: &mut Vec<_>| row.push((at, series)));
        }
        rows
    }

    /// Where the drawing begins: below title and legend.
    fn top_px(&self) -> f64 {
        TOP_PX + LEGEND_ROW_PX * (self.legend().len() - 1) as f64
    }

    fn draw_legend(&self, svg: &mut String) {
        let rows = self.legend().into_iter().zip(0..);
        for ((at, series), row) in
            rows.flat_map(|(all, n)| all.into_iter().zip(std::iter::repeat(n)))
        {
            let y = 12.0 + LEGEND_ROW_PX * f64::from(row);
            let (class, kind) = (series.tone.class(), kind_of(series));
            let key = if series.mark == Mark::Dots { "h0" } else { "h16" };
            let _ = write!(
                svg,
                "<path class=\"key {kind} {class}\" d=\"M{at:.1} {y}{key}\"/>\
                 <text class=\"tick\" x=\"{:.1}\" y=\"{}\">{}</text>",
                at + 20.0,
                y + 4.0,
                escape(&series.name)
            );
        }
    }
}

/// Classes of `page.css` by which a series is drawn.
fn kind_of(series: &Series) -> &'static str {
    match series.mark {
        Mark::Line => "line",
        Mark::Dashed => "line dashed",
        Mark::Bound => "line dashed bound",
        Mark::Dots if series.points.len() > FEW_DOTS => "dots",
        Mark::Dots => "dots few",
    }
}

/// Width of a text in the small font, pixels.
fn width_px(text: &str) -> f64 {
    CHAR_PX * text.chars().count() as f64
}

/// A range no narrower than `least`, with a margin on either side.
fn widened([low, high]: [f64; 2], least: f64, margin_frac: f64) -> [f64; 2] {
    let middle = (low + high) / 2.0;
    let half = ((high - low).max(least) / 2.0) * (1.0 + 2.0 * margin_frac);
    [middle - half, middle + half]
}

/// Text safe inside HTML and attributes.
pub fn escape(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' => out.push_str("&amp;"),
            '<' => out.push_str("&lt;"),
            '>' => out.push_str("&gt;"),
            '"' => out.push_str("&quot;"),
            c => out.push(c),
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plot_of(mark: Mark, points: Vec<[f64; 2]>) -> Plot {
        let series =
            |mark, points| Series { name: "a name".into(), tone: Tone::Truth, mark, points };
        Plot {
            series: vec![
                series(Mark::Line, vec![[0.0, 9.0], [1.0, 0.0], [2.0, 1.0], [3.0, 9.0]]),
                series(mark, points),
            ],
            size_px: [400.0, 200.0],
            ..Plot::default()
        }
    }

    #[test]
    fn prop_axes_are_scaled_to_the_flight_and_not_to_bounds() {
        let bound = || vec![[0.0, 50.0], [2.0, -50.0]];
        let high = |plot: &Plot| plot.extent(1).unwrap();
        assert_eq!(high(&plot_of(Mark::Dashed, bound())), [-50.0, 50.0]);
        assert_eq!(high(&plot_of(Mark::Bound, bound())), [0.0, 9.0]);
        let flown = |scaled_to| Plot { scaled_to, ..plot_of(Mark::Bound, bound()) };
        assert_eq!(high(&flown(Some([0.5, 2.5]))), [0.0, 1.0]);
        // Nothing was told while it flew.
        assert_eq!(high(&flown(Some([7.0, 8.0]))), [-50.0, 50.0]);
        assert!(flown(None).render().contains("clip-path=\"url(#b400-200-30)\""));
    }

    #[test]
    fn prop_names_of_limits_do_not_cover_one_another() {
        let limit = |name: &str, y| Limit { name: name.into(), y };
        let mut plot = plot_of(Mark::Line, vec![[0.0, 9.0]]);
        plot.limits = vec![limit("lower", 4.0), limit("upper", 4.1)];
        let svg = plot.render();
        let at = |name: &str| -> f64 {
            let text = &svg[..svg.find(name).unwrap()];
            let from = text.rfind(" y=\"").unwrap() + 4;
            text[from..].split('"').next().unwrap().parse().unwrap()
        };
        assert!((at("lower<") - at("upper<") - LIMIT_NAME_PX).abs() < 0.11, "{svg}");
    }

    #[test]
    fn prop_names_leave_neither_the_drawing_nor_the_title_uncovered() {
        let mut plot = plot_of(Mark::Dots, vec![[1.0, 1.0]]);
        plot.title = "A title of some length".into();
        plot.pins = vec![Pin { name: "at its very end".into(), at: [3.0, 1.0] }];
        assert_eq!(plot.legend().len(), 1);
        let wide = LEFT_PX + TITLE_CHAR_PX * plot.title.len() as f64;
        assert!(plot.legend().iter().flatten().all(|(at, _)| *at > wide));
        for series in &mut plot.series {
            series.name = "a name that is far longer".into();
        }
        assert!(plot.legend().len() > 1 && plot.legend().iter().flatten().all(|(at, _)| *at > 0.0));
        assert!(plot.top_px() > TOP_PX);
        let svg = plot.render();
        assert!(
            svg.contains("class=\"tick end\" x=\"381.0\"") && svg.contains("dots few"),
            "{svg}"
        );
    }

    #[test]
    fn prop_odd_input_draws_without_nan() {
        let series = |points: Vec<[f64; 2]>| Series {
            name: "a < b".into(),
            tone: Tone::Family(9),
            mark: Mark::Line,
            points,
        };
        let plot = |points| Plot {
            title: "t".into(),
            series: vec![series(points)],
            size_px: [400.0, 200.0],
            ..Plot::default()
        };
        assert!(plot(vec![]).render().contains("no data"));
        assert!(plot(vec![[f64::NAN, 1.0]]).render().contains("no data"));
        for points in [
            vec![[1.0, 2.0]],
            vec![[1.0, 2.0], [f64::NAN, f64::NAN], [2.0, f64::INFINITY], [3.0, 2.0]],
        ] {
            let svg = plot(points).render();
            assert!(!svg.contains("NaN") && !svg.contains("inf"), "{svg}");
            assert!(svg.contains("a &lt; b"));
        }
    }
}
