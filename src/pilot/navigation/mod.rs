//! Where the vehicle is: the tag, the estimator, and what is found of floor, room and sensors beside it.

pub(crate) mod before;
pub(crate) mod carried;
pub(crate) mod heading;
pub(crate) mod ingest;
pub(crate) mod magnetics;
pub(crate) mod reference;
pub(crate) mod rooms;
pub(crate) mod survey_check;
pub mod uwb;
