//! A growth that is interrupted at any moment is resumed, and each layer is laid once.

use growbot_tests::recovery::crash::{Interruption, check, crash_at};
use growbot_tests::recovery::{Body, ReferenceGrowth, robot};

/// Interval between the moments of the growth that this test tries. `cargo recovery-campaign` tries all of them.
const EVERY: usize = 50;

#[test]
fn each_layer_is_laid_once_after_any_interruption_at_any_time() {
    let (robot, body) = (robot(), Body::of(300));
    let job = body.job(&robot);
    let undisturbed = ReferenceGrowth::grow(&job);
    assert!(undisturbed.events > 300);
    // The first and the last moments all differ. Between them the layers are alike.
    let last = undisturbed.events - 2;
    let moments = (1..6).chain((6..last - 4).step_by(EVERY)).chain(last - 4..=last);
    let mut tried = 0;
    for event in moments {
        for crash in Interruption::ALL {
            let recovered = crash_at(&job, &undisturbed, crash, event)
                .and_then(|recovered| check(&job, &undisturbed, crash, &recovered));
            if let Err(wrong) = recovered {
                panic!("{crash:?} at event {event}: {wrong}");
            }
            tried += 1;
        }
    }
    println!("{tried} interruptions of a growth of 300 layers, all resumed");
}
