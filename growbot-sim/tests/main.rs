//! Tests of the public interface of growbot-sim.

mod clock;
mod commands;
mod configuring;
mod growing_in_scenes;
mod requests;
