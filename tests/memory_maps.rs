//! Each image lies in its board's memory. Errors in `memory.x` are easy to overlook.

use std::ops::Range;
use std::path::Path;

use growbot_tests::{firmware, pico_firmware};
use object::{Object, ObjectSection, ObjectSegment, ObjectSymbol, SectionFlags, elf};

/// Memory of a board.
struct Map {
    flash: Range<u64>,
    /// Address ranges of all RAM.
    ram: &'static [Range<u64>],
    /// Upper end of the stack.
    stack_top: u64,
}

#[expect(clippy::single_range_in_vec_init, reason = "a board with one piece of RAM")]
const RAM_OF_AN386: [Range<u64>; 1] = [0x2000_0000..0x2040_0000];

const AN386: Map = Map { flash: 0..0x40_0000, ram: &RAM_OF_AN386, stack_top: 0x2001_0000 };

/// Memory of the robot's board. An image must not use the last 512 KiB of flash, which hold the robot's description
/// and the journal.
const STM32F405: Map = Map {
    flash: 0x0800_0000..0x0808_0000,
    ram: &[0x2000_0000..0x2002_0000, 0x1000_0000..0x1001_0000],
    stack_top: 0x1001_0000,
};

#[expect(clippy::single_range_in_vec_init, reason = "a board with one piece of RAM")]
const RAM_OF_PICO: [Range<u64>; 1] = [0x2000_0000..0x2004_0000];

/// Memory of the Pico. The image lies in the first 512 KiB of the 2 MiB of flash, after the 256 bytes of the
/// second-stage loader. The last 512 KiB hold the description and the journal.
const PICO: Map = Map { flash: 0x1000_0100..0x1008_0000, ram: &RAM_OF_PICO, stack_top: 0x2001_0000 };
/// Section of the loader, which lies before the image.
const LOADER: &str = ".boot2";

fn within(inner: &Range<u64>, outer: &Range<u64>) -> bool {
    outer.start <= inner.start && inner.end <= outer.end
}

fn check(board: &str, image: &Path, map: &Map) {
    let image = std::fs::read(image).unwrap();
    let file = object::File::parse(&*image).unwrap();

    let mut flash_end = map.flash.start;
    let loader = file.section_by_name(LOADER).map(|loader| loader.address());
    let loaded = file.segments().filter(|segment| segment.file_range().1 > 0 && Some(segment.address()) != loader);
    for segment in loaded {
        let loaded = segment.address()..segment.address() + segment.file_range().1;
        assert!(
            within(&loaded, &map.flash) || map.ram.iter().any(|ram| within(&loaded, ram)),
            "{board}: a segment at {loaded:#x?} is in no memory"
        );
        flash_end = flash_end.max(if within(&loaded, &map.flash) { loaded.end } else { 0 });
    }
    assert!(flash_end > map.flash.start + 1024, "{board}: there is hardly any code in flash");

    for section in file.sections() {
        let SectionFlags::Elf { sh_flags, .. } = section.flags() else { panic!("{board} is no ELF") };
        if !sh_flags.contains(elf::SHF_ALLOC) || section.size() == 0 {
            continue;
        }
        let place = section.address()..section.address() + section.size();
        let name = section.name().unwrap().to_owned();
        if name == LOADER {
            continue;
        }
        assert!(
            within(&place, &map.flash) || map.ram.iter().any(|ram| within(&place, ram)),
            "{board}: section {name} at {place:#x?} is in no memory"
        );
    }

    // The flash begins with the vector table: initial stack pointer, then the reset handler with its Thumb bit.
    let vectors = file.section_by_name(".vector_table").unwrap();
    assert_eq!(vectors.address(), map.flash.start, "{board}: vector table");
    let words = vectors.data().unwrap().as_chunks::<4>().0;
    assert_eq!(u64::from(u32::from_le_bytes(words[0])), map.stack_top, "{board}: initial stack pointer");
    let reset = u64::from(u32::from_le_bytes(words[1]));
    assert!(reset & 1 == 1 && map.flash.contains(&reset), "{board}: reset handler at {reset:#x}");

    let has_symbol = |wanted: &str| file.symbols().any(|symbol| symbol.name() == Ok(wanted));
    assert!(has_symbol("_SEGGER_RTT"), "{board}: no log buffer");
    assert!(file.section_by_name(".defmt").is_some(), "{board}: no log strings");
}

#[test]
fn the_emulated_boards_image_fits_its_memory() {
    check("an386", &firmware("an386"), &AN386);
}

#[test]
fn the_robots_image_fits_and_spares_description_and_journal() {
    check("stm32f405", &firmware("stm32f405"), &STM32F405);
}

#[test]
fn the_picos_image_fits_and_spares_description_and_journal() {
    check("pico", &pico_firmware("none"), &PICO);
}
