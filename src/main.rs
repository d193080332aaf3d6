//! The `alvis` command.

use std::process::ExitCode;

fn main() -> ExitCode {
    alvis::cli::run(std::env::args_os())
}
