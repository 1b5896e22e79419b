//! Queue of bytes between a board's main loop and the interrupt of its UART.
//!
//! The firmware does not use the queue of the heapless crate. That queue takes items of any type, but it divides by a
//! buffer length that the compiler does not know, which leaves panics in the firmware.

use core::sync::atomic::{AtomicU8, AtomicUsize, Ordering};

/// Queue of up to `N` bytes. `N` is a power of two. One side adds bytes and the other side removes them. Either side
/// may interrupt the other.
#[derive(Debug)]
pub struct ByteQueue<const N: usize> {
    bytes: [AtomicU8; N],
    /// Number of bytes added since the start, wrapping.
    added: AtomicUsize,
    /// Number of bytes removed since the start, wrapping.
    removed: AtomicUsize,
}

impl<const N: usize> ByteQueue<N> {
    /// Creates an empty queue.
    pub const fn new() -> Self {
        // With any other capacity, bytes would be lost when the counts wrap.
        const { assert!(N.is_power_of_two()) };
        Self { bytes: [const { AtomicU8::new(0) }; N], added: AtomicUsize::new(0), removed: AtomicUsize::new(0) }
    }

    /// Returns whether the queue has room for another byte.
    pub fn has_room(&self) -> bool {
        self.added.load(Ordering::Relaxed).wrapping_sub(self.removed.load(Ordering::Acquire)) < N
    }

    /// Returns whether the queue is empty.
    pub fn is_empty(&self) -> bool {
        self.added.load(Ordering::Acquire) == self.removed.load(Ordering::Relaxed)
    }

    /// Adds a byte.
    ///
    /// # Errors
    /// Returns the byte if the queue is full.
    pub fn enqueue(&self, byte: u8) -> Result<(), u8> {
        if !self.has_room() {
            return Err(byte);
        }
        let added = self.added.load(Ordering::Relaxed);
        self.bytes[added % N].store(byte, Ordering::Relaxed);
        self.added.store(added.wrapping_add(1), Ordering::Release);
        Ok(())
    }

    /// Removes and returns the oldest byte. `None` if the queue is empty.
    pub fn dequeue(&self) -> Option<u8> {
        let removed = self.removed.load(Ordering::Relaxed);
        if self.added.load(Ordering::Acquire) == removed {
            return None;
        }
        let byte = self.bytes[removed % N].load(Ordering::Relaxed);
        self.removed.store(removed.wrapping_add(1), Ordering::Release);
        Some(byte)
    }
}

impl<const N: usize> Default for ByteQueue<N> {
    fn default() -> Self {
        Self::new()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bytes_are_popped_in_order_and_a_full_queue_rejects_more() {
        let queue = ByteQueue::<8>::new();
        let mut next = 0;
        for round in 0..100_u8 {
            for offset in 0..8 {
                assert_eq!(queue.enqueue(round.wrapping_mul(8).wrapping_add(offset)), Ok(()));
            }
            assert!(!queue.has_room());
            assert_eq!(queue.enqueue(1), Err(1));
            for _ in 0..8 {
                assert_eq!(queue.dequeue(), Some(next));
                next = next.wrapping_add(1);
            }
            assert_eq!(queue.dequeue(), None);
        }
    }
}
