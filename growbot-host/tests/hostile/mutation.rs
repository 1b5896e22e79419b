//! Texts with random changes.

use growbot_core::random::Rng;

/// Byte sequences that are inserted into texts: extreme numbers, sequences that control terminals, nesting, line breaks
/// and quotes.
const TOKENS: [&[u8]; 34] = [
    b"\x1b[2J\x1b[31m",
    "\u{9b}2J".as_bytes(),
    "\u{202e}\u{2066}".as_bytes(),
    b"\\u001b[2J\\u009b1m\\u202e\\u0007",
    b"\x00",
    b"\x7f",
    b"\xff\xfe",
    b"\n",
    b"\r\n",
    b"\"",
    b"\\",
    b"{",
    b"}",
    b"[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[[",
    b"]",
    b",",
    b":",
    b"null",
    b"true",
    b"[]",
    b"{}",
    b"-1",
    b"0",
    b"1e308",
    b"-1e308",
    b"1e-308",
    b"NaN",
    b"inf",
    b"4294967295",
    b"4294967296",
    b"18446744073709551615",
    b"99999999999999999999999999",
    b"0.0000000001",
    b"/dev/zero",
];

/// Texts that are inserted into strings of JSON and TOML: control characters, escaped and raw.
const STRINGS: [&str; 5] =
    ["\\u001b[2J\\u0007", "\\u009b2J\\u007f", "\\u202e\\u2066", "\u{202e}\u{200f}\u{9b}", "\\n\\r\\t"];

/// Returns the text with one to six random changes.
pub fn mutated(text: &[u8], random: &mut Rng) -> Vec<u8> {
    let mut bytes = text.to_vec();
    for _ in 0..=random.below(6) {
        change(&mut bytes, random);
    }
    bytes
}

fn change(bytes: &mut Vec<u8>, random: &mut Rng) {
    let place = |bytes: &[u8], random: &mut Rng| random.below(bytes.len() as u64 + 1) as usize;
    let range = |bytes: &[u8], random: &mut Rng, longest: u64| {
        let from = place(bytes, random);
        from..(from + random.below(longest) as usize).min(bytes.len())
    };
    match random.below(16) {
        0 | 1 => {
            let at = place(bytes, random);
            if let Some(byte) = bytes.get_mut(at) {
                *byte ^= 1 << random.below(8);
            }
        }
        2 => {
            let longest = 1 + bytes.len() as u64 / 8;
            let gone = range(bytes, random, longest);
            bytes.drain(gone);
        }
        3 => {
            let again = range(bytes, random, 200);
            let copy = bytes.get(again.clone()).unwrap_or_default().to_vec();
            bytes.splice(again.end..again.end, copy);
        }
        4 => bytes.truncate(place(bytes, random)),
        5..=7 => {
            let at = place(bytes, random);
            let token = TOKENS[random.below(TOKENS.len() as u64) as usize];
            bytes.splice(at..at, token.iter().copied());
        }
        8 | 9 => {
            // Replaces a number by another token.
            let is_part = |byte: &u8| byte.is_ascii_digit() || matches!(byte, b'.' | b'-' | b'+' | b'e');
            let from = place(bytes, random);
            let from = bytes.iter().skip(from).position(is_part).map_or(bytes.len(), |ahead| from + ahead);
            let end = bytes.iter().skip(from).position(|byte| !is_part(byte)).map_or(bytes.len(), |ahead| from + ahead);
            let token = TOKENS[17 + random.below(TOKENS.len() as u64 - 17) as usize];
            bytes.splice(from..end, token.iter().copied());
        }
        10..=13 => {
            // Inserts into a string, so that the text remains valid: of the first or last line, which has names and
            // outcomes, or of any line.
            let ends = (
                bytes.iter().position(|byte| *byte == b'\n'),
                bytes.trim_ascii().iter().rposition(|byte| *byte == b'\n'),
            );
            let (from, to) = match (random.below(3), ends) {
                (0, (Some(first), _)) => (0, first),
                (1, (_, Some(last))) => (last, bytes.len()),
                _ => (0, bytes.len()),
            };
            let quotes: Vec<usize> = (from..to).filter(|at| bytes[*at] == b'"').collect();
            if !quotes.is_empty() {
                let at = quotes[random.below(quotes.len() as u64) as usize] + 1;
                let token = STRINGS[random.below(STRINGS.len() as u64) as usize];
                bytes.splice(at..at, token.bytes());
            }
        }
        14 => {
            // Swaps two lines.
            let mut lines: Vec<Vec<u8>> = bytes.split(|byte| *byte == b'\n').map(<[u8]>::to_vec).collect();
            let (one, other) = (random.below(lines.len() as u64) as usize, random.below(lines.len() as u64) as usize);
            lines.swap(one, other);
            *bytes = lines.join(&b'\n');
        }
        _ => {
            // Removes or repeats a line.
            let mut lines: Vec<Vec<u8>> = bytes.split(|byte| *byte == b'\n').map(<[u8]>::to_vec).collect();
            let at = random.below(lines.len() as u64) as usize;
            if random.below(2) == 0 {
                lines.remove(at);
            } else {
                lines.insert(at, lines[at].clone());
            }
            *bytes = lines.join(&b'\n');
        }
    }
}
