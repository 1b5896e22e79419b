//! Ctrl-C, and being told to end: the robot is stopped first.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Set by Ctrl-C, by SIGTERM and when the terminal goes away. A second time ends the program, as people expect of one that seems
/// to hang.
pub fn stop_on_interrupt() -> Arc<AtomicBool> {
    let stop = Arc::new(AtomicBool::new(false));
    let seen = Arc::clone(&stop);
    let installed = ctrlc::set_handler(move || {
        if seen.swap(true, Ordering::Relaxed) {
            std::process::exit(1);
        }
        growbot_host::tell!("growbot: stopping; press Ctrl-C again to leave without waiting for the robot");
    });
    if let Err(error) = installed {
        growbot_host::tell!("growbot: Ctrl-C will end this program without stopping the robot ({error})");
    }
    stop
}
