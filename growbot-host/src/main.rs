//! `growbot`: plans, layers and growth of robots that print their own body.
#![forbid(unsafe_code)]

mod cli;

use std::process::ExitCode;

fn main() -> ExitCode {
    cli::run()
}
