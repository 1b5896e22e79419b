//! Writing of files so that a file is either complete or absent.
//!
//! This module also refuses to overwrite a file that the program reads ([`refuse_inputs`], [`note_input`]), and to
//! write a file whose extension is not one of the expected formats ([`format_from_extension`]).

use std::collections::VecDeque;
use std::ffi::{OsStr, OsString};
use std::fs::{self, File, Metadata, OpenOptions};
use std::io::{self, Seek, Write};
use std::os::fd::{AsFd, AsRawFd};
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use rustix::fs::{AtFlags, CWD, linkat};

/// Error of writing a file.
#[derive(Debug, thiserror::Error)]
pub enum FileError {
    /// The directory of the file that was to be written does not exist.
    #[error("cannot write {file}: directory {directory} does not exist; create it, or choose another directory")]
    NoDirectory {
        /// Path of the file that was to be written.
        file: String,
        /// Path of the missing directory.
        directory: String,
    },
    /// The file that was to be written is an input of the command.
    #[error("cannot write {file}: this file is an input of this command and would be lost; choose another file")]
    Input {
        /// Path of the file that was to be written.
        file: String,
    },
    /// Standard output is redirected to an input of the command.
    #[error(
        "cannot read {file}: standard output is redirected to it, and the output would overwrite it; redirect to \
         another file"
    )]
    OntoInput {
        /// Path of the input.
        file: String,
    },
    /// The file's extension is not one of the supported formats.
    #[error("cannot write {file}: its extension .{ending} is not supported here; use {formats}")]
    UnknownExtension {
        /// Path of the file that was to be written.
        file: String,
        /// Extension of the file, without the dot.
        ending: String,
        /// List of the supported extensions, such as ".json, .csv or .stl".
        formats: String,
    },
    /// The file cannot be written.
    #[error("cannot write {file}: {error}")]
    File {
        /// Path of the file that was to be written.
        file: String,
        /// Error of the operating system.
        #[source]
        error: io::Error,
    },
}

/// The latest inputs of this program: device and inode of each file, and the open file itself. As long as the file is
/// open, the system does not reuse its inode, even if the file is deleted.
static READ: Mutex<VecDeque<((u64, u64), File)>> = Mutex::new(VecDeque::new());
/// Maximum number of recorded inputs. No command reads more files.
const MAX_READ: usize = 64;

/// Records a file as an input of this program. From then on, this module refuses to write to the file under any of its
/// names. `name` is the file's name in error messages.
///
/// # Errors
/// [`FileError::OntoInput`] if standard output is redirected to the file. The error is returned before any work is
/// done, because the results could not be printed.
pub fn note_input(file: File, name: &str) -> Result<(), FileError> {
    note_input_beside(file, name, place_of_stdout())
}

/// Like [`note_input`], but takes the identity (device, inode) of the file that standard output is redirected to as
/// `stdout`.
fn note_input_beside(file: File, name: &str, stdout: Option<(u64, u64)>) -> Result<(), FileError> {
    let Some(place) = file.metadata().ok().as_ref().and_then(place_of) else { return Ok(()) };
    if stdout == Some(place) {
        return Err(FileError::OntoInput { file: name.to_owned() });
    }
    let mut read = READ.lock().unwrap_or_else(PoisonError::into_inner);
    if read.iter().all(|(known, _)| *known != place) {
        read.truncate(MAX_READ - 1);
        read.push_front((place, file));
    }
    Ok(())
}

/// Returns the identity (device, inode) of the file that standard output is redirected to. `None` unless it is a
/// regular file.
fn place_of_stdout() -> Option<(u64, u64)> {
    let stdout = File::from(io::stdout().as_fd().try_clone_to_owned().ok()?);
    stdout.metadata().ok().as_ref().and_then(place_of)
}

/// Returns an error if the file at this path is an input of this program. Links, relative paths and descriptors of an
/// input are recognized.
///
/// # Errors
/// [`FileError::Input`] if the file is an input.
pub fn refuse_inputs(path: &Path) -> Result<(), FileError> {
    let place = fs::metadata(path).ok().as_ref().and_then(place_of);
    let read = READ.lock().unwrap_or_else(PoisonError::into_inner);
    if place.is_some_and(|place| read.iter().any(|(known, _)| *known == place)) {
        return Err(FileError::Input { file: path.display().to_string() });
    }
    Ok(())
}

/// Returns the device and inode of a file, which are the same under each of its names. `None` unless it is a regular
/// file.
fn place_of(file: &Metadata) -> Option<(u64, u64)> {
    file.is_file().then(|| (file.dev(), file.ino()))
}

/// Returns the element of `formats` that equals a file's extension, in lower or upper case. `None` for a name without
/// an extension, and for standard output (`-`).
///
/// # Errors
/// [`FileError::UnknownExtension`] for any other extension.
pub fn format_from_extension<'a>(path: &Path, formats: &[&'a str]) -> Result<Option<&'a str>, FileError> {
    let Some(ending) = ending(path) else { return Ok(None) };
    match formats.iter().find(|format| **format == ending) {
        Some(format) => Ok(Some(format)),
        None => Err(unknown_ending(path, formats)),
    }
}

/// Returns the extension of a file's name, in lower case.
fn ending(path: &Path) -> Option<String> {
    path.extension().and_then(OsStr::to_str).map(str::to_ascii_lowercase)
}

/// Returns [`FileError::UnknownExtension`] for a file whose extension is not one of `formats`.
fn unknown_ending(path: &Path, formats: &[&str]) -> FileError {
    let formats: Vec<String> = formats.iter().map(|format| format!(".{format}")).collect();
    let formats = match formats.split_last() {
        Some((last, [])) => last.clone(),
        Some((last, others)) => format!("{} or {last}", others.join(", ")),
        None => String::new(),
    };
    FileError::UnknownExtension { file: path.display().to_string(), ending: ending(path).unwrap_or_default(), formats }
}

/// Writes a file through a temporary file in the same directory, which is then renamed. Readers therefore never see an
/// incomplete file, and after a failure the old file is still there. Symbolic links are followed. A device or a named
/// pipe is written to directly.
///
/// # Errors
/// [`FileError::NoDirectory`] or [`FileError::File`]; [`FileError::Input`] for a file that this program has read.
pub fn write_atomic(path: &Path, contents: &[u8]) -> Result<(), FileError> {
    let mut replacement = AtomicFile::begin(path)?;
    replacement.add(contents)?;
    replacement.finish()
}

/// The file that is written in place of the target.
#[derive(Debug)]
enum TemporaryFile {
    /// A file without a name, which the operating system deletes if the program ends early, for example by Ctrl-C.
    Unnamed,
    /// A file with this path, on file systems without unnamed files.
    Named(PathBuf),
    /// None: the target is a device, which is written to directly, or the file has its name already.
    None,
}

/// A file that is written in several calls, through a temporary file like that of [`write_atomic`]. [`Self::finish`]
/// gives the file its name. If the value is dropped before, the temporary file is deleted.
#[derive(Debug)]
pub struct AtomicFile {
    /// Path of the file as it was given, for error messages.
    name: String,
    target: PathBuf,
    temporary: TemporaryFile,
    file: File,
    existing: Option<Metadata>,
}

impl AtomicFile {
    /// Creates the temporary file for a file at this path.
    ///
    /// # Errors
    /// Like [`write_atomic`].
    pub fn begin(path: &Path) -> Result<Self, FileError> {
        refuse_inputs(path)?;
        let name = path.display().to_string();
        let failed = |error| FileError::File { file: path.display().to_string(), error };
        let target = fs::canonicalize(path).unwrap_or_else(|_| path.to_owned());
        let existing = fs::metadata(&target).ok();
        match &existing {
            Some(existing) if existing.is_dir() => return Err(failed(io::ErrorKind::IsADirectory.into())),
            Some(existing) if !existing.is_file() => {
                let file = OpenOptions::new().write(true).open(&target).map_err(failed)?;
                return Ok(Self { name, target, temporary: TemporaryFile::None, file, existing: None });
            }
            _ => {}
        }
        let directory = match target.parent() {
            Some(parent) if !parent.as_os_str().is_empty() => parent,
            _ => Path::new("."),
        };
        let names_a_directory = path.to_string_lossy().ends_with(std::path::is_separator);
        if names_a_directory || !directory.is_dir() {
            let missing = if names_a_directory { path } else { directory };
            return Err(FileError::NoDirectory { file: name, directory: missing.display().to_string() });
        }
        let (temporary, file) = match create_unnamed(directory) {
            Ok(file) => (TemporaryFile::Unnamed, file),
            Err(_) => {
                create_beside(&target).map(|(partial, file)| (TemporaryFile::Named(partial), file)).map_err(failed)?
            }
        };
        Ok(Self { name, target, temporary, file, existing })
    }

    /// Appends bytes to the file.
    ///
    /// # Errors
    /// [`FileError::File`].
    pub fn add(&mut self, contents: &[u8]) -> Result<(), FileError> {
        self.file.write_all(contents).map_err(|error| self.failed(error))
    }

    /// Renames the temporary file to the path of the file, and replaces an earlier file there.
    ///
    /// # Errors
    /// [`FileError::File`].
    pub fn finish(mut self) -> Result<(), FileError> {
        if matches!(self.temporary, TemporaryFile::None) {
            return Ok(());
        }
        let mut put = || {
            if let Some(existing) = &self.existing {
                self.file.set_permissions(existing.permissions())?;
            }
            // Without this, a power cut after the rename could leave an empty file in place of a good one.
            self.file.sync_all()?;
            if matches!(self.temporary, TemporaryFile::Unnamed) {
                // A link cannot replace a file, and a rename can.
                let linked = beside(&self.target, |partial| {
                    linkat(CWD, descriptor_path(&self.file), CWD, partial, AtFlags::SYMLINK_FOLLOW).map_err(Into::into)
                });
                let partial = linked.map(|(partial, ())| partial).or_else(|_| self.copy_beside())?;
                self.temporary = TemporaryFile::Named(partial);
            }
            if let TemporaryFile::Named(partial) = &self.temporary {
                fs::rename(partial, &self.target)?;
            }
            Ok(())
        };
        put().map_err(|error| self.failed(error))?;
        self.temporary = TemporaryFile::None;
        Ok(())
    }

    /// Copies the file to one with a temporary name, on file systems that have unnamed files and cannot name them.
    fn copy_beside(&self) -> io::Result<PathBuf> {
        let (partial, mut copy) = create_beside(&self.target)?;
        copy.set_permissions(self.file.metadata()?.permissions())?;
        (&self.file).rewind()?;
        io::copy(&mut &self.file, &mut copy)?;
        copy.sync_all()?;
        Ok(partial)
    }

    /// Converts an error of the operating system to [`FileError::File`] with the name of this file.
    pub fn failed(&self, error: io::Error) -> FileError {
        FileError::File { file: self.name.clone(), error }
    }
}

impl Write for AtomicFile {
    fn write(&mut self, contents: &[u8]) -> io::Result<usize> {
        self.file.write(contents)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.file.flush()
    }
}

impl Drop for AtomicFile {
    fn drop(&mut self) {
        if let TemporaryFile::Named(partial) = &self.temporary {
            let _ = fs::remove_file(partial);
        }
    }
}

/// An old file that was renamed within its directory, because a new file is about to take its name. Dropping the value
/// deletes the old file; [`Self::restore`] gives it its name again. If the program is killed before, the old file stays
/// under its temporary name.
#[derive(Debug)]
pub struct DisplacedFile {
    place: PathBuf,
    aside: PathBuf,
}

impl DisplacedFile {
    /// Renames the file at this path, or the target of a symbolic link, to a temporary name. Returns `None` if the file
    /// does not exist or is not a regular file.
    ///
    /// # Errors
    /// [`FileError::File`] if the file cannot be renamed.
    pub fn move_aside(path: &Path) -> Result<Option<Self>, FileError> {
        let Ok(place) = fs::canonicalize(path) else { return Ok(None) };
        if !fs::metadata(&place).is_ok_and(|file| file.is_file()) {
            return Ok(None);
        }
        let failed = |error| FileError::File { file: path.display().to_string(), error };
        // The empty file reserves the name for the rename.
        let (aside, _) = create_beside(&place).map_err(failed)?;
        fs::rename(&place, &aside).map_err(failed)?;
        Ok(Some(Self { place, aside }))
    }

    /// Returns the original path of the old file, with symbolic links resolved.
    pub fn place(&self) -> &Path {
        &self.place
    }

    /// Gives the old file its original name again, and replaces the new file that has this name now.
    pub fn restore(self) {
        if fs::rename(&self.aside, &self.place).is_err() {
            // The old file stays under its temporary name.
            std::mem::forget(self);
        }
    }
}

impl Drop for DisplacedFile {
    fn drop(&mut self) {
        let _ = fs::remove_file(&self.aside);
    }
}

/// Creates a file without a name in this directory. Only Linux has such files.
#[cfg(not(target_os = "linux"))]
fn create_unnamed(_: &Path) -> io::Result<File> {
    Err(io::ErrorKind::Unsupported.into())
}

/// Creates a file without a name in this directory.
#[cfg(target_os = "linux")]
fn create_unnamed(directory: &Path) -> io::Result<File> {
    use rustix::fs::{Mode, OFlags, openat};

    let flags = OFlags::TMPFILE | OFlags::RDWR | OFlags::CLOEXEC;
    let file = File::from(openat(CWD, directory, flags, Mode::from_raw_mode(0o666))?);
    // It gets its name by this path, which a system without /proc does not have.
    fs::metadata(descriptor_path(&file))?;
    Ok(file)
}

/// Returns the path by which the operating system shows an open file.
fn descriptor_path(file: &File) -> PathBuf {
    format!("/proc/self/fd/{}", file.as_raw_fd()).into()
}

/// Creates an empty file with a unique name in the directory of `target`, because a rename works only within a file
/// system. Returns its path and the open file.
fn create_beside(target: &Path) -> io::Result<(PathBuf, File)> {
    beside(target, |partial| OpenOptions::new().write(true).create_new(true).open(partial))
}

/// Calls `create` with a unique name in the directory of `target`, and with others as long as a file has that name.
/// Returns the path and the result.
fn beside<T>(target: &Path, create: impl Fn(&Path) -> io::Result<T>) -> io::Result<(PathBuf, T)> {
    let mut attempt = 0;
    loop {
        let mut name = OsString::from(".");
        name.push(target.file_name().ok_or(io::ErrorKind::InvalidInput)?);
        name.push(format!(".{}-{attempt}.partial", std::process::id()));
        let partial = target.with_file_name(name);
        match create(&partial) {
            Err(error) if error.kind() == io::ErrorKind::AlreadyExists && attempt < 100 => attempt += 1,
            Err(error) => return Err(error),
            Ok(created) => return Ok((partial, created)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(directory: &Path) -> Vec<String> {
        fs::read_dir(directory).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect()
    }

    #[test]
    fn a_file_that_cannot_be_named_is_copied() {
        let directory = tempfile::tempdir().unwrap();
        let mut file = AtomicFile::begin(&directory.path().join("plan.json")).unwrap();
        file.add(b"all of it").unwrap();
        let copy = file.copy_beside().unwrap();
        assert_eq!(fs::read(copy).unwrap(), b"all of it");
    }

    #[test]
    fn a_file_has_no_name_until_it_is_complete() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("plan.json");
        let mut file = AtomicFile::begin(&path).unwrap();
        file.add(b"half").unwrap();
        // A program that is ended here leaves nothing, because it does not delete the file itself.
        assert_eq!(names(directory.path()), [] as [String; 0]);
        file.add(b" and half").unwrap();
        file.finish().unwrap();
        assert_eq!(names(directory.path()), ["plan.json"]);
        assert_eq!(fs::read(&path).unwrap(), b"half and half");
    }

    #[test]
    fn a_file_is_replaced_without_leftover_files() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("plan.json");
        write_atomic(&path, b"one").unwrap();
        write_atomic(&path, b"two").unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"two");
        assert_eq!(names(directory.path()), ["plan.json"]);
    }

    #[test]
    fn a_file_in_parts_replaces_the_old_one_only_when_finished() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("answers.csv");
        write_atomic(&path, b"before").unwrap();
        let mut dropped = AtomicFile::begin(&path).unwrap();
        dropped.add(b"half").unwrap();
        assert_eq!(names(directory.path()).len(), 1);
        drop(dropped);
        let mut finished = AtomicFile::begin(&path).unwrap();
        finished.add(b"one, ").unwrap();
        finished.add(b"two").unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"before");
        finished.finish().unwrap();
        assert_eq!(
            (fs::read(&path).unwrap(), names(directory.path())),
            (b"one, two".to_vec(), vec!["answers.csv".into()])
        );
    }

    #[test]
    fn missing_directories_and_directory_targets_are_errors() {
        let directory = tempfile::tempdir().unwrap();
        let missing = directory.path().join("missing");
        let error = write_atomic(&missing.join("plan.json"), b"x").unwrap_err();
        assert!(matches!(&error, FileError::NoDirectory { directory, .. } if directory.ends_with("missing")));
        assert!(matches!(write_atomic(directory.path(), b"x"), Err(FileError::File { .. })));
        assert!(names(directory.path()).is_empty());
    }

    #[test]
    fn an_input_file_is_not_overwritten_under_any_path() {
        let directory = tempfile::tempdir().unwrap();
        let path = |name: &str| directory.path().join(name);
        fs::write(path("plan"), b"old").unwrap();
        fs::hard_link(path("plan"), path("hard")).unwrap();
        std::os::unix::fs::symlink(path("plan"), path("soft")).unwrap();
        fs::write(path("other"), b"old").unwrap();
        assert_eq!(crate::input::read_text(&path("plan")).unwrap(), "old");
        fs::create_dir(path("sub")).unwrap();
        let open = File::open(path("plan")).unwrap();
        let descriptor = format!("/proc/self/fd/{}", open.as_raw_fd());
        for name in [path("plan"), path("hard"), path("soft"), path("sub").join("../plan"), descriptor.into()] {
            let refused = write_atomic(&name, b"new");
            assert!(matches!(refused, Err(FileError::Input { .. })), "{}: {refused:?}", name.display());
        }
        assert_eq!(fs::read(path("plan")).unwrap(), b"old");
        write_atomic(&path("other"), b"new").unwrap();
    }

    #[test]
    fn an_input_that_is_also_standard_output_is_refused() {
        let directory = tempfile::tempdir().unwrap();
        let [log, other] = ["run.jsonl", "other"].map(|name| directory.path().join(name));
        fs::write(&log, b"log").unwrap();
        fs::write(&other, b"other").unwrap();
        let place = |path: &Path| place_of(&fs::metadata(path).unwrap());
        let noted = |stdout| note_input_beside(File::open(&log).unwrap(), "run.jsonl", stdout);
        let refused = noted(place(&log)).unwrap_err();
        assert!(matches!(refused, FileError::OntoInput { .. }) && refused.to_string().contains("run.jsonl"));
        noted(place(&other)).unwrap();
        noted(None).unwrap();
        // A terminal or a null device may be read and written at once.
        note_input_beside(File::open("/dev/null").unwrap(), "/dev/null", place("/dev/null".as_ref())).unwrap();
    }

    #[test]
    fn an_unknown_extension_is_refused_with_the_list_of_formats() {
        for wrong in ["a.pdf", "a.PNG", "a.b.svg", "a.plan", "a."] {
            let error = format_from_extension(wrong.as_ref(), &["json", "csv", "stl"]).unwrap_err().to_string();
            assert!(error.contains("use .json, .csv or .stl"), "{error}");
        }
        for (name, format) in
            [("a", None), ("-", None), (".pdf", None), ("a.json", Some("json")), ("a.CSV", Some("csv"))]
        {
            assert_eq!(format_from_extension(name.as_ref(), &["json", "csv"]).unwrap(), format, "{name}");
        }
    }

    #[test]
    fn a_displaced_file_is_restored_or_deleted() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("run.jsonl");
        assert!(DisplacedFile::move_aside(&path).unwrap().is_none());
        fs::write(&path, b"before").unwrap();
        let aside = DisplacedFile::move_aside(&path).unwrap().unwrap();
        assert!(!path.exists());
        fs::write(&path, b"new").unwrap();
        aside.restore();
        assert_eq!((fs::read(&path).unwrap(), names(directory.path()).len()), (b"before".to_vec(), 1));
        let aside = DisplacedFile::move_aside(&path).unwrap().unwrap();
        fs::write(&path, b"new").unwrap();
        drop(aside);
        assert_eq!((fs::read(&path).unwrap(), names(directory.path()).len()), (b"new".to_vec(), 1));
        // A device stays where it is.
        assert!(DisplacedFile::move_aside("/dev/null".as_ref()).unwrap().is_none());
    }

    #[test]
    fn symlinks_are_followed_and_devices_are_written_directly() {
        let directory = tempfile::tempdir().unwrap();
        let (file, link) = (directory.path().join("file"), directory.path().join("link"));
        fs::write(&file, b"old").unwrap();
        std::os::unix::fs::symlink(&file, &link).unwrap();
        write_atomic(&link, b"new").unwrap();
        assert_eq!(fs::read(&file).unwrap(), b"new");
        assert!(fs::symlink_metadata(&link).unwrap().is_symlink());

        let null = directory.path().join("null");
        std::os::unix::fs::symlink("/dev/null", &null).unwrap();
        write_atomic(&null, b"x").unwrap();
        assert!(!fs::metadata("/dev/null").unwrap().is_file());
    }
}
