//! Access of tests to the memory that the emulated board shares with its simulated tip.

use std::fs::File;
use std::os::unix::fs::FileExt;
use std::time::{Duration, Instant};

use growbot_core::link::message::Motor;
use growbot_firmware::emulated_tip as table;
use growbot_sim::port::emulator::{EmulatedClock, Emulator};

/// Time limit for a reset, a scan of the board's stack, or switching off, s of the board's clock. Each takes about 100
/// ms.
const LIMIT_S: u32 = 120;
/// Interval at which the board is polled.
const LOOK: Duration = Duration::from_millis(2);
/// Max time without progress of the board's clock. A busy machine may pause the emulator for a while. The clock also
/// stands while the board is reset, and while a board that hangs waits for its watchdog, 20 s.
const STANDING: Duration = Duration::from_secs(300);

/// Memory that the board shares with its tip, addressed by the byte offsets of `growbot_firmware::emulated_tip`.
pub struct TipMemoryView {
    memory: File,
    clock: EmulatedClock,
}

impl TipMemoryView {
    /// Returns a view of the memory that a running board shares with its tip.
    ///
    /// # Panics
    /// Panics if the system does not duplicate the handle of the memory.
    pub fn of(emulator: &mut Emulator) -> Self {
        Self { memory: another(emulator.board().tip().file()), clock: emulator.clock() }
    }

    /// Reads a word.
    ///
    /// # Panics
    /// Panics if the offset is outside of the memory.
    pub fn read(&self, offset: usize) -> u32 {
        let mut bytes = [0; 4];
        self.memory.read_exact_at(&mut bytes, offset as u64).expect("the word is in the tip's memory");
        u32::from_le_bytes(bytes)
    }

    /// Writes a word.
    ///
    /// # Panics
    /// Panics if the memory cannot be written.
    pub fn write(&self, offset: usize, value: u32) {
        self.memory.write_all_at(&value.to_le_bytes(), offset as u64).expect("the tip's memory can be written");
    }

    /// Waits until `until` returns true.
    ///
    /// # Panics
    /// Panics after two minutes of the board's clock. `what` describes the condition in the message.
    pub fn wait(&self, what: &str, mut until: impl FnMut(&Self) -> bool) {
        let mut limit = BoardLimit::new(self, LIMIT_S);
        while !until(self) {
            limit.check(what);
            self.pass();
        }
    }
}

impl TipMemoryView {
    /// Lets a short time pass on the board.
    fn pass(&self) {
        self.clock.pass(LOOK).expect("the emulator runs");
    }
}

fn another(memory: &File) -> File {
    memory.try_clone().expect("a second handle of the tip's memory")
}

/// Time limit by the board's own clock. The desktop's clock is unsuitable, because a busy machine slows the board down.
pub struct BoardLimit {
    words: TipMemoryView,
    limit_s: u32,
    /// Last reading of the clock, ticks since the board's boot.
    clock: u32,
    /// Time that has passed on the board, ticks.
    passed: u64,
    /// Time of the last progress of the clock.
    moved: Instant,
}

impl BoardLimit {
    /// Returns a limit of `limit_s` seconds that starts now.
    pub fn new(words: &TipMemoryView, limit_s: u32) -> Self {
        let clock = words.read(table::TICKS_LO);
        let words = TipMemoryView { memory: another(&words.memory), clock: words.clock.clone() };
        Self { words, limit_s, clock, passed: 0, moved: Instant::now() }
    }

    /// Reads the board's clock.
    ///
    /// # Panics
    /// Panics if the limit has passed, or if the clock has made no progress for five minutes. `what` describes the
    /// condition in the message.
    pub fn check(&mut self, what: impl std::fmt::Display) {
        let now = self.words.read(table::TICKS_LO);
        if now == self.clock {
            let stood = self.moved.elapsed();
            assert!(stood < STANDING, "{what}: the board's clock has not advanced for {stood:?}");
            return;
        }
        // The clock restarts at 0 after a reset.
        self.passed += u64::from(now.checked_sub(self.clock).unwrap_or(now));
        (self.clock, self.moved) = (now, Instant::now());
        let limit = u64::from(self.limit_s) * u64::from(self.words.read(table::TICK_HZ).max(1));
        assert!(self.passed <= limit, "{what}: this did not happen within {} s of the board's clock", self.limit_s);
    }
}

/// Waits until heater and motors of the tip are off. The simulation of the tip sees changes of the board after some
/// milliseconds, or later on a busy machine.
///
/// # Panics
/// Panics if they are not off within two minutes of the board's clock. `what` is in the message.
pub fn wait_until_outputs_off(emulator: &mut Emulator, what: &str) {
    let mut limit = BoardLimit::new(&TipMemoryView::of(emulator), LIMIT_S);
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
