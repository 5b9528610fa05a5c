//! The flight: modes, guidance, mission, controller, and what ends it.

pub(crate) mod arming;
pub(crate) mod at_rest;
pub(crate) mod awaited;
pub(crate) mod change;
pub(crate) mod check_report;
pub(crate) mod ending;
pub(crate) mod event_list;
pub(crate) mod excitation;
pub(crate) mod fence;
pub(crate) mod guidance;
pub(crate) mod hover;
pub(crate) mod landing_ramp;
pub(crate) mod manual;
pub(crate) mod mission;
pub mod mission_file;
pub(crate) mod mission_items;
pub(crate) mod mission_length;
pub(crate) mod modes;
pub(crate) mod place;
pub(crate) mod plans;
pub(crate) mod rally;
pub(crate) mod resume;
pub(crate) mod setpoint;
pub(crate) mod shadow;
pub(crate) mod shown_modes;
pub(crate) mod supervise;
pub(crate) mod supervisor;
pub(crate) mod tilt_step;

use haltere_core::control::{Command, ControlInput, ControlOutput, Controller, HeldTilt, margins};
use haltere_core::survey::Survey;
use haltere_core::time::HostTime;
use haltere_core::topics::ControlRecord;

use crate::config::PilotConfig;
use crate::view::{Around, Thrust};

use ending::Ending;
use guidance::Guidance;
use hover::HoverThrust;
use mission::Mission;
use modes::Mode;
use plans::Plans;
use resume::Resumption;
use shadow::Shadow;
use supervisor::Supervisor;
use tilt_step::Envelope;

/// The mode in force, and what flies by it.
#[derive(Debug)]
pub(crate) struct Flight {
    pub(crate) mode: Mode,
    pub(crate) mode_since: HostTime,
    pub(crate) supervisor: Supervisor,
    pub(crate) guidance: Guidance,
    pub(crate) mission: Mission,
    pub(crate) plans: Plans,
    pub(crate) controller: Controller,
    /// Why nothing may fly with the gains in force.
    pub(crate) gains_refusal: Option<String>,
    pub(crate) control: ControlRecord,
    pub(crate) hover: HoverThrust,
    pub(crate) shadow: Shadow,
    pub(crate) resumption: Resumption,
    pub(crate) lift_off_asked: bool,
    /// What was asked for while the board flew by itself: land as soon as control is back.
    pub(crate) land_when_back: bool,
    /// The program was asked to end.
    pub(crate) ending: Option<Ending>,
    /// Height above the floor while the estimate could be trusted, m.
    pub(crate) last_height_m: f64,
    /// Height at which the landing began, m.
    pub(crate) land_from_m: f64,
    /// Sinking speed at that time, m/s.
    pub(crate) last_sink_mps: f64,
    /// Since when the estimate is good again in a blind descent.
    pub(crate) good_since: Option<HostTime>,
}

impl Flight {
    pub(crate) fn new(config: &PilotConfig, survey: &Survey, at: HostTime) -> Self {
        let envelope = Envelope::of(config, survey);
        let velocity_limit_mps = config.control.limits.horizontal_mps;
        Self {
            mode: Mode::Disarmed,
            mode_since: at,
            supervisor: Supervisor::default(),
            guidance: Guidance::new(config.flight.clone(), envelope, velocity_limit_mps, at),
            mission: Mission::default(),
            plans: Plans::new(config.origin.in_force()),
            controller: Controller::new(config.control.clone()),
            gains_refusal: margins::refusal(&config.control),
            control: ControlRecord::default(),
            hover: HoverThrust::default(),
            shadow: Shadow::default(),
            resumption: Resumption::default(),
            lift_off_asked: false,
            land_when_back: false,
            ending: None,
            last_height_m: 0.0,
            land_from_m: 0.0,
            last_sink_mps: 0.0,
            good_since: None,
        }
    }

    /// Whether a vehicle stands that nobody flies.
    pub(crate) fn is_standing(&self) -> bool {
        !self.mode.has_thrust() && self.mode != Mode::Yielded && !self.shadow.airborne
    }

    /// Thrust that hovers at the present voltage, as far as it is known, 0 to 1.
    pub(crate) fn hover_thrust_frac(&self, config: &PilotConfig) -> f64 {
        let most = config.control.limits.thrust_max_frac;
        (self.control.thrust_base_frac * self.hover.factor()).min(most)
    }

    /// A step of the controller towards a command.
    pub(crate) fn run_controller(
        &mut self,
        around: &Around<'_>,
        command: &Command,
        dt_s: f64,
        integrators_frozen: bool,
        held: Option<HeldTilt>,
    ) -> ControlOutput {
        let view = around.view(self);
        self.controller.step(&ControlInput {
            at: around.at,
            estimate: around.estimate,
            command,
            supply_v: around.board.supply_v(around.at),
            height_above_ground_m: around.height_above_floor_m(),
            dt_s,
            integrators_frozen,
            thrust_ceiling_frac: around.navigation.thrust_ceiling_frac(&view),
            held,
        })
    }

    /// The thrust of the newest control step, for who looks at it.
    pub(crate) fn thrust(&self, config: &PilotConfig) -> Thrust {
        Thrust {
            sent_frac: self.control.thrust_frac,
            base_frac: self.control.thrust_base_frac,
            hover_frac: self.hover_thrust_frac(config),
            ground_factor: self.control.ground_factor,
        }
    }
}
