//! Reception on two ports, of which the host uses one at a time.

use crate::byte_queue::ByteQueue;

/// Merges the bytes received on two ports into one stream of frames. Each frame comes from one port only.
///
/// The port in use is the one from which the latest byte came. The other port is read only when the port in use has no
/// byte left. If the port changes within a frame, a delimiter ends that frame. The frame is lost, like a frame that was
/// damaged on the way.
#[derive(Debug)]
pub struct LinkMux<'a, const N: usize> {
    first: &'a ByteQueue<N>,
    second: &'a ByteQueue<N>,
    /// True if the second port is in use.
    on_second: bool,
    /// True if the latest byte did not end a frame.
    within_frame: bool,
}

/// Byte that ends a frame.
const DELIMITER: u8 = 0;

impl<'a, const N: usize> LinkMux<'a, N> {
    /// Creates the stream from the queues of two ports. The first port is in use.
    pub const fn new(first: &'a ByteQueue<N>, second: &'a ByteQueue<N>) -> Self {
        Self { first, second, on_second: false, within_frame: false }
    }

    /// Returns whether the second port is in use.
    pub const fn is_second_active(&self) -> bool {
        self.on_second
    }

    /// Removes and returns the next byte of the stream. `None` if neither port has a byte.
    pub fn next_byte(&mut self) -> Option<u8> {
        let (used, other) = if self.on_second { (self.second, self.first) } else { (self.first, self.second) };
        let byte = match used.dequeue() {
            Some(byte) => byte,
            None if other.is_empty() => return None,
            None => {
                self.on_second = !self.on_second;
                if self.within_frame { DELIMITER } else { other.dequeue()? }
            }
        };
        self.within_frame = byte != DELIMITER;
        Some(byte)
    }
}

#[cfg(test)]
mod tests {
    use std::vec::Vec;

    use super::*;

    fn put(queue: &ByteQueue<64>, bytes: &[u8]) {
        for byte in bytes {
            queue.enqueue(*byte).unwrap();
        }
    }

    fn taken(lines: &mut LinkMux<64>) -> Vec<u8> {
        std::iter::from_fn(|| lines.next_byte()).collect()
    }

    #[test]
    fn the_active_link_is_that_of_the_latest_byte() {
        let (first, second) = (ByteQueue::new(), ByteQueue::new());
        let mut lines = LinkMux::new(&first, &second);
        assert!(taken(&mut lines).is_empty());
        assert!(!lines.is_second_active());
        put(&second, &[1, 2, 0]);
        assert_eq!(taken(&mut lines), [1, 2, 0]);
        assert!(lines.is_second_active());
        put(&first, &[3, 0]);
        assert_eq!(taken(&mut lines), [3, 0]);
        assert!(!lines.is_second_active());
    }

    #[test]
    fn frames_of_two_links_do_not_mix() {
        let (first, second) = (ByteQueue::new(), ByteQueue::new());
        let mut lines = LinkMux::new(&first, &second);
        put(&first, &[1, 2]);
        put(&second, &[7, 8, 0, 9]);
        assert_eq!(taken(&mut lines), [1, 2, 0, 7, 8, 0, 9]);
        put(&first, &[3, 0]);
        assert_eq!(taken(&mut lines), [0, 3, 0]);
    }
}
