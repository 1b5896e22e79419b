//! Common Data Representation (OMG formal/02-06-51 15.3) as used by ROS 2: plain and little-endian, with numbers
//! aligned to their size, counted from the end of the header.

/// Header of a message: plain CDR, little-endian, without options.
const HEADER: [u8; 4] = [0, 1, 0, 0];

/// An unfinished message in CDR.
pub struct Cdr(Vec<u8>);

impl Cdr {
    /// Returns an empty message.
    pub fn new() -> Self {
        Self(HEADER.to_vec())
    }

    /// Returns the finished message.
    pub fn finish(self) -> Vec<u8> {
        self.0
    }

    fn number<const SIZE: usize>(&mut self, bytes: [u8; SIZE]) {
        let end = HEADER.len() + (self.0.len() - HEADER.len()).next_multiple_of(SIZE);
        self.0.resize(end, 0);
        self.0.extend(bytes);
    }

    /// Appends a `byte`, `uint8` or `bool`.
    pub fn u8(&mut self, value: u8) {
        self.0.push(value);
    }

    /// Appends a `uint32`, or the length of a sequence.
    pub fn u32(&mut self, value: u32) {
        self.number(value.to_le_bytes());
    }

    /// Appends an `int32`.
    pub fn i32(&mut self, value: i32) {
        self.number(value.to_le_bytes());
    }

    /// Appends a `float32`.
    pub fn f32(&mut self, value: f32) {
        self.number(value.to_le_bytes());
    }

    /// Appends a `float64`.
    pub fn f64(&mut self, value: f64) {
        self.number(value.to_le_bytes());
    }

    /// Appends a `string`: its length including the final zero, its bytes and the zero. Zeros within become spaces,
    /// because a zero would end the string.
    pub fn string(&mut self, text: &str) {
        let text = text.replace('\0', " ");
        self.u32(text.len() as u32 + 1);
        self.0.extend(text.bytes());
        self.u8(0);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_aligned_relative_to_the_end_of_the_header() {
        let mut cdr = Cdr::new();
        cdr.u8(7);
        cdr.u32(1);
        cdr.string("ab");
        cdr.f64(1.0);
        cdr.f32(0.5);
        cdr.i32(-2);
        #[rustfmt::skip]
        assert_eq!(cdr.finish(), [
            0, 1, 0, 0,
            7, 0, 0, 0, 1, 0, 0, 0,
            3, 0, 0, 0, b'a', b'b', 0, 0,
            0, 0, 0, 0, 0, 0, 0xf0, 0x3f,
            0, 0, 0, 0x3f, 0xfe, 0xff, 0xff, 0xff,
        ]);
    }
}
