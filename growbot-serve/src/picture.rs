//! Pictures of cameras: only JPEG and PNG are passed on, whatever a camera calls its response. Of a stream of pictures
//! (`multipart/x-mixed-replace`, as MJPEG cameras send), the first one is read.

use std::io::{self, Read};

use axum::body::Bytes;

/// Maximum length of a picture, and of the part of a stream that is read for it, bytes.
pub const MAX_PICTURE: usize = 4 << 20;
/// Maximum number of pixels of a picture. A small file can have many, and each page holds all of them.
const MAX_PIXELS: u64 = 40_000_000;
/// Maximum length of the parts in which a response is read, bytes.
const PART: usize = 16 << 10;

/// Format of a picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PictureFormat {
    Jpeg,
    Png,
}

impl PictureFormat {
    /// All formats.
    pub const ALL: [Self; 2] = [Self::Jpeg, Self::Png];

    /// Returns the format of a picture by its first bytes. `None` for anything else.
    pub fn of(bytes: &[u8]) -> Option<Self> {
        Self::ALL.into_iter().find(|format| bytes.starts_with(format.signature()))
    }

    fn signature(self) -> &'static [u8] {
        match self {
            Self::Jpeg => b"\xff\xd8\xff",
            Self::Png => b"\x89PNG\r\n\x1a\n",
        }
    }

    /// Returns the number of pixels of a picture, by its header. `None` without one.
    fn pixels(self, bytes: &[u8]) -> Option<u64> {
        match self {
            Self::Jpeg => jpeg_pixels(bytes),
            // The first chunk of a PNG file has width and height (PNG specification, 11.2.1).
            Self::Png => Some(u64::from(be_u32(bytes, 16)?).saturating_mul(be_u32(bytes, 20)?.into())),
        }
    }

    /// Returns the media type.
    pub const fn media_type(self) -> &'static str {
        match self {
            Self::Jpeg => "image/jpeg",
            Self::Png => "image/png",
        }
    }

    /// Returns the extension of files, without the dot.
    pub fn extension(self) -> &'static str {
        match self {
            Self::Jpeg => "jpg",
            Self::Png => "png",
        }
    }
}

/// A picture of a camera.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Picture {
    pub format: PictureFormat,
    pub bytes: Bytes,
}

/// Reasons why no picture can be read from a response.
#[derive(Debug, thiserror::Error)]
pub enum PictureError {
    #[error("it sends more than {} MiB: lower the resolution of its pictures", MAX_PICTURE >> 20)]
    TooLong,
    #[error("its pictures have more than {} megapixels: lower their resolution", MAX_PIXELS / 1_000_000)]
    TooManyPixels,
    #[error("it sends neither a JPEG nor a PNG picture: give the address of a picture or of an MJPEG stream")]
    NotPicture,
    #[error("the connection ended early: {0}")]
    Read(#[from] io::Error),
}

impl Picture {
    /// Reads a picture from a response with this content type: the response itself, or the first part of a stream.
    pub fn read(content_type: &str, mut from: impl Read) -> Result<Self, PictureError> {
        let boundary = boundary_of(content_type);
        let (mut read, mut part) = (Vec::new(), vec![0; PART]);
        let mut search = PartSearch::default();
        loop {
            if read.len() > MAX_PICTURE {
                return Err(PictureError::TooLong);
            }
            let count = from.read(&mut part)?;
            read.extend_from_slice(&part[..count]);
            let is_end = count == 0;
            let found = match &boundary {
                None if is_end => Some(&read[..]),
                None => None,
                Some(boundary) => search.first_part(&read, boundary, is_end),
            };
            if let Some(found) = found {
                if found.len() > MAX_PICTURE {
                    return Err(PictureError::TooLong);
                }
                let format = PictureFormat::of(found).ok_or(PictureError::NotPicture)?;
                if format.pixels(found).is_some_and(|pixels| pixels > MAX_PIXELS) {
                    return Err(PictureError::TooManyPixels);
                }
                return Ok(Self { format, bytes: Bytes::copy_from_slice(found) });
            }
            if is_end {
                return Err(PictureError::NotPicture);
            }
        }
    }
}

/// Returns the line that separates the parts of a stream of this content type. `None` if it is not a stream.
fn boundary_of(content_type: &str) -> Option<Vec<u8>> {
    let (kind, parameters) = content_type.split_once(';')?;
    if !kind.trim().eq_ignore_ascii_case("multipart/x-mixed-replace") {
        return None;
    }
    let named = |parameter: &str| {
        let (name, value) = parameter.split_once('=')?;
        name.trim().eq_ignore_ascii_case("boundary").then(|| value.trim().trim_matches('"').to_owned())
    };
    let boundary = parameters.split(';').find_map(named)?;
    // Some cameras name the boundary with its dashes.
    Some(format!("--{}", boundary.trim_start_matches("--")).into_bytes())
}

/// Returns the number of pixels of a JPEG file, from its frame header (ITU-T T.81, B.2.2). `None` without one.
fn jpeg_pixels(bytes: &[u8]) -> Option<u64> {
    let mut at = 2;
    loop {
        let (mark, length) = (be_u16(bytes, at)?, be_u16(bytes, at + 2)?);
        match mark {
            // Huffman tables, extensions and arithmetic tables have numbers between those of frames.
            0xffc4 | 0xffc8 | 0xffcc => {}
            0xffc0..=0xffcf => return Some(u64::from(be_u16(bytes, at + 5)?) * u64::from(be_u16(bytes, at + 7)?)),
            0xff00..=0xffff => {}
            _ => return None,
        }
        at += 2 + usize::from(length.max(2));
    }
}

fn be_u16(bytes: &[u8], at: usize) -> Option<u16> {
    Some(u16::from_be_bytes(*bytes.get(at..)?.first_chunk()?))
}

fn be_u32(bytes: &[u8], at: usize) -> Option<u32> {
    Some(u32::from_be_bytes(*bytes.get(at..)?.first_chunk()?))
}

/// Search for the first part of a stream. It does not search the content again when more of it arrives.
#[derive(Default)]
struct PartSearch {
    /// Start of the part's content and the length in its head, once the head has arrived.
    content: Option<(usize, Option<usize>)>,
    /// Number of bytes that were searched for the boundary after the content.
    searched: usize,
}

impl PartSearch {
    /// Returns the content of the first part, if it is complete.
    fn first_part<'a>(&mut self, stream: &'a [u8], boundary: &[u8], is_end: bool) -> Option<&'a [u8]> {
        let (start, length) = match self.content {
            Some(content) => content,
            None => {
                let head = position(stream, boundary)? + boundary.len();
                let end = head + position(&stream[head..], b"\r\n\r\n")?;
                let content = (end + 4, content_length(&stream[head..end]));
                (self.content, self.searched) = (Some(content), end + 4);
                content
            }
        };
        if let Some(length) = length {
            return stream.get(start..start.checked_add(length)?);
        }
        let from = self.searched.saturating_sub(boundary.len()).max(start);
        self.searched = stream.len();
        match position(&stream[from..], boundary) {
            Some(end) => {
                let content = &stream[start..from + end];
                // The line break before a boundary belongs to it.
                Some(content.strip_suffix(b"\r\n").unwrap_or(content))
            }
            None => is_end.then_some(&stream[start..]),
        }
    }
}

fn position(text: &[u8], mark: &[u8]) -> Option<usize> {
    text.windows(mark.len()).position(|window| window == mark)
}

fn content_length(head: &[u8]) -> Option<usize> {
    let head = str::from_utf8(head).ok()?;
    let mut fields = head.lines().filter_map(|line| line.split_once(':'));
    let (_, length) = fields.find(|(name, _)| name.trim().eq_ignore_ascii_case("content-length"))?;
    length.trim().parse().ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    const JPEG: &[u8] = b"\xff\xd8\xff\xe0 a picture \xff\xd9";
    const STREAM: &str = "multipart/x-mixed-replace; boundary=frame";

    fn read(content_type: &str, bytes: &[u8]) -> Result<Picture, PictureError> {
        Picture::read(content_type, bytes)
    }

    fn stream(head: &str, after: &str) -> Vec<u8> {
        [b"--frame\r\nContent-Type: image/jpeg\r\n", head.as_bytes(), b"\r\n", JPEG, after.as_bytes()].concat()
    }

    #[test]
    fn the_first_picture_of_a_stream_is_read() {
        let length = format!("Content-Length: {}\r\n", JPEG.len());
        for (content_type, bytes) in [
            ("image/jpeg", JPEG.to_vec()),
            ("text/html", JPEG.to_vec()),
            (STREAM, stream(&length, "\r\n--frame\r\nContent-Type: image/jpeg\r\n\r\nmore")),
            (STREAM, stream("", "\r\n--frame\r\n")),
            (STREAM, stream("", "")),
            ("multipart/x-mixed-replace;boundary=\"--frame\"", stream(&length, "")),
            ("Multipart/X-Mixed-Replace; a=b; Boundary=frame", stream("", "\r\n--frame--")),
        ] {
            let picture = read(content_type, &bytes).unwrap();
            assert_eq!((picture.format, &picture.bytes[..]), (PictureFormat::Jpeg, JPEG), "{content_type}");
        }
    }

    #[test]
    fn an_endless_stream_is_read_up_to_its_first_picture() {
        let head = stream(&format!("Content-Length: {}\r\n", JPEG.len()), "\r\n--frame\r\n");
        let endless = head.as_slice().chain(io::repeat(b'x'));
        assert_eq!(&Picture::read(STREAM, endless).unwrap().bytes[..], JPEG);
    }

    #[test]
    fn a_small_file_of_many_pixels_is_refused() {
        let png = |width: u32, height: u32| {
            [b"\x89PNG\r\n\x1a\n\0\0\0\x0dIHDR", &width.to_be_bytes()[..], &height.to_be_bytes()].concat()
        };
        let jpeg = |width: u16, height: u16| {
            let frame = [&b"\xff\xc2\0\x11\x08"[..], &height.to_be_bytes(), &width.to_be_bytes()].concat();
            [b"\xff\xd8\xff\xe0\0\x04ab\xff\xc4\0\x03t", &frame[..]].concat()
        };
        for bytes in [png(8000, 5000), jpeg(8000, 5000)] {
            assert!(read("", &bytes).is_ok());
        }
        for bytes in [png(8001, 5000), png(u32::MAX, u32::MAX), jpeg(8001, 5000), jpeg(u16::MAX, u16::MAX)] {
            assert!(matches!(read("", &bytes), Err(PictureError::TooManyPixels)));
        }
    }

    #[test]
    fn only_jpeg_and_png_up_to_the_limit_are_pictures() {
        let sent = |bytes: &[u8]| read("image/jpeg", bytes);
        assert_eq!(sent(b"\x89PNG\r\n\x1a\n...").unwrap().format, PictureFormat::Png);
        for other in [&b""[..], b"<svg onload=alert(1)>", b"GIF89a", b"\xff\xd8"] {
            assert!(matches!(sent(other), Err(PictureError::NotPicture)), "{other:?}");
        }
        assert!(matches!(read(STREAM, b"--frame\r\nno head"), Err(PictureError::NotPicture)));
        assert!(matches!(read(STREAM, &stream("Content-Length: 99\r\n", "")), Err(PictureError::NotPicture)));
        let mut long = JPEG.to_vec();
        long.resize(MAX_PICTURE, b'x');
        assert_eq!(sent(&long).unwrap().bytes.len(), MAX_PICTURE);
        long.push(b'x');
        assert!(matches!(sent(&long), Err(PictureError::TooLong)));
        let endless = JPEG.chain(io::repeat(b'x'));
        assert!(matches!(Picture::read("image/jpeg", endless), Err(PictureError::TooLong)));
        let endless = stream("", "");
        assert!(matches!(Picture::read(STREAM, endless.chain(io::repeat(b'x'))), Err(PictureError::TooLong)));
    }
}
