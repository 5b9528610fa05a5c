//! Completion scripts and manual pages, from the definitions of the arguments.

use std::path::{Path, PathBuf};

use anyhow::Context as _;
use clap::{Args, Command};

use super::output::print;
use haltere_log::written;

/// Prints a completion script.
#[derive(Debug, Args)]
#[command(
    after_help = "bash: haltere completions bash > ~/.local/share/bash-completion/completions/haltere\n\
                        zsh: haltere completions zsh > a folder of $fpath/_haltere\n\
                        fish: haltere completions fish > ~/.config/fish/completions/haltere.fish\n\
                        The same for haltere-sim, under its name."
)]
pub struct Completions {
    /// Which shell.
    #[arg(value_enum)]
    shell: clap_complete::Shell,
}

impl Completions {
    /// Prints the script of a program.
    pub fn print(&self, command: &mut Command, program: &str) -> anyhow::Result<()> {
        let mut script = Vec::new();
        clap_complete::generate(self.shell, command, program, &mut script);
        print(&String::from_utf8_lossy(&script))
    }
}

/// Writes manual pages.
#[derive(Debug, Args)]
pub struct Man {
    /// Folder for the pages, made if it is missing: a page for the program and one for each command.
    #[arg(long, value_name = "DIR")]
    dir: PathBuf,
}

impl Man {
    /// Writes the pages of a program.
    pub fn write(&self, mut command: Command, program: &str) -> anyhow::Result<()> {
        let name = |path: &Path| path.display().to_string();
        std::fs::create_dir_all(&self.dir).with_context(|| name(&self.dir))?;
        // Names of commands below commands, as they are typed.
        command.build();
        let mut count = 0;
        write_pages(&command, program, &self.dir, &mut count)?;
        print(&format!("{}: {count} pages\n", name(&self.dir)))?;
        Ok(())
    }
}

fn write_pages(
    command: &Command,
    title: &str,
    dir: &Path,
    count: &mut usize,
) -> anyhow::Result<()> {
    let title: &'static str = Box::leak(title.to_owned().into_boxed_str());
    let mut page = Vec::new();
    clap_mangen::Man::new(command.clone().name(title)).render(&mut page)?;
    let path = dir.join(format!("{title}.1"));
    written::write::<&Path>(&path, page, &[])?;
    *count += 1;
    for inner in command.get_subcommands() {
        if inner.get_name() != "help" && !inner.is_hide_set() {
            write_pages(inner, &format!("{title}-{}", inner.get_name()), dir, count)?;
        }
    }
    Ok(())
}
