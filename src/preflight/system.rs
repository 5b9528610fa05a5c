//! Whether the system lets the companion keep its deadlines, and knows what time it is.

use std::path::Path;

use super::Finding;
use crate::live::realtime;
use haltere_pilot::settings::TimingConfig;

/// Steps of 10 ms over which the timer is measured: a second.
const STEPS: u32 = 100;
/// Lateness that spoils control steps, s: half a period.
const LATE_S: f64 = 0.005;
/// Lateness that is worth a look, s: a fifth of a period.
const WORTH_A_LOOK_S: f64 = 0.002;
/// A clock before this has not been set since the computer started, s since 1970: 2025-01-01.
const NOT_SET_BEFORE_S: u64 = 1_735_689_600;
/// What systemd-timesyncd leaves when it has set the clock.
const SYNCHRONISED: &str = "/run/systemd/timesync/synchronized";

/// Scheduling, memory, timer, wall clock.
pub fn examine(timing: &TimingConfig) -> Vec<Finding> {
    vec![scheduling(timing), memory(timing), timer(timing), wall_clock(), governor()]
}

fn scheduling(timing: &TimingConfig) -> Finding {
    let key = "timing.realtime";
    if !timing.realtime {
        return Finding::warning(
            key,
            "false: the control loop is late on a loaded computer",
            "set timing.realtime = true",
        );
    }
    let priority = timing.priority;
    // In a thread of its own: this one goes on as it was.
    let tried = std::thread::spawn(move || realtime::insist_on_deadlines(priority)).join();
    match tried {
        Ok(Ok(())) => Finding::ok(key, format!("SCHED_FIFO {priority} is permitted")),
        Ok(Err(why)) => Finding::warning(
            key,
            why.split(": ").next().unwrap_or_default(),
            "run it as the service of packaging/, or `sudo setcap cap_sys_nice+ep` on the program, or \
             a line `@dialout - rtprio 60` in /etc/security/limits.conf",
        ),
        Err(_) => Finding::not_checked(key, "the thread did not come back", ""),
    }
}

fn memory(timing: &TimingConfig) -> Finding {
    let key = "timing.lock_memory";
    if !timing.lock_memory {
        return Finding::warning(
            key,
            "false: paging may delay the control loop",
            "set timing.lock_memory = true",
        );
    }
    match realtime::lock_memory() {
        Ok(()) => Finding::ok(key, "all memory can be kept resident"),
        Err(why) => Finding::warning(
            key,
            why.split(": ").next().unwrap_or_default(),
            "run it as the service of packaging/, or a line `@dialout - memlock unlimited` in \
             /etc/security/limits.conf",
        ),
    }
}

fn timer(timing: &TimingConfig) -> Finding {
    let what = "timer";
    let mut late = realtime::measure_lateness(STEPS, timing.realtime.then_some(timing.priority));
    late.sort_by(f64::total_cmp);
    let (Some(worst), Some(middle)) = (late.last().copied(), late.get(late.len() / 2).copied())
    else {
        return Finding::not_checked(what, "the thread did not come back", "");
    };
    let text = format!(
        "{} steps of 10 ms: half of them within {:.2} ms, worst {:.2} ms late",
        late.len(),
        middle * 1e3,
        worst * 1e3
    );
    let way_out = "end what loads this computer, and see timing.realtime";
    if worst > LATE_S {
        Finding::warning(what, format!("{text}; late from {:.0} ms", LATE_S * 1e3), way_out)
    } else if worst > WORTH_A_LOOK_S {
        Finding::warning(
            what,
            format!("{text}; up to {:.0} ms expected", WORTH_A_LOOK_S * 1e3),
            way_out,
        )
    } else {
        Finding::ok(what, text)
    }
}

/// Flights need no wall clock; names and times of logs, and signatures, do.
fn wall_clock() -> Finding {
    let what = "clock of the computer";
    let now = std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH);
    let now_s = now.map_or(0, |since| since.as_secs());
    let text =
        haltere_log::record::utc_text(i64::try_from(now_s).unwrap_or(0).saturating_mul(1_000_000));
    if now_s < NOT_SET_BEFORE_S {
        return Finding::warning(
            what,
            format!("{text}: it has not been set since the computer started"),
            "connect it to a time server once, or set it with `sudo date -s`: logs are named by it",
        );
    }
    if Path::new(SYNCHRONISED).exists() {
        return Finding::ok(what, format!("{text}, set by a time server"));
    }
    Finding::not_checked(
        what,
        format!("{text}; systemd-timesyncd has not set it since the computer started"),
        "look at `timedatectl`; another program may have set it",
    )
}

/// A processor that clocks down between steps wakes up late.
fn governor() -> Finding {
    let what = "processor";
    let of = |file: &str| {
        std::fs::read_to_string(format!("/sys/devices/system/cpu/cpu0/cpufreq/{file}"))
    };
    // Intel's own driver calls "powersave" what adapts to the load.
    let adapts = of("scaling_driver").is_ok_and(|driver| driver.trim() == "intel_pstate");
    match of("scaling_governor") {
        Ok(text) if text.trim() == "powersave" && !adapts => Finding::warning(
            what,
            "scaling governor powersave: it may wake up late",
            "sudo cpupower frequency-set -g performance, or schedutil",
        ),
        Ok(text) => Finding::ok(what, format!("scaling governor {}", text.trim())),
        Err(_) => Finding::ok(what, "does not scale its clock"),
    }
}
