//! Store of the layers that the board has accepted and not yet laid.

use growbot_core::layer_bytes::LayerBytes;
use heapless::Deque;

/// Max number of layers that the board stores: 3.2 m of robot A's body.
pub const CAPACITY: usize = 4096;

/// Store of the layers of one job, in order. A layer is dropped once it is laid, so that a new one can be stored.
#[derive(Debug, Default)]
pub struct LayerStore {
    layers: Deque<LayerBytes, CAPACITY>,
    /// Index, in the job, of the first stored layer.
    first: u32,
}

impl LayerStore {
    /// Creates an empty store.
    pub const fn new() -> Self {
        Self { layers: Deque::new(), first: 0 }
    }

    /// Clears the store. The next layer that is added has the index `first`.
    pub fn restart(&mut self, first: u32) {
        self.layers.clear();
        self.first = first;
    }

    /// Drops the stored layers from the index `index` of the job on.
    pub fn truncate(&mut self, index: u32) {
        let keep = index.saturating_sub(self.first) as usize;
        while self.layers.len() > keep {
            self.layers.pop_back();
        }
    }

    /// Returns the index, in the job, of the next layer to be pushed.
    pub fn next_index(&self) -> u32 {
        self.first + self.layers.len() as u32
    }

    /// Returns the number of further layers for which the store has room.
    pub fn room(&self) -> u32 {
        (CAPACITY - self.layers.len()) as u32
    }

    /// Adds a layer after the last one. Returns `false` if the store is full.
    #[must_use]
    // Without inlining, the compiler knows that the layer is outside of the store, and copying it needs no `memmove` of
    // 1.5 kB of flash.
    #[inline(never)]
    pub fn push(&mut self, layer: LayerBytes) -> bool {
        self.layers.push_back(layer).is_ok()
    }

    /// Returns the layer with this index in the job. `None` if it is not stored.
    pub fn get(&self, index: u32) -> Option<LayerBytes> {
        let offset = usize::try_from(index.checked_sub(self.first)?).ok()?;
        self.layers.get(offset).copied()
    }

    /// Drops the first stored layer, which has been laid.
    pub fn drop_first(&mut self) {
        if self.layers.pop_front().is_some() {
            self.first += 1;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn layers_keep_their_index_while_earlier_ones_are_dropped() {
        let mut store = LayerStore::new();
        for i in 0..10 {
            assert!(store.push([i; 12]));
        }
        store.drop_first();
        store.drop_first();
        assert_eq!(store.get(1), None);
        assert_eq!(store.get(2), Some([2; 12]));
        assert_eq!(store.get(9), Some([9; 12]));
        assert_eq!(store.get(10), None);
        assert_eq!(store.next_index(), 10);
    }

    #[test]
    fn a_full_store_rejects_more_layers() {
        let mut store = LayerStore::new();
        for _ in 0..CAPACITY {
            assert!(store.push([0; 12]));
        }
        assert_eq!(store.room(), 0);
        assert!(!store.push([0; 12]));
        store.drop_first();
        assert!(store.push([0; 12]));
    }
}
