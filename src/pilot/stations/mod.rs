//! Ground stations and clients: their links, who may command, what they are answered, sent and served.

pub(crate) mod anew;
pub(crate) mod clients;
pub(crate) mod commands;
pub(crate) mod endpoint;
pub(crate) mod ground;
pub mod guard;
pub(crate) mod identity;
pub(crate) mod mission_transfer;
pub(crate) mod orders;
pub(crate) mod permits;
pub(crate) mod radio;
pub(crate) mod routing;
pub mod services;
pub(crate) mod streams;
pub(crate) mod telemetry;
pub(crate) mod telemetry_counts;
pub(crate) mod telemetry_estimator;
pub(crate) mod telemetry_global;
pub(crate) mod telemetry_imu;
pub(crate) mod unheard;
