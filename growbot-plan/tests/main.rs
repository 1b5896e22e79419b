//! Tests of the public interface of growbot-plan.

mod laid_centrelines;
