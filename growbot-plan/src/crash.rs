//! A crash of the firmware as JSON for scripts and run logs: registers, reasons and the top of the stack. The names of
//! functions are known only if the firmware's image is given.

use growbot_core::link::crash::{CrashFrame, CrashRecord};
use growbot_core::link::message::ResetCause;
use serde::{Deserialize, Serialize};

/// A crash of the firmware. Processor words are hexadecimal.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct CrashJson {
    /// Cause of the crash.
    pub cause: String,
    /// Boot number of the board's start in which it crashed.
    pub boot_id: u32,
    /// CRC of the firmware's image. Null if unknown.
    pub image_crc: Option<String>,
    /// Number of the processor's exception.
    pub exception: u32,
    /// The bits of the fault status that are set.
    pub reasons: Vec<String>,
    /// Memory address whose access caused the crash. Null if unknown.
    pub address: Option<String>,
    /// Program counter at the crash. Null if the registers were not saved.
    pub pc: Option<String>,
    /// Link register: the return address.
    pub lr: Option<String>,
    /// Program status register.
    pub xpsr: Option<String>,
    /// Registers R0 to R3 and R12.
    pub registers: Option<Vec<String>>,
    /// Stack pointer.
    pub sp: String,
    /// Configurable fault status register.
    pub cfsr: String,
    /// Hard fault status register.
    pub hfsr: String,
    /// Words at the top of the stack.
    pub stack: Vec<String>,
    /// Functions that contain the address `pc`, the innermost first. Empty if the firmware's image is not given.
    #[serde(default)]
    pub at: Vec<CodeLocation>,
    /// Return addresses on the stack, with the functions that may have called those in `at`. Empty if the firmware's
    /// image is not given.
    #[serde(default)]
    pub called_from: Vec<Caller>,
}

/// A function that contains an address, or that was inlined there.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct CodeLocation {
    /// Name of the function.
    pub function: String,
    /// File of the function. Null if unknown.
    pub file: Option<String>,
    /// Line number in the file. Null if unknown.
    pub line: Option<u32>,
}

/// A return address on the stack.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct Caller {
    /// The return address.
    pub address: String,
    /// Functions that contain the call, the innermost first.
    pub at: Vec<CodeLocation>,
}

impl From<&CrashRecord> for CrashJson {
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

impl CrashJson {
    /// Returns the crash record. `None` if a value is not valid.
    pub fn record(&self) -> Option<CrashRecord> {
        let word = |text: &String| u32::from_str_radix(text, 16).ok();
        let words = |texts: &[String]| texts.iter().map(word).collect::<Option<Vec<u32>>>();
        let optional = |text: &Option<String>| text.as_ref().map(word);
        let frame = match (&self.registers, optional(&self.lr), optional(&self.pc), optional(&self.xpsr)) {
            (Some(registers), Some(lr), Some(pc), Some(xpsr)) => {
                Some(CrashFrame { registers: words(registers)?.try_into().ok()?, lr: lr?, pc: pc?, xpsr: xpsr? })
            }
            _ => None,
        };
        Some(CrashRecord {
            cause: ResetCause::ALL.into_iter().find(|cause| cause.name() == self.cause)?,
            boot_id: self.boot_id,
            image: self.image_crc.as_ref().and_then(word),
            exception: self.exception,
            frame,
            cfsr: word(&self.cfsr)?,
            hfsr: word(&self.hfsr)?,
            address: self.address.as_ref().and_then(word),
            sp: word(&self.sp)?,
            stack: words(&self.stack)?.try_into().ok()?,
        })
    }
}

/// Formats a 32-bit word of the processor as 8 hexadecimal digits.
pub fn hex(word: u32) -> String {
    format!("{word:08x}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_record_is_the_same_after_json() {
        let frame = CrashFrame { registers: [1, 2, 3, 4, 5], lr: 6, pc: 0x0800_1234, xpsr: 7 };
        let record = CrashRecord {
            cause: ResetCause::ProcessorFault,
            boot_id: 9,
            image: Some(0xdead_beef),
            exception: 3,
            frame: Some(frame),
            cfsr: 0x0001_0000,
            hfsr: 0x4000_0000,
            address: Some(0xffff_ffff),
            sp: 0x2000_0100,
            stack: std::array::from_fn(|index| index as u32),
        };
        for record in [record, CrashRecord { frame: None, address: None, image: None, ..record }] {
            let json = CrashJson::from(&record);
            assert_eq!(json.record(), Some(record));
            assert_eq!(CrashJson { sp: "none".to_owned(), ..json }.record(), None);
        }
    }
}
