//! Serialization of layers and hashes as hexadecimal digits: 24 digits for the 12 bytes of a layer, 16
//! digits for a hash.
//!
//! The modules are for the attribute `#[serde(with)]`.

use growbot_core::layer_bytes::LayerBytes;

/// Formats a hash as 16 hexadecimal digits.
pub fn format_hash(hash: u64) -> String {
    format!("{hash:016x}")
}

/// Formats the bytes of a layer as 24 hexadecimal digits.
pub(crate) fn hex(bytes: &LayerBytes) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

/// Formats layers one after the other, 24 hexadecimal digits each.
pub fn hex_of(layers: &[LayerBytes]) -> String {
    layers.iter().map(hex).collect()
}

/// Parses layers from 24 hexadecimal digits each. `None` if the text is anything else.
pub fn unhex(text: &str) -> Option<Vec<LayerBytes>> {
    let digits: Vec<u8> =
        text.chars().map(|digit| digit.to_digit(16).map(|value| value as u8)).collect::<Option<_>>()?;
    let (layers, []) = digits.as_chunks::<24>() else { return None };
    let layer = |digits: &[u8; 24]| {
        let (pairs, _) = digits.as_chunks::<2>();
        let mut bytes = [0; 12];
        for (byte, [high, low]) in bytes.iter_mut().zip(pairs) {
            *byte = high << 4 | low;
        }
        bytes
    };
    Some(layers.iter().map(layer).collect())
}

/// For `#[serde(with)]`: layers as one string of 24 hexadecimal digits each.
pub mod layers {
    use growbot_core::layer_bytes::LayerBytes;
    use serde::de::Error;
    use serde::{Deserialize, Deserializer, Serializer};

    /// Serializes layers.
    pub fn serialize<S: Serializer>(layers: &[LayerBytes], to: S) -> Result<S::Ok, S::Error> {
        to.serialize_str(&super::hex_of(layers))
    }

    /// Deserializes layers.
    pub fn deserialize<'de, D: Deserializer<'de>>(from: D) -> Result<Vec<LayerBytes>, D::Error> {
        super::unhex(&String::deserialize(from)?).ok_or_else(|| D::Error::custom("\"layers\" that are not layers"))
    }
}

/// For `#[serde(with)]`: an optional layer as 24 hexadecimal digits.
pub mod layer {
    use growbot_core::layer_bytes::LayerBytes;
    use serde::{Deserializer, Serialize, Serializer};

    /// Serializes a layer, or null for `None`.
    pub fn serialize<S: Serializer>(layer: &Option<LayerBytes>, to: S) -> Result<S::Ok, S::Error> {
        layer.as_ref().map(super::hex).serialize(to)
    }

    /// Deserializes a layer. `None` if the value is null or not a layer.
    pub fn deserialize<'de, D: Deserializer<'de>>(from: D) -> Result<Option<LayerBytes>, D::Error> {
        let text: Option<String> = crate::run_log::lenient(from)?;
        Ok(text.and_then(|text| super::unhex(&text)?.first().copied()))
    }
}

/// For `#[serde(with)]`: a hash as 16 hexadecimal digits.
pub mod hash {
    use serde::de::Error;
    use serde::{Deserialize, Deserializer, Serializer};

    /// Serializes a hash.
    pub fn serialize<S: Serializer>(hash: &u64, to: S) -> Result<S::Ok, S::Error> {
        to.serialize_str(&super::format_hash(*hash))
    }

    /// Deserializes a hash.
    pub fn deserialize<'de, D: Deserializer<'de>>(from: D) -> Result<u64, D::Error> {
        let text = String::deserialize(from)?;
        u64::from_str_radix(&text, 16)
            .map_err(|_| D::Error::custom(format!("{text:?}, which is not a hash of 16 hexadecimal digits")))
    }
}

/// For `#[serde(with)]`: an optional hash as 16 hexadecimal digits.
pub mod hash_or_none {
    use serde::de::Error;
    use serde::{Deserialize, Deserializer, Serialize, Serializer};

    /// Serializes a hash, or null for `None`.
    pub fn serialize<S: Serializer>(hash: &Option<u64>, to: S) -> Result<S::Ok, S::Error> {
        hash.map(super::format_hash).serialize(to)
    }

    /// Deserializes a hash, or `None` from null.
    pub fn deserialize<'de, D: Deserializer<'de>>(from: D) -> Result<Option<u64>, D::Error> {
        let read = |text: String| {
            u64::from_str_radix(&text, 16)
                .map_err(|_| D::Error::custom(format!("{text:?}, which is not a hash of 16 hexadecimal digits")))
        };
        Option::<String>::deserialize(from)?.map(read).transpose()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn layers_round_trip_through_hexadecimal() {
        let layers = [[0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 255], [0xab; 12]];
        let text: String = layers.iter().map(hex).collect();
        assert_eq!(unhex(&text).unwrap(), layers);
        assert_eq!(unhex("").unwrap(), Vec::<LayerBytes>::new());
        for wrong in ["0", "0g", &"0".repeat(23), "\u{e9}"] {
            assert_eq!(unhex(wrong), None, "{wrong}");
        }
    }
}
