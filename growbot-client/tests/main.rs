//! Tests of the public interface of growbot-client.

mod laid_centrelines;
