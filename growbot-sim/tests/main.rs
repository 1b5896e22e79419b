//! Tests of the public interface of growbot-sim.

mod clock;
mod commands;
mod configuring;
mod disturbed;
mod follower;
mod growing_in_scenes;
mod requests;
