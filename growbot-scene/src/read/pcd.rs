//! PCD: points, as text or binary. Compressed files are refused.

use nalgebra::Vector3;

use super::raw_geometry::RawGeometry;

/// Position of a coordinate among the values of a point in a PCD file.
#[derive(Debug, Clone, Copy)]
struct PcdField {
    /// Index of the value in a line of text.
    word: usize,
    /// Offset of the value in a binary point, bytes. `size` is the length of the value, 4 or 8 bytes.
    offset: usize,
    size: usize,
}

/// Content of the header of a PCD file.
#[derive(Debug, Default)]
struct PcdHeader {
    names: Vec<String>,
    sizes: Vec<usize>,
    kinds: Vec<String>,
    counts: Vec<usize>,
    points: Option<usize>,
    data: String,
}

/// Reads a PCD file.
pub(super) fn read(bytes: &[u8]) -> Result<RawGeometry, String> {
    let (header, data) = header(bytes)?;
    let (fields, words, size) = fields(&header)?;
    let points = header.points.ok_or("the header of the file has no POINTS")?;
    let points = match header.data.as_str() {
        "ascii" => read_ascii(data, &fields, words)?,
        "binary" => binary(data, &fields, size)?,
        other => {
            return Err(format!(
                "the points of the file are written as {other:?}: write the points as ascii or binary"
            ));
        }
    }
    .take_exactly(points)?;
    Ok(RawGeometry { points, triangles: Vec::new() })
}

/// The points of a file, before their number is compared with the header.
struct Points(Vec<Vector3<f64>>);

impl Points {
    fn take_exactly(mut self, announced: usize) -> Result<Vec<Vector3<f64>>, String> {
        let found = self.0.len();
        if announced > found {
            return Err(format!("the header of the file declares {announced} points, but the file has {found}"));
        }
        self.0.truncate(announced);
        // A point that a scanner did not detect is NaN.
        self.0.retain(|point| point.iter().all(|value| !value.is_nan()));
        Ok(self.0)
    }
}

fn header(bytes: &[u8]) -> Result<(PcdHeader, &[u8]), String> {
    let mut header = PcdHeader::default();
    let mut rest = bytes;
    while let Some(end) = rest.iter().position(|byte| *byte == b'\n') {
        let (line, after) = rest.split_at(end);
        rest = after.get(1..).unwrap_or_default();
        let line = std::str::from_utf8(line).map_err(|_| "the header of the file is not text")?;
        let mut words = line.split_ascii_whitespace();
        let key = words.next().unwrap_or("#");
        let words: Vec<&str> = words.collect();
        let numbers = || -> Result<Vec<usize>, String> {
            words
                .iter()
                .map(|word| {
                    word.parse().map_err(|_| format!("{key} in the header has {word:?}, which is not a number"))
                })
                .collect()
        };
        match key {
            "FIELDS" => header.names = words.iter().map(|word| (*word).to_owned()).collect(),
            "SIZE" => header.sizes = numbers()?,
            "TYPE" => header.kinds = words.iter().map(|word| (*word).to_owned()).collect(),
            "COUNT" => header.counts = numbers()?,
            "POINTS" => header.points = numbers()?.first().copied(),
            "DATA" => {
                header.data = words.first().copied().unwrap_or_default().to_owned();
                return Ok((header, rest));
            }
            _ => {}
        }
    }
    Err("the header of the file has no DATA".to_owned())
}

/// Returns the fields x, y and z, the number of words of a point in a text file, and the number of bytes of a point in
/// a binary file.
fn fields(header: &PcdHeader) -> Result<([PcdField; 3], usize, usize), String> {
    let (mut word, mut offset) = (0_usize, 0_usize);
    let mut found = [None; 3];
    for (index, name) in header.names.iter().enumerate() {
        let size = *header.sizes.get(index).ok_or("SIZE in the header has fewer values than FIELDS")?;
        let count = header.counts.get(index).copied().unwrap_or(1);
        let kind = header.kinds.get(index).ok_or("TYPE in the header has fewer values than FIELDS")?;
        if let Some(axis) = ["x", "y", "z"].iter().position(|axis| axis == name) {
            if kind != "F" || !matches!(size, 4 | 8) || count != 1 {
                return Err(format!("field {name} in the header is not a single number of type F and size 4 or 8"));
            }
            found[axis] = Some(PcdField { word, offset, size });
        }
        word = word.checked_add(count).ok_or("COUNT in the header is too large")?;
        offset = count
            .checked_mul(size)
            .and_then(|bytes| offset.checked_add(bytes))
            .ok_or("SIZE in the header is too large")?;
    }
    match found {
        [Some(x), Some(y), Some(z)] => Ok(([x, y, z], word, offset)),
        _ => Err("the header of the file lacks a field x, y or z".to_owned()),
    }
}

fn read_ascii(data: &[u8], fields: &[PcdField; 3], words: usize) -> Result<Points, String> {
    let mut points = Vec::new();
    for line in data.split(|byte| *byte == b'\n').filter(|line| !line.trim_ascii().is_empty()) {
        let line = std::str::from_utf8(line).map_err(|_| "the points of the file are not text")?;
        let values: Vec<&str> = line.split_ascii_whitespace().collect();
        let number = |field: &PcdField| values.get(field.word).and_then(|value| value.parse::<f64>().ok());
        let [Some(x), Some(y), Some(z)] = fields.each_ref().map(number) else {
            return Err(format!("point {} has no numbers for x, y, z among {words} values", points.len() + 1));
        };
        points.push(Vector3::new(x, y, z));
    }
    Ok(Points(points))
}

fn binary(data: &[u8], fields: &[PcdField; 3], size: usize) -> Result<Points, String> {
    if size == 0 {
        return Err("a point of the file has no bytes".to_owned());
    }
    let number = |point: &[u8], field: &PcdField| {
        let bytes = point.get(field.offset..).unwrap_or_default();
        match field.size {
            4 => bytes.first_chunk().map_or(f64::NAN, |bytes| f64::from(f32::from_le_bytes(*bytes))),
            _ => bytes.first_chunk().map_or(f64::NAN, |bytes| f64::from_le_bytes(*bytes)),
        }
    };
    let point = |bytes: &[u8]| Vector3::from(fields.each_ref().map(|field| number(bytes, field)));
    Ok(Points(data.chunks_exact(size).map(point).collect()))
}
