//! The engine with everything round it.
