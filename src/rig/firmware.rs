//! Firmwares as processes, with our physics and our parameters.

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use anyhow::{Context, Result, bail};

use super::{Endpoint, Process, free_port};

/// How a firmware takes physics of others.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Interface {
    /// ArduPilot's, on this UDP port of the loopback.
    Json(u16),
    /// PX4's, on this TCP port of the loopback.
    Hil(u16),
}

/// Parameters with which they fly this vehicle: a name and a value a line.
const ARDUPILOT_PARAMETERS: &str = include_str!("ardupilot.parm");
const PX4_PARAMETERS: &str = include_str!("px4.parm");
/// Where ArduPilot thinks it is: anywhere but at 0, 0, which it does not believe. Degrees, degrees, m.
const HOME: &str = "47.0,8.0,400";
/// Ports of PX4's first instance: of its physics, and that of its companion link.
const PX4_PHYSICS_PORT: u16 = 4560;
const PX4_COMPANION_PORT: u16 = 14_540;
/// A firmware that does not start has ended by then.
const START: std::time::Duration = std::time::Duration::from_millis(500);

/// Which firmware, and where its program is.
#[derive(Debug, Clone)]
enum Program {
    /// ArduPilot's copter.
    ArduPilot(PathBuf),
    /// PX4's `bin/px4`, in its build folder.
    Px4(PathBuf),
}

impl Program {
    /// How it takes physics, on a port that is free.
    fn interface(&self) -> Result<Interface> {
        Ok(match self {
            Self::ArduPilot(_) => Interface::Json(free_port()?),
            Self::Px4(_) => Interface::Hil(PX4_PHYSICS_PORT),
        })
    }

    /// UDP port on which the companion has to listen for it.
    fn companion_port(&self) -> Result<u16> {
        match self {
            Self::ArduPilot(_) => free_port(),
            Self::Px4(_) => Ok(PX4_COMPANION_PORT),
        }
    }

    fn command(&self, folder: &Path, interface: Interface, companion_port: u16) -> Result<Command> {
        match self {
            Self::ArduPilot(program) => {
                let parameters = folder.join("haltere.parm");
                haltere_log::written::write::<&Path>(&parameters, ARDUPILOT_PARAMETERS, &[])?;
                let mut command = Command::new(real(program)?);
                command
                    .args(["--model", "JSON:127.0.0.1", "--speedup", "1", "--wipe"])
                    .args(["--home", &format!("{HOME},0")])
                    .args(["--rc-in-port", &free_port()?.to_string()])
                    .args(["--serial0", &format!("udpclient:127.0.0.1:{companion_port}")])
                    .args(["--serial1", "none:", "--serial2", "none:", "--defaults"])
                    .arg(&parameters);
                if let Interface::Json(port) = interface {
                    command.args(["--sim-port-out", &port.to_string()]);
                }
                Ok(command)
            }
            Self::Px4(program) => {
                let program = real(program)?;
                let files = program.parent().and_then(Path::parent).map(|build| build.join("etc"));
                let files = files.filter(|etc| etc.is_dir()).with_context(|| {
                    format!(
                        "{}: no folder ../etc: name bin/px4 in its build folder",
                        program.display()
                    )
                })?;
                let mut command = Command::new(&program);
                command
                    .env("PX4_SIM_MODEL", "none_iris")
                    .args(["-d", "-i", "0", "-w"])
                    .arg(folder)
                    .arg(files);
                let lines = PX4_PARAMETERS.lines().filter(|line| !line.starts_with('#'));
                for (name, value) in lines.filter_map(|line| line.split_once(' ')) {
                    command.env(format!("PX4_PARAM_{name}"), value);
                }
                Ok(command)
            }
        }
    }
}

fn real(program: &Path) -> Result<PathBuf> {
    std::fs::canonicalize(program).with_context(|| format!("firmware {}", program.display()))
}

/// Whether a real firmware flies the vehicle, and which.
#[derive(Debug, Clone, Default, clap::Args)]
pub struct Which {
    /// A real firmware flies the vehicle instead of the simulated board: ArduPilot's copter, built for
    /// software-in-the-loop (docs/BOARDS.md).
    #[arg(long, value_name = "PROGRAM")]
    pub ardupilot: Option<PathBuf>,
    /// The same with PX4: `bin/px4` in its build folder.
    #[arg(long, value_name = "PROGRAM", conflicts_with = "ardupilot")]
    pub px4: Option<PathBuf>,
}

/// What stands between endpoint and companion: the simulated board's line, or a firmware.
#[derive(Debug)]
pub struct Between {
    program: Option<(Program, Interface)>,
    port: u16,
}

impl Which {
    /// Finds ports for it.
    pub fn between(&self) -> Result<Between> {
        let program =
            (self.ardupilot.clone().map(Program::ArduPilot)).or(self.px4.clone().map(Program::Px4));
        Ok(match program {
            Some(program) => {
                let (interface, port) = (program.interface()?, program.companion_port()?);
                Between { program: Some((program, interface)), port }
            }
            None => Between { program: None, port: free_port()? },
        })
    }

    /// Whether one does.
    pub fn is_real(&self) -> bool {
        self.ardupilot.is_some() || self.px4.is_some()
    }
}

impl Between {
    /// What the endpoint has to be told.
    pub fn arguments(&self) -> [std::ffi::OsString; 2] {
        let (how, what) = match self.program {
            Some((_, Interface::Json(port))) => ("--json-physics", port.to_string()),
            Some((_, Interface::Hil(port))) => ("--hil-physics", port.to_string()),
            None => ("--board", format!("udpout:127.0.0.1:{}", self.port)),
        };
        [how.into(), what.into()]
    }

    /// The board's address, as the companion has to be told.
    pub fn address(&self, endpoint: &Endpoint) -> Result<String> {
        match self.program {
            Some(_) => Ok(format!("udpin:127.0.0.1:{}", self.port)),
            None => endpoint.told("board").map(str::to_owned),
        }
    }

    /// Starts the firmware, if there is one, in a folder of its own.
    pub fn start(&self, folder: &Path) -> Result<Option<Firmware>> {
        let Some((program, interface)) = &self.program else { return Ok(None) };
        Firmware::start(program, folder, *interface, self.port).map(Some)
    }
}

/// The firmware, running.
#[derive(Debug)]
pub struct Firmware(Process);

impl Firmware {
    /// Starts it in a folder of its own, which it fills; everything on the loopback.
    fn start(
        program: &Program,
        folder: &Path,
        interface: Interface,
        companion_port: u16,
    ) -> Result<Self> {
        // Parameters and logs of an earlier flight must not be taken for ours.
        if folder.exists() {
            std::fs::remove_dir_all(folder).with_context(|| folder.display().to_string())?;
        }
        std::fs::create_dir_all(folder).with_context(|| folder.display().to_string())?;
        let output = folder.join("said.txt");
        let said = haltere_log::written::growing::<&Path>(&output, &[])?;
        let mut child = program
            .command(folder, interface, companion_port)?
            .current_dir(folder)
            .stdin(Stdio::null())
            .stdout(said.try_clone().with_context(|| output.display().to_string())?)
            .stderr(said)
            .spawn()
            .context("starting the firmware")?;
        std::thread::sleep(START);
        if let Ok(Some(status)) = child.try_wait() {
            let said = std::fs::read_to_string(&output).unwrap_or_default();
            bail!("the firmware ended at once ({status}): {}", said.trim());
        }
        Ok(Self(Process(child)))
    }

    /// Ends it. At once: with its physics gone it would not hear a signal, and it has nothing to save.
    pub fn stop(&mut self) -> Result<()> {
        self.0.0.kill().context("ending the firmware")?;
        self.0.0.wait().context("waiting for the firmware")?;
        Ok(())
    }
}
