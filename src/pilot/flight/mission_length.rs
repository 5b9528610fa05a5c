//! How long a mission takes as planned, by what its setpoint does.
//!
//! A leg of `d` m from rest to rest with speed at most `v` m/s and acceleration `a` m/s² (`guidance/carrot.rs`) takes `d/v + v/a`, or
//! `2 √(d/a)` where `d < v²/a` is too short for `v`. Left out: turns on the spot, corners that are cut, what an
//! effect delays. Elementary kinematics.

use haltere_core::frames::{E, Vec3};

use super::mission::{Mission, MissionItem};
use crate::config::FlightConfig;

/// A setpoint that jumps is followed at about this speed, m/s (judgement).
const JUMP_MPS: f64 = 1.0;
/// From a setpoint that has arrived to a vehicle that has, s: with it the standard flights of the diagnosis last as long
/// as planned to a tenth (`gap::missions`, tests).
const SETTLE_S: f64 = 0.2;
/// Items after which a mission that jumps back is taken for endless: a hundred times `MOST_ITEMS`.
const MOST_STEPS: usize = 100_000;

impl Mission {
    /// Time from take-off to the floor as planned, s: legs at their speed, stays, doublets, and waits
    /// at their limit. Infinite where the mission waits or jumps for ever. `start_E_m`: where the
    /// vehicle stands.
    pub fn length_s(&self, start_E_m: Vec3<E>, flight: &FlightConfig) -> f64 {
        let mut plan = Walk {
            home_E_m: start_E_m,
            at_E_m: start_E_m,
            speed_mps: flight.cruise_speed_mps,
            flight,
        };
        let mut total_s = flight.spool_s;
        let mut jumps_made = vec![0_u32; self.items.len()];
        let mut current = 0;
        for _ in 0..MOST_STEPS {
            let Some(stored) = self.items.get(current) else { return total_s };
            if let MissionItem::Jump { to, times } = stored.item {
                // As guidance does: counted for each jump, never forgotten.
                match jumps_made.get_mut(current) {
                    Some(made) if times.is_none_or(|times| *made < times) => {
                        *made = made.saturating_add(1);
                        current = usize::from(to);
                    }
                    _ => current += 1,
                }
                continue;
            }
            total_s += plan.item_s(&stored.item);
            if matches!(stored.item, MissionItem::Return | MissionItem::Land { .. }) {
                return total_s;
            }
            current += 1;
        }
        f64::INFINITY
    }
}

/// Where the setpoint is, and how fast it goes.
struct Walk<'a> {
    /// Where it took off, and returns to.
    home_E_m: Vec3<E>,
    at_E_m: Vec3<E>,
    speed_mps: f64,
    flight: &'a FlightConfig,
}

impl Walk<'_> {
    fn item_s(&mut self, item: &MissionItem) -> f64 {
        match *item {
            MissionItem::Takeoff { height_m } => {
                let climb_m = height_m + self.at_E_m.z();
                self.at_E_m = Vec3::new(self.at_E_m.x(), self.at_E_m.y(), -height_m);
                climb_m.abs() / self.flight.takeoff_speed_mps + SETTLE_S
            }
            MissionItem::Waypoint { pos_E_m, hold_s, .. } => self.leg_s(pos_E_m) + hold_s,
            MissionItem::Delay { duration_s } => duration_s,
            MissionItem::Speed { speed_mps } => {
                self.speed_mps = speed_mps.unwrap_or(self.flight.cruise_speed_mps);
                0.0
            }
            MissionItem::Doublet(doublet) => doublet.length_s(),
            MissionItem::Tilt(step) => step.duration_s + SETTLE_S,
            MissionItem::UntilVoltage { limit_s, .. } => limit_s,
            MissionItem::Land { pos_E_m } => self.land_s(pos_E_m.unwrap_or(self.at_E_m)),
            MissionItem::Return => self.land_s(self.home_E_m),
            MissionItem::Yaw { .. } | MissionItem::Home | MissionItem::Jump { .. } => 0.0,
        }
    }

    /// From rest to rest with limited speed and acceleration.
    fn leg_s(&mut self, to_E_m: Vec3<E>) -> f64 {
        let distance_m = (to_E_m - self.at_E_m).norm();
        self.at_E_m = to_E_m;
        self.flight.travel_s(distance_m, self.speed_mps.min(JUMP_MPS)) + SETTLE_S
    }

    /// Over a place at the height it has, and down.
    fn land_s(&mut self, over_E_m: Vec3<E>) -> f64 {
        let height_m = (-self.at_E_m.z()).max(0.0);
        let leg_s = self.leg_s(Vec3::new(over_E_m.x(), over_E_m.y(), self.at_E_m.z()));
        leg_s + self.flight.landing_s(height_m) + SETTLE_S
    }
}

#[cfg(test)]
mod tests {
    use super::super::mission::StoredItem;
    use super::*;

    fn mission(items: &[MissionItem]) -> Mission {
        let stored = |item: &MissionItem| StoredItem { wire: Default::default(), item: *item };
        Mission { items: items.iter().map(stored).collect(), id: 1 }
    }

    fn length_s(items: &[MissionItem]) -> f64 {
        let flight = FlightConfig {
            cruise_speed_mps: 0.5,
            cruise_acceleration_mps2: 0.5,
            takeoff_speed_mps: 0.5,
            spool_s: 0.0,
            ..FlightConfig::default()
        };
        mission(items).length_s(Vec3::zero(), &flight)
    }

    fn to(north_m: f64, hold_s: f64) -> MissionItem {
        let pos_E_m = Vec3::new(north_m, 0.0, -1.0);
        MissionItem::Waypoint { pos_E_m, hold_s, acceptance_m: None, yaw_rad: None }
    }

    const UP: MissionItem = MissionItem::Takeoff { height_m: 1.0 };

    #[test]
    fn val_legs_stays_and_waits_add_up() {
        // 1 m at 0.5 m/s; then 2 m at 0.5 m/s with 0.5 m/s²: 4 s + 1 s; then 3 s.
        let up_s = 2.0 + SETTLE_S;
        assert!((length_s(&[UP]) - up_s).abs() < 1e-9);
        assert!((length_s(&[UP, to(2.0, 3.0)]) - (up_s + 5.0 + SETTLE_S + 3.0)).abs() < 1e-9);
        // Too short for the full speed: 2 √(0.125 m / 0.5 m/s²) = 1 s.
        assert!((length_s(&[UP, to(0.125, 0.0)]) - (up_s + 1.0 + SETTLE_S)).abs() < 1e-9);
        let wait = MissionItem::UntilVoltage { supply_v: 7.0, limit_s: 60.0 };
        assert!((length_s(&[UP, wait]) - (up_s + 60.0)).abs() < 1e-9);
    }

    #[test]
    fn val_a_jump_repeats_what_it_jumps_over() {
        let round = [UP, to(2.0, 0.0), to(0.0, 0.0)];
        let twice = [UP, to(2.0, 0.0), to(0.0, 0.0), MissionItem::Jump { to: 1, times: Some(2) }];
        let once_s = length_s(&round) - length_s(&[UP]);
        assert!((length_s(&twice) - (length_s(&[UP]) + 3.0 * once_s)).abs() < 1e-9);
        let ever = [UP, to(2.0, 0.0), MissionItem::Jump { to: 1, times: None }];
        assert_eq!(length_s(&ever), f64::INFINITY);
        // A jump to itself that never ends is no loop for us.
        assert_eq!(length_s(&[UP, MissionItem::Jump { to: 1, times: None }]), f64::INFINITY);
    }

    #[test]
    fn val_nothing_after_a_landing_counts() {
        let land = MissionItem::Land { pos_E_m: None };
        let home = MissionItem::Land { pos_E_m: Some(Vec3::zero()) };
        assert_eq!(
            length_s(&[UP, to(2.0, 0.0), MissionItem::Return]),
            length_s(&[UP, to(2.0, 0.0), home])
        );
        assert!(length_s(&[UP, to(2.0, 0.0), home]) > length_s(&[UP, to(2.0, 0.0), land]) + 4.0);
        assert_eq!(length_s(&[UP, land]), length_s(&[UP, land, to(2.0, 100.0)]));
        assert!(length_s(&[UP, to(1.0, f64::INFINITY), land]).is_infinite());
    }
}
