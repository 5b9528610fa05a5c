//! Physics for simulation, fits and diagnosis: the vehicle, its inner-loop board and the UWB tag,
//! as one deterministic plant that eats and emits the bytes of the real links.
//!
//! ```text
//! board bytes ─► board (500 Hz loops) ─► wings ─► forces ─► rigid body ─► truth
//!                    ▲ attitude, IMU                              │
//!                    └──────────────── effects ◄──────────────────┤
//!                                         └─► anchors, tag ─► tag bytes
//! ```
//!
//! Every physical effect is one file in [`effects`]; [`effects::ALL`] is the one list of them.
//! The pilot core in it, on the same clock, is [`lockstep`]; nothing else here sees the pilot.
//! No clock, no I/O; random numbers come from generators seeded per effect, so that switching one
//! effect on does not shift the draws of another.
//!
//! Begin with `effects/mod.rs` and `lockstep/flight.rs`. [`plant`] joins `body`, `wings`, `servo`, the simulated board
//! (`board/`: `persona` a kind of firmware, `lies` what it says that is not so) and the tag (`tag/`); [`faults`] is what
//! breaks. [`vehicle`] is what a vehicle file holds, `vehicle_file` reads one, `left_out` has the laws by which what a file
//! leaves out follows from what it says, and `instruments` the tables of inner loops, IMU, radio and lines.
//!
//! ```
//! use haltere_dialect::mav::haltere::MavCmd;
//! use haltere_model::PlantConfig;
//! use haltere_model::lockstep::{Lockstep, fly, local_item};
//! use haltere_pilot::PilotConfig;
//!
//! // A vehicle in a hall of 10 × 10 × 7 m, by seed 1, and a core that knows how high it stands.
//! let plant = PlantConfig::hall(1);
//! let mut pilot = PilotConfig::default();
//! pilot.flight.gear_height_m = plant.vehicle.body.gear_m;
//! let survey = plant.survey.clone();
//! let mut world = Lockstep::new(plant, pilot, &survey)?;
//!
//! let items = [
//!     local_item(MavCmd::MAV_CMD_NAV_TAKEOFF, [5.0, 5.0, -1.2], 0.0),
//!     local_item(MavCmd::MAV_CMD_NAV_WAYPOINT, [5.5, 5.0, -1.2], 1.0),
//!     local_item(MavCmd::MAV_CMD_NAV_LAND, [5.5, 5.0, 0.0], 0.0),
//! ];
//! let flight = fly(&mut world, &items, 60.0)?;
//! assert!(flight.landed && !world.truth().crashed, "{:?}", flight.texts);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

pub mod board;
pub mod body;
pub mod effects;
pub mod faults;
pub mod gust;
pub mod instruments;
pub mod left_out;
pub mod line_noise;
pub mod link;
pub mod lockstep;
pub mod magnetometer;
pub mod plant;
pub mod random;
pub mod room;
pub mod rotorcraft;
pub mod servo;
pub mod tag;
pub mod truth;
pub mod vehicle;
mod vehicle_file;
mod waiting;
pub mod wings;

pub use effects::EffectSet;
pub use faults::Fault;
pub use plant::{Plant, PlantConfig};
pub use truth::Truth;
pub use vehicle::Vehicle;
