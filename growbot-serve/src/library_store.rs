//! Plans, scenes and robot files that people keep under a name, in a file for each entry.
//!
//! Jobs and queued bodies have copies of their plans, and the service never deletes stored scenes, so that nothing that
//! they use is removed with an entry.

use std::fs;
use std::io::{self, ErrorKind};
use std::path::PathBuf;
use std::sync::{Mutex, MutexGuard, PoisonError};

use growbot_plan::atomic_file::{FileError, write_atomic};
use growbot_plan::sanitize::is_control;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use strum::Display;

use super::paths::ServicePaths;

/// Maximum number of entries.
pub const MAX_ENTRIES: usize = 500;
/// Maximum size of all entries together, bytes. Scenes are stored elsewhere.
const MAX_BYTES: u64 = 64 << 20;
/// Maximum length of a name, characters.
const MAX_NAME: usize = 100;

/// Kind of an entry.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema, Display)]
#[serde(rename_all = "kebab-case")]
#[strum(serialize_all = "kebab-case")]
pub enum LibraryKind {
    /// A plan.
    Plan,
    /// A scene.
    Scene,
    /// The description of a robot.
    Robot,
}

/// An entry of the library.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct LibraryEntry {
    /// Identifier, also in URLs.
    pub id: String,
    /// Kind of the entry.
    pub kind: LibraryKind,
    /// Name for people. The service uses it in no path.
    pub name: String,
    /// Summary of the content, for people.
    pub summary: String,
    /// Name of the scene in the service: of this entry, or of its plan. Null without one.
    pub scene: Option<String>,
    /// Time when the entry was added, RFC 3339.
    pub created_utc: String,
}

/// An entry in its file.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct StoredEntry {
    /// The entry.
    pub entry: LibraryEntry,
    /// Text of the plan or of the robot file. Empty for a scene, which is stored elsewhere.
    pub text: String,
    /// Picture of the entry, an SVG document.
    pub thumbnail: String,
}

/// Errors of the library.
#[derive(Debug, thiserror::Error)]
pub enum LibraryError {
    /// The name is too long, empty, or contains control characters.
    #[error("the name {0:?} cannot be used: give 1 to {MAX_NAME} characters, without control characters")]
    Name(String),
    /// Another entry has that name.
    #[error("the library has a {0} {1:?}: choose another name, or remove that entry")]
    NameTaken(LibraryKind, String),
    /// There are too many entries.
    #[error("the library has {MAX_ENTRIES} entries, the limit: remove one of them")]
    Full,
    /// The entries are too large.
    #[error("with this entry, the library would have more than {MAX_BYTES} bytes: remove an entry")]
    TooLarge,
    /// The library has no such entry.
    #[error("no entry {0:?} in the library")]
    NotFound(String),
    /// A file of the library cannot be used.
    #[error("cannot use {path} of the library ({error}): mend the file, or move it away", path = .path.display())]
    File {
        /// Path of the file.
        path: PathBuf,
        /// Error of the operating system, or of the content.
        error: io::Error,
    },
    /// The file of an entry cannot be written.
    #[error(transparent)]
    Write(#[from] FileError),
}

/// The library of the service.
pub struct LibraryStore {
    directory: PathBuf,
    /// Held while entries are added or removed.
    lock: Mutex<()>,
}

impl LibraryStore {
    /// Creates the store with the files of these paths.
    pub fn new(places: &ServicePaths) -> Self {
        Self { directory: places.library(), lock: Mutex::new(()) }
    }

    /// Returns the entries, the latest first. Leaves out those that cannot be read.
    pub fn entries(&self) -> Result<Vec<LibraryEntry>, LibraryError> {
        let _lock = self.lock();
        self.entries_of(&self.ids()?)
    }

    fn entries_of(&self, ids: &[u64]) -> Result<Vec<LibraryEntry>, LibraryError> {
        let entry = |id: &u64| self.read(*id).inspect_err(|error| log::warn!("{error}")).ok();
        Ok(ids.iter().rev().filter_map(entry).map(|stored| stored.entry).collect())
    }

    /// Adds an entry. Its identifier is replaced by a new one. Returns the entry.
    pub fn add(&self, mut stored: StoredEntry) -> Result<LibraryEntry, LibraryError> {
        let LibraryEntry { kind, name, created_utc, .. } = &stored.entry;
        let length = name.chars().count();
        if length == 0 || length > MAX_NAME || name.chars().any(is_control) || name.trim() != name {
            return Err(LibraryError::Name(name.clone()));
        }
        let time: String = created_utc.chars().filter(char::is_ascii_digit).collect();
        let _lock = self.lock();
        let ids = self.ids()?;
        if ids.len() >= MAX_ENTRIES {
            return Err(LibraryError::Full);
        }
        if self.entries_of(&ids)?.iter().any(|entry| entry.kind == *kind && entry.name == *name) {
            return Err(LibraryError::NameTaken(*kind, name.clone()));
        }
        let id = time.parse().unwrap_or(0).max(ids.last().map_or(0, |latest| latest + 1));
        stored.entry.id = id.to_string();
        let path = self.path(id);
        let bytes = serde_json::to_vec(&stored)
            .map_err(|error| LibraryError::File { path: path.clone(), error: error.into() })?;
        let sizes = ids.iter().filter_map(|id| Some(fs::metadata(self.path(*id)).ok()?.len()));
        if sizes.sum::<u64>() + bytes.len() as u64 > MAX_BYTES {
            return Err(LibraryError::TooLarge);
        }
        write_atomic(&path, &bytes)?;
        Ok(stored.entry)
    }

    /// Returns an entry with its content.
    pub fn get(&self, id: &str) -> Result<StoredEntry, LibraryError> {
        self.read(number_of(id)?)
    }

    /// Removes an entry. Returns the entries that remain.
    pub fn remove(&self, id: &str) -> Result<Vec<LibraryEntry>, LibraryError> {
        let path = self.path(number_of(id)?);
        {
            let _lock = self.lock();
            fs::remove_file(&path).map_err(|error| match error.kind() {
                ErrorKind::NotFound => LibraryError::NotFound(id.to_owned()),
                _ => LibraryError::File { path, error },
            })?;
        }
        self.entries()
    }

    /// Returns the identifiers of all entries, the latest last.
    fn ids(&self) -> Result<Vec<u64>, LibraryError> {
        let files = fs::read_dir(&self.directory)
            .map_err(|error| LibraryError::File { path: self.directory.clone(), error })?;
        let id = |file: io::Result<fs::DirEntry>| file.ok()?.file_name().to_str()?.strip_suffix(".json")?.parse().ok();
        let mut ids: Vec<u64> = files.filter_map(id).collect();
        ids.sort_unstable();
        Ok(ids)
    }

    fn read(&self, id: u64) -> Result<StoredEntry, LibraryError> {
        let path = self.path(id);
        match fs::read(&path) {
            Ok(bytes) => {
                serde_json::from_slice(&bytes).map_err(|error| LibraryError::File { path, error: error.into() })
            }
            Err(error) if error.kind() == ErrorKind::NotFound => Err(LibraryError::NotFound(id.to_string())),
            Err(error) => Err(LibraryError::File { path, error }),
        }
    }

    fn path(&self, id: u64) -> PathBuf {
        self.directory.join(format!("{id}.json"))
    }

    fn lock(&self) -> MutexGuard<'_, ()> {
        self.lock.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Returns the number of an identifier in a URL, which names the file of its entry.
fn number_of(id: &str) -> Result<u64, LibraryError> {
    id.parse().map_err(|_| LibraryError::NotFound(id.to_owned()))
}
