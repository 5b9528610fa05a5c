//! The companion.

fn main() -> std::process::ExitCode {
    haltere::cli::main()
}
