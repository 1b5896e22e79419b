//! The flash and the retained memory of a simulated board, as files.

use std::fs::File;
use std::io;
use std::os::unix::fs::FileExt;

use growbot_firmware::hal::RetainedMemory;
use growbot_firmware::safety::retained::RETAINED_BYTES;

use super::{SimDaemonError, StateDir};
use crate::port::sim::Sim;
use crate::tip::flash::Flash;

/// The files that store the flash and the retained memory of a simulated board.
pub struct PersistentMemory {
    place: StateDir,
    flash: KeptFlash,
    /// Flash that stores the robot's description.
    descriptions: KeptFlash,
    retained: MemoryFile,
    /// Hash of the robot description in the directory's file `robot`.
    robot: u64,
}

impl PersistentMemory {
    /// Opens the files and loads their content into the board. The returned flag is true if retained memory was loaded.
    pub fn open(place: &StateDir, sim: &mut Sim) -> Result<(Self, bool), SimDaemonError> {
        let erased = [0; RETAINED_BYTES];
        let flash = KeptFlash::open(place, "flash", sim.flash())?;
        let descriptions = KeptFlash::open(place, "description-flash", sim.descriptions())?;
        let retained = MemoryFile::open(place, "retained", &erased)?;
        let retains = retained.bytes != erased;
        if retains {
            sim.retained().set(&retained.bytes);
        }
        let robot = sim.robot().hash();
        Ok((Self { place: place.clone(), flash, descriptions, retained, robot }, retains))
    }

    /// Writes the changes of the board's memories to the files.
    pub fn save(&mut self, sim: &Sim) -> Result<(), SimDaemonError> {
        self.flash.save(&self.place)?;
        self.descriptions.save(&self.place)?;
        if sim.robot().hash() != self.robot {
            self.place.store_robot(sim.robot())?;
            self.robot = sim.robot().hash();
        }
        self.retained.save(&self.place, "retained", &sim.retained().read())
    }

    /// Erases the file of the retained memory, because the board loses power.
    pub fn lose_retained(&mut self) -> Result<(), SimDaemonError> {
        self.retained.save(&self.place, "retained", &[0; RETAINED_BYTES])
    }
}

/// A file that mirrors a flash.
struct KeptFlash {
    name: &'static str,
    kept: MemoryFile,
    flash: Flash,
    /// Number of writes to the flash when the file was last saved.
    writes: u64,
}

impl KeptFlash {
    /// Opens the file and loads its content into the flash.
    fn open(place: &StateDir, name: &'static str, flash: Flash) -> Result<Self, SimDaemonError> {
        let kept = MemoryFile::open(place, name, &flash.bytes())?;
        flash.set_bytes(&kept.bytes);
        let writes = flash.writes();
        Ok(Self { name, kept, flash, writes })
    }

    fn save(&mut self, place: &StateDir) -> Result<(), SimDaemonError> {
        let writes = self.flash.writes();
        if writes != self.writes {
            self.kept.save(place, self.name, &self.flash.bytes())?;
            self.writes = writes;
        }
        Ok(())
    }
}

/// A file that mirrors a memory.
struct MemoryFile {
    file: File,
    bytes: Vec<u8>,
}

impl MemoryFile {
    /// Opens the file. If it does not have the length of `at_first`, writes `at_first` to it.
    fn open(place: &StateDir, name: &str, at_first: &[u8]) -> Result<Self, SimDaemonError> {
        let path = place.file(name);
        let opened = || -> io::Result<Self> {
            let file = File::options().read(true).write(true).create(true).truncate(false).open(&path)?;
            let mut bytes = at_first.to_vec();
            if file.metadata()?.len() == bytes.len() as u64 {
                file.read_exact_at(&mut bytes, 0)?;
            } else {
                file.set_len(0)?;
                file.write_all_at(&bytes, 0)?;
            }
            Ok(Self { file, bytes })
        };
        opened().map_err(|error| place.failed("open", path.clone(), error))
    }

    /// Writes the bytes of `now` that differ from the file's content, as one range from the first to the last changed
    /// byte.
    fn save(&mut self, place: &StateDir, name: &str, now: &[u8]) -> Result<(), SimDaemonError> {
        let mut differ = (0..now.len()).filter(|&at| self.bytes.get(at) != now.get(at));
        let Some(first) = differ.next() else { return Ok(()) };
        let last = differ.next_back().unwrap_or(first);
        let changed = now.get(first..=last).unwrap_or_default();
        let written = self.file.write_all_at(changed, first as u64);
        written.map_err(|error| place.failed("write", place.file(name), error))?;
        self.bytes = now.to_vec();
        Ok(())
    }
}
