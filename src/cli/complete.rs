//! Completion scripts and manual pages, from the definitions of the arguments.

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::Context as _;
use clap::{Args, CommandFactory as _};

use super::{Cli, print};

/// Prints a completion script.
#[derive(Debug, Args)]
#[command(
    after_help = "bash: haltere completions bash > ~/.local/share/bash-completion/completions/haltere\n\
                        zsh: haltere completions zsh > a folder of $fpath/_haltere\n\
                        fish: haltere completions fish > ~/.config/fish/completions/haltere.fish"
)]
pub(super) struct Completions {
    /// Which shell.
    #[arg(value_enum)]
    shell: clap_complete::Shell,
}

impl Completions {
    pub(super) fn run(&self) -> ExitCode {
        let mut script = Vec::new();
        clap_complete::generate(self.shell, &mut Cli::command(), "haltere", &mut script);
        print(&String::from_utf8_lossy(&script));
        ExitCode::SUCCESS
    }
}

/// Writes manual pages.
#[derive(Debug, Args)]
pub(super) struct Man {
    /// Folder for the pages, made if it is missing: haltere.1 and one page for each command.
    #[arg(long, value_name = "DIR")]
    dir: PathBuf,
}

impl Man {
    pub(super) fn run(&self) -> anyhow::Result<ExitCode> {
        let name = |path: &Path| path.display().to_string();
        std::fs::create_dir_all(&self.dir).with_context(|| name(&self.dir))?;
        let mut command = Cli::command();
        // Names of commands below commands, as they are typed.
        command.build();
        let mut count = 0;
        write_pages(&command, "haltere", &self.dir, &mut count)?;
        print(&format!("{}: {count} pages\n", name(&self.dir)));
        Ok(ExitCode::SUCCESS)
    }
}

fn write_pages(
    command: &clap::Command,
    title: &str,
    dir: &Path,
    count: &mut usize,
) -> anyhow::Result<()> {
    let title: &'static str = Box::leak(title.to_owned().into_boxed_str());
    let mut page = Vec::new();
    clap_mangen::Man::new(command.clone().name(title)).render(&mut page)?;
    let path = dir.join(format!("{title}.1"));
    std::fs::write(&path, page).with_context(|| path.display().to_string())?;
    *count += 1;
    for inner in command.get_subcommands() {
        if inner.get_name() != "help" && !inner.is_hide_set() {
            write_pages(inner, &format!("{title}-{}", inner.get_name()), dir, count)?;
        }
    }
    Ok(())
}
