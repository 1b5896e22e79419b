//! Layers in a log: the bytes of the link as hexadecimal digits.

use growbot_core::layer_bytes::LayerBytes;

/// A layer, 24 digits.
pub(super) fn hex(bytes: &LayerBytes) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

/// Layers one after the other, 24 hexadecimal digits each.
#[must_use]
pub fn hex_of(layers: &[LayerBytes]) -> String {
    layers.iter().map(hex).collect()
}

/// Layers from the hex digits of their bytes.
pub(super) fn unhex(text: &str) -> Option<Vec<LayerBytes>> {
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn layers_survive_their_digits() {
        let layers = [[0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 255], [0xab; 12]];
        let text: String = layers.iter().map(hex).collect();
        assert_eq!(unhex(&text).unwrap(), layers);
        assert_eq!(unhex("").unwrap(), Vec::<LayerBytes>::new());
        for wrong in ["0", "0g", &"0".repeat(23), "\u{e9}"] {
            assert_eq!(unhex(wrong), None, "{wrong}");
        }
    }
}
