//! The words that the emulated board shares with its tip, read and written from the side.

use std::fs::File;
use std::os::unix::fs::FileExt;
use std::time::{Duration, Instant};

use growbot_sim::port::emulator::Emulator;
use growbot_sim::tip::Motor;

/// How long the board may take to a reset, or to look through its stack. It takes some 100 ms, or more on a busy machine.
const PATIENCE: Duration = Duration::from_secs(120);

/// The memory that the board shares with its tip, by the byte offsets of `growbot_firmware::emulated_tip`.
pub struct Words(File);

impl Words {
    /// Those of a running board.
    ///
    /// # Panics
    /// If the system gives no second handle of the memory.
    #[must_use]
    pub fn of(emulator: &mut Emulator) -> Self {
        Self(emulator.board().tip().file().try_clone().expect("a second handle of the tip's memory"))
    }

    /// Reads a word.
    ///
    /// # Panics
    /// If it is not in the memory.
    #[must_use]
    pub fn read(&self, offset: usize) -> u32 {
        let mut bytes = [0; 4];
        self.0.read_exact_at(&mut bytes, offset as u64).expect("the word is in the tip's memory");
        u32::from_le_bytes(bytes)
    }

    /// Writes a word.
    ///
    /// # Panics
    /// If the memory cannot be written.
    pub fn write(&self, offset: usize, value: u32) {
        self.0.write_all_at(&value.to_le_bytes(), offset as u64).expect("the tip's memory can be written");
    }

    /// Waits until the words are as they should be.
    ///
    /// # Panics
    /// If they are not within two minutes; `what` says what was waited for.
    pub fn wait(&self, what: &str, until: impl Fn(&Self) -> bool) {
        let began = Instant::now();
        while !until(self) {
            assert!(began.elapsed() < PATIENCE, "{what}: not within {PATIENCE:?}");
            std::thread::sleep(Duration::from_millis(2));
        }
    }
}

/// Waits until heater and motors of the tip are off. Its player sees what the board does some milliseconds later, or more on a busy machine.
///
/// # Panics
/// If they are not off within two minutes; `what` says after what they should be.
pub fn all_off_at_the_tip(emulator: &mut Emulator, what: &str) {
    let began = Instant::now();
    loop {
        let mut on = Vec::new();
        emulator.simulated_tip(|tip| {
            on.extend(tip.heater_is_on().then_some("heater"));
            on.extend(tip.is_enabled(Motor::Head).then_some("head"));
            on.extend(tip.is_enabled(Motor::Feed).then_some("feed"));
        });
        if on.is_empty() {
            return;
        }
        assert!(began.elapsed() < PATIENCE, "{what}: still on: {}", on.join(", "));
        std::thread::sleep(Duration::from_millis(2));
    }
}
