//! Logs through the debug probe (SEGGER's RTT). The frames of defmt are in a ring buffer in RAM. The probe finds the
//! ring buffer by its header and reads it while the board runs.
//!
//! A frame that does not fit is dropped, so that the robot never waits for a probe. (The crate `defmt-rtt` waits, and
//! leaves panics in the firmware.)

use core::cell::UnsafeCell;
use core::sync::atomic::{AtomicU8, AtomicU32, Ordering};

use critical_section::RestoreState;

/// Length of the ring buffer, bytes, a power of two.
const SIZE: u32 = 1024;

static RING: [AtomicU8; SIZE as usize] = [const { AtomicU8::new(0) }; SIZE as usize];

/// Header by which the debug probe finds the ring buffer.
#[repr(C)]
struct Header {
    id: [u8; 16],
    channels_up: u32,
    channels_down: u32,
    name: *const u8,
    ring: *const AtomicU8,
    size: u32,
    /// Offset in the ring buffer of the next byte that the board writes. Only the board changes it.
    write: AtomicU32,
    /// Offset in the ring buffer of the next byte that the probe reads. Only the probe changes it.
    read: AtomicU32,
    /// Mode of the ring buffer: 0, which means that frames that do not fit are dropped. If a probe requests another
    /// mode, the board ignores it.
    mode: AtomicU32,
}

// SAFETY: only the pointers are not `Sync`, and only the probe uses them.
unsafe impl Sync for Header {}

#[unsafe(no_mangle)]
static _SEGGER_RTT: Header = Header {
    id: *b"SEGGER RTT\0\0\0\0\0\0",
    channels_up: 1,
    channels_down: 0,
    name: c"defmt".as_ptr().cast(),
    ring: RING.as_ptr(),
    size: SIZE,
    write: AtomicU32::new(0),
    read: AtomicU32::new(0),
    mode: AtomicU32::new(0),
};

/// The log frame that is being written.
struct LogFrame {
    encoder: defmt::Encoder,
    interrupts: RestoreState,
    /// Offset in the ring buffer of the next byte of the frame.
    at: u32,
    fits: bool,
}

struct FrameCell(UnsafeCell<LogFrame>);

// SAFETY: accessed only between `acquire` and `release`, during which all interrupts are off.
unsafe impl Sync for FrameCell {}

static FRAME: FrameCell = FrameCell(UnsafeCell::new(LogFrame {
    encoder: defmt::Encoder::new(),
    interrupts: RestoreState::invalid(),
    at: 0,
    fits: true,
}));

#[defmt::global_logger]
struct Logger;

// SAFETY: all interrupts are off from `acquire` to `release`, and formatting a log message logs nothing itself. There
// is therefore one frame at a time.
unsafe impl defmt::Logger for Logger {
    fn acquire() {
        // SAFETY: defmt guarantees that `release` follows.
        let interrupts = unsafe { critical_section::acquire() };
        // SAFETY: interrupts are off.
        let frame = unsafe { &mut *FRAME.0.get() };
        let LogFrame { encoder, at, fits, .. } = frame;
        (*at, *fits) = (_SEGGER_RTT.write.load(Ordering::Relaxed), true);
        encoder.start_frame(|bytes| put(at, fits, bytes));
        frame.interrupts = interrupts;
    }

    unsafe fn write(bytes: &[u8]) {
        // SAFETY: interrupts are off since `acquire`, which defmt guarantees came before.
        let LogFrame { encoder, at, fits, .. } = unsafe { &mut *FRAME.0.get() };
        encoder.write(bytes, |bytes| put(at, fits, bytes));
    }

    unsafe fn flush() {}

    unsafe fn release() {
        // SAFETY: interrupts are off since `acquire`, which defmt guarantees came before.
        let LogFrame { encoder, at, fits, interrupts } = unsafe { &mut *FRAME.0.get() };
        encoder.end_frame(|bytes| put(at, fits, bytes));
        if *fits {
            _SEGGER_RTT.write.store(*at, Ordering::Release);
        }
        // SAFETY: the state from `acquire` is restored once.
        unsafe { critical_section::release(*interrupts) };
    }
}

/// Appends bytes to the log frame. Sets `fits` to false if the ring buffer is full.
fn put(at: &mut u32, fits: &mut bool, bytes: &[u8]) {
    for byte in bytes {
        let next = (*at + 1) % SIZE;
        if next == _SEGGER_RTT.read.load(Ordering::Acquire) {
            *fits = false;
        }
        if *fits {
            RING[(*at % SIZE) as usize].store(*byte, Ordering::Relaxed);
            *at = next;
        }
    }
}
