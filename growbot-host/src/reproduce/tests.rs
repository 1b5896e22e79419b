//! The whole of it, by few repetitions.
