//! Builds the growbot book: `cargo book [GROWBOT [DIRECTORY]]`.
//!
//! GROWBOT is the path of the program `growbot`, which writes the reference and draws the figures (default: a release
//! build is made). DIRECTORY is the directory for the pages (default: `target/book`). The build fails if a link has no
//! target, a page loads anything from a network, or a command fails.

mod figures;
mod formulas;
mod growbot;
mod links;
mod mentions;
mod pictures;

use std::env;
use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context, Result, ensure};
use mdbook_driver::MDBook;

use crate::formulas::Formulas;
use crate::growbot::{Growbot, Reference};
use crate::mentions::Mentions;
use crate::pictures::Pictures;

fn main() -> Result<()> {
    let mut arguments = env::args_os().skip(1);
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let repository = root.parent().context("the book lies in no repository")?;
    let target = env::var_os("CARGO_TARGET_DIR").map_or_else(|| repository.join("target"), PathBuf::from);
    let program = match arguments.next() {
        Some(program) => PathBuf::from(program),
        None => built(repository, &target)?,
    };
    let pages = arguments.next().map_or_else(|| target.join("book"), PathBuf::from);
    let program = Growbot::at(&program)?;
    // mdBook resolves a relative directory against the book's root.
    let pages = std::path::absolute(pages)?;

    let mut book = MDBook::load(root).context("the book cannot be read")?;
    book.config.build.build_dir = pages.clone();
    book.with_preprocessor(Reference(program.clone()))
        .with_preprocessor(Mentions)
        .with_preprocessor(Pictures)
        .with_preprocessor(Formulas);
    book.build().context("the book cannot be built")?;
    figures::draw(&program, &pages.join("figures"))?;
    let checked = links::check(&pages)?;
    println!("book: {}: {checked}", pages.join("index.html").display());
    Ok(())
}

/// Builds growbot in release mode, unless it is up to date, and returns the path of the program.
fn built(repository: &Path, target: &Path) -> Result<PathBuf> {
    let cargo = env::var_os("CARGO").unwrap_or_else(|| "cargo".into());
    let status = Command::new(cargo)
        .args(["build", "--release", "-p", "growbot-host"])
        .current_dir(repository)
        .status()
        .context("cargo cannot be run")?;
    ensure!(status.success(), "growbot cannot be built: see above");
    Ok(target.join("release/growbot"))
}
