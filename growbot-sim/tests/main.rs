//! Tests of the public interface of growbot-sim.

mod clock;
mod configuring;
mod growing_in_scenes;
mod orders;
mod requests;
