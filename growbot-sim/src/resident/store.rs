//! The flash and the retained memory of a simulated board, as files.

use std::fs::File;
use std::io;
use std::os::unix::fs::FileExt;

use growbot_firmware::hal::RetainedMemory;
use growbot_firmware::safety::retained::RETAINED_BYTES;

use super::{Place, ResidentError};
use crate::port::sim::Sim;

/// The files, and what they hold.
pub struct Store {
    place: Place,
    flash: Kept,
    retained: Kept,
    /// Writes of the flash that are in the file.
    flash_writes: u64,
}

impl Store {
    /// Opens the files, and has the board know what they hold. Returns whether it retains something.
    pub fn open(place: &Place, sim: &mut Sim) -> Result<(Self, bool), ResidentError> {
        let flash = Kept::open(place, "flash", &sim.flash().bytes())?;
        let erased = [0; RETAINED_BYTES];
        let retained = Kept::open(place, "retained", &erased)?;
        sim.flash().set_bytes(&flash.bytes);
        let retains = retained.bytes != erased;
        if retains {
            sim.retained().set(&retained.bytes);
        }
        let flash_writes = sim.flash().writes();
        Ok((Self { place: place.clone(), flash, retained, flash_writes }, retains))
    }

    /// Writes what has changed.
    pub fn keep(&mut self, sim: &Sim) -> Result<(), ResidentError> {
        let writes = sim.flash().writes();
        if writes != self.flash_writes {
            self.flash.keep(&self.place, "flash", &sim.flash().bytes())?;
            self.flash_writes = writes;
        }
        self.retained.keep(&self.place, "retained", &sim.retained().read())
    }

    /// The power goes: nothing is retained.
    pub fn lose_retained(&mut self) -> Result<(), ResidentError> {
        self.retained.keep(&self.place, "retained", &[0; RETAINED_BYTES])
    }
}

/// A file that is a copy of a memory.
struct Kept {
    file: File,
    bytes: Vec<u8>,
}

impl Kept {
    /// The file, which holds this if there is none of that length.
    fn open(place: &Place, name: &str, at_first: &[u8]) -> Result<Self, ResidentError> {
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

    /// Writes from the first byte that differs to the last, in one piece.
    fn keep(&mut self, place: &Place, name: &str, now: &[u8]) -> Result<(), ResidentError> {
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
