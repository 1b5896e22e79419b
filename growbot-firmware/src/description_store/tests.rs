//! Tests of the store of robot descriptions, with losses of power at every byte of a write.

use growbot_core::robot::Robot;

use super::{DescriptionStore, HEADER_BYTES, LONGEST, StoreError, StoredDescription};
use crate::testing::flash::Flash;
use crate::testing::{fast_robot, robot_a};

/// Length of a sector that is just long enough for a description, bytes.
const SECTOR: usize = 1024;
type Small = Flash<SECTOR>;

fn stored(flash: &Small) -> Option<Robot> {
    DescriptionStore::open(flash.clone()).newest().robot()
}

fn named(name: &str) -> Robot {
    let mut description = robot_a().description().clone();
    description.name = name.try_into().unwrap();
    Robot::new(description).unwrap()
}

#[test]
fn the_newest_description_is_loaded() {
    let flash = Small::new(2);
    assert_eq!(stored(&flash), None);
    let mut descriptions = DescriptionStore::open(flash.clone());
    for name in ["a", "b", "c", "d", "e"] {
        descriptions.store(&named(name)).unwrap();
        assert_eq!(descriptions.newest().robot(), Some(named(name)));
        assert_eq!(stored(&flash), Some(named(name)), "after a reset");
    }
    assert_eq!(flash.erasures(), [3, 2], "each slot by turns");
}

/// Checks that a description with another encoding, as after an update of the firmware, is not mistaken for no
/// description. It must not be replaced without a request.
#[test]
fn an_unreadable_description_is_distinguished_from_none() {
    let flash = Small::new(2);
    assert_eq!(DescriptionStore::open(flash.clone()).newest(), StoredDescription::Empty);
    let mut descriptions = DescriptionStore::open(flash.clone());
    descriptions.store(&robot_a()).unwrap();
    let newest = descriptions.newest.unwrap();
    // The same bytes with another version, and with a header that matches them.
    let (header, mut bytes) = descriptions.read(newest.slot).unwrap();
    bytes[0] ^= 0x40;
    descriptions.write(newest, &bytes).unwrap();
    assert_eq!(descriptions.read(newest.slot), Some((header, bytes)));
    assert_eq!(DescriptionStore::open(flash).newest(), StoredDescription::Undecodable);
}

#[test]
fn blank_flash_holds_no_description() {
    for byte in [0x00, 0xff, 0x47] {
        let flash = Small::new(2);
        flash.set_bytes(&[byte; 2 * SECTOR]);
        assert_eq!(stored(&flash), None, "{byte:#x}");
        DescriptionStore::open(flash.clone()).store(&robot_a()).unwrap();
        assert_eq!(stored(&flash), Some(robot_a()), "{byte:#x}");
    }
}

#[test]
fn a_flipped_bit_is_detected() {
    let flash = Small::new(2);
    let (old, new) = (robot_a(), fast_robot());
    DescriptionStore::open(flash.clone()).store(&old).unwrap();
    DescriptionStore::open(flash.clone()).store(&new).unwrap();
    let whole = flash.bytes();
    let length = new.encode_for_board(&mut [0; LONGEST]).unwrap().len();
    for bit in 0..8 * (HEADER_BYTES + length) {
        let mut bytes = whole.clone();
        bytes[SECTOR + bit / 8] ^= 1 << (bit % 8);
        flash.set_bytes(&bytes);
        assert_eq!(stored(&flash), Some(old.clone()), "bit {bit}");
    }
}

#[test]
fn a_power_loss_at_any_byte_leaves_the_old_or_the_new_description() {
    let (old, new) = (robot_a(), fast_robot());
    let (mut olds, mut news) = (0, 0);
    for before in [None, Some(old)] {
        let mut cut = 0;
        loop {
            cut += 1;
            let flash = Small::new(2);
            if let Some(old) = &before {
                // Both slots are written to, so the next write has to erase one.
                DescriptionStore::open(flash.clone()).store(&named("older")).unwrap();
                DescriptionStore::open(flash.clone()).store(old).unwrap();
            }
            let mut descriptions = DescriptionStore::open(flash.clone());
            flash.lose_power_after(cut, cut as u64);
            let written = descriptions.store(&new);
            if !flash.has_lost_power() {
                assert_eq!(written, Ok(()));
                break;
            }
            flash.power_up();
            match stored(&flash) {
                Some(robot) if robot == new => news += 1,
                found => {
                    assert_eq!(found, before, "cut at byte {cut}");
                    assert_eq!(written, Err(StoreError));
                    olds += 1;
                }
            }
            // The board can be configured again, and the remains of the cut write do not undo it.
            DescriptionStore::open(flash.clone()).store(&new).unwrap();
            assert_eq!(stored(&flash), Some(new.clone()), "cut at byte {cut}, and written again");
        }
        assert!(cut > SECTOR + LONGEST, "{cut} cuts");
    }
    assert!(olds > 2 * SECTOR && news > 0, "{olds} old, {news} new");
}

/// Checks that cells that were being programmed at a loss of power, and may read differently at each start, never read
/// as another description.
#[test]
fn weak_cells_read_as_the_old_or_the_new_description() {
    let (old, new) = (robot_a(), fast_robot());
    for at in 0..HEADER_BYTES + LONGEST {
        let flash = Small::new(2);
        DescriptionStore::open(flash.clone()).store(&old).unwrap();
        DescriptionStore::open(flash.clone()).store(&new).unwrap();
        flash.weaken(SECTOR + at, &[0xff; 4]);
        for reading in [[0x00; 4], [0xff; 4], [0x5a; 4], [0x01, 0x80, 0xfe, 0x7f]] {
            flash.read_weak_as(&reading);
            let found = stored(&flash).unwrap();
            assert!(found == old || found == new, "weak from byte {at} on");
        }
    }
}

#[test]
fn a_flash_write_error_keeps_the_old_description() {
    let flash = Small::new(2);
    DescriptionStore::open(flash.clone()).store(&robot_a()).unwrap();
    let mut descriptions = DescriptionStore::open(flash.clone());
    flash.lose_power_after(1, 1);
    assert_eq!(descriptions.store(&fast_robot()), Err(StoreError));
    flash.power_up();
    assert_eq!(descriptions.newest().robot(), Some(robot_a()));
    assert_eq!(descriptions.store(&fast_robot()), Ok(()));
    assert_eq!(descriptions.newest().robot(), Some(fast_robot()));
}
