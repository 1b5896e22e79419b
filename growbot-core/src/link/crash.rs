//! The record of a crash of a board's firmware, with the processor's registers and the stack: [`CRASH_WORDS`] words of
//! 32 bits.
//!
//! | word | content |
//! |---|---|
//! | 0 | cause: 1 watchdog, 2 stack overflow, 3 processor fault; from bit 16 on the number of the exception |
//! | 1 | the boot in which the crash occurred |
//! | 2 | CRC-32C of the image that crashed; 0 if the image was not sealed |
//! | 3 | stack pointer at which the exception was taken |
//! | 4 | EXC_RETURN: value of the link register in the exception handler |
//! | 5 | CFSR, configurable fault status register |
//! | 6 | HFSR, hard fault status register |
//! | 7 | MMFAR, address of a memory management fault |
//! | 8 | BFAR, address of a bus fault |
//! | 9 to 16 | registers that the processor saved: R0, R1, R2, R3, R12, LR, PC, xPSR |
//! | 17 to 31 | the stack above the saved registers, or possible return addresses if the stack pointer is below the stack |
//!
//! Words beyond the end of the stack are 0. Possible return addresses come from the stack, from its lowest word on. The
//! names are those of the ARMv7-M Architecture Reference Manual.

use super::reset_cause::ResetCause;

/// Number of words of a crash record.
pub const CRASH_WORDS: usize = 32;
/// A crash record in the form that a board retains and sends.
pub type CrashWords = [u32; CRASH_WORDS];
/// Number of words of a crash record before the saved registers.
pub const HEAD_WORDS: usize = 9;
/// Number of words that the processor saves on the stack when it takes an exception, without floating-point registers.
pub const FRAME_WORDS: usize = 8;
/// Number of words of a crash record that hold the stack above the saved registers.
pub const STACK_WORDS: usize = CRASH_WORDS - HEAD_WORDS - FRAME_WORDS;

/// Bit of the CFSR that is set if the MMFAR holds the address of the fault.
const MMARVALID: u32 = 1 << 7;
/// Bit of the CFSR that is set if the BFAR holds the address of the fault.
const BFARVALID: u32 = 1 << 15;
/// Bits of the CFSR that are set if the registers could not be saved on the stack (MSTKERR, STKERR).
const NOT_STACKED: u32 = 1 << 4 | 1 << 12;
/// Bit of EXC_RETURN that is clear if the stack frame has space for the floating-point registers.
const BASIC_FRAME: u32 = 1 << 4;
/// Number of bytes of the stack that an exception uses, without the floating-point registers and with them.
const FRAME_BYTES: [u32; 2] = [32, 104];
/// Bit of the saved xPSR that is set if the processor skipped a word to align the stack frame.
const ALIGNED: u32 = 1 << 9;

/// Bits of the CFSR: number, name and meaning.
const CFSR_BITS: [(u32, &str, &str); 17] = [
    (0, "IACCVIOL", "an instruction fetch from a forbidden address"),
    (1, "DACCVIOL", "an access that is not allowed"),
    (3, "MUNSTKERR", "registers could not be restored from the stack"),
    (4, "MSTKERR", "registers could not be saved on the stack"),
    (5, "MLSPERR", "floating-point registers could not be saved"),
    (8, "IBUSERR", "an instruction fetch from an address without memory"),
    (9, "PRECISERR", "an access to an address without memory"),
    (10, "IMPRECISERR", "an access to an address without memory, some instructions earlier"),
    (11, "UNSTKERR", "registers could not be restored from the stack"),
    (12, "STKERR", "registers could not be saved on the stack"),
    (13, "LSPERR", "floating-point registers could not be saved"),
    (16, "UNDEFINSTR", "an undefined instruction"),
    (17, "INVSTATE", "a jump to an address that is not Thumb code"),
    (18, "INVPC", "an invalid return from an exception"),
    (19, "NOCP", "the floating-point unit is off"),
    (24, "UNALIGNED", "an unaligned access"),
    (25, "DIVBYZERO", "a division by zero"),
];

/// Returns the number of bytes that the processor saved on the stack when it took an exception with this EXC_RETURN.
pub const fn frame_bytes(exc_return: u32) -> u32 {
    let [basic, extended] = FRAME_BYTES;
    if exc_return & BASIC_FRAME != 0 { basic } else { extended }
}

/// Returns the number that stands for the cause of a crash in the first word of its record.
pub const fn cause_code(cause: ResetCause) -> u32 {
    match cause {
        ResetCause::Watchdog => 1,
        ResetCause::StackOverflow => 2,
        _ => 3,
    }
}

/// A decoded crash record.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct CrashRecord {
    /// The cause of the crash, and of the reset that followed.
    pub cause: ResetCause,
    /// The boot in which the crash occurred ([`super::message::BoardInfo::boot_id`]).
    pub boot_id: u32,
    /// CRC-32C of the firmware image that crashed. `None` if the image had no seal (a CRC that is stored in it).
    pub image: Option<u32>,
    /// Number of the exception: 2 is the non-maskable interrupt, 3 a hard fault, 16 and above an interrupt.
    pub exception: u32,
    /// Registers that the processor saved. `None` if it could not save them, for example after a stack overflow.
    pub frame: Option<CrashFrame>,
    /// Configurable fault status register.
    pub cfsr: u32,
    /// Hard fault status register.
    pub hfsr: u32,
    /// Address of the memory access that failed. `None` if the processor has not recorded it.
    pub address: Option<u32>,
    /// Stack pointer before the exception. If `frame` is `None`, the stack pointer at which the exception was taken.
    pub sp: u32,
    /// Words of the stack from `sp` on. Words beyond the end of the stack are 0. If the stack pointer is below the
    /// stack, the words of the stack that may be return addresses.
    pub stack: [u32; STACK_WORDS],
}

/// Registers that the processor saved when it took an exception.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct CrashFrame {
    /// Registers R0 to R3 and R12, in this order.
    pub registers: [u32; 5],
    /// Link register: return address of the interrupted function.
    pub lr: u32,
    /// Program counter: address at which the exception interrupted the program.
    pub pc: u32,
    /// Program status register (xPSR).
    pub xpsr: u32,
}

impl From<&CrashWords> for CrashRecord {
    fn from(words: &CrashWords) -> Self {
        let [what, boot_id, image, sp, exc_return, cfsr, hfsr, mmfar, bfar, rest @ ..] = *words;
        let [r0, r1, r2, r3, r12, lr, pc, xpsr, mut stack @ ..] = rest;
        let is_there = cfsr & NOT_STACKED == 0 && rest.iter().take(FRAME_WORDS).any(|word| *word != 0);
        let frame = is_there.then_some(CrashFrame { registers: [r0, r1, r2, r3, r12], lr, pc, xpsr });
        let mut before = sp;
        if frame.is_some() {
            before = sp.wrapping_add(frame_bytes(exc_return));
            if xpsr & ALIGNED != 0 {
                before = before.wrapping_add(4);
                stack.rotate_left(1);
                stack[STACK_WORDS - 1] = 0;
            }
        }
        let address = match cfsr {
            cfsr if cfsr & MMARVALID != 0 => Some(mmfar),
            cfsr if cfsr & BFARVALID != 0 => Some(bfar),
            _ => None,
        };
        let cause = match what & 0xFFFF {
            1 => ResetCause::Watchdog,
            2 => ResetCause::StackOverflow,
            _ => ResetCause::ProcessorFault,
        };
        let image = (image != 0).then_some(image);
        Self { cause, boot_id, image, exception: what >> 16, frame, cfsr, hfsr, address, sp: before, stack }
    }
}

impl CrashRecord {
    /// Returns the names and meanings of the bits that are set in the CFSR.
    pub fn reasons(&self) -> impl Iterator<Item = (&'static str, &'static str)> {
        let cfsr = self.cfsr;
        CFSR_BITS.into_iter().filter(move |(bit, ..)| cfsr >> bit & 1 != 0).map(|(_, name, meaning)| (name, meaning))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn words() -> CrashWords {
        let mut words = core::array::from_fn(|index| 0x100 * index as u32);
        words[..9].copy_from_slice(&[3 << 16 | 3, 7, 0xfeed_beef, 0x1000_0800, 0xFFFF_FFF9, 1 << 16, 1 << 30, 1, 2]);
        words
    }

    #[test]
    fn registers_and_stack_are_decoded_from_the_words() {
        let record = CrashRecord::from(&words());
        let registers = [0x900, 0xa00, 0xb00, 0xc00, 0xd00];
        assert_eq!(record.frame, Some(CrashFrame { registers, lr: 0xe00, pc: 0xf00, xpsr: 0x1000 }));
        assert_eq!((record.cause, record.exception, record.boot_id), (ResetCause::ProcessorFault, 3, 7));
        assert_eq!((record.image, record.address), (Some(0xfeed_beef), None));
        assert_eq!((record.sp, record.stack[0], record.stack[14]), (0x1000_0820, 0x1100, 0x1f00));
        assert!(record.reasons().eq([("UNDEFINSTR", "an undefined instruction")]));
        for (number, cause) in [(1, ResetCause::Watchdog), (2, ResetCause::StackOverflow)] {
            let mut words = words();
            words[0] = cause_code(cause);
            words[2] = 0;
            let record = CrashRecord::from(&words);
            assert_eq!((words[0], record.cause, record.image, record.exception), (number, cause, None, 0));
        }
    }

    #[test]
    fn fpu_registers_and_padding_before_the_stack_are_skipped() {
        let mut words = words();
        words[4] = 0xFFFF_FFE9;
        assert_eq!(CrashRecord::from(&words).sp, 0x1000_0868);
        // The processor skipped a word.
        words[16] |= ALIGNED;
        let record = CrashRecord::from(&words);
        assert_eq!((record.sp, record.stack[0], record.stack[13], record.stack[14]), (0x1000_086C, 0x1200, 0x1f00, 0));
    }

    #[test]
    fn a_fault_address_is_reported_only_if_it_is_valid() {
        for (bit, address) in [(7, 1), (15, 2)] {
            let mut words = words();
            words[5] = 1 << bit;
            assert_eq!(CrashRecord::from(&words).address, Some(address));
        }
    }

    #[test]
    fn registers_that_were_not_saved_are_not_reported() {
        for bit in [4, 12] {
            let mut words = words();
            words[5] = 1 << bit;
            let record = CrashRecord::from(&words);
            assert_eq!((record.frame, record.sp), (None, 0x1000_0800));
        }
        let mut words = words();
        words[9..].fill(0);
        assert_eq!(CrashRecord::from(&words).frame, None);
    }
}
