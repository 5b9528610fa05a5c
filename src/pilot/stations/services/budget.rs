//! How much of a link the services may use: lists and files wait, telemetry and control do not.

/// Frames of services in one control step. A link's queue holds 64 and counts as full beyond 16; the rest is
/// telemetry's.
const FRAMES_PER_STEP: usize = 24;
/// Bytes of services in one control step where no line limits: [`FRAMES_PER_STEP`] of the longest.
const BYTES_PER_STEP: f64 = FRAMES_PER_STEP as f64 * LONGEST_FRAME_BYTES;
/// The longest frame of MAVLink 2: header 10, payload 255, checksum 2, signature 13.
const LONGEST_FRAME_BYTES: f64 = 280.0;
/// Share of a line that services may use.
const SHARE: f64 = 0.5;
/// Control steps in a second.
const STEPS_PER_S: f64 = 100.0;

/// What may still be sent in this step.
#[derive(Debug)]
pub(crate) struct Budget<'a> {
    frames: usize,
    credit_bytes: &'a mut f64,
}

impl Budget<'_> {
    /// Takes a frame of this size out of it, if it is in there.
    pub fn take(&mut self, bytes: usize) -> bool {
        let bytes = bytes as f64;
        if self.frames == 0 || *self.credit_bytes < bytes {
            return false;
        }
        self.frames -= 1;
        *self.credit_bytes -= bytes;
        true
    }
}

/// Credit of one link: a slow line saves up for a frame over several steps.
#[derive(Debug, Default)]
pub(crate) struct Bucket {
    credit_bytes: f64,
}

impl Bucket {
    /// The budget of the next step, on a line that carries so many bytes/s; nothing while there is no room for more.
    pub fn step(&mut self, line_Bps: Option<f64>, has_room: bool) -> Budget<'_> {
        let per_step = line_Bps
            .map_or(BYTES_PER_STEP, |bps| (SHARE * bps / STEPS_PER_S).clamp(0.0, BYTES_PER_STEP));
        let most = per_step.max(LONGEST_FRAME_BYTES);
        self.credit_bytes = (self.credit_bytes + per_step).min(most);
        let frames = if has_room { FRAMES_PER_STEP } else { 0 };
        Budget { frames, credit_bytes: &mut self.credit_bytes }
    }
}
