//! Tests of the supervision's limits for the dither in the reading.

use super::*;

/// Checks the dither in a simulated reading for some periods. The reading contains `share` of the dither, shifted by
/// `shift` of a period, and the power is saturated for `saturated_s` of each period. Returns the number of updates
/// without a fault, and the fault.
fn swing(
    supervision: &mut Supervision,
    share: f32,
    shift: f32,
    saturated_s: f32,
    periods: u32,
) -> (u32, Option<Fault>) {
    const AMPLITUDE_C: f32 = 0.5;
    let looks = (DITHER_PERIOD_S / DT) as u32;
    let mut look = 0;
    looks_without_fault(periods * looks, || {
        let phase = (look % looks) as f32 / looks as f32;
        let saturated = (look % looks) as f32 * DT < saturated_s;
        look += 1;
        let swings = share * AMPLITUDE_C * dither_at(phase + shift).0;
        let regulated =
            Some(ControlState { trim: 0.0, saturated, dither: Some(Dither { phase, amplitude_c: AMPLITUDE_C }) });
        supervision.check_dither(&SupervisionInput { regulated, ..at(TARGET_C + swings) })
    })
}

#[test]
fn a_dither_missing_twice_means_a_wrong_reading() {
    let frozen = Some(Fault::ThermistorFrozen);
    for shift in [0.0, 0.25, 0.625] {
        assert_eq!(swing(&mut Supervision::default(), 0.16, shift, 0.0, 10), (640, None), "{shift}");
        assert_eq!(swing(&mut Supervision::default(), 0.14, shift, 0.0, 10), (128, frozen), "{shift}");
    }
    assert_eq!(swing(&mut Supervision::default(), 0.0, 0.0, 0.0, 10), (128, frozen));
    // A period with the dither restarts the count, and so do a time without dither and a new target.
    let mut supervision = Supervision::default();
    let forget: [fn(&mut Supervision); 3] = [
        |supervision| assert_eq!(swing(supervision, 1.0, 0.0, 0.0, 1), (64, None)),
        |supervision| assert_eq!(supervision.check_dither(&at(TARGET_C)), None),
        Supervision::retarget,
    ];
    for forget in forget.iter().cycle().take(9) {
        assert_eq!(swing(&mut supervision, 0.0, 0.0, 0.0, 1), (64, None));
        forget(&mut supervision);
    }
}

#[test]
fn a_constant_reading_shows_no_dither_at_any_sample_period() {
    // The compared period ends within half an update of 16 s: after 15.9 and 15.95 s.
    for (seconds, looks) in [(0.3, 53), (0.11, 145)] {
        let mut supervision = Supervision::default();
        let mut look = 0;
        let found = looks_without_fault(10 * looks, || {
            let phase = look as f32 * seconds / DITHER_PERIOD_S;
            look += 1;
            let regulated = Some(ControlState {
                dither: Some(Dither { phase: phase - libm::floorf(phase), amplitude_c: 0.5 }),
                ..STEADY
            });
            supervision.check_dither(&SupervisionInput { seconds, regulated, ..at(TARGET_C) })
        });
        assert_eq!(found, (2 * looks, Some(Fault::ThermistorFrozen)));
    }
}

#[test]
fn power_saturated_for_three_periods_is_a_fault() {
    let energy = Some(Fault::HeaterEnergy);
    // 0.6 of 16 s are 9.6 s.
    assert_eq!(swing(&mut Supervision::default(), 1.0, 0.0, 9.5, 10), (640, None));
    assert_eq!(swing(&mut Supervision::default(), 1.0, 0.0, 9.75, 10), (192, energy));
    // If saturated power prevents the dither, a reading without it is not frozen.
    assert_eq!(swing(&mut Supervision::default(), 0.0, 0.0, 9.75, 10), (128, energy));
    // One period without saturation restarts the count.
    let mut supervision = Supervision::default();
    for _ in 0..5 {
        assert_eq!(swing(&mut supervision, 1.0, 0.0, 16.0, 2), (128, None));
        assert_eq!(swing(&mut supervision, 1.0, 0.0, 0.0, 1), (64, None));
    }
}
