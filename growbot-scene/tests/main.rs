//! Tests of the public interface of growbot-scene.

mod distances;
mod files;
mod planning;
