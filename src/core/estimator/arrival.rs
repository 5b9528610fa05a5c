//! The error of one arrival at the tag, which two measurements share.
//!
//! **Equation.** A difference of distances is made of two arrivals, `z = … + e_b − e_a + noise`. The newest packet is
//! the later one of its own measurement and the earlier one of the next, or of two from one packet: neighbours in
//! the stream are correlated, by −f where they hand an anchor on and by +f where both have the same later one,
//!
//! ```text
//! var e = f R,   var of what else is in z = R − f R (for each arrival that has a state)
//! ```
//!
//! with R the whole variance of z. So the errors of the newest arrivals are states for as long as they can come again:
//! the joint update of a set of measurements, one at a time.
//!
//! **Symbols.** e error of an arrival, m; f share of the variance that is one arrival's. **Source.** Coloured noise by
//! further states: Bryson and Henrikson, "Estimation using sampled data containing sequentially correlated noise",
//! J. Spacecraft and Rockets 5(6), 1968. f from the recordings of UTIL, errors against motion capture less the mean
//! of the pair's four neighbours: by TDoA2 (ten flights) −0.14 to −0.20 from one measurement to the next, less than
//! 0.01 to the one after; by TDoA3 (two) −0.06 to −0.19, and +0.16 and +0.44 with the same earlier arrival. There it
//! changes nothing that matters (docs/ESTIMATOR.md): what limits the filter is not white. So it is off.
//! **Left out.** The third arrival of a measurement, that of a's packet at b; how noise depends on the received power.

use super::bias::{Biases, Pair};
use super::state::STATES;
use crate::time::HostTime;

/// Arrivals that are kept: by TDoA2 a measurement shares one with each of its neighbours.
pub const SLOTS: usize = 2;

/// An arrival that has a state.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Slot {
    /// Place of its anchor in the survey; none: no arrival yet.
    pub anchor: Option<usize>,
    /// When the measurement came that it was the later one of.
    pub at: HostTime,
    /// Variance of its error before anything was measured, m².
    pub var_m2: f64,
}

const EMPTY: Slot = Slot { anchor: None, at: HostTime::from_us(0), var_m2: 0.0 };

/// States of the arrivals in a measurement: of the earlier one, which is subtracted, and of the later.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Arrivals {
    /// Of the anchor that is subtracted.
    pub a: Option<usize>,
    /// Of the one that is added.
    pub b: Option<usize>,
}

impl Biases {
    /// Begins anew with none, if they have states.
    pub fn forget_arrivals(&mut self) {
        if self.arrivals.is_some() {
            self.arrivals = Some([EMPTY; SLOTS]);
            for slot in 0..SLOTS {
                self.clear_arrival(slot, 0.0);
            }
        }
    }

    /// Gives arrivals states, or takes them.
    pub fn keep_arrivals(&mut self, keep: bool) {
        self.arrivals = keep.then_some([EMPTY; SLOTS]);
        self.forget_arrivals();
    }

    fn clear_arrival(&mut self, slot: usize, var_m2: f64) {
        let (row, rows) = (self.arrival_row(slot), self.rows());
        self.value[row] = 0.0;
        self.cross[row] = [0.0; STATES];
        for j in 0..rows {
            self.own[row][j] = 0.0;
            self.own[j][row] = 0.0;
        }
        self.own[row][row] = var_m2;
    }

    #[inline]
    fn arrival_row(&self, slot: usize) -> usize {
        self.gyro_row() + self.gyro + slot
    }

    /// The rows of arrivals in a measurement, with their signs.
    #[inline]
    pub(super) fn arrival_rows(
        &self,
        arrivals: Arrivals,
    ) -> impl Iterator<Item = (usize, f64)> + use<> {
        let first = self.arrival_row(0);
        let b = arrivals.b.map(|slot| (first + slot, 1.0));
        b.into_iter().chain(arrivals.a.map(|slot| (first + slot, -1.0)))
    }

    /// What arrivals with a state add to a difference of distances, m.
    #[inline]
    pub fn arrivals_m(&self, arrivals: Arrivals) -> f64 {
        self.arrival_rows(arrivals).map(|(row, sign)| sign * self.value[row]).sum()
    }

    /// How much of a measurement's variance is theirs, m².
    #[inline]
    pub fn var_of_arrivals_m2(&self, arrivals: Arrivals) -> f64 {
        let Some(slots) = &self.arrivals else { return 0.0 };
        [arrivals.a, arrivals.b].iter().flatten().map(|slot| slots[*slot].var_m2).sum()
    }

    /// The states of a measurement's arrivals. That of the later one is new, with this variance, m², unless the same
    /// packet has given a measurement before.
    #[inline]
    pub fn arrive(&mut self, pair: Pair, at: HostTime, var_m2: f64) -> Arrivals {
        let Some(slots) = self.arrivals else { return Arrivals::default() };
        let of = |anchor: usize| slots.iter().position(|slot| slot.anchor == Some(anchor));
        let a = of(pair.a);
        if let Some(same) = of(pair.b).filter(|slot| slots[*slot].at == at) {
            return Arrivals { a, b: Some(same) };
        }
        // The oldest that is not in this measurement makes room; an older packet of the same anchor does first.
        let oldest =
            || (0..SLOTS).filter(|slot| Some(*slot) != a).min_by_key(|slot| slots[*slot].at);
        let Some(b) = of(pair.b).or_else(oldest) else { return Arrivals { a, b: None } };
        if let Some(slots) = &mut self.arrivals {
            slots[b] = Slot { anchor: Some(pair.b), at, var_m2 };
        }
        self.clear_arrival(b, var_m2);
        Arrivals { a, b: Some(b) }
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{Matrix2, SMatrix, UnitQuaternion, Vector3};

    use super::*;
    use crate::estimator::state::{ATT, POS, State, VEL};
    use crate::estimator::truth::geometry;
    use crate::estimator::update::Observation;
    use crate::estimator::{tdoa, update};

    const VAR_M2: f64 = 0.04;
    const FRAC: f64 = 0.2;

    fn start() -> State {
        let q = UnitQuaternion::from_euler_angles(0.1, -0.2, 0.7);
        let mut state = State::at_pose(Vector3::new(3.0, 4.0, -2.0), q, 0.5, 0.4, 0.1);
        state.biases.keep_arrivals(true);
        state
    }

    /// As the estimator does it, without innovation.
    fn fuse(state: &mut State, a: u8, b: u8, at_us: u64) -> Observation {
        let g = geometry(a, b, Vector3::new(0.02, 0.01, -0.1), 0.01);
        let mut o = tdoa::observe(state, &g, 0.0, None, VAR_M2).unwrap();
        let pair = Pair { a: usize::from(a), b: usize::from(b) };
        o.innovation = 0.0;
        o.arrivals = state.biases.arrive(pair, HostTime::from_us(at_us), FRAC * VAR_M2);
        o.var = VAR_M2 - state.biases.var_of_arrivals_m2(o.arrivals);
        update::fuse(state, &o);
        o
    }

    /// Two measurements at once, their errors correlated.
    fn jointly(before: &State, os: [Observation; 2], correlation: f64) -> super::super::state::Cov {
        let mut h = SMatrix::<f64, 2, STATES>::zeros();
        for (i, o) in os.iter().enumerate() {
            for k in 0..3 {
                h[(i, POS + k)] = o.h_pos[k];
                h[(i, VEL + k)] = o.h_vel[k];
                h[(i, ATT + k)] = o.h_att[k];
            }
        }
        let r = Matrix2::new(1.0, correlation, correlation, 1.0) * VAR_M2;
        let s = h * before.P * h.transpose() + r;
        let pht = before.P * h.transpose();
        before.P - pht * s.try_inverse().unwrap() * pht.transpose()
    }

    #[test]
    fn prop_one_after_the_other_is_the_joint_update_of_correlated_measurements() {
        // The next packet; two pairs of one packet; two that share nothing.
        for (second, at_us, correlation) in
            [((2, 3), 2000, -FRAC), ((4, 2), 1000, FRAC), ((4, 5), 2000, 0.0)]
        {
            let before = start();
            let mut state = before.clone();
            let first = fuse(&mut state, 1, 2, 1000);
            let second = fuse(&mut state, second.0, second.1, at_us);
            let off = (state.P - jointly(&before, [first, second], correlation)).amax();
            assert!(off < 1e-12, "{correlation}: {off}");
        }
    }

    #[test]
    fn prop_an_arrival_that_is_replaced_is_forgotten() {
        let mut state = start();
        for (k, (a, b)) in [(1, 2), (2, 3), (3, 4)].into_iter().enumerate() {
            fuse(&mut state, a, b, 1000 * (k as u64 + 1));
        }
        // The arrival of 2 has gone: that of 4 took its place.
        let o = fuse(&mut state, 2, 6, 9000);
        assert_eq!((o.arrivals.a, o.var), (None, VAR_M2 * (1.0 - FRAC)));
        // Without states nothing is shared.
        let mut plain = start();
        plain.biases.keep_arrivals(false);
        let pair = Pair { a: 1, b: 2 };
        assert_eq!(plain.biases.arrive(pair, HostTime::from_us(1), 1.0), Arrivals::default());
        assert!(plain.biases.is_empty());
    }
}
