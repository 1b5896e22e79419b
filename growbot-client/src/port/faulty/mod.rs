//! Simulated faults of a connection, for tests: a [`FaultyPort`] loses, corrupts, duplicates and reorders the bytes of
//! any other port, at random from a seed.
//!
//! The bytes are processed in frames. Here, a frame is any bytes up to a zero byte, or as many bytes as the longest
//! frame has. Each direction draws its own random numbers, one for each fault and frame. The same seed and the same
//! bytes therefore give the same faults.
//!
//! | fault | effect on a frame |
//! |---|---|
//! | `drop` | the frame is lost |
//! | `flip` | one bit of a byte is inverted; the probability is per byte, including the ending zero |
//! | `dup` | the frame arrives twice |
//! | `reorder` | the frame arrives after the next frame, and not before there is one |
//! | `truncate` | its last bytes are lost, with the ending zero, so that its rest is joined to the next frame |
//! | `stall` | the frame and all later ones, in both directions, are delayed by the given time |
//! | `reset` | a cut: all undelivered frames in both directions, and all frames of the next second, are lost |
//!
//! Time is the sum of the timeouts of `receive`, also on the virtual clock of a simulated board. Runs with a simulated
//! board are therefore repeatable to the byte. [`FaultyPort::tally`] returns the number of each fault so far.

mod spec;

use std::collections::VecDeque;
use std::time::Duration;

use growbot_core::link::frame::MAX_FRAME_LEN;

use self::spec::STEP;
pub use self::spec::{FaultSpec, FaultSpecError};
use super::{Port, PortError};
use growbot_core::random::splitmix64;

/// Duration of a cut, in which all bytes are lost.
const CUT: Duration = Duration::from_secs(1);
/// Maximum number of bytes that `receive` may read and lose to faults before it returns without bytes.
const MAX_SWALLOWED: usize = 1 << 16;

/// Numbers of the faults of a [`FaultyPort`] so far, both directions together.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct FaultCounts {
    /// Number of frames that were sent, including those that were lost.
    pub frames: u64,
    /// Number of frames that the fault `drop` has lost.
    pub dropped: u64,
    /// Number of bytes of which a bit was inverted.
    pub flipped: u64,
    /// Number of frames that arrived twice.
    pub doubled: u64,
    /// Number of frames that arrived after the next frame.
    pub reordered: u64,
    /// Number of frames that lost their last bytes.
    pub truncated: u64,
    /// Number of stalls.
    pub stalls: u64,
    /// Number of cuts of the connection.
    pub resets: u64,
    /// Number of frames that were lost in cuts of the connection.
    pub cut_off: u64,
}

/// A port whose bytes are subject to simulated faults.
///
/// To call [`Self::tally`] while a client uses the port, put the port into an `Rc<RefCell<_>>`, which is a port too.
pub struct FaultyPort {
    port: Box<dyn Port>,
    spec: FaultSpec,
    tally: FaultCounts,
    to_board: FaultyChannel,
    from_board: FaultyChannel,
    /// Remaining time of a stall, in which no bytes arrive. Zero without a stall.
    stalled: Duration,
    /// Remaining time of a cut, in which all bytes are lost. Zero without a cut.
    cut: Duration,
}

/// State of one direction of a [`FaultyPort`].
struct FaultyChannel {
    draws: Draws,
    /// Bytes of an incomplete frame.
    begun: Vec<u8>,
    /// Frame that is delivered after the next frame. `None` without one.
    kept_back: Option<Vec<u8>>,
    /// Bytes to which the faults have been applied and which wait to be delivered.
    through: VecDeque<u8>,
}

#[derive(Clone, Copy)]
enum LinkDirection {
    ToBoard,
    FromBoard,
}

impl FaultyPort {
    /// Adds these faults to a port.
    pub fn new(port: Box<dyn Port>, spec: FaultSpec) -> Self {
        Self {
            port,
            spec,
            tally: FaultCounts::default(),
            to_board: FaultyChannel::new(spec.seed, 1),
            from_board: FaultyChannel::new(spec.seed, 2),
            stalled: Duration::ZERO,
            cut: Duration::ZERO,
        }
    }

    /// Returns the number of each fault so far.
    pub fn tally(&self) -> FaultCounts {
        self.tally
    }

    fn wire(&mut self, direction: LinkDirection) -> &mut FaultyChannel {
        match direction {
            LinkDirection::ToBoard => &mut self.to_board,
            LinkDirection::FromBoard => &mut self.from_board,
        }
    }

    /// Divides sent or received bytes into frames, and applies the faults to each complete frame.
    fn take(&mut self, direction: LinkDirection, bytes: &[u8]) {
        for byte in bytes {
            let wire = self.wire(direction);
            wire.begun.push(*byte);
            if *byte == 0 || wire.begun.len() >= MAX_FRAME_LEN {
                let piece = std::mem::take(&mut wire.begun);
                self.carry(direction, piece);
            }
        }
    }

    /// Applies the faults to a frame and queues the remaining bytes for delivery.
    fn carry(&mut self, direction: LinkDirection, mut piece: Vec<u8>) {
        let spec = self.spec;
        let draws = &mut self.wire(direction).draws;
        let [reset, stall, drop, truncate, tail, reorder, dup] = [(); 7].map(|()| draws.draw());
        let mut flipped = 0;
        if spec.flip > 0.0 {
            for byte in &mut piece {
                if draws.draw() < spec.flip {
                    *byte ^= 1 << (draws.draw() * 8.0) as u32;
                    flipped += 1;
                }
            }
        }
        self.tally.frames += 1;
        if !self.cut.is_zero() {
            self.tally.cut_off += 1;
            return;
        }
        if reset < spec.reset {
            self.tally.resets += 1;
            self.tally.cut_off += 1;
            self.cut = CUT;
            self.to_board.clear();
            self.from_board.clear();
            return;
        }
        if stall < spec.stall {
            self.tally.stalls += 1;
            self.stalled = spec.stall_for;
        }
        if drop < spec.drop {
            self.tally.dropped += 1;
            return;
        }
        self.tally.flipped += flipped;
        if truncate < spec.truncate {
            self.tally.truncated += 1;
            piece.truncate((tail * piece.len() as f64) as usize);
        }
        let doubled = dup < spec.dup;
        self.tally.doubled += u64::from(doubled);
        if doubled {
            piece.extend_from_within(..);
        }
        let wire = self.wire(direction);
        match wire.kept_back.take() {
            Some(earlier) => wire.through.extend(piece.into_iter().chain(earlier)),
            None if reorder < spec.reorder => {
                wire.kept_back = Some(piece);
                self.tally.reordered += 1;
            }
            None => wire.through.extend(piece),
        }
    }

    /// Sends the queued bytes to the board, unless there is a stall.
    fn deliver(&mut self) -> Result<(), PortError> {
        if !self.stalled.is_zero() || self.to_board.through.is_empty() {
            return Ok(());
        }
        self.port.send(&self.to_board.through.drain(..).collect::<Vec<_>>())
    }
}

impl Port for FaultyPort {
    fn send(&mut self, bytes: &[u8]) -> Result<(), PortError> {
        self.take(LinkDirection::ToBoard, bytes);
        self.deliver()
    }

    fn receive(&mut self, buffer: &mut [u8], timeout: Duration) -> Result<usize, PortError> {
        let mut left = timeout;
        let mut swallowed = 0;
        loop {
            if self.stalled.is_zero() && !self.from_board.through.is_empty() {
                let through = &mut self.from_board.through;
                let count = buffer.len().min(through.len());
                for (slot, byte) in buffer.iter_mut().zip(through.drain(..count)) {
                    *slot = byte;
                }
                return Ok(count);
            }
            let mut arrived = [0; MAX_FRAME_LEN];
            let step = STEP.min(left);
            let count = self.port.receive(&mut arrived, step)?;
            self.take(LinkDirection::FromBoard, arrived.get(..count).unwrap_or_default());
            swallowed += count;
            if count == 0 {
                left -= step;
                self.cut = self.cut.saturating_sub(step);
                self.stalled = self.stalled.saturating_sub(step);
                self.deliver()?;
            }
            let nothing = !self.stalled.is_zero() || self.from_board.through.is_empty();
            if nothing && (left.is_zero() || swallowed > MAX_SWALLOWED) {
                return Ok(0);
            }
        }
    }

    fn now(&self) -> Duration {
        self.port.now()
    }

    fn has_comparable_clock(&self) -> bool {
        self.port.has_comparable_clock()
    }

    /// Returns the emergency port of the port without faults.
    fn emergency_port(&mut self) -> Option<Box<dyn Port + Send>> {
        self.port.emergency_port()
    }
}

impl FaultyChannel {
    fn new(seed: u64, direction: u64) -> Self {
        Self {
            draws: Draws { state: splitmix64(seed) ^ splitmix64(direction), count: 0 },
            begun: Vec::new(),
            kept_back: None,
            through: VecDeque::new(),
        }
    }

    /// Drops all bytes that are not delivered yet.
    fn clear(&mut self) {
        self.begun.clear();
        self.kept_back = None;
        self.through.clear();
    }
}

/// Pseudorandom numbers from a seed.
struct Draws {
    state: u64,
    count: u64,
}

impl Draws {
    /// Returns the next number, from 0 up to but below 1.
    fn draw(&mut self) -> f64 {
        self.count += 1;
        (splitmix64(self.state ^ self.count) >> 11) as f64 / (1_u64 << 53) as f64
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::cell::RefCell;
    use std::rc::Rc;

    /// A port that returns the bytes that were sent to it. Its clock advances only during waits without bytes.
    #[derive(Default)]
    struct LoopBack {
        bytes: VecDeque<u8>,
        waited: Duration,
    }

    impl Port for LoopBack {
        fn send(&mut self, bytes: &[u8]) -> Result<(), PortError> {
            self.bytes.extend(bytes);
            Ok(())
        }

        fn receive(&mut self, buffer: &mut [u8], timeout: Duration) -> Result<usize, PortError> {
            let count = buffer.len().min(self.bytes.len());
            for (slot, byte) in buffer.iter_mut().zip(self.bytes.drain(..count)) {
                *slot = byte;
            }
            if count == 0 {
                self.waited += timeout;
            }
            Ok(count)
        }
    }

    /// Returns a port with these faults, and the port behind it.
    fn faulty(spec: &str) -> (FaultyPort, Rc<RefCell<LoopBack>>) {
        let behind = Rc::new(RefCell::new(LoopBack::default()));
        (FaultyPort::new(Box::new(Rc::clone(&behind)), spec.parse().unwrap()), behind)
    }

    /// Returns a frame of ten bytes that contains its number.
    fn frame(number: u32) -> Vec<u8> {
        let digits = (0..8).map(|digit| 1 + (number >> (4 * digit) & 15) as u8);
        digits.chain([0xA5, 0]).collect()
    }

    /// Returns all bytes that arrive within the timeout.
    fn received(port: &mut FaultyPort, timeout: Duration) -> Vec<u8> {
        let (mut all, mut buffer) = (Vec::new(), [0; 64]);
        loop {
            match port.receive(&mut buffer, timeout).unwrap() {
                0 => return all,
                count => all.extend(&buffer[..count]),
            }
        }
    }

    /// Sends `frames` frames one by one. Returns the bytes received and the counts.
    fn run(spec: &str, frames: u32) -> (Vec<u8>, FaultCounts) {
        let (mut port, _) = faulty(spec);
        let mut all = Vec::new();
        for number in 0..frames {
            port.send(&frame(number)).unwrap();
            all.extend(received(&mut port, STEP));
        }
        (all, port.tally())
    }

    /// Asserts that a count is within 4.5 standard deviations of its mean for this number of tries at this probability.
    fn assert_rate(count: u64, tries: u64, chance: f64) {
        let mean = tries as f64 * chance;
        let deviation = (mean * (1.0 - chance)).sqrt();
        assert!((count as f64 - mean).abs() <= 4.5 * deviation, "{count} of {tries}, expected {mean} +- {deviation}");
    }

    #[test]
    fn without_faults_nothing_is_changed() {
        let (bytes, tally) = run("seed=3", 100);
        assert_eq!(bytes, (0..100).flat_map(frame).collect::<Vec<_>>());
        assert_eq!(tally, FaultCounts { frames: 200, ..FaultCounts::default() });
    }

    #[test]
    fn each_fault_occurs_at_the_requested_rate() {
        let n = 20_000;
        let (bytes, tally) = run("drop=10%", n);
        assert_rate(tally.dropped, tally.frames, 0.1);
        assert_eq!(bytes.len() as u64, 10 * (u64::from(n) - tally.dropped));

        let (_, tally) = run("dup=0.05", n);
        // A frame that was doubled on the way to the board counts as two frames on the way back.
        assert_rate(tally.doubled, tally.frames, 0.05);
        let (_, tally) = run("truncate=2%", n);
        assert_rate(tally.truncated, tally.frames, 0.02);
        let (_, tally) = run("flip=1e-3", n);
        // A flipped zero byte joins two frames, and a byte that is flipped to zero divides one, but the number of bytes
        // stays the same.
        assert_rate(tally.flipped, 2 * 10 * u64::from(n), 1e-3);
        let (_, tally) = run("stall=500ms@3%", 2_000);
        assert_rate(tally.stalls, tally.frames, 0.03);
        let (_, tally) = run("reset=0.2%", n);
        assert_rate(tally.resets, tally.frames - (tally.cut_off - tally.resets), 0.002);
    }

    #[test]
    fn the_seed_determines_the_faults() {
        let spec = "drop=2%,flip=1e-3,dup=2%,reorder,truncate,stall=50ms,reset=0.1%";
        let [first, second] = [(); 2].map(|()| run(&format!("{spec},seed=7"), 3_000));
        assert!(first == second);
        assert!(first != run(&format!("{spec},seed=8"), 3_000));
        assert!(run("drop=2%,seed=1", 500) == run("drop=2%", 500));
    }

    #[test]
    fn adjacent_frames_are_swapped() {
        let (mut port, behind) = faulty("reorder=100%");
        // Two frames are swapped on the way to the board and once more on the way back.
        for number in 0..4 {
            port.send(&frame(number)).unwrap();
        }
        assert_eq!(behind.borrow().bytes, [1, 0, 3, 2].into_iter().flat_map(frame).collect::<Vec<_>>());
        assert_eq!(received(&mut port, STEP), (0..4).flat_map(frame).collect::<Vec<_>>());
        assert_eq!(port.tally().reordered, 4);
    }

    #[test]
    fn a_truncated_frame_is_joined_to_the_next_one() {
        let (mut port, behind) = faulty("truncate=100%");
        port.send(&frame(1)).unwrap();
        port.send(&frame(2)).unwrap();
        let arrived: Vec<u8> = behind.borrow().bytes.iter().copied().collect();
        assert!(arrived.len() < 20 && !arrived.contains(&0), "{arrived:?}");
    }

    #[test]
    fn a_stall_delays_all_bytes_for_its_duration() {
        let (mut port, behind) = faulty("stall=2s@100%");
        port.send(&frame(1)).unwrap();
        assert!(behind.borrow().bytes.is_empty());
        let mut buffer = [0; 64];
        for _ in 0..3 {
            assert_eq!(port.receive(&mut buffer, Duration::from_millis(500)).unwrap(), 0);
        }
        assert!(behind.borrow().bytes.is_empty());
        // The board receives the frame here, and its response causes another stall.
        assert_eq!(port.receive(&mut buffer, Duration::from_secs(2)).unwrap(), 0);
        assert_eq!(port.receive(&mut buffer, Duration::from_secs(2)).unwrap(), 10);
        assert_eq!((&buffer[..10], port.tally().stalls), (&frame(1)[..], 2));
        assert_eq!(behind.borrow().waited, Duration::from_secs(4));
    }

    #[test]
    fn a_cut_link_loses_all_bytes_until_it_is_restored() {
        let (mut port, _) = faulty("reset=100%");
        port.send(&frame(1)).unwrap();
        port.send(&frame(2)).unwrap();
        assert_eq!(port.tally(), FaultCounts { frames: 2, resets: 1, cut_off: 2, ..FaultCounts::default() });
        assert!(received(&mut port, CUT).is_empty());
        port.spec.reset = 0.0;
        port.send(&frame(3)).unwrap();
        assert_eq!(received(&mut port, STEP), frame(3));
    }

    #[test]
    fn a_receive_times_out_on_time_if_all_bytes_are_lost() {
        let (mut port, behind) = faulty("drop=100%");
        behind.borrow_mut().bytes.extend((0..10).flat_map(frame));
        assert!(received(&mut port, Duration::from_secs(3)).is_empty());
        assert_eq!((port.tally().dropped, behind.borrow().waited), (10, Duration::from_secs(3)));
        assert_eq!(port.receive(&mut [0; 8], Duration::ZERO).unwrap(), 0);
    }

    #[test]
    fn bytes_without_a_frame_end_are_passed_on() {
        let (mut port, _) = faulty("seed=1");
        port.send(&[7; 3 * MAX_FRAME_LEN]).unwrap();
        assert_eq!(received(&mut port, STEP).len(), 3 * MAX_FRAME_LEN);
    }
}
