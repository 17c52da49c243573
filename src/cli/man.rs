//! `tamis man`: the help as manual pages.

use std::fs;
use std::path::PathBuf;

use clap::Args;
use clap_mangen::Man;

use super::error::Error;
use super::log::Log;
use crate::image::write_atomically;
use crate::report::number;

const EXAMPLES: &str = "\
Examples:
  tamis man -o ~/.local/share/man/man1";

/// Write manual pages, one per command.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub(super) struct Manual {
    /// The folder for the pages; it is made if it is not there
    #[arg(long, short, value_name = "DIR")]
    output: PathBuf,
}

impl Manual {
    /// Writes the pages of a command line.
    pub(super) fn run(&self, line: clap::Command, log: Log) -> Result<String, Error> {
        // That would be a page about help.
        let mut line = line.disable_help_subcommand(true);
        line.build();
        fs::create_dir_all(&self.output).map_err(|source| Error::Folder {
            path: self.output.display().to_string(),
            option: "--output",
            source,
        })?;
        let commands = line.get_subcommands().filter(|command| !command.is_hide_set());
        let pages: Vec<&clap::Command> = [&line].into_iter().chain(commands).collect();
        for page in &pages {
            let notes = page.get_after_help().map(ToString::to_string).unwrap_or_default();
            let man = Man::new((*page).clone().after_help(None::<&str>));
            let path = self.output.join(man.get_filename());
            let mut text = Vec::new();
            man.render(&mut text).expect("memory can be written");
            text.extend(as_it_is(&notes).into_bytes());
            write_atomically(&path, &text)?;
        }
        let pages = number::plural(pages.len(), "page");
        log.say(format_args!("wrote {pages} into {}", self.output.display()));
        Ok(String::new())
    }
}

/// Examples and notes as a section whose lines stay as they are.
fn as_it_is(notes: &str) -> String {
    let mut section = ".SH \"EXAMPLES AND NOTES\"\n.nf\n".to_owned();
    for line in notes.lines() {
        // Lines that begin with these are commands of roff.
        if line.starts_with(['.', '\'']) {
            section.push_str("\\&");
        }
        section.push_str(&line.replace('\\', "\\e").replace('-', "\\-").replace('\'', "\\(aq"));
        section.push('\n');
    }
    section.push_str(".fi\n");
    section
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn examples_can_be_pasted() {
        let section = as_it_is("a -b 'c' \\\n.d");
        let lines: Vec<&str> = section.lines().skip(2).collect();
        assert_eq!(lines, ["a \\-b \\(aqc\\(aq \\e", "\\&.d", ".fi"]);
    }
}
