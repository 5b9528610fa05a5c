//! The one-page report of a flight: verdict, tables and plots in a single HTML file.
//!
//! The page needs no network and no other file. It follows the light or dark setting of the
//! browser, prints on white, and tells lines apart by dash and weight as well as by colour.

pub mod errors;
pub mod flight;
pub mod fourier;
pub mod from_log;
pub mod gap;
pub mod html;
mod lanes;
mod lists;
mod path;
mod plots;
mod spectrum;
pub mod svg;
mod ticks;
mod timing;
pub mod truth;
pub mod verdict;

use std::fmt::Write as _;

pub use html::STYLE;

use errors::{AXES, AxisErrors, Path, PathKind, STEP_WINDOW_S};
use flight::Flight;
use svg::escape;
use verdict::{Check, all_passed};

/// Everything the page shows.
pub struct Page<'a> {
    /// Heading, such as "Demo flight".
    pub title: &'a str,
    /// Line under the heading: build, vehicle, scenario, files.
    pub subtitle: &'a str,
    /// What was checked. Empty: the page gives no verdict.
    pub checks: &'a [Check],
    /// Errors by path and axis.
    pub errors: &'a [AxisErrors],
    /// When each path was flown: shapes get a map of their own.
    pub paths: &'a [Path],
    /// The flight.
    pub flight: &'a Flight,
}

impl Page<'_> {
    /// The whole page.
    pub fn render(&self) -> String {
        let mut html = html::open(self.title, "");
        self.header(&mut html);
        lists::facts(&mut html, self.flight);
        html.push_str(&html::checks(self.checks));
        self.errors(&mut html);
        let shapes = plots::shapes(self.flight, self.paths);
        if !shapes.is_empty() {
            let _ = write!(html, "<h2>Shapes, from above</h2><div class=\"maps\">{shapes}</div>");
        }
        for section in plots::sections(self.flight) {
            let _ = write!(html, "<h2>{}</h2>", escape(section.title));
            if !section.note.is_empty() {
                let _ = write!(html, "<p class=\"note\">{}</p>", escape(&section.note));
            }
            html.push_str("<div class=\"two\">");
            for plot in section.plots {
                html.push_str(&plot);
            }
            html.push_str("</div>");
        }
        lists::all(&mut html, self.flight);
        let _ = write!(
            html,
            "<footer>Frame: local NED, origin of the anchor survey; heights are shown upward. \
             Shading in the time plots: modes. Time is counted from the start of the \
             companion, as in <code>haltere log trim</code>. Drag across a plot to look closer, \
             double-click to see everything again.</footer>"
        );
        html::close(html)
    }

    fn header(&self, html: &mut String) {
        let (class, word) = if self.checks.is_empty() {
            ("none", "NOT JUDGED")
        } else if all_passed(self.checks) {
            ("good", "PASS")
        } else {
            ("bad", "FAIL")
        };
        let _ = write!(
            html,
            "<header><span class=\"verdict {class}\">{word}</span><div><h1>{}</h1><p>{}</p></div>\
             </header>",
            escape(self.title),
            escape(self.subtitle)
        );
    }

    fn errors(&self, html: &mut String) {
        if self.errors.is_empty() {
            return;
        }
        let _ = write!(
            html,
            "<h2>Errors</h2><p class=\"note\">Mean absolute error, then standard deviation of the \
             signed error. A step is judged on its own axis over {STEP_WINDOW_S} s from the jump of \
             the setpoint, rise included; a shape from leaving its first corner to the setpoint's \
             arrival at its last. Velocity command is the velocity setpoint of the cascade.</p>\
             <table><thead><tr><th rowspan=\"2\">Path</th><th rowspan=\"2\">Axis</th>\
             <th class=\"n\" colspan=\"2\">truth \u{2212} command, m</th>\
             <th class=\"n\" colspan=\"2\">truth \u{2212} command, m/s</th>\
             <th class=\"n\" colspan=\"2\">estimate \u{2212} truth, m</th>\
             <th class=\"n\" colspan=\"2\">estimate \u{2212} truth, m/s</th></tr><tr>"
        );
        for _ in 0..4 {
            html.push_str("<th class=\"n\">mean abs</th><th class=\"n\">std</th>");
        }
        html.push_str("</tr></thead><tbody>");
        let mut before = "";
        for row in self.errors {
            let new = row.path != before;
            before = &row.path;
            let _ = write!(
                html,
                "<tr{}><td>{}</td><td>{}</td>",
                if new && row.kind == PathKind::Shape { " class=\"first\"" } else { "" },
                if new { escape(&row.path) } else { String::new() },
                AXES[row.axis]
            );
            for spread in [
                &row.position_m,
                &row.velocity_mps,
                &row.estimate_position_m,
                &row.estimate_velocity_mps,
            ] {
                for value in [spread.mae(), spread.std()] {
                    let _ = write!(
                        html,
                        "<td class=\"n\">{}</td>",
                        value.map_or("\u{2013}".to_string(), |v| format!("{v:.3}"))
                    );
                }
            }
            html.push_str("</tr>");
        }
        html.push_str("</tbody></table>");
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use errors::{Leg, axis_errors, find_paths};
    use flight::ModeRow;
    use haltere_core::drops::{DropReason, Drops};
    use haltere_core::estimate::{Estimate, Health};
    use haltere_core::frames::{Rot, Vec3};
    use haltere_core::measure::{AnchorId, BatterySample, Tdoa};
    use haltere_core::survey::Survey;
    use haltere_core::time::HostTime;
    use haltere_core::topics::{ControlRecord, HealthRecord, UwbRecord};
    use truth::TruthRow;

    /// A circle with known errors: the estimate stands 5 cm off in x.
    fn synthetic() -> Flight {
        let corner = |i: u8, bit: u8, far: f64| if i & bit != 0 { far } else { 0.0 };
        let anchors: Vec<_> = (0..8u8)
            .map(|i| {
                let pos = Vec3::new(corner(i, 1, 10.0), corner(i, 2, 10.0), -corner(i, 4, 7.0));
                (AnchorId(i), pos)
            })
            .collect();
        let mut flight = Flight { survey: Survey::new(&anchors).ok(), ..Flight::default() };
        for i in 0..6000_u32 {
            let at = HostTime::from_us(5_000_000 + 10_000 * u64::from(i));
            let t_s = f64::from(i) * 0.01;
            let (s, c) = (0.3 * t_s).sin_cos();
            let pos = Vec3::new(5.0 + 2.0 * c, 5.0 + 2.0 * s, -1.2 - 0.3 * (0.1 * t_s).sin());
            let vel = Vec3::new(-0.6 * s, 0.6 * c, 0.0);
            let R_EB = Rot::from_euler_rad(0.02 * s, 0.05 * c, 0.0);
            let wobble = 0.03 * (11.0 * t_s).sin();
            flight.truth.push(TruthRow {
                at,
                t_s,
                pos_E_m: pos,
                vel_E_mps: vel,
                R_EB,
                rate_B_radps: Vec3::zero(),
                flap_hz: [12.5; 2],
                supply_v: 7.9 - 0.01 * t_s,
                charge_frac: 0.9,
                thrust_n: 1.0,
                on_ground: false,
                crashed: false,
            });
            flight.estimates.push(Estimate {
                at,
                pos_E_m: pos + Vec3::new(0.05, wobble, wobble),
                vel_B_mps: R_EB.inverse() * vel,
                R_EB,
                rate_B_radps: Vec3::zero(),
                std_pos_E_m: Vec3::new(0.05, 0.05, 0.08),
                std_vel_B_mps: Vec3::new(0.1, 0.1, 0.1),
                std_att_B_rad: Vec3::new(0.01, 0.01, 0.05),
                uwb_noise_factor: 0.5,
                health: Health::Good,
            });
            let setpoint = if i < 3000 { [7.0, 5.0, -1.2] } else { [6.0, 5.0, -1.2] };
            flight.controls.push(ControlRecord {
                at,
                pos_setpoint_E_m: setpoint.map(Some),
                thrust_frac: 0.6 + wobble,
                thrust_base_frac: 0.6,
                thrust_feedback_frac: wobble,
                ground_factor: 1.0,
                hover_factor: 1.0,
                roll_rad: 0.02 * s + wobble,
                pitch_rad: 0.05 * c,
                ..ControlRecord::default()
            });
            flight.uwb.push(UwbRecord {
                tdoa: Tdoa {
                    valid_at: at,
                    received_at: at,
                    anchor_a: AnchorId((i % 8) as u8),
                    anchor_b: AnchorId(((i + 1) % 8) as u8),
                    distance_diff_m: 0.0,
                    std_m: None,
                },
                innovation_m: 5.0 * wobble * (f64::from(i) * 0.37).cos(),
                var_innovation_m2: 0.01,
                test_ratio: 0.5,
                fused: i % 29 != 0,
            });
            if i % 100 == 0 {
                let mut drops = Drops::default();
                drops.add(DropReason::TagGarbageByte, u64::from(i / 300));
                drops.add(DropReason::UwbGated, u64::from(i / 29));
                flight.battery.push(BatterySample {
                    received_at: at,
                    supply_v: 7.9 - 0.01 * t_s,
                    current_a: None,
                    remaining_frac: None,
                });
                flight.health.push(HealthRecord {
                    at,
                    drops: vec![(0, drops)].into(),
                    deadline_misses: u64::from(i / 2000),
                    control_steps: u64::from(i),
                    uwb_age_s: Some(0.004),
                    imu_age_s: Some(0.002 + wobble.abs() * 0.1),
                    std_board_clock_s: Some(1e-4),
                    left_out: 0,
                });
            }
        }
        for (s, mode) in [(0, "disarmed"), (4, "takeoff"), (10, "mission"), (52, "land")] {
            flight.modes.push(ModeRow {
                at: HostTime::from_us(5_000_000 + 1_000_000 * s),
                mode: mode.into(),
                armed: s > 0,
                cause: "asked <by> a client".into(),
            });
        }
        flight
    }

    #[test]
    fn prop_page_stands_alone_and_shows_the_errors() {
        let flight = synthetic();
        let plan = [
            Leg { path: None, to_E_m: Vec3::new(7.0, 5.0, -1.2) },
            Leg {
                path: Some(("step x 1 m".into(), PathKind::Step { axis: 0 })),
                to_E_m: Vec3::new(6.0, 5.0, -1.2),
            },
        ];
        let (paths, flown) = find_paths(&plan, &flight.controls);
        assert_eq!(flown, Ok(()));
        let errors = axis_errors(&flight, &paths);
        assert_eq!(errors.len(), 1);
        let mae_m = errors[0].estimate_position_m.mae().unwrap();
        assert!((mae_m - 0.05).abs() < 1e-9, "{mae_m}");
        let checks = [Check::at_most("estimate, step x", Some(mae_m), 0.10, "m")];
        let page = Page {
            title: "Synthetic flight",
            subtitle: "a circle <script>",
            checks: &checks,
            errors: &errors,
            paths: &paths,
            flight: &flight,
        };
        let html = page.render();
        for needed in ["PASS", "step x 1 m", "0.050", "a circle &lt;script&gt;", "tag garbage byte"]
        {
            assert!(html.contains(needed), "{needed}");
        }
        for forbidden in ["http:", "https:", "src=", "href=", "NaN", "@import"] {
            assert!(!html.contains(forbidden), "{forbidden}");
        }
        assert!(html.len() < 3_000_000, "{} bytes", html.len());
    }

    #[test]
    fn prop_empty_log_gives_a_page() {
        let flight = Flight::default();
        let page = Page {
            title: "Empty",
            subtitle: "",
            checks: &[],
            errors: &[],
            paths: &[],
            flight: &flight,
        };
        assert!(page.render().contains("NOT JUDGED"));
    }
}
