//! The command line; everything is in [`tamis::cli`].

use std::process::ExitCode;

fn main() -> ExitCode {
    tamis::cli::main()
}
