//! Tests of the public interface of growbot-core.

mod constructed_csc_paths;
mod constructed_helicoids;
mod corruption;
mod descriptions;
mod protocol_examples;
mod to_position;
