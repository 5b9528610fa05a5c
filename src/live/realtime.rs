//! Scheduling class and resident memory, where the system permits them.

use super::clock;
use rustix::mm::{MlockAllFlags, mlockall};
use rustix::process::{Resource, geteuid, getrlimit};
use thread_priority::{
    RealtimeThreadSchedulePolicy, ThreadPriority, ThreadPriorityValue, ThreadSchedulePolicy,
    set_thread_priority_and_policy, thread_native_id,
};

/// Puts the calling thread under SCHED_FIFO. `Err`: what to tell the user.
pub fn insist_on_deadlines(priority: u8) -> Result<(), String> {
    let told = ThreadPriorityValue::try_from(priority).map_err(|error| error.to_string()).and_then(
        |value| {
            set_thread_priority_and_policy(
                thread_native_id(),
                ThreadPriority::Crossplatform(value),
                ThreadSchedulePolicy::Realtime(RealtimeThreadSchedulePolicy::Fifo),
            )
            .map_err(|error| match error {
                thread_priority::Error::OS(code) => {
                    std::io::Error::from_raw_os_error(code).to_string()
                }
                other => other.to_string(),
            })
        },
    );
    told.map_err(|why| {
        format!(
            "SCHED_FIFO refused ({why}): the control loop will be late on a loaded computer; \
             allow it with `setcap cap_sys_nice+ep` on the program or an rtprio line in \
             /etc/security/limits.conf, or set timing.realtime = false"
        )
    })
}

/// Priority of the threads that carry bytes of tag and board: below the control thread, above everything
/// that stations can keep busy. `None` where SCHED_FIFO is not wanted.
pub(super) type Urgency = Option<u8>;

/// Puts the calling thread there. The control thread has told people if the system does not permit it.
pub(super) fn hurry(urgency: Urgency) {
    if let Some(priority) = urgency {
        let _ = insist_on_deadlines(priority.saturating_sub(1).max(1));
    }
}

/// How late a thread of this computer wakes up from sleeping to a deadline each 10 ms, s, in order of
/// time; under SCHED_FIFO with `priority` where that is given and permitted.
pub fn measure_lateness(steps: u32, priority: Option<u8>) -> Vec<f64> {
    let thread = std::thread::Builder::new().name("jitter".into()).spawn(move || {
        if let Some(priority) = priority {
            // Whether it is permitted is a question of its own.
            let _ = insist_on_deadlines(priority);
        }
        let start = clock::now();
        (1..=i64::from(steps))
            .map(|step| {
                let deadline = start.offset_us(10_000 * step);
                clock::sleep_until(deadline);
                clock::now().seconds_since(deadline).max(0.0)
            })
            .collect()
    });
    thread.ok().and_then(|thread| thread.join().ok()).unwrap_or_default()
}

/// Touches as much of the calling thread's stack as its work may ever need, so that it is resident
/// before the first deadline.
pub fn touch_stack() {
    std::hint::black_box(&mut [0u8; STACK_BYTES]);
}

/// Far above what the control loop was seen to use.
const STACK_BYTES: usize = 256 << 10;

/// Keeps all memory resident. `Err`: what to tell the user.
pub fn lock_memory() -> Result<(), String> {
    // Under a finite limit the lock could succeed now and let an allocation in flight fail.
    let limited = getrlimit(Resource::Memlock).current.is_some();
    let why = if limited && !geteuid().is_root() {
        "the memlock limit is finite".to_owned()
    } else {
        // What is there is read in and stays: the program's code, its tables. What comes later stays once
        // it has been touched: threads reserve stacks of 2 MB of which they use a few pages.
        let locked = mlockall(MlockAllFlags::CURRENT)
            .and_then(|()| mlockall(MlockAllFlags::FUTURE | MlockAllFlags::ONFAULT));
        match locked {
            Ok(()) => return Ok(()),
            Err(error) => error.to_string(),
        }
    };
    Err(format!(
        "memory is not locked ({why}): paging may delay the control loop; set memlock to \
         unlimited in /etc/security/limits.conf, or set timing.lock_memory = false"
    ))
}
