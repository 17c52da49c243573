//! `tamis completions`: what shells need to complete command lines.

use clap::Args;
use clap_complete::{Shell, generate};

const EXAMPLES: &str = "\
Examples:
  tamis completions bash > ~/.local/share/bash-completion/completions/tamis
  tamis completions zsh > ~/.zfunc/_tamis      # with fpath+=~/.zfunc before compinit
  tamis completions fish > ~/.config/fish/completions/tamis.fish";

/// Write a shell's completions of commands and options to stdout.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub(super) struct Completions {
    /// For which shell
    #[arg(value_enum)]
    shell: Shell,
}

impl Completions {
    /// The completions of a command line.
    pub(super) fn run(&self, mut line: clap::Command) -> Vec<u8> {
        let mut script = Vec::new();
        let name = line.get_name().to_owned();
        generate(self.shell, &mut line, name, &mut script);
        script
    }
}
