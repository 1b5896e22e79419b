//! The simulated tip of the emulated board, and the memory that they share.

use std::fs::File;
use std::io;
use std::os::unix::fs::FileExt;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::{self, JoinHandle};
use std::time::Duration;

use growbot_client::ground_truth::{GroundTruth, LaidBody};
use growbot_client::port::PortError;
use growbot_core::layer::Layer;
use growbot_core::link::message::Motor;
use growbot_core::pose::Pose;
use growbot_core::robot::Robot;
use growbot_firmware::emulated_tip as table;
use growbot_firmware::stepping::MotorDirection;

use crate::simulated_tip::SimulatedTip;
use crate::tip::manual_action::ManualAction;
use crate::tip::{IndexMark, TipModel, Variation, encoder_pitch};

/// Interval at which the simulated tip polls the shared memory while the board runs in real time.
const TIP_POLL_INTERVAL: Duration = Duration::from_millis(1);

/// Returns the simulated tip in its initial state. Its head is at position 0, because the emulated board counts the
/// head's steps from power-on and computes the level of the index sensor from this count.
pub(super) fn tip_of(robot: &Robot) -> TipModel {
    TipModel::new(robot.clone(), 0, Variation::default())
}

/// The memory that the emulated board and the tip share, read and written as words.
pub(super) struct TipRegisters(pub(super) File);

impl TipRegisters {
    pub(super) fn read(&self, offset: usize) -> io::Result<u32> {
        let mut bytes = [0; 4];
        self.0.read_exact_at(&mut bytes, offset as u64)?;
        Ok(u32::from_le_bytes(bytes))
    }

    /// Reads a counter that the board may be changing. The counter is read until two readings agree.
    pub(super) fn read_counter(&self, offset: usize) -> io::Result<u32> {
        let mut value = self.read(offset)?;
        loop {
            let again = self.read(offset)?;
            if again == value {
                return Ok(value);
            }
            value = again;
        }
    }

    pub(super) fn read_pair(&self, low: usize, high: usize) -> io::Result<u64> {
        loop {
            let before = self.read_counter(high)?;
            let value = u64::from(self.read_counter(low)?);
            if self.read_counter(high)? == before {
                return Ok(u64::from(before) << 32 | value);
            }
        }
    }

    pub(super) fn write(&self, offset: usize, value: u32) -> io::Result<()> {
        self.0.write_all_at(&value.to_le_bytes(), offset as u64)
    }

    /// Writes the readings of the tip's sensors to the shared memory.
    pub(super) fn show(&self, tip: &mut TipModel) -> io::Result<()> {
        self.show_converted(table::THERMISTOR_RAW, table::THERMISTOR_LIVE, tip.sample_thermistor())?;
        self.show_converted(table::SUPPLY_RAW, table::SUPPLY_LIVE, tip.sample_supply())?;
        self.write(table::FILAMENT_PRESENT, tip.has_filament().into())?;
        self.write(table::DRIVER_FAULT, tip.driver_fault().into())?;
        self.write(table::EMERGENCY_STOP, tip.is_emergency_stop_pressed().into())?;
        self.show_index(tip)?;
        let encoder = match (tip.filament_moves_with_feed(), tip.encoder()) {
            (true, _) => table::ENCODER_OK,
            (false, false) => table::ENCODER_STUCK_LOW,
            (false, true) => table::ENCODER_STUCK_HIGH,
        };
        self.write(table::ENCODER_STATE, encoder)?;
        self.show_encoder_mapping(tip)?;
        let gravity = tip.gravity();
        if let Some(gravity) = gravity {
            for (offset, part) in [table::GRAVITY_X, table::GRAVITY_Y, table::GRAVITY_Z].into_iter().zip(gravity) {
                self.write(offset, i32::from(part).cast_unsigned())?;
            }
        }
        self.write(table::GRAVITY_LIVE, gravity.is_some().into())
    }

    /// Writes the mapping from feed steps to the encoder's level, if the mapping has changed. The emulated board
    /// computes the level from its own feed steps.
    pub(super) fn show_encoder_mapping(&self, tip: &mut TipModel) -> io::Result<()> {
        let (turned, seen_per_step) = tip.encoder_mapping();
        let slip = libm::rint((seen_per_step - 1.0) * 65_536.0) as i32;
        if slip.cast_unsigned() == self.read(table::ENCODER_SLIP)? {
            return Ok(());
        }
        let pitch = f64::from(encoder_pitch(tip.robot()).max(1));
        let phase = libm::rint((turned * 256.0).rem_euclid(pitch)) as u32;
        let sequence = self.read(table::ENCODER_SEQUENCE)?;
        self.write(table::ENCODER_SEQUENCE, sequence.wrapping_add(1))?;
        self.write(table::ENCODER_ORIGIN, tip.feed_position() as u32)?;
        self.write(table::ENCODER_PHASE, phase)?;
        self.write(table::ENCODER_SLIP, slip.cast_unsigned())?;
        self.write(table::ENCODER_SEQUENCE, sequence.wrapping_add(2))
    }

    pub(super) fn show_converted(&self, raw: usize, live: usize, sample: Option<u16>) -> io::Result<()> {
        if let Some(sample) = sample {
            self.write(raw, sample.into())?;
        }
        self.write(live, sample.is_some().into())
    }

    /// Writes the index mark's position. The emulated board computes the level of its index sensor from the head's
    /// commanded steps, so the written position is corrected by the steps that the head has slipped. If a fault makes
    /// the level independent of the steps, the constant level is written as a fault of the sensor.
    pub(super) fn show_index(&self, tip: &TipModel) -> io::Result<()> {
        let mark = IndexMark::of(tip.robot());
        let position = (i64::from(mark.position) - tip.head_slip()).rem_euclid(i64::from(mark.steps_per_turn));
        self.write(table::INDEX_POSITION, position as u32)?;
        let fault = match (tip.index_follows(), tip.on_index()) {
            (true, _) => table::INDEX_FAULT_NONE,
            // The emulated sensor pulls its output low on the mark.
            (false, true) => table::INDEX_FAULT_STUCK_LOW,
            (false, false) => table::INDEX_FAULT_STUCK_HIGH,
        };
        self.write(table::INDEX_FAULT, fault)
    }
}

/// The simulated tip, and the state of the shared memory at the latest poll.
pub(super) struct TipFollower {
    pub(super) words: TipRegisters,
    pub(super) tip: TipModel,
    pub(super) boots: u32,
    /// Clock of the tip at the board's latest start, ticks.
    pub(super) boot_tick: u64,
    pub(super) steps_read: u32,
    /// Tick of the latest step, counted from the board's latest start.
    pub(super) step_tick: u64,
    /// Clock of the board at the latest poll, ticks since the board's latest start.
    pub(super) ticks: u64,
    pub(super) energy: u64,
    pub(super) lost_steps: u32,
}

impl TipFollower {
    pub(super) fn new(words: TipRegisters, robot: &Robot) -> Self {
        Self {
            words,
            tip: tip_of(robot),
            boots: 0,
            boot_tick: 0,
            steps_read: 0,
            step_tick: 0,
            ticks: 0,
            energy: 0,
            lost_steps: 0,
        }
    }

    /// Returns the board's clock: ticks since its start.
    pub(super) fn clock(&self) -> io::Result<u64> {
        self.words.read_pair(table::TICKS_LO, table::TICKS_HI)
    }

    /// Applies the motor steps and the heating of the board since the latest poll to the tip, and writes the tip's
    /// sensor readings to the shared memory.
    pub(super) fn sync(&mut self) -> io::Result<()> {
        if self.words.read(table::MAGIC)? != table::MAGIC_VALUE {
            return Ok(()); // not booted yet
        }
        let boots = self.words.read_counter(table::BOOTS)?;
        if boots != self.boots {
            // The board has restarted, and its clock too.
            self.step(self.words.read_counter(table::BOOT_WRITE_INDEX)?)?;
            (self.boots, self.boot_tick) = (boots, self.tip.now());
            (self.step_tick, self.ticks, self.energy) = (0, 0, 0);
        }
        self.step(self.words.read_counter(table::STEP_WRITE_INDEX)?)?;
        self.warm()?;
        self.words.show(&mut self.tip)
    }

    /// Advances the tip to the board's clock, with the mean heating power since the latest poll.
    pub(super) fn warm(&mut self) -> io::Result<()> {
        let ticks = self.clock()?;
        let energy = self.words.read_pair(table::HEATER_ENERGY_LO, table::HEATER_ENERGY_HI)?;
        let enabled = self.words.read(table::HEATER_ENABLE)? == 1;
        let duty = self.words.read(table::HEATER_DUTY)?;
        // Both are zero while a board restarts.
        let (passed, gained) = (ticks.saturating_sub(self.ticks), energy.saturating_sub(self.energy));
        if passed > 0 {
            // The heat is the energy that the board has counted, however rarely this polls. The duty word is only for a
            // broken switch.
            let mean = if gained > 0 { gained as f64 / passed as f64 } else { f64::from(duty) };
            self.tip.set_heater((mean / f64::from(u16::MAX)).min(1.0), enabled || gained > 0);
            self.tip
                .set_fan(f64::from(self.words.read(table::FAN_DUTY)?.min(u32::from(u16::MAX))) / f64::from(u16::MAX));
            self.tip.set_enabled(Motor::Head, self.words.read(table::HEAD_ENABLE)? == 1);
            self.tip.set_enabled(Motor::Feed, self.words.read(table::FEED_ENABLE)? == 1);
            self.tip.advance(self.boot_tick + ticks);
            (self.ticks, self.energy) = (ticks, energy);
        }
        Ok(())
    }

    /// Applies the recorded motor steps to the tip, from the running index `steps_read` up to but excluding `written`.
    pub(super) fn step(&mut self, written: u32) -> io::Result<()> {
        while self.steps_read != written {
            // Reads as many records as are contiguous in the ring.
            let at = table::step_record_offset(self.steps_read);
            let to_end = (table::STEP_RING + 4 * table::STEP_RING_RECORDS as usize - at) / 4;
            let count = (written.wrapping_sub(self.steps_read) as usize).min(to_end).min(4096);
            let mut bytes = vec![0; 4 * count];
            self.words.0.read_exact_at(&mut bytes, at as u64)?;
            let (records, _) = bytes.as_chunks::<4>();
            for record in records {
                let record = table::StepRecord::from_word(u32::from_le_bytes(*record));
                let motor = match record.axis {
                    table::RecordedMotor::Head => Motor::Head,
                    table::RecordedMotor::Feed => Motor::Feed,
                };
                self.tip.set_enabled(motor, record.enabled);
                let direction = if record.forward { MotorDirection::Forward } else { MotorDirection::Backward };
                self.tip.set_direction(motor, direction);
                self.step_tick = record.tick_after(self.step_tick);
                self.tip.advance(self.boot_tick + self.step_tick);
                self.tip.step(motor);
            }
            self.steps_read = self.steps_read.wrapping_add(count as u32);
            self.words.write(table::STEP_READ_INDEX, self.steps_read)?;
        }
        self.lost_steps = self.words.read(table::STEP_OVERRUN)?;
        Ok(())
    }
}

pub(super) fn locked(followed: &Mutex<TipFollower>) -> MutexGuard<'_, TipFollower> {
    followed.lock().unwrap_or_else(PoisonError::into_inner)
}

/// The thread that simulates the tip in real time.
pub(super) struct TipThread {
    over: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl TipThread {
    pub(super) fn start(followed: &Arc<Mutex<TipFollower>>) -> Self {
        let over = Arc::new(AtomicBool::new(false));
        let thread = thread::spawn({
            let (followed, over) = (Arc::clone(followed), Arc::clone(&over));
            move || {
                while !over.load(Ordering::Relaxed) {
                    // A memory that cannot be read is reported when the record is read.
                    let _ = locked(&followed).sync();
                    thread::sleep(TIP_POLL_INTERVAL);
                }
            }
        });
        Self { over, thread: Some(thread) }
    }
}

impl Drop for TipThread {
    fn drop(&mut self) {
        self.over.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

/// The simulated tip that follows the emulated board, shared with the thread that updates it. The body that was really
/// laid is read through it, for comparison with the board's report.
pub(super) struct SharedFollowed(pub(super) Arc<Mutex<TipFollower>>);

impl GroundTruth for SharedFollowed {
    fn laid(&mut self) -> Result<LaidBody, PortError> {
        let mut followed = locked(&self.0);
        followed.sync().map_err(|error| PortError::EmulatorFile("read the tip's memory", error))?;
        if followed.lost_steps > 0 {
            let what = format!("{} steps were lost before the tip could read them", followed.lost_steps);
            return Err(PortError::Lost("the emulated tip".to_string(), io::Error::other(what)));
        }
        Ok(LaidBody { body: followed.tip.body(), feed_steps: followed.tip.feed_steps() })
    }

    fn settled(&mut self, from: usize) -> Vec<Layer> {
        locked(&self.0).tip.settled(from).to_vec()
    }

    fn start_at(&mut self, pose: &Pose) {
        locked(&self.0).tip.start_at(pose);
    }
}

impl SimulatedTip for SharedFollowed {
    fn apply_action(&mut self, hand: ManualAction) -> bool {
        locked(&self.0).tip.apply_action(hand);
        true
    }
}
