//! Checks of the board's measurements while nothing heats or moves.

use growbot_client::commissioning_report::{Finding, StepOutcome};
use growbot_core::link::message::{SensorReadings, State, celsius};
use growbot_sim::tip::manual_action::ManualAction;

use super::session::{DoctorSession, WATCH};
use crate::cli::failure::Failure;

/// Range of a room's temperature, C.
const ROOM_C: [f64; 2] = [5.0, 45.0];
/// Range of the acceleration that an accelerometer at rest measures, as a multiple of the earth's gravity.
const GRAVITY: [f64; 2] = [0.85, 1.15];
/// Minimum angle by which the measured direction of gravity must change when the user tilts the tip, degrees.
const TILT_DEG: f64 = 20.0;

/// Checks that a nozzle that was not heated has the temperature of the room.
pub fn temperature(session: &mut DoctorSession) -> Result<Finding, Failure> {
    let Some(centi_c) = session.sample()?.status.temperature_centi_c else {
        return Ok(Finding::failed("no reading", "check the thermistor's wires"));
    };
    let [min, max] = ROOM_C;
    let temperature_c = celsius(centi_c);
    let found = format!("the nozzle is at {temperature_c:.1} C; a room has {min} to {max} C");
    if (min..=max).contains(&temperature_c) {
        return Ok(Finding::passed(found));
    }
    Ok(Finding::failed(
        found,
        "if the nozzle was heated, let it cool; otherwise compare [thermistor] in the robot file with the part and its \
         pull-up",
    ))
}

/// Checks that the supply is within the robot's limits.
pub fn supply(session: &mut DoctorSession) -> Result<Finding, Failure> {
    let description = session.robot.description();
    let (min, max) = (description.supply.min_v, description.supply.max_v);
    if !description.sensors.supply {
        return Ok(Finding::absent("sensors.supply"));
    }
    let Some(mv) = session.sample()?.sensors.supply_mv else {
        return Ok(Finding::failed("no reading", "check the voltage divider that measures the supply"));
    };
    let volts = f64::from(mv) / 1000.0;
    let found = format!("the supply has {volts:.1} V; supply.min_v to supply.max_v is {min} to {max} V");
    Ok(if (min..=max).contains(&volts) {
        Finding::passed(found)
    } else {
        Finding::failed(
            found,
            "measure the supply with a voltmeter: if the voltage is right, check the voltage divider and \
             supply.full_scale_v",
        )
    })
}

/// True for each level, low and high, that an input has shown while it was watched.
struct BothLevels([bool; 2]);

impl BothLevels {
    fn add(&mut self, level: bool) -> bool {
        if let Some(seen) = self.0.get_mut(usize::from(level)) {
            *seen = true;
        }
        self.0 == [true; 2]
    }
}

/// Checks that the index sensor detects its mark at one place of a turn, and not at another.
pub fn index(session: &mut DoctorSession) -> Result<Finding, Failure> {
    if !session.confirm(
        "Confirm first, then turn the head slowly by hand, by more than a turn, until the board has detected the \
         index mark.",
    )? {
        return Ok(Finding::skipped());
    }
    let mut levels = BothLevels([false; 2]);
    let seen = session.wait_until(WATCH, Some(ManualAction::TurnHead(1)), |seen| levels.add(seen.sensors.on_index))?;
    if seen.is_some() {
        return Ok(Finding::passed(
            "the index sensor reports the mark at one angle of the head, and no mark at another",
        ));
    }
    let only = if levels.0[1] { "on" } else { "off" };
    Ok(Finding::failed(
        format!("the index sensor reported the head only {only} its mark in {} s", WATCH.as_secs()),
        "check the sensor's supply, its wire and its distance, and head.index_low_on_mark",
    ))
}

/// A switch at an input of the board. The user is guided to put it into both positions.
struct SwitchInput {
    close: (&'static str, ManualAction),
    open: (&'static str, ManualAction),
    level: fn(&SensorReadings) -> Option<bool>,
    /// Names of the switch's positions: after the action `close`, and after `open`.
    names: [&'static str; 2],
    remedy: &'static str,
}

impl SwitchInput {
    fn run(&self, session: &mut DoctorSession) -> Result<Finding, Failure> {
        for (wanted, (question, hand)) in [(true, self.close), (false, self.open)] {
            if !session.confirm(question)? {
                return Ok(Finding::skipped());
            }
            session.act(hand);
            let level = self.level;
            if session.wait_until(WATCH / 6, None, |seen| level(&seen.sensors) == Some(wanted))?.is_none() {
                let [closed, open] = self.names;
                let (found, missing) = if wanted { (open, closed) } else { (closed, open) };
                return Ok(Finding::failed(
                    format!("the switch reports \"{found}\" instead of \"{missing}\""),
                    self.remedy,
                ));
            }
        }
        Ok(Finding::passed(self.names.join(" and ")))
    }
}

/// Checks the filament switch.
pub fn filament(session: &mut DoctorSession) -> Result<Finding, Failure> {
    if session.robot.description().sensors.filament_presence.is_none() {
        return Ok(Finding::absent("sensors.filament_presence"));
    }
    let switch = SwitchInput {
        close: ("Put filament into the filament switch.", ManualAction::TakeFilament(false)),
        open: ("Take the filament out of the filament switch.", ManualAction::TakeFilament(true)),
        level: |sensors| sensors.filament_present,
        names: ["filament", "no filament"],
        remedy: "check the switch and its wire, and sensors.filament_presence.active_low",
    };
    let found = switch.run(session)?;
    session.act(ManualAction::TakeFilament(false));
    Ok(found)
}

/// Checks the emergency-stop button. A pressed button must put the board into the state of an emergency stop, and
/// after the release the stop must be clearable.
pub fn emergency_stop(session: &mut DoctorSession) -> Result<Finding, Failure> {
    if session.robot.description().sensors.emergency_stop.is_none() {
        return Ok(Finding::absent("sensors.emergency_stop"));
    }
    let switch = SwitchInput {
        close: ("Press the emergency stop, and leave it pressed.", ManualAction::PressEmergencyStop(true)),
        open: ("Release the emergency stop.", ManualAction::PressEmergencyStop(false)),
        level: |sensors| sensors.emergency_stop,
        names: ["pressed", "released"],
        remedy: "check the button and its wires, and sensors.emergency_stop.active_low",
    };
    let found = switch.run(session)?;
    session.act(ManualAction::PressEmergencyStop(false));
    if found.outcome != StepOutcome::Passed {
        return Ok(found);
    }
    let state = session.sample()?.status.state;
    if state != State::EmergencyStop {
        return Ok(Finding::failed(
            format!("the button was pressed, but the board is in state {}, not in state emergency-stop", state.name()),
            "the board's firmware is defective: flash a released image",
        ));
    }
    Ok(match session.clear()? {
        None => Finding::passed(
            "the button leads to state emergency-stop, and the emergency stop can be cleared after release",
        ),
        Some(why) => Finding::failed(format!("the emergency stop cannot be cleared: {why}"), "release the button"),
    })
}

/// Checks that the orientation sensor measures the earth's gravity, and follows the tip.
pub fn orientation(session: &mut DoctorSession) -> Result<Finding, Failure> {
    if !session.robot.description().sensors.orientation {
        return Ok(Finding::absent("sensors.orientation"));
    }
    let remedy = "check the orientation sensor: its wires SDA and SCL, its 3.3 V, and how it is fixed to the tip";
    let Some(first) = session.sample()?.sensors.gravity_milli_g.map(earths) else {
        return Ok(Finding::failed("no reading", remedy));
    };
    let [min, max] = GRAVITY;
    let length = length(first);
    if !(min..=max).contains(&length) {
        return Ok(Finding::failed(
            format!("the sensor measures a gravity of {length:.2} g at rest; right is {min} to {max} g"),
            remedy,
        ));
    }
    if !session.confirm("Tilt the tip by more than 20 degrees and hold it there.")? {
        return Ok(Finding::skipped());
    }
    session.act(ManualAction::LayDown(true));
    let mut most = 0.0_f64;
    let tilted = session.wait_until(WATCH / 6, None, |seen| {
        most = most.max(seen.sensors.gravity_milli_g.map_or(0.0, |gravity| angle_deg(first, earths(gravity))));
        most > TILT_DEG
    })?;
    session.act(ManualAction::LayDown(false));
    Ok(match tilted {
        Some(_) => {
            Finding::passed(format!("the sensor measures a gravity of {length:.2} g and a tilt of {most:.0} degrees"))
        }
        None => Finding::failed(
            format!("the sensor measured a tilt of {most:.0} degrees; more than {TILT_DEG} was expected"),
            remedy,
        ),
    })
}

fn earths(milli: [i16; 3]) -> [f64; 3] {
    milli.map(|milli| f64::from(milli) / 1000.0)
}

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

fn length(a: [f64; 3]) -> f64 {
    libm::sqrt(dot(a, a))
}

/// Returns the angle between two directions, degrees.
fn angle_deg(a: [f64; 3], b: [f64; 3]) -> f64 {
    let cosine = dot(a, b) / (length(a) * length(b)).max(1e-9);
    libm::acos(cosine.clamp(-1.0, 1.0)).to_degrees()
}
