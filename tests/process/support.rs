//! What the process tests share: the program, and a run with a time limit.

use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

/// The simulator program, which is also the companion.
pub fn program() -> &'static Path {
    Path::new(env!("CARGO_BIN_EXE_haltere-sim"))
}

/// Root of the repository.
pub fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().expect("sim/ lies in the root").to_owned()
}

/// How a process ended.
#[derive(Debug)]
pub struct Ended {
    /// `None`: by a signal, or it had to be killed.
    pub code: Option<i32>,
    /// Standard output and standard error, in that order.
    pub text: String,
}

impl Ended {
    /// Fails the test unless the process refused in words.
    pub fn refused(&self, says: &[&str]) {
        assert!(self.code.is_some_and(|code| code != 0), "no failing exit code: {self:?}");
        assert!(!self.text.contains("panicked"), "{}", self.text);
        for needed in says {
            assert!(self.text.contains(needed), "`{needed}` is not in: {}", self.text);
        }
    }
}

/// Runs the companion to its end.
pub fn companion(args: &[&str], folder: &Path, limit: Duration) -> Ended {
    let mut command = Command::new(program());
    command.arg("companion").args(args).current_dir(folder);
    finish(command, folder, limit)
}

/// Runs the simulator program to its end.
pub fn sim(args: &[&str], folder: &Path, limit: Duration) -> Ended {
    let mut command = Command::new(program());
    command.args(args).current_dir(folder);
    finish(command, folder, limit)
}

/// Output goes through a file: a pipe that nobody reads would stop the process.
fn finish(mut command: Command, folder: &Path, limit: Duration) -> Ended {
    let path = folder.join("output.txt");
    let output = std::fs::File::create(&path).expect("a file for output");
    let mut child = command
        .stdin(Stdio::null())
        .stdout(output.try_clone().expect("a second handle"))
        .stderr(output)
        .spawn()
        .expect("the program starts");
    let code = wait(&mut child, limit);
    Ended { code, text: std::fs::read_to_string(&path).unwrap_or_default() }
}

/// Exit code, or `None` after killing it at the limit.
pub fn wait(child: &mut Child, limit: Duration) -> Option<i32> {
    let deadline = Instant::now() + limit;
    while Instant::now() < deadline {
        if let Some(status) = child.try_wait().expect("a child of ours") {
            return status.code();
        }
        std::thread::sleep(Duration::from_millis(20));
    }
    let _ = child.kill();
    let _ = child.wait();
    None
}
