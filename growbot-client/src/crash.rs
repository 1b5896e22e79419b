//! A crash of the firmware as JSON: registers, reasons and the top of the stack. In which function it was, only an
//! image tells.

use growbot_core::link::crash::CrashRecord;
use serde_json::{Value, json};

/// The record as JSON. Numbers of the processor are hexadecimal; `at` and `called_from` are empty without an image.
#[must_use]
pub fn json_of_crash(record: &CrashRecord) -> Value {
    let CrashRecord { cause, boot_id, image, exception, frame, cfsr, hfsr, address, sp, stack } = record;
    let hex = |word: u32| format!("{word:08x}");
    json!({
        "cause": cause.name(),
        "boot_id": boot_id,
        "image_crc": image.map(hex),
        "exception": exception,
        "reasons": record.reasons().map(|(name, _)| name).collect::<Vec<_>>(),
        "address": address.map(hex),
        "pc": frame.map(|frame| hex(frame.pc)),
        "lr": frame.map(|frame| hex(frame.lr)),
        "xpsr": frame.map(|frame| hex(frame.xpsr)),
        "registers": frame.map(|frame| frame.registers.map(hex)),
        "sp": hex(*sp),
        "cfsr": hex(*cfsr),
        "hfsr": hex(*hfsr),
        "stack": stack.map(hex),
        "at": [],
        "called_from": [],
    })
}
