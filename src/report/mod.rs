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
pub mod said;
mod spectrum;
pub mod svg;
mod ticks;
mod timing;
pub mod truth;
pub mod verdict;

use std::fmt::Write as _;

use errors::{AXES, AxisErrors, Path, STEP_WINDOW_S, Spread};
use flight::Flight;
use html::Cell;
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
    /// The whole page: what came of it, then pictures, then numbers.
    pub fn render(&self) -> String {
        let mut html = html::open(self.title, "");
        let badge = match all_passed(self.checks) {
            _ if self.checks.is_empty() => None,
            true => Some(("good", "PASS")),
            false => Some(("bad", "FAIL")),
        };
        html += &html::header(badge, self.title, self.subtitle);
        let said = said::said(self.flight);
        html += &html::said(if said.bad { "bad" } else { "" }, &said.words);
        let shapes = plots::shapes(self.flight, self.paths);
        if !shapes.is_empty() {
            let _ = write!(html, "<h2>Shapes, from above</h2><div class=\"maps\">{shapes}</div>");
        }
        html += &html::checks(self.checks);
        for (i, section) in plots::sections(self.flight).into_iter().enumerate() {
            let _ = write!(html, "<h2>{}</h2>", escape(section.title));
            if !section.note.is_empty() {
                let _ = write!(html, "<p class=\"note\">{}</p>", escape(&section.note));
            }
            let _ = write!(html, "<div class=\"two\">{}</div>", section.plots.concat());
            if i == 0 {
                lists::facts(&mut html, self.flight);
            } else if i == 1 {
                self.errors(&mut html);
            }
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

    fn errors(&self, html: &mut String) {
        if self.errors.is_empty() {
            return;
        }
        let _ = write!(
            html,
            "<h2>Errors</h2><p class=\"note\">Without sign: mean, root mean square, largest. Track: truth \u{2212} \
             setpoint, of the velocity that of the cascade. Estimate: estimate \u{2212} truth. A step is judged on its \
             own axis over {STEP_WINDOW_S} s from the jump of the setpoint, rise included; a shape from leaving its \
             first corner to the setpoint's arrival at its last.</p>{}\
             <details><summary>Errors of the velocity</summary>{}</details>",
            self.table("m", |row| [&row.position_m, &row.estimate_position_m]),
            self.table("m/s", |row| [&row.velocity_mps, &row.estimate_velocity_mps]),
        );
    }

    /// Errors of track and estimate by path and axis.
    fn table(&self, unit: &str, pick: fn(&AxisErrors) -> [&Spread; 2]) -> String {
        let number = |v: Option<f64>| v.map_or(String::new(), |v| format!("{v:.3}")).into();
        let mut before = "";
        let rows = self.errors.iter().map(|row| {
            let name = if row.path == before { "" } else { &row.path };
            before = &row.path;
            let numbers = pick(row).into_iter().flat_map(|s| [s.mae(), s.rms(), s.worst()]);
            [name, AXES[row.axis]].map(Cell::from).into_iter().chain(numbers.map(number)).collect()
        });
        let rows: Vec<Vec<Cell>> = rows.collect();
        let [track, estimate] = ["track", "estimate"].map(|what| format!("#{what}, {unit}: mean"));
        let heads = ["path", "axis", &track, "#RMSE", "#worst", &estimate, "#RMSE", "#worst"];
        html::table(heads, &rows)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use errors::{Leg, PathKind, axis_errors, find_paths};
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
        let html = page.render();
        assert!(html.contains("Nothing was flown.") && !html.contains("class=\"verdict"), "{html}");
    }
}
