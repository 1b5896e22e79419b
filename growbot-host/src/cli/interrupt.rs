//! Ctrl-C, and being told to end: the robot is stopped first.

use std::sync::Arc;

use growbot_host::growth::Orders;

/// What is ordered by Ctrl-C, by SIGTERM and when the terminal goes away: to stop. A second time ends the program, as people expect of
/// one that seems to hang.
pub fn stop_on_interrupt() -> Arc<Orders> {
    let orders = Arc::new(Orders::default());
    let given = Arc::clone(&orders);
    let installed = ctrlc::set_handler(move || {
        if given.interrupt() {
            std::process::exit(1);
        }
        growbot_host::tell!("growbot: stopping; press Ctrl-C again to leave without waiting for the robot");
    });
    if let Err(error) = installed {
        growbot_host::tell!("growbot: Ctrl-C will end this program without stopping the robot ({error})");
    }
    orders
}
