//! The flight: modes, guidance, mission, controller, and what ends it.

pub(crate) mod arming;
pub(crate) mod at_rest;
pub(crate) mod awaited;
pub(crate) mod change;
pub(crate) mod ending;
pub(crate) mod excitation;
pub(crate) mod fence;
pub(crate) mod guidance;
pub(crate) mod home;
pub(crate) mod hover;
pub(crate) mod landing_ramp;
pub(crate) mod manual;
pub(crate) mod mission;
pub mod mission_file;
pub(crate) mod mission_items;
pub(crate) mod mission_length;
pub(crate) mod modes;
pub(crate) mod place;
pub(crate) mod rally;
pub(crate) mod resume;
pub(crate) mod setpoint;
pub(crate) mod shadow;
pub(crate) mod supervise;
pub(crate) mod supervisor;
pub(crate) mod tilt_step;
