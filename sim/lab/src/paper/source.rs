//! Numbers of the source, each with its place in it.
//!
//! G. González, G. C. H. E. de Croon, D. Olejnik, M. Karásek: "Position controller for a
//! flapping-wing drone using UWB", IMAV 2021, pages 85 to 92. Of its figures we have what its text says of them.

use super::results::Source;

/// Angles of the steps, degrees: pitch and roll.
pub const ANGLES_DEG: [[f64; 5]; 2] =
    [[12.0, 22.0, 33.0, 45.0, 52.0], [12.0, 22.0, 33.0, 47.0, 52.0]];
/// From this angle on the source's last measured speed is still a part of the transient, degrees.
pub const TRANSIENT_FROM_DEG: f64 = 45.0;
/// Table 1, m/s: pitch and roll; by share of the data (10, 30, 50, 70, 90 %); by angle.
pub const TABLE_1_MPS: [[[f64; 5]; 5]; 2] = [
    [
        [0.124, 0.0752, 0.1842, 0.2641, 0.276],
        [0.0318, 0.0459, 0.0347, 0.1899, 0.1259],
        [0.0166, 0.0636, 0.015, 0.2048, 0.0038],
        [0.0183, 0.0632, 0.0282, 0.1379, 0.0402],
        [0.0142, 0.0561, 0.0289, 0.0857, 0.0185],
    ],
    [
        [0.1007, 0.1479, 0.0391, 0.2972, 0.3028],
        [0.10, 0.1216, 0.0452, 0.2303, 0.2366],
        [0.0262, 0.1427, 0.0325, 0.0499, 0.0849],
        [0.0234, 0.0802, 0.0378, 0.0486, 0.095],
        [0.0268, 0.0247, 0.0261, 0.0266, 0.0757],
    ],
];
/// Motions of table 2.
pub const MOTIONS: [&str; 5] = ["X", "Y", "Z", "XZ", "YZ"];
/// Table 2, m: constant P, constant PI, variable P, variable PI; X, Y, Z, XZ, YZ and overall; mean absolute error and
/// standard deviation of the height.
pub const TABLE_2_M: [[[f64; 2]; 6]; 4] = [
    [[0.109, 0.08], [0.098, 0.075], [0.077, 0.117], [0.035, 0.166], [0.043, 0.143], [0.072, 0.116]],
    [[0.061, 0.159], [0.048, 0.093], [0.06, 0.075], [0.047, 0.09], [0.047, 0.1175], [0.053, 0.107]],
    [
        [0.114, 0.069],
        [0.086, 0.079],
        [0.065, 0.069],
        [0.057, 0.116],
        [0.046, 0.1038],
        [0.074, 0.09],
    ],
    [[0.049, 0.107], [0.025, 0.083], [0.06, 0.056], [0.05, 0.092], [0.037, 0.061], [0.044, 0.08]],
];
/// Table 3: position, m, then velocity, m/s; by size (1 m, 2 m) and axis; `raw`, then `modified`.
pub const TABLE_3: [[[[f64; 2]; 3]; 2]; 2] = [
    [
        [[0.1706, 0.105], [0.1898, 0.1048], [0.0496, 0.043]],
        [[0.3316, 0.1978], [0.2989, 0.2055], [0.1245, 0.1097]],
    ],
    [
        [[0.3945, 0.1297], [0.3001, 0.1199], [0.1001, 0.0892]],
        [[0.6330, 0.2859], [0.4583, 0.1802], [0.2476, 0.1613]],
    ],
];
/// Error of `raw` over that of `modified`, all of table 3.
pub const GAIN: Source = Source::number(1.5, "abstract, section 7");
/// Mean absolute error of position in x and y.
pub const LEVEL_M: Source = Source::number(0.10, "abstract");
/// The same in z: the cell of `raw` for 1 m in table 3, where `modified` has 4.3 cm.
pub const HEIGHT_M: Source = Source::number(0.049, "abstract");
/// How much smaller most peaks of the velocity error of `modified` are.
pub const PEAKS: Source = Source::number(0.75, "figure 10");
/// What the variable UWB noise takes off the error on the floor, each axis.
pub const NOISE_GAIN_M: Source = Source::number(0.2, "figure 3");
/// A complementary filter settles at a drift, the filter with UWB at zero: how much more the first is off.
pub const DRIFT: Source = Source { range: [1.0, f64::INFINITY], origin: "section 4" };
/// Mean absolute error on the four path shapes.
pub const PATHS_M: Source = Source { range: [0.08, 0.10], origin: "section 4" };
/// R² of thrust over voltage, orders 1 to 3.
pub const THRUST_R2: Source = Source::number(0.756, "figure 7");
/// Starting values of the drag law θ = a + b·e^(−c·v): degrees, degrees, s/m.
pub const DRAG_START: [f64; 3] = [-90.0, 90.0, 0.3];
/// Ground effect T_in/T_out = 1 − λ/(h − a)²: λ, m², and a, m, as printed in equation 7.
pub const GROUND_PRINTED: [f64; 2] = [0.00093, 0.4213];
/// a with which the equation gives what the text states, m.
pub const GROUND_A_CORRECTED_M: f64 = 0.2213;
/// Thrust ratio that the text states, and its height, m.
pub const GROUND_TEXT: (f64, Source) = (0.33, Source::number(0.92, "figure 9"));
