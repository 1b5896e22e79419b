//! Tests of the journal with losses of power and damaged flash.

use proptest::prelude::*;

use super::*;

#[test]
fn a_power_loss_at_any_byte_loses_at_most_the_current_record() {
    let story = story();
    let mut losses = 0;
    for bytes in 0.. {
        let flash = Small::new(SECTORS);
        let mut first = Some((bytes, bytes as u64));
        let mut lost = 0;
        live(&flash, &story, || {
            lost += 1;
            first.take()
        });
        losses += lost - 1;
        if lost == 1 {
            break;
        }
    }
    std::println!("{losses} losses of power");
    assert!(losses > 7000);
}

#[test]
fn repeated_power_losses_lose_at_most_the_current_record() {
    let mut seed = 1_u64;
    for _ in 0..crate::testing::number_from_environment("GROWBOT_POWER_LOSSES", 300) {
        let flash = Small::new(SECTORS);
        live(&flash, &story(), || {
            seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            Some((150 + (seed >> 33) as usize % 2500, seed))
        });
    }
}

proptest! {
    #[test]
    fn random_flash_has_no_journal(bytes in prop::collection::vec(any::<u8>(), 2048)) {
        let flash = Small::new(SECTORS);
        flash.set_bytes(&bytes);
        prop_assert!(Journal::open(flash.clone()).job().is_none());
        prop_assert_eq!(flash.bytes(), bytes);
        live(&flash, &story(), || None);
    }

    #[test]
    fn flipped_bits_yield_an_earlier_state_or_nothing(
        deeds in 1_usize..90,
        bits in prop::collection::vec(0_usize..2048 * 8, 1..20),
    ) {
        let flash = Small::new(SECTORS);
        let mut journal = Journal::open(flash.clone());
        let mut history = std::vec![None];
        for deed in story().iter().take(deeds) {
            deed.done(&mut journal).unwrap();
            history.push(known(&mut journal));
        }
        let mut bytes = flash.bytes();
        for bit in bits {
            bytes[bit / 8] ^= 1 << (bit % 8);
        }
        flash.set_bytes(&bytes);
        prop_assert!(history.contains(&known(&mut Journal::open(flash))));
    }
}
