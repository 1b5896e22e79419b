//! What the images of the boards must be: without panics, small, and with a stack that is deep enough whatever happens.

use growbot_tests::firmware;
use growbot_tests::stack_depth::{Image, Step};
use object::{Object, ObjectSection, ObjectSymbol};

/// The robot's flash that the image may fill, bytes: the journal and updates to come need the rest.
const FLASH: u64 = 128 * 1024;
/// The robot's memory that may be taken for good, the 4,096 layers included; the stack has its own.
const STATIC_RAM: u64 = 96 * 1024;
/// Stack that an exception takes before its handler's first instruction: 26 words, and one to align them.
const EXCEPTION_FRAME: u64 = 104 + 4;

const FLASH_SECTIONS: [&str; 4] = [".vector_table", ".text", ".rodata", ".data"];
const RAM_SECTIONS: [&str; 3] = [".data", ".bss", ".uninit"];

/// Parts of the names of what panics, as the linker sees them.
const PANICS: [&str; 6] =
    ["panicking", "panic_fmt", "unwrap_failed", "expect_failed", "slice_index", "growbot_firmware_can_panic"];

fn size(file: &object::File, names: &[&str]) -> u64 {
    names.iter().map(|name| file.section_by_name(name).map_or(0, |section| section.size())).sum()
}

#[test]
fn no_panic_is_left_in_an_image() {
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

/// The handler of a crash keeps the stack pointer where this much of the stack is left (`LITTLE` in `bin/stack.rs`).
const LEFT_FOR_A_CRASH: u64 = 512;

#[test]
fn a_crash_is_retained_within_what_is_left_of_the_stack() {
    for board in ["stm32f405", "an386"] {
        let image = std::fs::read(firmware(board)).unwrap();
        let image = Image::parse(&image);
        let depth = image.deepest(image.symbol("HardFault") & !1).iter().map(|step| step.own).sum::<u64>();
        println!("{board}: {depth} B of stack, {LEFT_FOR_A_CRASH} B are there");
        assert!((128..LEFT_FOR_A_CRASH).contains(&depth), "{board}: {depth} B");
    }
}

/// The deepest that the robot's stack can get, over all paths that its code has: the main program is interrupted at its deepest by one
/// interrupt after the other, each at its deepest.
#[test]
fn the_robots_stack_is_twice_as_deep_as_it_gets() {
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
