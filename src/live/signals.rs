//! Signals of a companion that flies: one thread takes them all, and none ends a flight by itself.
//!
//! ```text
//! INT TERM QUIT                      ends: what flies is landed first. Two of them 0.5 to 2 s apart: at once
//! XCPU                               the same, and never at once: it comes each second once it has come
//! HUP USR1 USR2 ALRM VTALRM PROF     ends while disarmed, nothing while armed
//! IO PWR STKFLT
//! TSTP                               stops the program while disarmed, nothing while armed
//! XFSZ TTOU TTIN                     nothing ever: the write that is too long fails as on a full disk, and one
//!                                    from the background goes through
//! ```
//! They are blocked in every thread but one, so that no call of a flying thread is cut short by one. Blocking is not
//! enough: a serial line is polled with a mask of its own that lets all of them in (`ppoll`), and what came then
//! ended the program. So each has a handler as well, whose only deed is to wake that one thread.

use std::collections::VecDeque;
use std::future::poll_fn;
use std::task::Poll;
use std::time::{Duration, Instant};

use nix::sys::signal::{SigSet, Signal as S};
use tokio::runtime::Runtime;
use tokio::signal::unix::{Signal, SignalKind, signal};

use super::stop::Stop;

/// A person who wants the end now asks again: two signals so far apart, s, with a margin for the time that
/// a busy computer takes to deliver them. Nearer ones are one wish that came twice (a terminal and a program
/// around ours both pass Ctrl-C on), later ones are impatience with a landing.
const AGAIN_S: std::ops::RangeInclusive<f64> = 0.45..=2.1;
/// Time in which the log is closed at the end that cannot wait, s.
const CLOSE: Duration = Duration::from_millis(500);
/// Signals that are remembered: more need not be looked at for two that are far enough apart.
const MOST_REMEMBERED: usize = 256;

/// Exit code of a companion that ended while the vehicle was armed: as a shell's after Ctrl-C. The service is
/// not started again by it (`packaging/haltere.service`).
pub const ENDED_ARMED: u8 = 130;

const ENDS: [S; 3] = [S::SIGINT, S::SIGTERM, S::SIGQUIT];
const LANDS: [S; 1] = [S::SIGXCPU];
const AT_REST: [S; 9] = [
    S::SIGHUP,
    S::SIGUSR1,
    S::SIGUSR2,
    S::SIGALRM,
    S::SIGVTALRM,
    S::SIGPROF,
    S::SIGIO,
    S::SIGPWR,
    S::SIGSTKFLT,
];
const NEVER: [S; 3] = [S::SIGXFSZ, S::SIGTTOU, S::SIGTTIN];

/// Signals that have their handlers, and wait for somebody who takes them.
#[derive(Debug)]
pub struct Signals {
    waited: SigSet,
    runtime: Runtime,
    streams: Vec<(S, Signal)>,
}

impl Signals {
    /// Holds them back in this thread and in all that it starts. What whoever started us has switched off
    /// (`nohup`) stays off, but for those that end the program.
    pub fn hold() -> std::io::Result<Self> {
        let ignored = ignored();
        let heeded = |signal: &S| ignored >> (*signal as u32 - 1) & 1 == 0;
        let others = AT_REST.into_iter().chain([S::SIGTSTP]).filter(heeded);
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
        let inside = runtime.enter();
        let streams = ENDS
            .into_iter()
            .chain(LANDS)
            .chain(others)
            .map(|which| Ok((which, signal(SignalKind::from_raw(which as i32))?)))
            .collect::<std::io::Result<Vec<_>>>()?;
        for which in NEVER {
            // The handler stays when nobody looks for what it has seen.
            drop(signal(SignalKind::from_raw(which as i32))?);
        }
        let waited: SigSet = streams.iter().map(|(which, _)| *which).collect();
        let held: SigSet = waited.iter().chain(NEVER).collect();
        held.thread_block()?;
        drop(inside);
        Ok(Self { waited, runtime, streams })
    }

    /// Takes them from now on, on a thread of its own.
    pub fn serve(mut self, stop: Stop) -> std::io::Result<()> {
        let serve = move || {
            if let Err(error) = self.waited.thread_unblock() {
                tracing::error!("signals cannot be heard: {error}");
            }
            let mut wishes = Wishes::default();
            loop {
                let next = poll_fn(|context| {
                    let come = self.streams.iter_mut().find_map(|(which, stream)| {
                        stream.poll_recv(context).is_ready().then_some(*which)
                    });
                    come.map_or(Poll::Pending, Poll::Ready)
                });
                let signal = self.runtime.block_on(next);
                take(signal, &mut wishes, &stop);
            }
        };
        std::thread::Builder::new().name("signals".into()).spawn(serve).map(drop)
    }
}

/// Bits of the signals that this process ignores; none where that cannot be read.
fn ignored() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let bits = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
    bits.and_then(|bits| u64::from_str_radix(bits.trim(), 16).ok()).unwrap_or(0)
}

fn take(signal: S, wishes: &mut Wishes, stop: &Stop) {
    if ENDS.contains(&signal) && wishes.come_again(Instant::now()) {
        tracing::error!("{signal} a second time: ends at once");
        stop.stop();
        std::thread::sleep(CLOSE);
        std::process::exit(if stop.is_armed() { ENDED_ARMED.into() } else { 0 });
    }
    if ENDS.contains(&signal) || LANDS.contains(&signal) {
        tracing::warn!("{signal}: ends as soon as the vehicle is disarmed");
        stop.ask();
    } else if stop.is_armed() {
        tracing::warn!("{signal} does nothing while the vehicle is armed");
    } else if signal == S::SIGTSTP {
        let _ =
            rustix::process::kill_process(rustix::process::getpid(), rustix::process::Signal::STOP);
    } else {
        tracing::info!("{signal}: ends");
        stop.ask();
    }
}

/// When the end was asked for.
#[derive(Debug, Default)]
struct Wishes(VecDeque<Instant>);

impl Wishes {
    /// Remembers one. `true`: together with an earlier one it means now.
    fn come_again(&mut self, at: Instant) -> bool {
        let since_s = |then: &Instant| at.saturating_duration_since(*then).as_secs_f64();
        while self.0.front().is_some_and(|then| since_s(then) > *AGAIN_S.end()) {
            self.0.pop_front();
        }
        let again = self.0.iter().any(|then| AGAIN_S.contains(&since_s(then)));
        if self.0.len() < MOST_REMEMBERED {
            self.0.push_back(at);
        }
        again
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prop_two_wishes_so_far_apart_mean_now() {
        let began = Instant::now();
        for (times_s, now) in [
            (&[0.0][..], false),
            (&[0.0, 0.1, 0.3], false),
            (&[0.0, 0.5], true),
            (&[0.0, 2.0], true),
            (&[0.0, 2.5], false),
            (&[0.0, 2.5, 5.0], false),
            // The first and the third, and two of a later pair.
            (&[0.0, 0.3, 0.6], true),
            (&[0.0, 20.0, 21.0], true),
        ] {
            let mut wishes = Wishes::default();
            let again =
                times_s.iter().map(|s| wishes.come_again(began + Duration::from_secs_f64(*s)));
            assert_eq!(again.last(), Some(now), "{times_s:?}");
        }
    }

    #[test]
    fn prop_a_storm_of_signals_is_bounded_and_means_now() {
        let began = Instant::now();
        let mut wishes = Wishes::default();
        let again = (0..100_000)
            .map(|n| wishes.come_again(began + Duration::from_micros(20 * n)))
            .filter(|again| *again);
        assert!(again.count() > 10_000);
        assert!(wishes.0.len() <= MOST_REMEMBERED);
    }

    #[test]
    fn prop_the_service_is_not_started_again_by_who_ended_it() {
        let unit = include_str!("../../packaging/haltere.service");
        assert!(unit.contains(&format!("RestartPreventExitStatus={ENDED_ARMED}\n")));
    }

    #[test]
    fn prop_every_signal_has_one_meaning() {
        let all = ENDS.into_iter().chain(LANDS).chain(AT_REST).chain(NEVER).chain([S::SIGTSTP]);
        let numbers: std::collections::BTreeSet<_> =
            all.clone().map(|signal| signal as i32).collect();
        assert_eq!(numbers.len(), all.count());
    }
}
