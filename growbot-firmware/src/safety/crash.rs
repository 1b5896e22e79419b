//! The record of a crash, for the next start: words in RAM that is not cleared at start-up, between a mark and a
//! checksum.
//!
//! The handler of the processor's faults writes the record after it has switched everything off. It uses little stack
//! and relies on no other data. The stack pointer may have any value, so every word of the stack is read through a
//! function that checks the stack's bounds. The handler only copies words. The host decodes them
//! ([`growbot_core::link::crash`]).

use core::ops::Range;

use growbot_core::link::crash::{CRASH_WORDS, CrashWords, FRAME_WORDS, HEAD_WORDS, frame_bytes};

/// Number of words of the crash record in the retained RAM: a mark, the words of the crash, and a checksum.
pub const RETAINED_WORDS: usize = CRASH_WORDS + 2;
/// First word of every crash record.
const MARK: u32 = 0x6372_6173;

/// Address ranges of the stack and of the program.
#[derive(Debug, Clone)]
pub struct MemoryLayout {
    /// Addresses of the stack, from the lowest on.
    pub stack: Range<u32>,
    /// Addresses of the program's code.
    pub code: Range<u32>,
}

impl MemoryLayout {
    /// Returns whether a word of the stack may be a return address: an address of code, in Thumb state.
    fn may_return_to(&self, word: u32) -> bool {
        word & 1 == 1 && self.code.contains(&word)
    }
}

/// Builds the crash record. `head` contains the registers, and `stack` returns the stack's word at an address, and 0
/// outside of the stack.
///
/// After an overflow the stack pointer is below the stack. The record then contains the words that may be return
/// addresses, starting at the stack's lowest address. They show which calls have filled the stack, however large their
/// frames are.
pub fn encode(head: &[u32; HEAD_WORDS], places: &MemoryLayout, stack: impl Fn(u32) -> u32) -> [u32; RETAINED_WORDS] {
    let [_, _, _, sp, exc_return, ..] = *head;
    let overflowed = sp < places.stack.start;
    let mut words = [MARK; RETAINED_WORDS];
    let mut sum = MARK;
    let mut address = sp;
    let mut head = head.iter();
    for (index, into) in words.iter_mut().skip(1).enumerate() {
        *into = if let Some(word) = head.next() {
            *word
        } else if index < CRASH_WORDS {
            if index == HEAD_WORDS + FRAME_WORDS {
                address = if overflowed { places.stack.start } else { sp.wrapping_add(frame_bytes(exc_return)) };
            }
            if overflowed && index >= HEAD_WORDS + FRAME_WORDS {
                while places.stack.contains(&address) && !places.may_return_to(stack(address)) {
                    address = address.wrapping_add(4);
                }
            }
            let word = stack(address);
            address = address.wrapping_add(4);
            word
        } else {
            sum
        };
        sum = added(sum, *into);
    }
    words
}

/// Returns the words of the crash from a crash record. `None` if `words` is not a valid record of [`encode`].
pub fn decode(words: &[u32; RETAINED_WORDS]) -> Option<CrashWords> {
    let [mark, crash @ .., sum] = *words;
    (mark == MARK && crash.iter().fold(MARK, |sum, word| added(sum, *word)) == sum).then_some(crash)
}

/// Adds a word to a checksum that depends on every word and its position.
const fn added(sum: u32, word: u32) -> u32 {
    (sum.rotate_left(5) ^ word).wrapping_mul(0x9E37_79B1)
}

#[cfg(test)]
mod tests {
    use std::vec::Vec;

    use super::*;

    /// Address range of the stack. Each word of the test's stack is its own address with the high bits changed.
    const STACK: Range<u32> = 0x1000_0000..0x1000_1000;
    const PLACES: MemoryLayout = MemoryLayout { stack: STACK, code: 0x0000_0400..0x0000_8000 };

    fn word(address: u32) -> u32 {
        if STACK.contains(&address) && address.is_multiple_of(4) { address ^ 0xA000_0000 } else { 0 }
    }

    fn head(sp: u32, exc_return: u32) -> [u32; HEAD_WORDS] {
        [3, 0x1234_5678, 0xfeed_beef, sp, exc_return, 1 << 16, 1 << 30, 1, 2]
    }

    fn crash(sp: u32, exc_return: u32) -> CrashWords {
        decode(&encode(&head(sp, exc_return), &PLACES, word)).unwrap()
    }

    #[test]
    fn registers_and_stack_are_retained() {
        for (exc_return, beyond) in [(0xFFFF_FFF9, 0x1000_0820), (0xFFFF_FFE9, 0x1000_0868)] {
            let crash = crash(0x1000_0800, exc_return);
            assert_eq!(crash[..HEAD_WORDS], head(0x1000_0800, exc_return));
            let saved = |index: usize| word(0x1000_0800 + 4 * index as u32);
            assert!((0..8).all(|index| crash[HEAD_WORDS + index] == saved(index)));
            assert!((0..15).all(|index| crash[HEAD_WORDS + 8 + index] == word(beyond + 4 * index as u32)));
        }
    }

    #[test]
    fn any_stack_pointer_is_handled() {
        for sp in [0, 3, 0x0FFF_FFF0, 0x0FFF_FFFC, 0x1000_0001, 0x1000_0FF0, 0x1000_1000, u32::MAX - 3, u32::MAX] {
            let crash = crash(sp, 0xFFFF_FFF9);
            assert_eq!(crash[HEAD_WORDS], word(sp), "{sp:x}");
        }
        assert!(crash(0x2000_0000, 0xFFFF_FFF9)[HEAD_WORDS..].iter().all(|word| *word == 0));
    }

    #[test]
    fn an_overflow_retains_the_return_addresses_on_the_stack() {
        // The stack has frames of 200 bytes, each with its return address and a word that only resembles one.
        let filled = |address: u32| match (STACK.contains(&address), address % 200) {
            (false, _) => 0,
            (true, 0) => 0x0000_0401 + (address - STACK.start) / 200 * 2,
            (true, 8) => 0x0000_0400,
            (true, 16) => 0x0000_8001,
            (true, _) => address,
        };
        let head = head(0x0FFF_FE00, 0xFFFF_FFF9);
        let crash = decode(&encode(&head, &PLACES, filled)).unwrap();
        assert!(crash[HEAD_WORDS..HEAD_WORDS + FRAME_WORDS].iter().all(|word| *word == 0));
        let kept = &crash[HEAD_WORDS + FRAME_WORDS..];
        let there: Vec<u32> = STACK.step_by(4).map(filled).filter(|word| PLACES.may_return_to(*word)).collect();
        assert!(there.len() > kept.len(), "{}", there.len());
        assert_eq!(kept, &there[..kept.len()]);
        // The stack contains no return addresses.
        let crash = decode(&encode(&head, &PLACES, word)).unwrap();
        assert!(crash[HEAD_WORDS..].iter().all(|word| *word == 0));
    }

    #[test]
    fn invalid_words_are_not_a_crash_record() {
        let words = encode(&head(0x1000_0800, 0xFFFF_FFF9), &PLACES, word);
        for bit in 0..32 * RETAINED_WORDS {
            let mut flipped = words;
            flipped[bit / 32] ^= 1 << (bit % 32);
            assert_eq!(decode(&flipped), None, "bit {bit}");
        }
        for word in [0, u32::MAX, MARK] {
            assert_eq!(decode(&[word; RETAINED_WORDS]), None);
        }
    }
}
