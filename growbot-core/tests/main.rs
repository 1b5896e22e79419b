//! Tests of the public interface of growbot-core.

mod corruption;
mod descriptions;
mod laid_helicoids;
mod laid_paths;
mod protocol_examples;
mod to_point;
