//! The layers that one message carries.

use heapless::Vec;

use crate::layer_bytes::LayerBytes;

/// Max number of layers in one `AppendLayers`, `Amend` or `StoredLayers`.
pub const MAX_LAYERS_PER_MESSAGE: usize = 16;
/// The layers that one message carries.
pub type LayerBatch = Vec<LayerBytes, MAX_LAYERS_PER_MESSAGE>;
