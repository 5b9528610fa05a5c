//! When a processor of this computer stood still, whatever it was asked to do.
//!
//! A computer that is itself a guest is put aside now and then by its host: for that time nothing runs on
//! it, the companion no more than anything else. One thread for each processor, above everything that is
//! measured, wakes each millisecond and notes when it could not. What it cannot tell apart from the host is
//! the kernel with interrupts off.

use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;

use anyhow::{Context, Result};
use haltere::live::clock;
use haltere::live::realtime::insist_on_deadlines;
use rustix::thread::{CpuSet, sched_getaffinity, sched_setaffinity};

use haltere::rig::stop::Stop;

/// Above the companion's control thread, which has 50, and below the kernel's own threads of 99.
const PRIORITY: u8 = 80;
const PERIOD_US: i64 = 1_000;
/// Waking later than this is standing still, µs: ten times the 99 % of an undisturbed timer here.
const LATE_US: u64 = 1_500;

/// A time during which a processor did nothing, µs of the monotonic clock.
pub type Stall = [u64; 2];

/// The watch over all processors; ends when dropped.
#[derive(Debug)]
pub struct Watch {
    stalls: Arc<Mutex<Vec<Stall>>>,
    stop: Stop,
    threads: Vec<JoinHandle<()>>,
}

impl Watch {
    /// Begins to watch. Without real-time scheduling it watches nothing: then it would only see that other
    /// threads have their turn, those of the companion among them.
    pub fn start() -> Result<Self> {
        let mut watch = Self { stalls: Arc::default(), stop: Stop::default(), threads: Vec::new() };
        let allowed = sched_getaffinity(None).context("the processors of this process")?;
        for cpu in (0..CpuSet::MAX_CPU).filter(|cpu| allowed.is_set(*cpu)) {
            let (stalls, stop) = (watch.stalls.clone(), watch.stop.clone());
            let thread = std::thread::Builder::new().name(format!("processor {cpu}"));
            let thread = thread.spawn(move || {
                let mut only = CpuSet::new();
                only.set(cpu);
                if sched_setaffinity(None, &only).is_ok() && insist_on_deadlines(PRIORITY).is_ok() {
                    sleep_and_note(&stalls, &stop);
                }
            });
            watch.threads.push(thread.context("a thread for a processor")?);
        }
        Ok(watch)
    }

    /// Forgets what was noted so far, and gives it.
    pub fn take(&self) -> Stalls {
        Stalls::of(std::mem::take(&mut *self.stalls.lock().unwrap_or_else(PoisonError::into_inner)))
    }
}

impl Drop for Watch {
    fn drop(&mut self) {
        self.stop.ask();
        for thread in self.threads.drain(..) {
            let _ = thread.join();
        }
    }
}

fn sleep_and_note(stalls: &Mutex<Vec<Stall>>, stop: &Stop) {
    let mut deadline = clock::now();
    while !stop.asked() {
        deadline = deadline.offset_us(PERIOD_US);
        clock::sleep_until(deadline);
        let woke = clock::now();
        if woke.as_us().saturating_sub(deadline.as_us()) > LATE_US {
            let stall = [deadline.as_us(), woke.as_us()];
            stalls.lock().unwrap_or_else(PoisonError::into_inner).push(stall);
            deadline = woke;
        }
    }
}

/// Stalls of all processors in order of time; what stood still together did so once.
#[derive(Debug, Default, Clone)]
pub struct Stalls(Vec<Stall>);

impl Stalls {
    pub fn of(mut all: Vec<Stall>) -> Self {
        all.sort_unstable();
        let mut merged: Vec<Stall> = Vec::with_capacity(all.len());
        for [from, to] in all {
            match merged.last_mut() {
                Some(last) if from <= last[1] => last[1] = last[1].max(to),
                _ => merged.push([from, to]),
            }
        }
        Self(merged)
    }

    /// How much of the time between two points any processor stood still, µs.
    pub fn stood_us(&self, from_us: u64, to_us: u64) -> u64 {
        let first = self.0.partition_point(|[_, to]| *to <= from_us);
        let within = self.0.iter().skip(first).take_while(|[from, _]| *from < to_us);
        within.map(|[from, to]| (*to).min(to_us).saturating_sub((*from).max(from_us))).sum()
    }

    /// Of each, ms.
    pub fn durations_ms(&self) -> Vec<f64> {
        self.0.iter().map(|[from, to]| to.saturating_sub(*from) as f64 * 1e-3).collect()
    }

    /// Takes others in.
    pub fn join(&mut self, other: Self) {
        self.0.extend(other.0);
        *self = Self::of(std::mem::take(&mut self.0));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prop_standing_still_counts_once_and_within() {
        let stalls = Stalls::of(vec![[50, 70], [10, 30], [20, 40]]);
        assert_eq!(stalls.stood_us(0, 100), 50);
        assert_eq!(stalls.stood_us(25, 60), 25);
        assert_eq!(stalls.stood_us(41, 49), 0);
        assert_eq!(stalls.durations_ms(), [0.03, 0.02]);
        assert_eq!(Stalls::default().stood_us(0, 100), 0);
    }

    #[test]
    fn prop_a_watch_ends() {
        let watch = Watch::start().expect("threads");
        std::thread::sleep(std::time::Duration::from_millis(5));
        let now_us = clock::now().as_us();
        assert!(watch.take().0.iter().all(|[from, to]| from < to && *to <= now_us));
    }
}
