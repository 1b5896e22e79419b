//! The bounds of the stack.
//!
//! No memory lies below the stack (`memory/*.x`), so that an overflow faults before it destroys data.

unsafe extern "C" {
    /// Linker symbol at the lowest word of the stack.
    static _stack_end: u32;
    /// Linker symbol at the end of the stack, above its highest word.
    static _stack_start: u32;
}

/// Returns the address of the lowest word of the stack.
pub fn bottom() -> usize {
    &raw const _stack_end as usize
}

/// Returns the address of the end of the stack, above its highest word.
pub fn top() -> usize {
    &raw const _stack_start as usize
}
