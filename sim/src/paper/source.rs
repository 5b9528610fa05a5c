//! Numbers of the source, each with its place in it.
//!
//! G. González, G. C. H. E. de Croon, D. Olejnik, M. Karásek: "Position controller for a
//! flapping-wing drone using UWB", IMAV 2021, pages 85 to 92. Its full tables are not available to
//! us: what stands here is what its abstract and public summaries of it state. Whatever is missing
//! is reported as missing.

use super::results::Source;

/// Mean absolute error on the four path shapes.
pub const PATHS_M: Source = Source { range: [0.08, 0.10], origin: "section 4" };
/// Mean absolute position error of `modified`, by size (1 m, 2 m) and axis.
pub const MODIFIED_M: [[f64; 3]; 2] = [[0.105, 0.105, 0.043], [0.198, 0.206, 0.110]];
/// Position error of `raw` over that of `modified`, by size and axis.
pub const RATIO: [[f64; 3]; 2] = [[1.62, 1.81, 1.15], [1.68, 1.45, 1.13]];
/// Where both stand.
pub const TABLE_3: &str = "table 3";
/// Position error of `raw` in z, 1 m: the cell that the abstract quotes as 4.9 cm.
pub const RAW_Z_1_M: Source = Source::number(0.0496, "table 3, raw");
/// R² of thrust over voltage.
pub const THRUST_R2: Source = Source::number(0.756, "figure 7");
/// Angles of the steps, degrees: pitch and roll.
pub const ANGLES_DEG: [[f64; 5]; 2] =
    [[12.0, 22.0, 33.0, 45.0, 52.0], [12.0, 22.0, 33.0, 47.0, 52.0]];
/// Starting values of the drag law θ = a + b·e^(−c·v): degrees, degrees, s/m.
pub const DRAG_START: [f64; 3] = [-90.0, 90.0, 0.3];
/// Ground effect T_in/T_out = 1 − λ/(h − a)²: λ, m², and a, m, as printed in equation 7.
pub const GROUND_PRINTED: [f64; 2] = [0.00093, 0.4213];
/// a with which the equation gives what the text states, m.
pub const GROUND_A_CORRECTED_M: f64 = 0.2213;
/// Thrust ratio that the text states, and its height, m.
pub const GROUND_TEXT: (f64, Source) = (0.33, Source::number(0.92, "section on ground effect"));
