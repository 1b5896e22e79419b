//! Flashing of boards that appear as a USB drive: the UF2 file of an image, and the drive.

use std::ffi::OsStr;
use std::fs::{self, File};
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::thread;
use std::time::Duration;

use growbot_host::note;
use growbot_plan::atomic_file::write_atomic;
use growbot_sim::uf2;

use super::failure::Failure;

/// Volume name of the drive that the boot loader of a board presents.
const DRIVE: &str = "RPI-RP2";
/// File by which the drive of a board is recognised.
const MARK: &str = "INFO_UF2.TXT";
/// Directories in which drives, or the directories of a user's drives, are mounted.
const MOUNTS: [&str; 4] = ["/media", "/run/media", "/mnt", "/Volumes"];
/// Length of the last block of a UF2 file, bytes. It is written separately, because the board restarts when it has
/// every block, so that this write may fail without a loss of data.
const END: usize = 512;
/// Maximum number of checks whether the drive has disappeared.
const LOOKS: u32 = 30;
/// Pause between two checks whether the drive has disappeared.
const LOOK: Duration = Duration::from_millis(100);

/// Writes an image (ELF or UF2) as a UF2 file, to `file` or else to the drive of the board. `way` is the instruction
/// that makes the board appear as a drive, for messages.
pub fn write(image: &Path, file: Option<&Path>, drive: Option<&Path>, way: &str) -> Result<(), Failure> {
    let failed = |reason: String| Failure::bad_input(format!("{} cannot be flashed: {reason}", image.display()));
    let bytes = fs::read(image).map_err(|error| failed(error.to_string()))?;
    let uf2 = if uf2::is_uf2(&bytes) {
        let checked = uf2::check(&bytes);
        checked.map_err(|reason| failed(format!("{reason}; download the file again, or give the ELF image")))?;
        bytes
    } else {
        uf2::of_image(&bytes).map_err(|reason| {
            failed(format!("{reason}; give the image that `cargo build-pico` builds, or a UF2 file"))
        })?
    };
    if let Some(file) = file {
        write_atomic(file, &uf2)?;
        note!("the image was written to {}: {way}, and copy this file to the drive {DRIVE}", file.display());
        return Ok(());
    }
    let drive = match drive {
        Some(drive) => Some(drive.to_owned()).filter(|drive| is_board(drive)),
        None => only(find(&MOUNTS.map(Path::new)))?,
    };
    let Some(drive) = drive else {
        return Err(Failure::bad_input(format!(
            "no drive {DRIVE}, or drive of --drive, with a file {MARK} was found: {way}, and check that the drive is \
             mounted; name the drive with --drive DIR, or write a file with --uf2 FILE and copy the file to the drive"
        )));
    };
    put(&uf2, &drive)?;
    note!("written to {}: the board starts by itself", drive.display());
    Ok(())
}

/// Writes a UF2 file to a drive, and waits until it is written.
fn put(uf2: &[u8], drive: &Path) -> Result<(), Failure> {
    // A temporary file is impossible, because the board takes the data as they are written and then disappears.
    let onto = drive.join("growbot.uf2");
    let failed = |error: io::Error| {
        Failure::request_failed(format!(
            "cannot write {}: {error}; the board may have received only a part of the file: hold BOOTSEL (SKR Pico: \
             set the BOOT jumper) while you plug it in, and repeat",
            onto.display()
        ))
    };
    let (most, end) = uf2.split_at(uf2.len().saturating_sub(END));
    let mut file = File::create(&onto).map_err(|error| {
        Failure::bad_input(format!(
            "cannot write {}: {error}; check that the drive is writable and has free space",
            onto.display()
        ))
    })?;
    file.write_all(most).map_err(failed)?;
    match file.write_all(end).and_then(|()| file.sync_all()) {
        Err(error) if !wait_until_unmounted(drive) => Err(failed(error)),
        _ => Ok(()),
    }
}

/// Returns true if a drive disappears within some 3 s, as it does when its board has every block.
fn wait_until_unmounted(drive: &Path) -> bool {
    (0..LOOKS).any(|look| {
        thread::sleep(if look == 0 { Duration::ZERO } else { LOOK });
        !is_board(drive)
    })
}

fn is_board(directory: &Path) -> bool {
    directory.join(MARK).is_file()
}

/// Returns the drive if there is exactly one. `None` without a drive. Several drives are an error.
fn only(mut drives: Vec<PathBuf>) -> Result<Option<PathBuf>, Failure> {
    if drives.len() > 1 {
        let list: Vec<String> = drives.iter().map(|drive| drive.display().to_string()).collect();
        return Err(Failure::bad_input(format!(
            "{} drives of boards are mounted: {}; name the right one with --drive DIR, or unplug the others",
            drives.len(),
            list.join(", ")
        )));
    }
    Ok(drives.pop())
}

/// Returns the mounted drives of boards.
fn find(mounts: &[&Path]) -> Vec<PathBuf> {
    let within = |directory: &Path| -> Vec<PathBuf> {
        fs::read_dir(directory).into_iter().flatten().flatten().map(|entry| entry.path()).collect()
    };
    let outer = mounts.iter().flat_map(|mount| within(mount));
    let all = outer.flat_map(|mount| within(&mount).into_iter().chain([mount]));
    let mut drives: Vec<PathBuf> = all.filter(|drive| is_name(drive.file_name()) && is_board(drive)).collect();
    // One directory of mounts may be a link to another.
    drives.sort_by_cached_key(|drive| whole(drive));
    drives.dedup_by_key(|drive| whole(drive));
    drives
}

fn whole(path: &Path) -> PathBuf {
    path.canonicalize().unwrap_or_else(|_| path.to_owned())
}

/// Returns true if a drive has the name of a board's drive. The system adds a number to the name of a second drive:
/// `RPI-RP21`, `RPI-RP2 1`.
fn is_name(name: Option<&OsStr>) -> bool {
    let number = name.and_then(OsStr::to_str).and_then(|name| name.strip_prefix(DRIVE));
    number.is_some_and(|number| number.chars().all(|c| c.is_ascii_digit() || " -_".contains(c)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_single_drive_is_found_and_several_are_ambiguous() {
        let mounts = tempfile::tempdir().unwrap();
        let mounted = |name: &str| {
            let drive = mounts.path().join(name);
            fs::create_dir_all(&drive).unwrap();
            fs::write(drive.join(MARK), "").unwrap();
            drive
        };
        fs::create_dir_all(mounts.path().join("somebody/RPI-RP22")).unwrap();
        mounted("somebody/RP2350");
        mounted("somebody/another");
        let found = || only(find(&[mounts.path(), mounts.path()]));
        assert!(matches!(found(), Ok(None)));
        let second = mounted("somebody/RPI-RP21");
        assert!(matches!(found(), Ok(Some(drive)) if drive == second));
        let first = mounted("RPI-RP2");
        let Err(failure) = found() else { panic!("one was chosen") };
        for part in ["2 drives", &*first.to_string_lossy(), &*second.to_string_lossy(), "--drive DIR"] {
            assert!(failure.message().contains(part), "no {part:?} in {}", failure.message());
        }
    }
}
