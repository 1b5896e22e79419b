//! A crash of the firmware as scripts and run logs read it: registers, reasons and the top of the stack. In which
//! function it was, only an image tells.

use growbot_core::link::crash::CrashRecord;
use serde::{Deserialize, Serialize};

/// A crash of the firmware. Numbers of the processor are hexadecimal.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct WrittenCrash {
    /// What has crashed.
    pub cause: String,
    /// Number of the start of the board in which it crashed.
    pub boot_id: u32,
    /// CRC of the image; null where that is not known.
    pub image_crc: Option<String>,
    /// Number of the processor's exception.
    pub exception: u32,
    /// The bits of the fault status that are set.
    pub reasons: Vec<String>,
    /// The address that was accessed; null where that is not known.
    pub address: Option<String>,
    /// Where it was; null where the registers were not saved.
    pub pc: Option<String>,
    /// Where it was called from.
    pub lr: Option<String>,
    /// The program status.
    pub xpsr: Option<String>,
    /// R0 to R3 and R12.
    pub registers: Option<Vec<String>>,
    /// The stack pointer.
    pub sp: String,
    /// The configurable fault status.
    pub cfsr: String,
    /// The hard fault status.
    pub hfsr: String,
    /// The top of the stack.
    pub stack: Vec<String>,
    /// The functions that `pc` lies in, the innermost first. Empty without an image.
    #[serde(default)]
    pub at: Vec<Place>,
    /// The functions that may have called them. Empty without an image.
    #[serde(default)]
    pub called_from: Vec<Caller>,
}

/// A function that an address lies in, or that was inlined there.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct Place {
    /// Its name.
    pub function: String,
    /// Its file; null where that is not known.
    pub file: Option<String>,
    /// The line; null where that is not known.
    pub line: Option<u32>,
}

/// A return address.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct Caller {
    /// The address.
    pub address: String,
    /// The functions that the call lies in, the innermost first.
    pub at: Vec<Place>,
}

impl From<&CrashRecord> for WrittenCrash {
    fn from(record: &CrashRecord) -> Self {
        let CrashRecord { cause, boot_id, image, exception, frame, cfsr, hfsr, address, sp, stack } = record;
        Self {
            cause: cause.name().to_owned(),
            boot_id: *boot_id,
            image_crc: image.map(hex),
            exception: *exception,
            reasons: record.reasons().map(|(name, _)| name.to_owned()).collect(),
            address: address.map(hex),
            pc: frame.map(|frame| hex(frame.pc)),
            lr: frame.map(|frame| hex(frame.lr)),
            xpsr: frame.map(|frame| hex(frame.xpsr)),
            registers: frame.map(|frame| frame.registers.map(hex).to_vec()),
            sp: hex(*sp),
            cfsr: hex(*cfsr),
            hfsr: hex(*hfsr),
            stack: stack.map(hex).to_vec(),
            at: Vec::new(),
            called_from: Vec::new(),
        }
    }
}

/// A word of the processor.
#[must_use]
pub fn hex(word: u32) -> String {
    format!("{word:08x}")
}
