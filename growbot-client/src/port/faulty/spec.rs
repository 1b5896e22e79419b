//! Text form of the simulated faults of a connection: `drop=1%,flip=1e-4,stall=2s@0.1%,seed=7`.

use std::str::FromStr;
use std::time::Duration;

use growbot_plan::pose_text::parse_number;
use growbot_plan::suggest::did_you_mean;

/// Step in which the remaining time of a stall or a cut is counted down, and minimum duration of a stall.
pub(super) const STEP: Duration = Duration::from_millis(10);
/// Probability of a fault that is given without a value.
const CHANCE: f64 = 0.01;
/// Maximum duration of a stall, s.
const LONGEST_STALL_S: f64 = 3600.0;

const NAMES: [&str; 8] = ["drop", "flip", "dup", "reorder", "truncate", "stall", "reset", "seed"];

/// Error of parsing a fault specification.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum FaultSpecError {
    /// The name of a fault is unknown.
    #[error(
        "unknown fault {name:?}{}: give one or more of {}, separated by commas",
        did_you_mean(.name, NAMES), NAMES.join(", ")
    )]
    Unknown {
        /// Name that the text contains.
        name: String,
    },
    /// A fault is given twice.
    #[error("{name} is given twice: remove one")]
    Twice {
        /// Name of the fault.
        name: &'static str,
    },
    /// A fault is given without the value that it needs.
    #[error("{name} has no value: write the fault like {example}")]
    NoValue {
        /// Name of the fault.
        name: &'static str,
        /// Example of a value.
        example: &'static str,
    },
    /// The value of a fault is not a probability between 0 and 1.
    #[error("{name} is {text:?}, which is not a probability: give 0% to 100%, or 0 to 1")]
    Chance {
        /// Name of the fault.
        name: &'static str,
        /// Value that the text contains.
        text: String,
    },
    /// The value of `stall` is not a valid duration.
    #[error(
        "stall is {text:?}, which is not a time: give 0.01s to {LONGEST_STALL_S}s, for example 2s, or 500ms@0.1% for \
         500 ms at 0.1 % of the frames"
    )]
    Time {
        /// Value that the text contains.
        text: String,
    },
    /// The value of `seed` is not a valid seed.
    #[error("seed is {text:?}, which is not a seed: give a whole number from 0 to {}", u64::MAX)]
    Seed {
        /// Value that the text contains.
        text: String,
    },
}

/// Probabilities of simulated faults of a connection, from 0 to 1, for each frame (`flip`: for each byte).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FaultSpec {
    /// Probability that a frame is lost.
    pub drop: f64,
    /// Probability that one bit of a byte is inverted.
    pub flip: f64,
    /// Probability that a frame arrives twice.
    pub dup: f64,
    /// Probability that a frame arrives after the next frame.
    pub reorder: f64,
    /// Probability that a frame loses its last bytes, including the zero byte at its end.
    pub truncate: f64,
    /// Probability that a frame starts a stall, in which no bytes arrive in either direction for
    /// [`FaultSpec::stall_for`].
    pub stall: f64,
    /// Duration of a stall.
    pub stall_for: Duration,
    /// Probability that a frame starts a cut, in which all bytes are lost in both directions for a second.
    pub reset: f64,
    /// Seed of the random faults.
    pub seed: u64,
}

impl Default for FaultSpec {
    /// Creates the specification of a connection without faults.
    fn default() -> Self {
        Self {
            drop: 0.0,
            flip: 0.0,
            dup: 0.0,
            reorder: 0.0,
            truncate: 0.0,
            stall: 0.0,
            stall_for: Duration::ZERO,
            reset: 0.0,
            seed: 1,
        }
    }
}

impl FromStr for FaultSpec {
    type Err = FaultSpecError;

    /// ```
    /// use growbot_client::port::faulty::FaultSpec;
    /// let spec: FaultSpec = "drop=1%, flip=1e-4, stall=2s@0.1%, seed=7".parse().unwrap();
    /// assert_eq!((spec.drop, spec.flip, spec.stall, spec.seed), (0.01, 1e-4, 0.001, 7));
    /// assert!("drop=200%".parse::<FaultSpec>().is_err());
    /// ```
    fn from_str(text: &str) -> Result<Self, FaultSpecError> {
        let mut spec = Self::default();
        let mut named = Vec::new();
        for part in text.split(',').map(str::trim) {
            let (word, value) = match part.split_once('=') {
                Some((word, value)) => (word.trim(), Some(value.trim())),
                None => (part, None),
            };
            let name = NAMES
                .into_iter()
                .find(|name| *name == word)
                .ok_or_else(|| FaultSpecError::Unknown { name: word.to_owned() })?;
            if named.contains(&name) {
                return Err(FaultSpecError::Twice { name });
            }
            named.push(name);
            match name {
                "drop" => spec.drop = needed_chance(name, value, "drop=1%")?,
                "flip" => spec.flip = needed_chance(name, value, "flip=1e-4")?,
                "dup" => spec.dup = needed_chance(name, value, "dup=1%")?,
                "reorder" => spec.reorder = chance_or_default(name, value)?,
                "truncate" => spec.truncate = chance_or_default(name, value)?,
                "reset" => spec.reset = chance_or_default(name, value)?,
                "stall" => {
                    let value = value.ok_or(FaultSpecError::NoValue { name, example: "stall=2s or stall=2s@0.1%" })?;
                    let (time, odds) = value.split_once('@').map_or((value, None), |(time, odds)| (time, Some(odds)));
                    spec.stall_for = stall_time(time)?;
                    spec.stall = chance_or_default(name, odds)?;
                }
                // `seed`, the only remaining name.
                _ => {
                    let text = value.ok_or(FaultSpecError::NoValue { name, example: "seed=7" })?;
                    spec.seed = text.parse().map_err(|_| FaultSpecError::Seed { text: text.to_owned() })?;
                }
            }
        }
        Ok(spec)
    }
}

fn needed_chance(name: &'static str, value: Option<&str>, example: &'static str) -> Result<f64, FaultSpecError> {
    chance(name, value.ok_or(FaultSpecError::NoValue { name, example })?)
}

fn chance_or_default(name: &'static str, value: Option<&str>) -> Result<f64, FaultSpecError> {
    value.map_or(Ok(CHANCE), |text| chance(name, text))
}

fn chance(name: &'static str, text: &str) -> Result<f64, FaultSpecError> {
    let number = match text.strip_suffix('%') {
        Some(percent) => parse_number(percent).map(|percent| percent / 100.0),
        None => parse_number(text),
    };
    number
        .filter(|number| (0.0..=1.0).contains(number))
        .ok_or_else(|| FaultSpecError::Chance { name, text: text.to_owned() })
}

fn stall_time(text: &str) -> Result<Duration, FaultSpecError> {
    let text = text.trim();
    let seconds = match text.strip_suffix("ms") {
        Some(milliseconds) => parse_number(milliseconds).map(|number| number / 1000.0),
        None => text.strip_suffix('s').and_then(parse_number),
    };
    seconds
        .filter(|seconds| (STEP.as_secs_f64()..=LONGEST_STALL_S).contains(seconds))
        .map(Duration::from_secs_f64)
        .ok_or_else(|| FaultSpecError::Time { text: text.to_owned() })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fault_specs_are_parsed() {
        let spec: FaultSpec =
            "drop=1%,flip=1e-4,dup=0.5,reorder,truncate=3 %,stall=1500ms,reset=0,seed=18446744073709551615"
                .parse()
                .unwrap();
        let expected = FaultSpec {
            drop: 0.01,
            flip: 1e-4,
            dup: 0.5,
            reorder: CHANCE,
            truncate: 0.03,
            stall: CHANCE,
            stall_for: Duration::from_millis(1500),
            reset: 0.0,
            seed: u64::MAX,
        };
        assert_eq!(spec, expected);
        assert_eq!("stall=2s@0.1%".parse::<FaultSpec>().unwrap().stall, 0.001);
        assert_eq!("reset".parse::<FaultSpec>().unwrap().reset, CHANCE);
    }

    #[test]
    fn invalid_fault_specs_are_refused_and_quoted() {
        for (text, parts) in [
            ("", ["unknown fault \"\"", "drop, flip"]),
            ("dorp=1%", ["\"dorp\"", "did you mean drop?"]),
            ("drop", ["drop has no value", "drop=1%"]),
            ("drop=", ["drop is \"\"", "100%"]),
            ("drop=1%,", ["unknown fault \"\"", "seed"]),
            ("drop=1%,drop=2%", ["drop is given twice", "remove"]),
            ("drop=101%", ["\"101%\"", "0% to 100%"]),
            ("flip=-1e-9", ["flip is \"-1e-9\"", "0 to 1"]),
            ("flip=nan", ["\"nan\"", "not a probability"]),
            ("reorder=often", ["reorder is \"often\"", "not a probability"]),
            ("stall", ["stall has no value", "2s@0.1%"]),
            ("stall=2", ["stall is \"2\"", "3600s"]),
            ("stall=1ms", ["\"1ms\"", "0.01s"]),
            ("stall=2h", ["\"2h\"", "500ms"]),
            ("stall=1e9s", ["\"1e9s\"", "3600s"]),
            ("stall=2s@2", ["stall is \"2\"", "not a probability"]),
            ("seed=-1", ["seed is \"-1\"", "whole number"]),
            ("seed", ["seed has no value", "seed=7"]),
        ] {
            let message = text.parse::<FaultSpec>().unwrap_err().to_string();
            assert!(parts.iter().all(|part| message.contains(part)), "{text:?}: {message}");
        }
    }
}
