//! Identity of a build: whether two runs may be expected to agree bit for bit.

/// What was built, from what, for what, and where it runs.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct BuildIdentity {
    /// Version of the program.
    pub program_version: String,
    /// `git describe`, empty outside a repository. For people; the hash decides.
    pub git_commit: String,
    /// Hash of what decides which bytes the companion makes of its input (`REPLAY` in `src/log/build.rs`).
    pub source_hash: String,
    /// Target triple.
    pub target: String,
    /// Compiler.
    pub rustc: String,
    /// Cargo profile and optimisation level.
    pub build_profile: String,
    /// Processor it ran on: mathematical functions of the C library depend on it.
    pub processor: String,
}

impl BuildIdentity {
    /// Of this program on this computer.
    pub fn current() -> Self {
        Self {
            program_version: env!("CARGO_PKG_VERSION").into(),
            git_commit: env!("HALTERE_GIT_COMMIT").into(),
            source_hash: env!("HALTERE_REPLAY_HASH").into(),
            target: env!("HALTERE_TARGET").into(),
            rustc: env!("HALTERE_RUSTC").into(),
            build_profile: env!("HALTERE_PROFILE").into(),
            processor: processor(),
        }
    }

    /// What differs from `other`, in words; empty when bit-exact agreement is due.
    pub fn differences(&self, other: &Self) -> Vec<String> {
        let pairs = [
            ("version", &self.program_version, &other.program_version),
            ("source", &self.source_hash, &other.source_hash),
            ("target", &self.target, &other.target),
            ("compiler", &self.rustc, &other.rustc),
            ("profile", &self.build_profile, &other.build_profile),
            ("processor", &self.processor, &other.processor),
        ];
        pairs
            .into_iter()
            .filter(|(_, a, b)| a != b)
            .map(|(what, a, b)| format!("{what}: {a} here, {b} in the log"))
            .collect()
    }
}

/// Name of the processor, or its architecture where the kernel gives no name.
fn processor() -> String {
    let info = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    ["model name", "CPU part"]
        .iter()
        .find_map(|key| info.lines().find(|line| line.starts_with(key)))
        .and_then(|line| line.split_once(':'))
        .map_or_else(|| std::env::consts::ARCH.to_owned(), |(_, name)| name.trim().to_owned())
}
