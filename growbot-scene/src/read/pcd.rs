//! PCD: points, as text or binary. Compressed files are refused.

use nalgebra::Vector3;

use super::format_error::FormatError;
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
pub(super) fn read(bytes: &[u8]) -> Result<RawGeometry, FormatError> {
    let (header, data) = header(bytes)?;
    let (fields, words, size) = fields(&header)?;
    let points = header.points.ok_or(FormatError::NoEntry("POINTS"))?;
    let points = match header.data.as_str() {
        "ascii" => read_ascii(data, &fields, words)?,
        "binary" => binary(data, &fields, size)?,
        other => return Err(FormatError::Encoding(other.to_owned())),
    }
    .take_exactly(points)?;
    Ok(RawGeometry { points, triangles: Vec::new() })
}

/// The points of a file, before their number is compared with the header.
struct Points(Vec<Vector3<f64>>);

impl Points {
    fn take_exactly(mut self, declared: usize) -> Result<Vec<Vector3<f64>>, FormatError> {
        let found = self.0.len();
        if declared > found {
            return Err(FormatError::Count { what: "points", declared, found });
        }
        self.0.truncate(declared);
        // A point that a scanner did not detect is NaN.
        self.0.retain(|point| point.iter().all(|value| !value.is_nan()));
        Ok(self.0)
    }
}

fn header(bytes: &[u8]) -> Result<(PcdHeader, &[u8]), FormatError> {
    let mut header = PcdHeader::default();
    let mut rest = bytes;
    while let Some(end) = rest.iter().position(|byte| *byte == b'\n') {
        let (line, after) = rest.split_at(end);
        rest = after.get(1..).unwrap_or_default();
        let line = std::str::from_utf8(line).map_err(|_| FormatError::HeaderNotText)?;
        let mut words = line.split_ascii_whitespace();
        let key = words.next().unwrap_or("#");
        let words: Vec<&str> = words.collect();
        let number = |word: &&str| {
            let invalid = |_| FormatError::HeaderNumber { entry: key.to_owned(), word: (*word).to_owned() };
            word.parse::<usize>().map_err(invalid)
        };
        let numbers = || words.iter().map(number).collect::<Result<Vec<usize>, FormatError>>();
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
    Err(FormatError::NoEntry("DATA"))
}

/// Returns the fields x, y and z, the number of words of a point in a text file, and the number of bytes of a point in
/// a binary file.
fn fields(header: &PcdHeader) -> Result<([PcdField; 3], usize, usize), FormatError> {
    let (mut word, mut offset) = (0_usize, 0_usize);
    let mut found = [None; 3];
    for (index, name) in header.names.iter().enumerate() {
        let size = *header.sizes.get(index).ok_or(FormatError::ShortEntry("SIZE"))?;
        let count = header.counts.get(index).copied().unwrap_or(1);
        let kind = header.kinds.get(index).ok_or(FormatError::ShortEntry("TYPE"))?;
        if let Some(axis) = ["x", "y", "z"].iter().position(|axis| axis == name) {
            if kind != "F" || !matches!(size, 4 | 8) || count != 1 {
                return Err(FormatError::FieldType(name.clone()));
            }
            found[axis] = Some(PcdField { word, offset, size });
        }
        word = word.checked_add(count).ok_or(FormatError::LargeEntry("COUNT"))?;
        offset = count
            .checked_mul(size)
            .and_then(|bytes| offset.checked_add(bytes))
            .ok_or(FormatError::LargeEntry("SIZE"))?;
    }
    match found {
        [Some(x), Some(y), Some(z)] => Ok(([x, y, z], word, offset)),
        _ => Err(FormatError::NoCoordinate),
    }
}

fn read_ascii(data: &[u8], fields: &[PcdField; 3], words: usize) -> Result<Points, FormatError> {
    let mut points = Vec::new();
    for line in data.split(|byte| *byte == b'\n').filter(|line| !line.trim_ascii().is_empty()) {
        let line = std::str::from_utf8(line).map_err(|_| FormatError::PointsNotText)?;
        let values: Vec<&str> = line.split_ascii_whitespace().collect();
        let number = |field: &PcdField| values.get(field.word).and_then(|value| value.parse::<f64>().ok());
        let [Some(x), Some(y), Some(z)] = fields.each_ref().map(number) else {
            return Err(FormatError::Point { point: points.len() + 1, words });
        };
        points.push(Vector3::new(x, y, z));
    }
    Ok(Points(points))
}

fn binary(data: &[u8], fields: &[PcdField; 3], size: usize) -> Result<Points, FormatError> {
    if size == 0 {
        return Err(FormatError::EmptyPoint);
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
