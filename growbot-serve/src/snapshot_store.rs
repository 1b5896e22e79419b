//! Pictures of a growing body, one of each layer: `snapshots/JOB/LAYER.jpg` or `.png`.

use std::fs::{self, DirBuilder};
use std::io;
use std::os::unix::fs::DirBuilderExt;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};
use std::time::SystemTime;

use growbot_plan::atomic_file::write_atomic;
use rustix::fs::statvfs;

use super::paths::ServicePaths;
use super::picture::{Picture, PictureFormat};

/// Limits of the store.
#[derive(Debug, Clone, Copy)]
struct StoreLimits {
    /// Maximum size of all pictures together, bytes.
    max_bytes: u64,
    /// Free space of the disk below which pictures are deleted, and none is stored, bytes.
    min_free: u64,
}

const LIMITS: StoreLimits = StoreLimits { max_bytes: 4 << 30, min_free: 1 << 30 };

/// Reasons why a picture is not stored.
#[derive(Debug, thiserror::Error)]
pub enum SnapshotError {
    #[error("less than {} GiB are free on the disk of {directory}: free space there", min_free >> 30)]
    DiskFull { min_free: u64, directory: String },
    #[error("the pictures of this job alone have {} MiB: lower the resolution of the camera", .0 >> 20)]
    StoreFull(u64),
    #[error("{0}")]
    Write(#[from] io::Error),
}

/// The stored pictures of all jobs.
pub struct SnapshotStore {
    directory: PathBuf,
    limits: StoreLimits,
    /// Size of all pictures together, bytes, or more. `None` until they are counted.
    bytes: Mutex<Option<u64>>,
}

impl SnapshotStore {
    /// Returns the store in the service's directory.
    pub fn new(places: &ServicePaths) -> Self {
        Self { directory: places.snapshots(), limits: LIMITS, bytes: Mutex::default() }
    }

    /// Stores the picture of a layer. If all pictures together would be too large, or the disk is nearly full, those of
    /// the oldest other jobs are deleted.
    ///
    /// # Errors
    /// The disk stays nearly full, the pictures of this job fill the store, or the file cannot be written.
    pub fn add(&self, job: &str, layer: u32, picture: &Picture) -> Result<(), SnapshotError> {
        let mut bytes = self.bytes.lock().unwrap_or_else(PoisonError::into_inner);
        let StoreLimits { max_bytes, min_free } = self.limits;
        let added = picture.bytes.len() as u64;
        let mut total = bytes.unwrap_or(max_bytes);
        if total + added > max_bytes || self.is_disk_full()? {
            let jobs = self.jobs()?;
            total = jobs.iter().map(|(_, _, size)| size).sum();
            for (path, _, size) in jobs.into_iter().filter(|(path, ..)| !path.ends_with(job)) {
                if total + added <= max_bytes && !self.is_disk_full()? {
                    break;
                }
                fs::remove_dir_all(&path)?;
                total = total.saturating_sub(size);
            }
        }
        *bytes = Some(total);
        if total + added > max_bytes {
            return Err(SnapshotError::StoreFull(max_bytes));
        }
        if self.is_disk_full()? {
            return Err(SnapshotError::DiskFull { min_free, directory: self.directory.display().to_string() });
        }
        let directory = self.directory.join(job);
        DirBuilder::new().recursive(true).mode(0o700).create(&directory)?;
        let name = format!("{layer}.{}", picture.format.extension());
        write_atomic(&directory.join(name), &picture.bytes).map_err(io::Error::other)?;
        *bytes = Some(total + added);
        Ok(())
    }

    fn is_disk_full(&self) -> io::Result<bool> {
        let disk = statvfs(&self.directory)?;
        Ok(disk.f_bavail.saturating_mul(disk.f_frsize) < self.limits.min_free)
    }

    /// Returns the layers of a job of which there are pictures, in order.
    pub fn layers(&self, job: &str) -> Vec<u32> {
        let files = fs::read_dir(self.directory.join(job)).into_iter().flatten().flatten();
        let mut layers: Vec<u32> = files.filter_map(|file| layer_of(&file.path())).collect();
        layers.sort_unstable();
        layers.dedup();
        layers
    }

    /// Returns the picture of a layer. `None` if there is none.
    pub fn get(&self, job: &str, layer: u32) -> Option<Picture> {
        PictureFormat::ALL.into_iter().find_map(|format| {
            let path = self.directory.join(job).join(format!("{layer}.{}", format.extension()));
            Some(Picture { format, bytes: fs::read(path).ok()?.into() })
        })
    }

    /// Returns the directory of each job with the time of its latest picture and its size, the oldest first.
    fn jobs(&self) -> io::Result<Vec<(PathBuf, SystemTime, u64)>> {
        let mut jobs = Vec::new();
        for entry in fs::read_dir(&self.directory)? {
            let (path, mut size, mut latest) = (entry?.path(), 0, SystemTime::UNIX_EPOCH);
            if !path.is_dir() {
                continue;
            }
            for file in fs::read_dir(&path)? {
                let metadata = file?.metadata()?;
                size += metadata.len();
                latest = latest.max(metadata.modified()?);
            }
            jobs.push((path, latest, size));
        }
        jobs.sort_unstable_by_key(|(_, latest, _)| *latest);
        Ok(jobs)
    }
}

fn layer_of(file: &Path) -> Option<u32> {
    let extension = file.extension()?.to_str()?;
    let is_picture = PictureFormat::ALL.iter().any(|format| format.extension() == extension);
    is_picture.then(|| file.file_stem()?.to_str()?.parse().ok()).flatten()
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;

    fn picture(bytes: usize) -> Picture {
        let mut picture = b"\xff\xd8\xff".to_vec();
        picture.resize(bytes, 0);
        Picture { format: PictureFormat::Jpeg, bytes: picture.into() }
    }

    fn store(directory: &tempfile::TempDir, limits: StoreLimits) -> SnapshotStore {
        let directory = directory.path().to_owned();
        SnapshotStore { directory, limits, bytes: Mutex::default() }
    }

    /// Makes the pictures of a job older.
    fn age(store: &SnapshotStore, job: &str, hours: u64) {
        for file in fs::read_dir(store.directory.join(job)).unwrap() {
            let file = fs::File::open(file.unwrap().path()).unwrap();
            file.set_modified(SystemTime::now() - Duration::from_secs(3600 * hours)).unwrap();
        }
    }

    #[test]
    fn the_pictures_of_a_job_come_back_in_order() {
        let directory = tempfile::tempdir().unwrap();
        let store = store(&directory, StoreLimits { min_free: 0, ..LIMITS });
        for layer in [10, 2, 0] {
            store.add("lab-1", layer, &picture(10 + layer as usize)).unwrap();
        }
        fs::write(directory.path().join("lab-1/3.jpg.part"), "").unwrap();
        assert_eq!((store.layers("lab-1"), store.layers("lab-2")), (vec![0, 2, 10], vec![]));
        assert_eq!(store.get("lab-1", 2), Some(picture(12)));
        assert_eq!((store.get("lab-1", 1), store.get("lab-2", 2)), (None, None));
    }

    #[test]
    fn a_full_store_gives_up_the_oldest_other_job() {
        let directory = tempfile::tempdir().unwrap();
        let limits = StoreLimits { min_free: 0, max_bytes: 100 };
        for (job, hours) in [("old", 2), ("older", 3), ("own", 9)] {
            let store = store(&directory, limits);
            store.add(job, 0, &picture(30)).unwrap();
            age(&store, job, hours);
        }
        // A new store counts what is there.
        let store = store(&directory, limits);
        store.add("own", 1, &picture(30)).unwrap();
        let left = ["old", "older", "own"].map(|job| store.layers(job));
        assert_eq!(left, [vec![0], vec![], vec![0, 1]]);
        store.add("own", 2, &picture(40)).unwrap();
        assert_eq!(["old", "own"].map(|job| store.layers(job)), [vec![], vec![0, 1, 2]]);
        assert!(matches!(store.add("own", 3, &picture(30)), Err(SnapshotError::StoreFull(100))));
        assert_eq!(store.layers("own"), [0, 1, 2]);
    }

    #[test]
    fn nothing_is_stored_on_a_disk_that_is_nearly_full() {
        let directory = tempfile::tempdir().unwrap();
        let store = store(&directory, StoreLimits { min_free: u64::MAX, ..LIMITS });
        assert!(matches!(store.add("lab-1", 0, &picture(10)), Err(SnapshotError::DiskFull { .. })));
    }
}
