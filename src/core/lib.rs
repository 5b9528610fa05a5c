//! The filter and the controller of haltere, with the types that everything else speaks in. It opens nothing, waits for
//! no clock, draws no random number and knows no wire format: measurements and times come in, estimates and setpoints go
//! out.
//!
//! Begin with [`frames`] and [`time`]: vectors carry their frame, and three clocks do not mix. In [`estimator`] `predict.rs`
//! carries nine states on, each sensor has a file that says what it measures, and `update.rs` alone fuses into the
//! covariance; biases of anchors and what lasts beyond drag are further states, off unless configured. In [`control`]
//! `controller.rs` is the cascade, each enhancement has a file, and `margins` judges a set of gains.
//!
//! ```
//! use haltere_core::estimator::{Estimator, EstimatorConfig};
//! use haltere_core::frames::{G_MPS2, Vec3};
//! use haltere_core::measure::{AnchorId, ImuSample, Tdoa};
//! use haltere_core::survey::Survey;
//! use haltere_core::time::HostTime;
//!
//! // Eight anchors in the corners of a hall, m north, east and down; the vehicle stands in it.
//! let corner = |i: u8, bit: u8, size_m: f64| if i & bit != 0 { size_m } else { 0.0 };
//! let anchors: Vec<_> = (0..8)
//!     .map(|i| (AnchorId(i), Vec3::new(corner(i, 1, 8.0), corner(i, 2, 10.0), -corner(i, 4, 5.0))))
//!     .collect();
//! let survey = Survey::new(&anchors)?;
//! let stands_E_m = Vec3::new(3.0, 4.0, -0.1);
//! let distance_m = |id| survey.position_E_m(id).map_or(0.0, |at_E_m| (stands_E_m - at_E_m).norm());
//!
//! let mut filter = Estimator::new(EstimatorConfig::default(), survey.clone());
//! // Rest shows what is level, and no heading.
//! filter.set_initial_heading(0.0, 0.1);
//! for step in 0..1000_u64 {
//!     let at = HostTime::from_us(1_000_000 + 4_000 * step);
//!     let (a, b) = (AnchorId((step % 8) as u8), AnchorId(((step + 1) % 8) as u8));
//!     filter.imu(&ImuSample {
//!         valid_at: at,
//!         received_at: at,
//!         acc_B_mps2: Vec3::new(0.0, 0.0, -G_MPS2),
//!         rate_B_radps: Vec3::new(0.0, 0.0, 0.0),
//!     });
//!     filter.tdoa(&Tdoa {
//!         valid_at: at,
//!         received_at: at,
//!         anchor_a: a,
//!         anchor_b: b,
//!         distance_diff_m: distance_m(b) - distance_m(a),
//!         std_m: None,
//!     });
//! }
//! let found_E_m = filter.estimate().pos_E_m;
//! assert!(filter.is_aligned() && (found_E_m - stands_E_m).norm() < 0.1, "{found_E_m:?}");
//! # Ok::<(), haltere_core::checks::Problems>(())
//! ```

pub mod checks;
pub mod control;
pub mod drops;
pub mod estimate;
pub mod estimator;
pub mod frames;
pub mod geo;
pub mod keys;
pub mod measure;
pub mod survey;
pub mod time;
pub mod topics;
