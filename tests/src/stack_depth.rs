//! Max stack depth of an image, computed from its code alone.
//!
//! The Thumb-2 instructions of every function show how much stack it uses and which functions it calls. A tail call
//! counts as a call. A call through a pointer counts as a call of the deepest function whose address is taken anywhere.
//! Recursion has no bound and is rejected.

use std::collections::{BTreeMap, BTreeSet};

use object::{Object, ObjectSection, ObjectSymbol, SymbolKind};

/// Properties of a function that matter for the stack.
#[derive(Debug, Default)]
struct Function {
    name: String,
    end: u64,
    /// Stack of the function itself, bytes.
    own: u64,
    calls: BTreeSet<u64>,
    /// True if the function calls through a pointer.
    indirect: bool,
}

/// A function in a chain of calls.
#[derive(Debug, Clone)]
pub struct Step {
    /// Name of the function.
    pub function: String,
    /// Stack of the function itself, bytes.
    pub own: u64,
}

/// A decoded image.
#[derive(Debug)]
pub struct Image {
    functions: BTreeMap<u64, Function>,
    /// Addresses of the functions whose address is taken, so that they may be called through a pointer.
    pointed_at: BTreeSet<u64>,
    symbols: BTreeMap<String, u64>,
    vectors: Vec<u32>,
}

fn word(bytes: &[u8]) -> u32 {
    u32::from_le_bytes(bytes.try_into().unwrap())
}

/// Symbols of an image.
struct Symbols {
    functions: BTreeMap<u64, Function>,
    named: BTreeMap<String, u64>,
    /// Addresses at which code (true) or data (false) begins, from the assembler's mapping symbols.
    kinds: BTreeMap<u64, bool>,
}

impl Symbols {
    fn of(file: &object::File) -> Self {
        let mut all = Self { functions: BTreeMap::new(), named: BTreeMap::new(), kinds: BTreeMap::new() };
        for symbol in file.symbols() {
            let Ok(name) = symbol.name() else { continue };
            let address = symbol.address();
            match name.split('.').next() {
                Some("$t") => _ = all.kinds.insert(address, true),
                Some("$d") => _ = all.kinds.insert(address, false),
                _ => _ = all.named.insert(name.to_owned(), address),
            }
            if symbol.kind() == SymbolKind::Text && !name.starts_with('$') {
                let (start, end) = (address & !1, (address & !1) + symbol.size());
                let function = all.functions.entry(start).or_default();
                function.end = function.end.max(end);
                function.name = name.to_owned();
            }
        }
        // A symbol without a size ends at the next function.
        let starts: Vec<u64> = all.functions.keys().copied().collect();
        let text = file.section_by_name(".text").unwrap();
        let text_end = text.address() + text.size();
        for (index, (start, function)) in all.functions.iter_mut().enumerate() {
            if function.end == *start {
                function.end = starts.get(index + 1).copied().unwrap_or(text_end);
            }
        }
        all
    }
}

/// Decoder of a function's instructions (ARMv7-M Architecture Reference Manual, A5).
struct Decoder<'a> {
    start: u64,
    function: &'a mut Function,
    pointers: &'a mut BTreeSet<u32>,
    /// Lower halves that `movw` has written to the registers.
    halves: [u32; 16],
    saved: u64,
}

impl Decoder<'_> {
    fn read(mut self, base: u64, code: &[u8], kinds: &BTreeMap<u64, bool>) {
        let mut at = self.start;
        while at + 2 <= self.function.end {
            let offset = (at - base) as usize;
            let is_code = kinds.range(..=at).next_back().is_none_or(|(_, code)| *code);
            if !is_code {
                if at.is_multiple_of(4) && offset + 4 <= code.len() {
                    self.pointers.insert(word(&code[offset..offset + 4]));
                }
                at += 2;
                continue;
            }
            let half = |offset: usize| u32::from(code[offset]) | u32::from(code[offset + 1]) << 8;
            let high = half(offset);
            if high >> 11 < 0b11101 {
                self.narrow(at, high);
                at += 2;
            } else {
                self.wide(at, high, half(offset + 2));
                at += 4;
            }
        }
        self.function.own += self.saved;
    }

    fn jump(&mut self, at: u64, offset: i64) {
        let target = (at as i64 + 4 + offset) as u64;
        if !(self.start..self.function.end).contains(&target) {
            self.function.calls.insert(target);
        }
    }

    /// Decodes an instruction of 16 bits.
    fn narrow(&mut self, at: u64, high: u32) {
        match high {
            _ if high & 0xFE00 == 0xB400 => self.function.own += 4 * u64::from((high & 0x1FF).count_ones()),
            _ if high & 0xFF80 == 0xB080 => self.function.own += 4 * u64::from(high & 0x7F),
            _ if high & 0xF800 == 0xE000 => self.jump(at, i64::from((high << 21).cast_signed() >> 20)),
            _ if high & 0xF000 == 0xD000 && high & 0x0F00 < 0x0E00 => {
                self.jump(at, i64::from((high << 24).cast_signed() >> 23));
            }
            0x4770 => {}
            _ if high & 0xFF07 == 0x4700 => self.function.indirect = true,
            _ => {}
        }
    }

    /// Decodes an instruction of 32 bits.
    fn wide(&mut self, at: u64, high: u32, low: u32) {
        let function = &mut *self.function;
        let register = (low >> 8 & 0xF) as usize;
        let immediate = (high & 0xF) << 12 | (high >> 10 & 1) << 11 | (low >> 12 & 7) << 8 | low & 0xFF;
        match high {
            0xE92D => function.own += 4 * u64::from(low.count_ones()),
            _ if high & 0xFFBF == 0xED2D && low & 0x0E00 == 0x0A00 => function.own += 4 * u64::from(low & 0xFF),
            // A call of outlined code saves the return address on the stack until the code returns.
            0xF84D if low & 0x0F00 == 0x0D00 => self.saved = self.saved.max(u64::from(low & 0xFF)),
            _ if high & 0xFBEF == 0xF1AD && register == 13 => function.own += expanded(high >> 10 & 1, low),
            _ if high & 0xFBFF == 0xF2AD && register == 13 => {
                function.own += u64::from((high >> 10 & 1) << 11 | (low >> 12 & 7) << 8 | low & 0xFF);
            }
            _ if high & 0xFFEF == 0xEBAD && register == 13 => {
                panic!("the function {} takes a stack of unknown size at {at:#x}", function.name)
            }
            _ if high & 0xFBF0 == 0xF240 && low & 0x8000 == 0 => self.halves[register] = immediate,
            _ if high & 0xFBF0 == 0xF2C0 && low & 0x8000 == 0 => {
                self.pointers.insert(immediate << 16 | self.halves[register]);
            }
            _ if high >> 11 == 0b11110 && low & 0x9000 == 0x9000 => self.jump(at, branch_offset(high, low)),
            _ if high >> 11 == 0b11110 && low & 0xD000 == 0x8000 && high >> 6 & 0xE != 0xE => {
                self.jump(at, conditional_offset(high, low));
            }
            _ => {}
        }
    }
}

/// Returns the offset of a conditional branch of 32 bits.
fn conditional_offset(high: u32, low: u32) -> i64 {
    let bits = (high >> 10 & 1) << 20
        | (low >> 11 & 1) << 19
        | (low >> 13 & 1) << 18
        | (high & 0x3F) << 12
        | (low & 0x7FF) << 1;
    i64::from((bits << 11).cast_signed() >> 11)
}

/// Returns the number that the instruction set encodes in twelve bits.
fn expanded(i: u32, low: u32) -> u64 {
    let (code, byte) = ((i << 11 | (low >> 12 & 7) << 8 | low & 0xFF) >> 7, low & 0xFF);
    let pattern = i << 3 | low >> 12 & 7;
    u64::from(match pattern {
        0 => byte,
        1 => byte << 16 | byte,
        2 => byte << 24 | byte << 8,
        3 => byte * 0x0101_0101,
        _ => (0x80 | byte).rotate_right(code),
    })
}

/// Returns the offset of a 32-bit branch.
fn branch_offset(high: u32, low: u32) -> i64 {
    let sign = high >> 10 & 1;
    let (i1, i2) = (!(low >> 13 ^ sign) & 1, !(low >> 11 ^ sign) & 1);
    let bits = sign << 24 | i1 << 23 | i2 << 22 | (high & 0x3FF) << 12 | (low & 0x7FF) << 1;
    i64::from((bits << 7).cast_signed() >> 7)
}

impl Image {
    /// Decodes an ELF image of a Cortex-M4.
    ///
    /// # Panics
    /// Panics if the image is invalid, or changes its stack pointer in a way that the decoder does not know.
    pub fn parse(image: &[u8]) -> Self {
        let file = object::File::parse(image).unwrap();
        let Symbols { mut functions, named, kinds } = Symbols::of(&file);
        let data = |name: &str| file.section_by_name(name).unwrap().data().unwrap();
        let words = |bytes: &[u8]| bytes.chunks_exact(4).map(word).collect::<Vec<_>>();
        let mut pointers: BTreeSet<u32> = [".rodata", ".data"].into_iter().flat_map(|name| words(data(name))).collect();
        // Some code runs from RAM, so that it can erase the flash.
        let sections = [".text", ".data"].map(|name| (file.section_by_name(name).unwrap().address(), data(name)));
        for (start, function) in &mut functions {
            let within = |(base, code): &&(u64, &[u8])| (*base..*base + code.len() as u64).contains(start);
            let &(base, code) = sections
                .iter()
                .find(within)
                .unwrap_or_else(|| panic!("the function {} has no address in the image", function.name));
            Decoder { start: *start, function, pointers: &mut pointers, halves: [0; 16], saved: 0 }
                .read(base, code, &kinds);
        }
        let pointed_at = functions.keys().copied().filter(|start| pointers.contains(&(*start as u32 | 1))).collect();
        Self { functions, pointed_at, symbols: named, vectors: words(data(".vector_table")) }
    }

    /// Returns the address of a symbol.
    ///
    /// # Panics
    /// Panics if the symbol does not exist.
    pub fn symbol(&self, name: &str) -> u64 {
        *self.symbols.get(name).unwrap_or_else(|| panic!("the image has no symbol {name}"))
    }

    /// Returns the entry point and the handlers of exceptions and interrupts. The handler of faults is left out,
    /// because it starts a stack of its own.
    pub fn entries(&self) -> (u64, impl Iterator<Item = (&str, u64)>) {
        let handler = |vector: &u32| u64::from(vector & !1);
        // These handlers end the program, so their use of the stack does not count here.
        let named = |name| self.symbols.get(name).map_or(0, |at| at & !1);
        let none = [0, named("DefaultHandler_"), named("DefaultHandler"), self.symbol("HardFault") & !1];
        let handlers: BTreeSet<u64> =
            self.vectors.iter().skip(2).map(handler).filter(|at| !none.contains(at)).collect();
        let named = handlers.into_iter().map(|at| (self.functions.get(&at).map_or("?", |it| it.name.as_str()), at));
        (self.vectors.get(1).map_or(0, handler), named)
    }

    /// Returns the chain of calls from a function that uses the most stack.
    ///
    /// # Panics
    /// Panics on recursion.
    pub fn deepest(&self, entry: u64) -> Vec<Step> {
        self.deepest_of(entry, &mut BTreeMap::new(), &mut Vec::new()).1
    }

    fn deepest_of(
        &self,
        at: u64,
        known: &mut BTreeMap<u64, (u64, Vec<Step>)>,
        callers: &mut Vec<u64>,
    ) -> (u64, Vec<Step>) {
        if let Some(found) = known.get(&at) {
            return found.clone();
        }
        // A branch into the middle of a function counts as one to that function.
        let Some((start, function)) = self.functions.range(..=at).next_back() else { return (0, Vec::new()) };
        let names = |chain: &[u64]| chain.iter().map(|at| self.functions[at].name.clone()).collect::<Vec<_>>();
        assert!(
            !callers.contains(start),
            "the stack depth has no bound, because of a recursion: {:?} calls {}",
            names(callers),
            function.name
        );
        callers.push(*start);
        let pointed_at = self.pointed_at.iter().filter(|_| function.indirect);
        let mut deepest = (0, Vec::new());
        for callee in function.calls.iter().chain(pointed_at) {
            let below = self.deepest_of(*callee, known, callers);
            if below.0 > deepest.0 {
                deepest = below;
            }
        }
        callers.pop();
        let mut path = vec![Step { function: function.name.clone(), own: function.own }];
        path.append(&mut deepest.1);
        known.insert(at, (function.own + deepest.0, path));
        known[&at].clone()
    }
}
