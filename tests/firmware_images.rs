//! Requirements of the boards' images: no panics, a small size, and a stack that is always deep enough.

use growbot_tests::firmware;
use growbot_tests::stack_depth::{Image, Step};
use object::{Object, ObjectSection, ObjectSymbol};

/// Max flash of the robot's image, bytes. The description, the journal and future updates need the rest. Reading,
/// checking and storing descriptions takes 29 KiB of it.
const FLASH: u64 = 192 * 1024;
/// Max static memory of the robot's image, bytes, including the 4,096 layers. The stack has its own memory.
const STATIC_RAM: u64 = 96 * 1024;
/// Stack that an exception uses before its handler's first instruction: 26 words, and one for alignment.
const EXCEPTION_FRAME: u64 = 104 + 4;

const FLASH_SECTIONS: [&str; 4] = [".vector_table", ".text", ".rodata", ".data"];
const RAM_SECTIONS: [&str; 3] = [".data", ".bss", ".uninit"];

/// Parts of the linker's names of functions that panic.
const PANICS: [&str; 6] =
    ["panicking", "panic_fmt", "unwrap_failed", "expect_failed", "slice_index", "growbot_firmware_can_panic"];

fn size(file: &object::File, names: &[&str]) -> u64 {
    names.iter().map(|name| file.section_by_name(name).map_or(0, |section| section.size())).sum()
}

#[test]
fn images_contain_no_panic() {
    for board in ["stm32f405", "an386"] {
        let image = std::fs::read(firmware(board)).unwrap();
        let file = object::File::parse(&*image).unwrap();
        let names: Vec<_> = file.symbols().filter_map(|symbol| symbol.name().ok()).collect();
        assert!(names.len() > 500, "{board}: {} symbols: has it been stripped?", names.len());
        let left: Vec<_> = names.iter().filter(|name| PANICS.iter().any(|panic| name.contains(panic))).collect();
        assert!(left.is_empty(), "{board}: {left:?}");
    }
}

#[test]
fn the_robots_image_is_small() {
    let image = std::fs::read(firmware("stm32f405")).unwrap();
    let file = object::File::parse(&*image).unwrap();
    let (flash, ram) = (size(&file, &FLASH_SECTIONS), size(&file, &RAM_SECTIONS));
    println!("stm32f405: {flash} B of flash (at most {FLASH}), {ram} B of static RAM (at most {STATIC_RAM})");
    assert!(flash < FLASH && ram < STATIC_RAM, "{flash} B of flash, {ram} B of static RAM");
}

/// Min free stack with which the handler of a crash keeps the stack pointer, bytes (`STACK_RESERVE_BYTES` in
/// `boards/runtime/fault_handler.rs`). With less, the handler starts again at the top of the stack.
const LEFT_FOR_A_CRASH: u64 = 512;

#[test]
fn retaining_a_crash_fits_the_remaining_stack() {
    for board in ["stm32f405", "an386"] {
        let image = std::fs::read(firmware(board)).unwrap();
        let image = Image::parse(&image);
        let depth = image.deepest(image.symbol("HardFault") & !1).iter().map(|step| step.own).sum::<u64>();
        println!("{board}: {depth} B of stack, {LEFT_FOR_A_CRASH} B are there");
        assert!((128..LEFT_FOR_A_CRASH).contains(&depth), "{board}: {depth} B");
    }
}

/// Bytes of a barrier, `dsb sy`.
const BARRIER: [u8; 4] = [0xBF, 0xF3, 0x4F, 0x8F];

/// While a sector is erased, nothing can be read from flash, including code. Therefore the code for it is in RAM and
/// calls nothing. The write that starts the erase must have arrived before the status is read, because otherwise the
/// status reports that the erase is finished.
#[test]
fn a_sector_is_erased_from_ram_after_a_barrier() {
    let image = std::fs::read(firmware("stm32f405")).unwrap();
    let file = object::File::parse(&*image).unwrap();
    let data = file.section_by_name(".data").unwrap();
    let in_ram = |symbol: &object::Symbol| {
        symbol.kind() == object::SymbolKind::Text
            && (data.address()..data.address() + data.size()).contains(&(symbol.address() & !1))
    };
    let code: Vec<_> = file.symbols().filter(in_ram).collect();
    let [erase] = &code[..] else { panic!("{} functions are in RAM", code.len()) };
    assert!(erase.name().unwrap().contains("erase"), "{:?}", erase.name());
    let from = ((erase.address() & !1) - data.address()) as usize;
    let bytes = &data.data().unwrap()[from..from + erase.size() as usize];
    let halves: Vec<u16> = bytes.chunks_exact(2).map(|half| u16::from_le_bytes([half[0], half[1]])).collect();
    let barrier = bytes.windows(4).position(|four| four == BARRIER).expect("there is a barrier") / 2;
    // Stores and loads of words have 0x60 to 0x6F as first byte (Thumb, immediate offset), or begin with 0xF8C or
    // 0xF8D.
    let stores = |half: &u16| half >> 11 == 0b01100 || half >> 4 == 0xF8C;
    let loads = |half: &u16| half >> 11 == 0b01101 || half >> 4 == 0xF8D;
    assert_eq!(
        halves[..barrier].iter().filter(|half| stores(half)).count(),
        1,
        "the write that starts it: {halves:04x?}"
    );
    assert!(!halves[..barrier].iter().any(loads), "the status is read before the barrier: {halves:04x?}");
    assert!(halves[barrier..].iter().any(loads), "the status is read: {halves:04x?}");
    // A call is 0xF000 to 0xF7FF with 0xD000 or 0xC000 in its second half, or BLX, 0x4780 to 0x47F8.
    let calls = |pair: &[u16]| pair[0] >> 11 == 0b11110 && pair[1] & 0xD000 == 0xD000 || pair[0] & 0xFF87 == 0x4780;
    assert!(!halves.windows(2).any(calls), "it calls something: {halves:04x?}");
}

/// The stack region is more than twice as large as the max depth of the robot's stack over all paths of its code. In
/// this depth each interrupt interrupts the others and the main program at their greatest depths.
#[test]
fn the_robots_stack_is_twice_the_measured_depth() {
    let image = std::fs::read(firmware("stm32f405")).unwrap();
    let image = Image::parse(&image);
    let region = image.symbol("_stack_start") - image.symbol("_stack_end");

    let (reset, handlers) = image.entries();
    let mut total = 0;
    for (name, entry, overhead) in
        [("main program", reset, 0)].into_iter().chain(handlers.map(|(name, entry)| (name, entry, EXCEPTION_FRAME)))
    {
        let path = image.deepest(entry);
        println!("{name}:");
        for Step { function, own } in &path {
            println!("{own:>8}  {function}");
        }
        let depth = overhead + path.iter().map(|step| step.own).sum::<u64>();
        println!("{depth:>8}  in all");
        total += depth;
    }
    println!("{total} B of {region} B of stack at the deepest, {} %", 100 * total / region);
    assert!(total < region / 2, "{total} B of {region} B of stack");
}
