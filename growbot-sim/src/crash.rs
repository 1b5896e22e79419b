//! Source locations of a firmware crash: functions and lines, from the debug information of an image.

use std::path::Path;

use addr2line::Context;
use gimli::{Dwarf, EndianArcSlice, RunTimeEndian};
use growbot_core::link::crash::CrashRecord;
use growbot_plan::crash::{Caller, CodeLocation, CrashJson, hex};
use growbot_plan::input::{InputError, read_bytes};
use object::{Object, ObjectSection, SectionKind};

use crate::image_seal;

type DwarfSlice = EndianArcSlice<RunTimeEndian>;

/// Maximum length of an ELF image, bytes. growbot's own images have about 3 MB with debug information.
const LONGEST_IMAGE: u64 = 64 << 20;

/// Error of opening a firmware image.
#[derive(Debug, thiserror::Error)]
#[error("cannot use {file} as the firmware image: {fault}; give the ELF image that the board was flashed with")]
pub struct ImageError {
    file: String,
    /// Reason why the file cannot be used.
    #[source]
    pub fault: ImageFault,
}

/// Reason why a file cannot be used as a firmware image.
#[derive(Debug, thiserror::Error)]
pub enum ImageFault {
    /// The file cannot be read.
    #[error("{0}")]
    Unreadable(#[from] InputError),
    /// The file is not an object file.
    #[error("{0}")]
    NoObject(#[from] object::Error),
    /// The debug information is not valid.
    #[error("{0}")]
    DebugInformation(#[from] gimli::Error),
}

/// A firmware image (ELF file) in which the function and the source line of an address can be looked up.
pub struct FirmwareImage {
    context: Context<DwarfSlice>,
    /// Address ranges of the image's code.
    code: Vec<std::ops::Range<u64>>,
    /// CRC-32C that the image has after `growbot flash` has added its checksum (the seal). `None` if the image has no
    /// place for a seal.
    crc: Option<u32>,
}

impl FirmwareImage {
    /// Opens an ELF image.
    ///
    /// # Errors
    /// [`ImageError`].
    pub fn open(path: &Path) -> Result<Self, ImageError> {
        Self::read(path).map_err(|fault| ImageError { file: path.display().to_string(), fault })
    }

    fn read(path: &Path) -> Result<Self, ImageFault> {
        let bytes = read_bytes(path, LONGEST_IMAGE)?;
        let file = object::File::parse(&*bytes)?;
        let endian = if file.is_little_endian() { RunTimeEndian::Little } else { RunTimeEndian::Big };
        let dwarf = Dwarf::load(|section| {
            let data = file.section_by_name(section.name()).and_then(|section| section.uncompressed_data().ok());
            Ok::<_, gimli::Error>(EndianArcSlice::new(data.unwrap_or_default().into(), endian))
        });
        let context = dwarf.and_then(Context::from_dwarf)?;
        let is_code = |section: &object::Section| section.kind() == SectionKind::Text;
        let code =
            file.sections().filter(is_code).map(|it| it.address()..it.address().saturating_add(it.size())).collect();
        let crc = image_seal::seal(&bytes).ok().map(|sealed| sealed.crc);
        Ok(Self { context, code, crc })
    }

    /// Returns the CRC-32C of the image with its seal, the checksum that `growbot flash` adds. `None` if the image
    /// has no place for a seal.
    pub fn crc(&self) -> Option<u32> {
        self.crc
    }

    /// Returns the function at an address and the functions into which it is inlined, the innermost first. Empty if
    /// the address is not in the image's code.
    pub fn frames_at(&self, address: u32) -> Vec<CodeLocation> {
        let address = u64::from(address & !1);
        if !self.code.iter().any(|code| code.contains(&address)) {
            return Vec::new();
        }
        let mut places = Vec::new();
        let Ok(mut frames) = self.context.find_frames(address).skip_all_loads() else { return places };
        while let Ok(Some(frame)) = frames.next() {
            let name = frame.function.as_ref().and_then(|function| function.demangle().ok());
            let function = name.map_or_else(|| "?".to_string(), std::borrow::Cow::into_owned);
            let line = frame.location.and_then(|at| Some((shortened(at.file?), at.line?)));
            let (file, line) = line.unzip();
            places.push(CodeLocation { function, file, line });
        }
        places
    }

    /// Returns the function that contains the call with this return address, and the functions into which it is
    /// inlined, the innermost first. Empty if the value is not a return address in the image's code.
    pub fn callers(&self, return_address: u32) -> Vec<CodeLocation> {
        // Return addresses of Thumb code are odd, so an even value is not a return address.
        if return_address & 1 == 0 { Vec::new() } else { self.frames_at((return_address & !1).wrapping_sub(2)) }
    }
}

/// Shortens the path of a source file to its path in growbot's tree or in its crate.
fn shortened(file: &str) -> String {
    if let Some((_, registry)) = file.rsplit_once("/registry/src/") {
        return registry.split_once('/').map_or(registry, |(_, crate_and_file)| crate_and_file).to_string();
    }
    let from = ["/growbot-firmware/", "/growbot-core/", "/library/"].iter().filter_map(|it| file.rfind(it)).max();
    from.map_or(file, |at| &file[at + 1..]).to_string()
}

/// The crash record of a board, with the firmware image that crashed.
pub struct CrashReport<'a> {
    /// Crash record of the board.
    pub record: CrashRecord,
    /// Image that crashed. `None` if it is not known.
    pub image: Option<&'a FirmwareImage>,
}

impl<'a> CrashReport<'a> {
    /// Creates the report of a crash. `image` is ignored if its CRC shows that another image crashed.
    pub fn new(record: CrashRecord, image: Option<&'a FirmwareImage>) -> Self {
        let is_that = |image: &&FirmwareImage| record.image.is_none() || image.crc() == record.image;
        Self { record, image: image.filter(is_that) }
    }

    /// Returns the function that contains the program counter of the crash, and the functions into which it is
    /// inlined, the innermost first.
    fn at(&self) -> Vec<CodeLocation> {
        let (Some(image), Some(frame)) = (self.image, self.record.frame) else { return Vec::new() };
        image.frames_at(frame.pc)
    }

    /// Returns the possible callers, the innermost first. They come from return addresses in the link register and on
    /// the stack. The stack may contain return addresses of earlier calls.
    fn calls(&self) -> Vec<(u32, Vec<CodeLocation>)> {
        let Some(image) = self.image else { return Vec::new() };
        let addresses = self.record.frame.map(|frame| frame.lr).into_iter().chain(self.record.stack);
        let mut calls: Vec<(u32, Vec<CodeLocation>)> = Vec::new();
        for address in addresses {
            let places = image.callers(address);
            if !places.is_empty() && calls.last().is_none_or(|(latest, _)| *latest != address) {
                calls.push((address, places));
            }
        }
        calls
    }

    /// Returns the crash as text with several lines.
    pub fn text(&self) -> String {
        let CrashRecord { cause, boot_id, exception, frame, cfsr, hfsr, address, sp, .. } = self.record;
        let mut text = format!("last crash   {}, in boot {boot_id:08x}, exception {exception}", cause.name());
        for (name, meaning) in self.record.reasons() {
            text += &format!(": {meaning} ({name})");
        }
        if let Some(address) = address {
            text += &format!(", at address {address:08x}");
        }
        text += "\n";
        match frame {
            Some(frame) => {
                text += &format!("             pc {:08x}{}\n", frame.pc, text_of(&self.at()));
                text += &format!("             lr {:08x}, sp {sp:08x}, xpsr {:08x}, ", frame.lr, frame.xpsr);
            }
            None => text += &format!("             registers not saved, sp {sp:08x}, "),
        }
        text += &format!("cfsr {cfsr:08x}, hfsr {hfsr:08x}\n");
        for (address, places) in self.calls() {
            text += &format!("             called from {address:08x}{}\n", text_of(&places));
        }
        text
    }

    /// Returns the crash for JSON.
    pub fn to_json(&self) -> CrashJson {
        let caller = |(address, at): (u32, Vec<CodeLocation>)| Caller { address: hex(address), at };
        let called_from = self.calls().into_iter().map(caller).collect();
        CrashJson { at: self.at(), called_from, ..CrashJson::from(&self.record) }
    }
}

/// Formats functions with their lines, the innermost first.
fn text_of(places: &[CodeLocation]) -> String {
    let place = |place: &CodeLocation| match (&place.file, place.line) {
        (Some(file), Some(line)) => format!(" {} ({file}:{line})", place.function),
        _ => format!(" {}", place.function),
    };
    places.iter().map(place).collect::<Vec<_>>().join(" in")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_that_are_not_images_are_refused() {
        let text = tempfile::NamedTempFile::new().unwrap();
        std::fs::write(text.path(), "no image").unwrap();
        let fault = |path| FirmwareImage::open(path).err().map(|error| error.fault);
        assert!(matches!(fault(text.path()), Some(ImageFault::NoObject(_))));
        assert!(matches!(fault(Path::new("nothing.elf")), Some(ImageFault::Unreadable(InputError::Unreadable { .. }))));
    }
}
