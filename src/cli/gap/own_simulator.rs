//! A simulator of the user's own as a program: a request a line on its standard input, an answer a line on its standard output
//! (docs/INTERFACES.md, section 6).
//!
//! Nothing that the program does stalls us: an answer is waited for for a time, and is so long at most; what is no answer is read over. A
//! program that is late or has ended is not asked again.

use std::io::{BufRead as _, BufReader, Read as _, Write as _};
use std::os::unix::process::CommandExt as _;
use std::process::{Child, ChildStdin, Command, Stdio};
use std::sync::mpsc::{Receiver, RecvTimeoutError, sync_channel};
use std::time::{Duration, Instant};

use anyhow::Context as _;
use rustix::process::{Pid, Signal, kill_process_group};

use haltere_gap::balance::flown::{Answer, Request};

/// Longest answer, bytes: 15 s at 2 kHz of eight columns, of 20 digits each, twice over.
const MOST_BYTES: u64 = 16 << 20;
/// Answers that may wait to be taken: the program is asked for one at a time.
const WAITING: usize = 4;

/// A program that runs.
pub(super) struct OwnSimulator {
    child: Child,
    stdin: ChildStdin,
    lines: Receiver<Vec<u8>>,
    limit: Duration,
    /// Why it is not asked any more.
    gone: Option<String>,
}

impl OwnSimulator {
    /// Starts a command of words between blanks. `limit`: for how long an answer is waited for.
    pub fn start(command: &str, limit: Duration) -> anyhow::Result<Self> {
        let mut words = command.split_whitespace();
        let program = words.next().context("--simulator: no program")?;
        let mut child = Command::new(program)
            .args(words)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .process_group(0)
            .spawn()
            .with_context(|| format!("--simulator: {program}: cannot be started"))?;
        let pipes = child.stdin.take().zip(child.stdout.take());
        let (stdin, stdout) = pipes.context("--simulator: no pipes")?;
        let (sender, lines) = sync_channel(WAITING);
        // It ends with the program, or with the first line that is too long or that nobody takes.
        std::thread::spawn(move || {
            let mut stdout = BufReader::new(stdout);
            loop {
                let mut line = Vec::new();
                let read = stdout.by_ref().take(MOST_BYTES).read_until(b'\n', &mut line);
                let is_whole = line.ends_with(b"\n");
                if read.is_err() || !is_whole || sender.send(line).is_err() {
                    break;
                }
            }
        });
        Ok(Self { child, stdin, lines, limit, gone: None })
    }

    /// Has one flight flown.
    pub fn fly(&mut self, request: &Request<'_>) -> Result<Answer, String> {
        if let Some(why) = &self.gone {
            return Err(why.clone());
        }
        let answer = self.asked(request);
        answer.map_err(|why| {
            self.kill();
            self.gone.insert(why).clone()
        })
    }

    /// Ends it with all that it has started.
    fn kill(&self) {
        let _ = kill_process_group(Pid::from_child(&self.child), Signal::KILL);
    }

    fn asked(&mut self, request: &Request<'_>) -> Result<Answer, String> {
        let ended = || "the program has ended, or wrote a line of more than 16 MiB".to_owned();
        let line = serde_json::to_string(request).map_err(|why| why.to_string())?;
        writeln!(self.stdin, "{line}").and_then(|()| self.stdin.flush()).map_err(|_| ended())?;
        let begun = Instant::now();
        let (mut others, mut last) = (0, String::new());
        loop {
            let left = self.limit.saturating_sub(begun.elapsed());
            let line = self.lines.recv_timeout(left).map_err(|why| match why {
                RecvTimeoutError::Timeout if others == 0 => {
                    format!("no answer within {:.0} s", self.limit.as_secs_f64())
                }
                RecvTimeoutError::Timeout => format!(
                    "no answer within {:.0} s, but {others} lines that are none, of the last: {last}",
                    self.limit.as_secs_f64()
                ),
                RecvTimeoutError::Disconnected => ended(),
            })?;
            // What libraries print, and answers to what was not asked, are no answer.
            others += 1;
            match serde_json::from_slice::<Answer>(&line) {
                Ok(answer) if answer.flight == request.flight => return Ok(answer),
                Ok(answer) => last = format!("of flight {}, not {}", answer.flight, request.flight),
                Err(why) => last = why.to_string(),
            }
        }
    }
}

impl Drop for OwnSimulator {
    fn drop(&mut self) {
        self.kill();
        let _ = self.child.wait();
    }
}

#[cfg(test)]
mod tests {
    use haltere_gap::balance::flown::{Flown, fly_bank};
    use haltere_log::written;
    use haltere_model::rotorcraft::Rotorcraft;

    use super::*;

    /// What a program of the shell comes to, which reads a line into `$line` for every flight.
    fn flown(script: &str) -> Result<Flown, String> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("simulator.sh");
        written::write::<&std::path::Path>(&path, script, &[]).unwrap();
        let command = format!("sh {}", path.display());
        let mut simulator = OwnSimulator::start(&command, Duration::from_secs(2)).unwrap();
        let file = include_str!("../../../sim/rotorcraft/crazyflie-2.1.toml");
        let vehicle = Rotorcraft::from_toml(file).unwrap();
        fly_bank(&vehicle, &mut |request| simulator.fly(request))
    }

    #[test]
    fn regress_what_a_program_has_started_ends_with_it() {
        let folder = tempfile::tempdir().unwrap();
        let pid = folder.path().join("pid");
        let script = format!("sleep 600 &\necho $! > {}\nwait\n", pid.display());
        flown(&script).unwrap_err();
        let pid = std::fs::read_to_string(pid).unwrap();
        // Nobody takes its end before init does.
        let runs = || {
            let stat = std::fs::read_to_string(format!("/proc/{}/stat", pid.trim()));
            stat.is_ok_and(|stat| !stat.contains(") Z "))
        };
        let begun = Instant::now();
        while runs() && begun.elapsed() < Duration::from_secs(5) {
            std::thread::sleep(Duration::from_millis(10));
        }
        assert!(!runs());
    }

    /// Ten seconds of hover in lines of the shell, with a fourth motor that carries more.
    const HOVER: &str = "rows=$(awk 'BEGIN { for (k = 0; k < 1000; k++) \
        printf \"%s[%.2f, 0.45, 0.45, 0.45, 0.5, 1.0]\", (k ? \", \" : \"\"), k / 100 }')\n\
        n=0\n\
        while read -r line; do\n\
          echo \"a library says hello\"\n\
          echo \"{\\\"flight\\\": $n, \\\"columns\\\": [\\\"t_s\\\", \\\"m1\\\", \\\"m2\\\", \\\"m3\\\", \\\"m4\\\", \\\"height_m\\\"], \\\"rows\\\": [$rows]}\"\n\
          n=$((n + 1))\n\
        done\n";

    #[test]
    fn prop_a_tiny_program_flies_the_bank() {
        let flown = flown(HOVER).unwrap();
        assert_eq!((flown.healthy.len(), flown.flights, flown.lost.len()), (3, 27, 0));
    }

    #[test]
    fn prop_a_program_that_hangs_dies_or_writes_garbage_is_told_and_does_not_stall() {
        let begun = Instant::now();
        for (script, told) in [
            ("sleep 600\n", "3 of 3: no answer within 2 s"),
            ("exit 3\n", "3 of 3: the program has ended"),
            ("yes garbage\n", "lines that are none, of the last: expected value"),
            ("tr '\\0' x < /dev/zero\n", "3 of 3: the program has ended, or wrote a line of more"),
        ] {
            let why = flown(script).unwrap_err();
            assert!(why.contains(told), "{script}: {why}");
        }
        assert!(begun.elapsed() < Duration::from_secs(60), "{:?}", begun.elapsed());
        let none = OwnSimulator::start("/nowhere/at/all", Duration::from_secs(1)).err().unwrap();
        assert!(format!("{none:#}").contains("cannot be started"));
    }
}
