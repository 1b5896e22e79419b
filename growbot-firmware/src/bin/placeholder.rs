//! Stands in for the controller while the boards are brought up: says its name, echoes the line, makes a few steps.
//!
//! Each byte is echoed. Besides, `s` starts and `x` stops the head, `r` turns it round, `w` stops feeding the watchdog, `p` panics,
//! `h` heats at half power, `i` answers `0` or `1`, the level of the index line, and `t` the thermistor's last reading in hexadecimal.

use core::sync::atomic::{AtomicBool, Ordering};

use embedded_hal::digital::{InputPin, OutputPin};
use embedded_hal::pwm::SetDutyCycle;
use growbot_firmware::{Thermistor, Watchdog};
use heapless::spsc::{Consumer, Producer};

static RUNNING: AtomicBool = AtomicBool::new(false);
static FORWARD: AtomicBool = AtomicBool::new(true);

/// What runs in the step interrupt.
pub struct Engine<HS, HD, FS, FD> {
    /// STEP of the head.
    pub head_step: HS,
    /// DIR of the head.
    pub head_direction: HD,
    /// STEP of the feed.
    pub feed_step: FS,
    /// DIR of the feed.
    pub feed_direction: FD,
    /// Counts ticks.
    pub phase: u32,
}

impl<HS: OutputPin, HD: OutputPin, FS: OutputPin, FD: OutputPin> Engine<HS, HD, FS, FD> {
    /// A head step every 4 ticks, a feed step every 40.
    pub fn tick(&mut self) {
        let _ = self.head_step.set_low();
        let _ = self.feed_step.set_low();
        if !RUNNING.load(Ordering::Relaxed) {
            return;
        }
        let forward = FORWARD.load(Ordering::Relaxed);
        let _ = self.head_direction.set_state(forward.into());
        let _ = self.feed_direction.set_high();
        self.phase = self.phase.wrapping_add(1);
        if self.phase.is_multiple_of(4) {
            let _ = self.head_step.set_high();
        }
        if self.phase.is_multiple_of(40) {
            let _ = self.feed_step.set_high();
        }
    }
}

/// What the main loop polls.
pub struct Controller<D, H, HE, T, I, W> {
    /// Enables of head and feed.
    pub drivers: D,
    /// Heater power.
    pub heater: H,
    /// The heater's second switch.
    pub heater_enable: HE,
    /// Heater temperature.
    pub thermistor: T,
    /// Index sensor.
    pub index: I,
    /// Watchdog.
    pub watchdog: W,
    /// Fed only while true.
    pub feeding: bool,
    /// The last reading.
    pub reading: u16,
}

impl<E: OutputPin, F: OutputPin, H: SetDutyCycle, HE: OutputPin, T: Thermistor, I: InputPin, W: Watchdog>
    Controller<(E, F), H, HE, T, I, W>
{
    /// Answers what has been received.
    pub fn poll(&mut self, _now_us: u64, received: &mut Consumer<'_, u8>, to_send: &mut Producer<'_, u8>) {
        if self.feeding {
            self.watchdog.feed();
        }
        if let Some(reading) = self.thermistor.sample() {
            self.reading = reading;
        }
        while to_send.ready() {
            let Some(byte) = received.dequeue() else { break };
            let _ = to_send.enqueue(byte);
            match byte {
                b's' => {
                    let _ = self.drivers.0.set_high();
                    let _ = self.drivers.1.set_high();
                    RUNNING.store(true, Ordering::Relaxed);
                }
                b'x' => RUNNING.store(false, Ordering::Relaxed),
                b'r' => FORWARD.store(!FORWARD.load(Ordering::Relaxed), Ordering::Relaxed),
                b'w' => self.feeding = false,
                b'p' => panic!("as asked"),
                b'h' => {
                    let _ = self.heater_enable.set_high();
                    let _ = self.heater.set_duty_cycle_percent(50);
                }
                b'i' => {
                    let high = self.index.is_high().unwrap_or(true);
                    let _ = to_send.enqueue(b'0' + u8::from(high));
                }
                b't' => {
                    for shift in [8, 4, 0] {
                        let digit = (self.reading >> shift & 0xF) as u8;
                        let _ = to_send.enqueue(if digit < 10 { b'0' + digit } else { b'a' + digit - 10 });
                    }
                }
                _ => {}
            }
        }
    }
}
