//! `-o DIR` of commands that write several files.

use std::fs;
use std::path::Path;

use growbot_host::output::is_standard_output;
use growbot_plan::atomic_file::{FileError, write_atomic};

use super::failure::Failure;

/// Checks that the directory exists or can be created. Commands call this function first, so that a directory that
/// cannot be written is reported at once and not at the end. A directory that it creates is removed again, so that an
/// interrupted command leaves none.
pub fn check(directory: &Path) -> Result<(), Failure> {
    if directory.is_dir() {
        return Ok(());
    }
    if is_standard_output(directory) {
        return Err(Failure::bad_input("several files cannot go to standard output: give a directory with -o"));
    }
    if directory.exists() {
        return Err(Failure::bad_input(format!(
            "-o takes a directory, but {} is a file: name a directory",
            directory.display()
        )));
    }
    let parent = directory.parent().filter(|parent| !parent.as_os_str().is_empty());
    if let Some(parent) = parent.filter(|parent| !parent.is_dir()) {
        return Err(Failure::from(FileError::NoDirectory {
            file: directory.display().to_string(),
            directory: parent.display().to_string(),
        }));
    }
    fs::create_dir(directory)
        .and_then(|()| fs::remove_dir(directory))
        .map_err(|error| Failure::from(FileError::File { file: directory.display().to_string(), error }))
}

/// Writes these files into the directory, which it creates if necessary, over those of the same names, and prints a
/// note.
pub fn fill<'a>(directory: &Path, files: impl IntoIterator<Item = (&'a str, &'a [u8])>) -> Result<(), Failure> {
    fs::create_dir_all(directory)
        .map_err(|error| Failure::from(FileError::File { file: directory.display().to_string(), error }))?;
    let mut count = 0;
    for (name, contents) in files {
        write_atomic(&directory.join(name), contents)?;
        count += 1;
    }
    growbot_host::note!("{count} files written to {}", directory.display());
    Ok(())
}
