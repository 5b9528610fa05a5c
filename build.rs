//! Compiles the log's message types and stamps the build with its identity.

use std::error::Error;
use std::path::{Path, PathBuf};
use std::process::Command;

use prost::Message as _;

const PROTO: &str = "src/record/haltere.proto";

/// What decides which bytes the companion makes of its input: a log that another build of these wrote is replayed within a
/// tolerance only.
const REPLAY: [&str; 10] = [
    "Cargo.lock",
    "dialect/build.rs",
    "dialect/src",
    "dialect/xml",
    "src/core",
    "src/export",
    "src/import",
    "src/pilot",
    "src/record",
    "src/replay",
];
/// What decides, beside these, how a simulated flight goes and what is said of a flight: a bank that another build of these
/// flew is flown anew. The words and pages of the program are not among them.
const BANK: [&str; 3] = ["src/gap", "src/lockstep", "src/model"];

fn main() -> Result<(), Box<dyn Error>> {
    let out_dir = PathBuf::from(std::env::var("OUT_DIR")?);
    let files = protox::compile([PROTO], ["src/record"])?;
    std::fs::write(out_dir.join("haltere_descriptors.bin"), files.encode_to_vec())?;
    let mut config = prost_build::Config::new();
    config.type_attribute(".", "#[allow(missing_docs)]");
    config.compile_fds(files)?;

    let mut hash = Fnv::new();
    for (name, sources) in [("REPLAY", &REPLAY[..]), ("BANK", &BANK[..])] {
        for source in sources {
            println!("cargo::rerun-if-changed={source}");
            if !Path::new(source).exists() {
                return Err(format!(
                    "build.rs: {source} is no more: name what stands in its place"
                )
                .into());
            }
            hash_tree(Path::new(source), &mut hash)?;
        }
        println!("cargo::rustc-env=HALTERE_{name}_HASH={:016x}", hash.0);
    }
    println!("cargo::rustc-env=HALTERE_TARGET={}", std::env::var("TARGET")?);
    println!(
        "cargo::rustc-env=HALTERE_PROFILE={}-O{}",
        std::env::var("PROFILE")?,
        std::env::var("OPT_LEVEL")?
    );
    println!("cargo::rustc-env=HALTERE_RUSTC={}", first_line(&std::env::var("RUSTC")?, &["-V"]));
    let commit = first_line("git", &["describe", "--always", "--dirty", "--abbrev=12"]);
    println!("cargo::rustc-env=HALTERE_GIT_COMMIT={commit}");
    Ok(())
}

/// First line that a command prints; empty when it cannot be run, so that a source archive builds.
fn first_line(program: &str, arguments: &[&str]) -> String {
    Command::new(program)
        .args(arguments)
        .output()
        .ok()
        .filter(|output| output.status.success())
        .and_then(|output| String::from_utf8(output.stdout).ok())
        .and_then(|text| text.lines().next().map(str::to_owned))
        .unwrap_or_default()
}

fn hash_tree(path: &Path, hash: &mut Fnv) -> std::io::Result<()> {
    if path.is_dir() {
        let mut entries: Vec<_> =
            std::fs::read_dir(path)?.map(|e| e.map(|e| e.path())).collect::<Result<_, _>>()?;
        entries.sort();
        for entry in entries {
            hash_tree(&entry, hash)?;
        }
    } else if path.is_file() {
        hash.add(path.to_string_lossy().as_bytes());
        hash.add(&std::fs::read(path)?);
    }
    Ok(())
}

/// FNV-1a, 64 bits: tells two source trees apart, nothing more.
struct Fnv(u64);

impl Fnv {
    fn new() -> Self {
        Self(0xcbf2_9ce4_8422_2325)
    }
    fn add(&mut self, bytes: &[u8]) {
        for byte in bytes {
            self.0 = (self.0 ^ u64::from(*byte)).wrapping_mul(0x0000_0100_0000_01b3);
        }
    }
}
