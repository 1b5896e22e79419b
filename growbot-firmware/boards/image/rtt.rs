//! Logs through the debug probe (SEGGER's RTT). The frames of defmt are in a ring in memory. The probe finds it by its
//! header and reads it while the board runs.
//!
//! A frame that finds no room is dropped: the robot never waits for a probe. (The crate `defmt-rtt` waits, and leaves
//! panics in the firmware.)

use core::cell::UnsafeCell;
use core::sync::atomic::{AtomicU8, AtomicU32, Ordering};

use critical_section::RestoreState;

/// Bytes of the ring, a power of two.
const SIZE: u32 = 1024;

static RING: [AtomicU8; SIZE as usize] = [const { AtomicU8::new(0) }; SIZE as usize];

/// What the probe looks for.
#[repr(C)]
struct Header {
    id: [u8; 16],
    channels_up: u32,
    channels_down: u32,
    name: *const u8,
    ring: *const AtomicU8,
    size: u32,
    /// Where the next byte goes; the board's.
    write: AtomicU32,
    /// Where the probe reads on; the probe's.
    read: AtomicU32,
    /// 0: frames without room are dropped. A probe that asks for another mode is ignored.
    mode: AtomicU32,
}

// SAFETY: the pointers, which alone are not `Sync`, are for the probe.
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

/// The frame that is being written.
struct Frame {
    encoder: defmt::Encoder,
    interrupts: RestoreState,
    /// Where its next byte goes.
    at: u32,
    fits: bool,
}

struct FrameCell(UnsafeCell<Frame>);

// SAFETY: only reached between `acquire` and `release`, which keep all interrupts off.
unsafe impl Sync for FrameCell {}

static FRAME: FrameCell = FrameCell(UnsafeCell::new(Frame {
    encoder: defmt::Encoder::new(),
    interrupts: RestoreState::invalid(),
    at: 0,
    fits: true,
}));

#[defmt::global_logger]
struct Logger;

// SAFETY: all interrupts are off from `acquire` to `release`, and what is logged logs nothing itself, so that there is
// one frame at a time.
unsafe impl defmt::Logger for Logger {
    fn acquire() {
        // SAFETY: `release` follows, by defmt's promise.
        let interrupts = unsafe { critical_section::acquire() };
        // SAFETY: interrupts are off.
        let frame = unsafe { &mut *FRAME.0.get() };
        let Frame { encoder, at, fits, .. } = frame;
        (*at, *fits) = (_SEGGER_RTT.write.load(Ordering::Relaxed), true);
        encoder.start_frame(|bytes| put(at, fits, bytes));
        frame.interrupts = interrupts;
    }

    unsafe fn write(bytes: &[u8]) {
        // SAFETY: interrupts are off since `acquire`, which came before, by defmt's promise.
        let Frame { encoder, at, fits, .. } = unsafe { &mut *FRAME.0.get() };
        encoder.write(bytes, |bytes| put(at, fits, bytes));
    }

    unsafe fn flush() {}

    unsafe fn release() {
        // SAFETY: interrupts are off since `acquire`, which came before, by defmt's promise.
        let Frame { encoder, at, fits, interrupts } = unsafe { &mut *FRAME.0.get() };
        encoder.end_frame(|bytes| put(at, fits, bytes));
        if *fits {
            _SEGGER_RTT.write.store(*at, Ordering::Release);
        }
        // SAFETY: what `acquire` took is given back once.
        unsafe { critical_section::release(*interrupts) };
    }
}

/// Puts bytes where the frame has come to, as long as there is room.
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
