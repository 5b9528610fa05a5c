//! What the process tests share: the program, and a run with a time limit.

use std::io::{BufRead as _, Write as _};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, LazyLock, RwLock};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// The simulator program, which is also the companion. Cargo names it to the tests of its own package; those of another find
/// it beside their program, or fail.
pub fn program() -> &'static Path {
    static PROGRAM: LazyLock<PathBuf> = LazyLock::new(|| {
        if let Some(own) = option_env!("CARGO_BIN_EXE_haltere-sim") {
            return own.into();
        }
        let test = std::env::current_exe().expect("the test's own path");
        let beside = test.ancestors().nth(2).expect("target/…/deps/").join("haltere-sim");
        let how = "`cargo build -p haltere-sim` makes it, `cargo test --workspace` as well";
        assert!(beside.is_file(), "{}: {how}", beside.display());
        beside
    });
    &PROGRAM
}

/// Root of the repository.
pub fn root() -> PathBuf {
    let mut above = Path::new(env!("CARGO_MANIFEST_DIR")).ancestors();
    above.find(|folder| folder.join("ARCHITECTURE.md").is_file()).expect("the root").to_owned()
}

/// Watches how long this machine keeps somebody waiting who only wants to wake up: a thread that sleeps a little
/// and looks how late it is. What is measured here is no matter of the program that is tested.
struct Standstills {
    ends: Arc<AtomicBool>,
    thread: JoinHandle<Duration>,
}

impl Standstills {
    /// Between two looks.
    const PERIOD: Duration = Duration::from_millis(5);
    /// Later than this is a standstill: several time slices of the scheduler.
    const LATE: Duration = Duration::from_millis(30);
    /// So much in all explains a missed time limit of a test.
    const MANY: Duration = Duration::from_millis(300);

    fn watch() -> Self {
        let ends = Arc::new(AtomicBool::new(false));
        let flag = Arc::clone(&ends);
        let thread = std::thread::spawn(move || {
            let mut sum = Duration::ZERO;
            while !flag.load(Ordering::Relaxed) {
                let began = Instant::now();
                std::thread::sleep(Self::PERIOD);
                let late = began.elapsed().saturating_sub(Self::PERIOD);
                if late > Self::LATE {
                    sum += late;
                }
            }
            sum
        });
        Self { ends, thread }
    }

    /// The sum of them, where it is enough to explain a missed time limit.
    fn end(self) -> Option<Duration> {
        self.ends.store(true, Ordering::Relaxed);
        let sum = self.thread.join().expect("the watch only sleeps");
        (sum >= Self::MANY).then_some(sum)
    }
}

/// Attempts at a test in which real time passes, on a machine that stands still during each of them.
const ATTEMPTS: usize = 3;

/// Tests in which real time passes run beside each other, but what is tried again runs without them (the first
/// attempt at a program of somebody else does not ask).
static ROOM: RwLock<()> = RwLock::new(());

/// Runs a test in which real time passes. Once; but a machine that stood still meanwhile has tested itself: then
/// again, and what went wrong is told, past the harness, which keeps to itself what a green test says.
pub fn in_real_time(name: &str, test: impl Fn()) {
    for attempt in 1..=ATTEMPTS {
        let (_shared, _alone);
        if attempt == 1 {
            _shared = ROOM.read();
        } else {
            _alone = ROOM.write();
        }
        let standstills = Standstills::watch();
        let result = std::panic::catch_unwind(std::panic::AssertUnwindSafe(&test));
        let stood_still = standstills.end();
        let Err(panic) = result else { return };
        match stood_still {
            Some(sum) if attempt < ATTEMPTS => {
                let told = panic.downcast_ref::<String>().map_or("it failed", String::as_str);
                tell(&format!(
                    "{name}: ONCE MORE, this machine stood still for {sum:.1?} during attempt {attempt}\n{told}"
                ));
            }
            _ => std::panic::resume_unwind(panic),
        }
    }
}

/// Past the test harness.
pub fn tell(what: &str) {
    let _ = writeln!(std::io::stderr(), "{what}");
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
pub fn finish(mut command: Command, folder: &Path, limit: Duration) -> Ended {
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

/// Exit code, or `None` after ending it at the limit: interrupted, so that it can say where it was and
/// end what it has started, and then killed.
pub fn wait(child: &mut Child, limit: Duration) -> Option<i32> {
    if let Some(status) = ends_within(child, limit) {
        return status.code();
    }
    let _ = Command::new("kill").args(["-INT", &child.id().to_string()]).status();
    if ends_within(child, INTERRUPTED).is_none() {
        let _ = child.kill();
        let _ = child.wait();
    }
    None
}

/// Time to end after an interrupt.
const INTERRUPTED: Duration = Duration::from_secs(30);

fn ends_within(child: &mut Child, limit: Duration) -> Option<std::process::ExitStatus> {
    let deadline = Instant::now() + limit;
    while Instant::now() < deadline {
        if let Some(status) = child.try_wait().expect("a child of ours") {
            return Some(status);
        }
        std::thread::sleep(Duration::from_millis(20));
    }
    None
}

/// A program that ends with the test.
pub struct Running(pub Child);

impl Drop for Running {
    fn drop(&mut self) {
        let _ = Command::new("kill").args(["-TERM", &self.0.id().to_string()]).status();
        wait(&mut self.0, Duration::from_secs(90));
    }
}

/// `haltere-sim serve` with these arguments, and its first line. What it says goes to `sim.txt`.
pub fn serve(dir: &Path, args: &[&str]) -> (Running, serde_json::Value) {
    let mut command = Command::new(program());
    command.arg("serve").args(args).current_dir(dir).stdin(Stdio::null()).stdout(Stdio::piped());
    command.stderr(std::fs::File::create(dir.join("sim.txt")).unwrap());
    let mut child = command.spawn().unwrap();
    let mut line = String::new();
    std::io::BufReader::new(child.stdout.take().unwrap()).read_line(&mut line).unwrap();
    (Running(child), serde_json::from_str(&line).expect("a JSON object"))
}

/// The survey of the hall that `haltere-sim serve` flies in without a scenario.
pub fn hall() -> String {
    let mut anchors = String::from("frame = \"ned\"\n");
    for i in 0..8 {
        let at = |bit: i32, far: &'static str| if i & bit != 0 { far } else { "0.0" };
        let [x, y, z] = [at(1, "10.0"), at(2, "10.0"), at(4, "-7.0")];
        anchors += &format!("[[anchor]]\nid = {i}\nposition_m = [{x}, {y}, {z}]\n");
    }
    anchors
}
