//! What was flown: logs are written, read, lived through again and given to other programs, and recordings of others are
//! read. It never flies, judges or draws anything.
//!
//! Begin with [`record`]: `recorder` is the side of the flight, `scribe` the thread that writes, `reader` steps over what is
//! damaged, `outline` tells by head and tail what a log holds, `haltere.proto` is the format. [`replay`] compares every
//! outgoing byte, for another build by link and message; [`export`] makes tables; [`import`] brings recordings of others to
//! one form, where signs and units are turned. [`written`] is the one writer of files and [`intake`] the one way in.
//!
//! ```
//! use haltere_core::frames::Vec3;
//! use haltere_core::measure::AnchorId;
//! use haltere_core::survey::Survey;
//! use haltere_core::time::HostTime;
//! use haltere_log::record::{BuildIdentity, Recorder, Session};
//! use haltere_log::replay::replay;
//! use haltere_pilot::settings::Config;
//! use haltere_pilot::{Input, Pilot};
//!
//! let corner = |i: u8, bit: u8, size_m: f64| if i & bit != 0 { size_m } else { 0.0 };
//! let anchors: Vec<_> = (0..8)
//!     .map(|i| (AnchorId(i), Vec3::new(corner(i, 1, 8.0), corner(i, 2, 10.0), -corner(i, 4, 5.0))))
//!     .collect();
//! let survey = Survey::new(&anchors)?;
//! let config = Config::default();
//! let begin = HostTime::from_us(1_000_000);
//! let session = Session {
//!     build: BuildIdentity::current(),
//!     started_unix_us: 1_700_000_000_000_000,
//!     pilot_started_at: begin,
//!     config_toml: config.to_log(&survey),
//!     survey: survey.clone(),
//! };
//!
//! // One second of a core that hears nothing, written down with what it sends …
//! let folder = tempfile::tempdir()?;
//! let mut recorder = Recorder::start_waiting(folder.path(), &session)?;
//! let mut pilot = Pilot::new(config.pilot(), survey, begin);
//! while pilot.next_deadline() < begin.offset_us(1_000_000) {
//!     let at = pilot.next_deadline();
//!     recorder.input(at, Input::Wake);
//!     pilot.handle(at, Input::Wake);
//!     pilot.drain_output(|link, bytes| recorder.output(at, link, bytes));
//!     recorder.commit(at);
//! }
//! let log = recorder.finish().path.expect("a log");
//!
//! // … and lived through again: every byte is the same.
//! let report = replay(&log)?;
//! assert_eq!((report.outputs_identical, report.exit_code()), (report.outputs, 0));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

pub mod export;
pub mod import;
pub mod intake;
pub mod log_file;
pub mod record;
pub mod replay;
pub mod written;
