//! The words that the emulated board shares with its tip, read and written from the side.

use std::fs::File;
use std::os::unix::fs::FileExt;
use std::time::{Duration, Instant};

use growbot_firmware::emulated_tip as table;
use growbot_sim::port::emulator::{BoardClock, Emulator};
use growbot_sim::tip::Motor;

/// How long the board may take to a reset, to look through its stack, or to switch off, s of its clock. It takes some
/// 100 ms.
const LIMIT_S: u32 = 120;
/// How often the board is looked at.
const LOOK: Duration = Duration::from_millis(2);
/// How long the board's clock may stand: as long as a busy machine may leave the emulator waiting. It stands while the
/// board is reset, and while a board that hangs waits for its watchdog, 20 s.
const STANDING: Duration = Duration::from_secs(300);

/// The memory that the board shares with its tip, by the byte offsets of `growbot_firmware::emulated_tip`.
pub struct Words {
    memory: File,
    clock: BoardClock,
}

impl Words {
    /// Those of a running board.
    ///
    /// # Panics
    /// If the system gives no second handle of the memory.
    #[must_use]
    pub fn of(emulator: &mut Emulator) -> Self {
        Self { memory: another(emulator.board().tip().file()), clock: emulator.clock() }
    }

    /// Reads a word.
    ///
    /// # Panics
    /// If it is not in the memory.
    #[must_use]
    pub fn read(&self, offset: usize) -> u32 {
        let mut bytes = [0; 4];
        self.memory.read_exact_at(&mut bytes, offset as u64).expect("the word is in the tip's memory");
        u32::from_le_bytes(bytes)
    }

    /// Writes a word.
    ///
    /// # Panics
    /// If the memory cannot be written.
    pub fn write(&self, offset: usize, value: u32) {
        self.memory.write_all_at(&value.to_le_bytes(), offset as u64).expect("the tip's memory can be written");
    }

    /// Waits until the words are as they should be.
    ///
    /// # Panics
    /// If they are not within two minutes of the board's clock; `what` says what was waited for.
    pub fn wait(&self, what: &str, mut until: impl FnMut(&Self) -> bool) {
        let mut limit = BoardLimit::new(self, LIMIT_S);
        while !until(self) {
            limit.check(what);
            self.pass();
        }
    }
}

impl Words {
    /// Lets some of the board's time pass.
    fn pass(&self) {
        self.clock.pass(LOOK).expect("the emulator runs");
    }
}

fn another(memory: &File) -> File {
    memory.try_clone().expect("a second handle of the tip's memory")
}

/// A limit of the board's own clock, for who waits for the board: a busy machine stretches that clock, so that no limit
/// of the desktop's clock is a measure.
pub struct BoardLimit {
    words: Words,
    limit_s: u32,
    /// The clock that was read last, ticks since the board's boot.
    clock: u32,
    /// Time of the board that has passed, ticks.
    passed: u64,
    /// When the clock has moved last.
    moved: Instant,
}

impl BoardLimit {
    /// A limit that begins now, s.
    #[must_use]
    pub fn new(words: &Words, limit_s: u32) -> Self {
        let clock = words.read(table::TICKS_LO);
        let words = Words { memory: another(&words.memory), clock: words.clock.clone() };
        Self { words, limit_s, clock, passed: 0, moved: Instant::now() }
    }

    /// Looks at the board's clock.
    ///
    /// # Panics
    /// If the limit has passed, or the clock has been standing for five minutes; `what` says what was waited for.
    pub fn check(&mut self, what: impl std::fmt::Display) {
        let now = self.words.read(table::TICKS_LO);
        if now == self.clock {
            let stood = self.moved.elapsed();
            assert!(stood < STANDING, "{what}: the board's clock has been standing for {stood:?}");
            return;
        }
        // After a reset it counts from zero.
        self.passed += u64::from(now.checked_sub(self.clock).unwrap_or(now));
        (self.clock, self.moved) = (now, Instant::now());
        let limit = u64::from(self.limit_s) * u64::from(self.words.read(table::TICK_HZ).max(1));
        assert!(self.passed <= limit, "{what}: not within {} s of the board's clock", self.limit_s);
    }
}

/// Waits until heater and motors of the tip are off. Its player sees what the board does some milliseconds
/// later, or more on a busy machine.
///
/// # Panics
/// If they are not off within two minutes of the board's clock; `what` says after what they should be.
pub fn all_off_at_the_tip(emulator: &mut Emulator, what: &str) {
    let mut limit = BoardLimit::new(&Words::of(emulator), LIMIT_S);
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
        limit.check(format_args!("{what}: {} off", on.join(", ")));
        emulator.clock().pass(LOOK).expect("the emulator runs");
    }
}
