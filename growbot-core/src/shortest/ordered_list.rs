//! Lists that stay in order while items are inserted.

use core::mem;

use heapless::Vec;

/// Inserts an item into an ordered list, after all items for which `goes_before` returns true. If the list is full, the
/// last item is dropped.
pub(super) fn insert_behind<T, const N: usize>(list: &mut Vec<T, N>, item: T, goes_before: impl Fn(&T) -> bool) {
    if list.is_full() {
        if list.last().is_none_or(&goes_before) {
            return;
        }
        list.pop();
    }
    // The list has space now.
    let _ = list.push(item);
    move_last_behind(list, goes_before);
}

/// Moves the last item of a list forward, to the position after all other items for which `goes_before` returns true.
/// The other items must already be in order.
fn move_last_behind<T>(list: &mut [T], goes_before: impl Fn(&T) -> bool) {
    let mut left = list;
    while let Some((last, others)) = left.split_last_mut() {
        match others.last_mut() {
            Some(other) if !goes_before(other) => mem::swap(other, last),
            _ => break,
        }
        left = others;
    }
}
