//! A nozzle in parts: a heater cartridge in a block in air, and a thermistor with a published table.
//!
//! `C_h dH/dt = P - G (H - B)` for the cartridge, `C_b dB/dt = G (H - B) - loss - c Q (B - A)` for the block, and the
//! thermistor follows the block as in [`super::nozzle`]. H and B are the temperatures of cartridge and block, A that of
//! the surroundings, P the heating power, G the conductance between cartridge and block, and Q the flow of filament
//! with the heat capacity c. The loss consists of natural convection and radiation (Stefan and Boltzmann). Natural
//! convection is proportional to the temperature difference to the power of 1.25 (laminar: McAdams, Heat Transmission,
//! 1954). A fan or a draught adds to the convection.
//!
//! The firmware's model is a single heat capacity, a loss in proportion to the temperature difference, and an equation
//! of the thermistor. This module uses none of these, so a result that holds for this nozzle does not depend on the
//! firmware's model. The equations are integrated by the Runge-Kutta method of fourth order, with steps of at most 0.05
//! s.

use super::nozzle_inputs::NozzleInputs;

/// Parameters of a nozzle whose heater cartridge, block and thermistor are simulated as separate parts.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CartridgeParameters {
    /// Fraction of the heat capacity that belongs to the cartridge, 0 to 1.
    pub capacity_share: f64,
    /// Thermal conductance from the cartridge to the block, W/K.
    pub coupling_w_per_k: f64,
    /// Fraction of the heat loss that is radiation, at the robot's target temperature in still air, 0 to 1.
    pub radiation_share: f64,
}

/// Room temperature to which the description's loss at the target refers, degrees Celsius.
const ROOM_C: f64 = 25.0;
/// Temperature of 0 degrees Celsius, K.
const ZERO_C: f64 = 273.15;
/// Maximum integration step, s: a sixth of the shortest time constant, that of a cartridge with a tenth of the nozzle's
/// heat capacity and a conductance of 4 W/K.
const STEP_S: f64 = 0.05;
/// Minimum lag of a thermistor that the integration with steps of [`STEP_S`] can follow, s.
const SHORTEST_LAG_S: f64 = 0.1;

/// Temperatures of cartridge, block and thermistor, degrees Celsius.
type Temperatures = [f64; 3];

/// A nozzle whose cartridge, block and thermistor are simulated as separate parts.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Cartridge {
    parts: CartridgeParameters,
    heat_capacity: f64,
    ambient_c: f64,
    /// Heat loss by radiation at the target temperature `target_c`, divided by the difference between target and room
    /// temperature, W/K.
    radiated_w_per_k: f64,
    target_c: f64,
    /// Temperature of the cartridge, degrees Celsius.
    celsius: f64,
}

/// Inputs of the cartridge, the block and the thermistor, which are constant during an integration step.
pub(super) struct Load<'a> {
    pub drive: &'a NozzleInputs,
    /// Heat flow that the filament removes for each degree of the block above the surroundings, W/K.
    pub flow_w_per_k: f64,
}

impl Cartridge {
    /// Creates a cartridge at the temperature of its surroundings. `loss_w_per_k` is the nozzle's heat loss in still
    /// air.
    pub fn new(
        parts: CartridgeParameters,
        heat_capacity: f64,
        loss_w_per_k: f64,
        target_c: f64,
        ambient_c: f64,
    ) -> Self {
        let radiated_w_per_k = parts.radiation_share * loss_w_per_k;
        Self { parts, heat_capacity, ambient_c, radiated_w_per_k, target_c, celsius: ambient_c }
    }

    /// Sets the temperature of the cartridge, degrees Celsius.
    pub fn set(&mut self, celsius: f64) {
        self.celsius = celsius;
    }

    /// Returns the heat that a block of this temperature loses to its surroundings, W.
    fn loss(&self, block_c: f64, drive: &NozzleInputs) -> f64 {
        let at_target = self.target_c - ROOM_C;
        let fourth = |celsius: f64| {
            let square = (celsius + ZERO_C) * (celsius + ZERO_C);
            square * square
        };
        let radiated = self.radiated_w_per_k * at_target * (fourth(block_c) - fourth(self.ambient_c))
            / (fourth(self.target_c) - fourth(ROOM_C));
        let warmth = block_c - self.ambient_c;
        let convected =
            (drive.loss_w_per_k - self.radiated_w_per_k) * warmth * libm::sqrt(libm::sqrt((warmth / at_target).abs()));
        radiated + convected
    }

    /// Returns the rate of change of each temperature, degrees per second.
    fn rates(&self, [cartridge, block, sensor]: Temperatures, load: &Load) -> Temperatures {
        let Load { drive, flow_w_per_k } = load;
        let CartridgeParameters { capacity_share, coupling_w_per_k, .. } = self.parts;
        let conducted = coupling_w_per_k * (cartridge - block);
        let taken = self.loss(block, drive) + flow_w_per_k * (block - self.ambient_c);
        let followed = self.ambient_c + drive.share * (block - self.ambient_c);
        [
            (drive.power_w - conducted) / (self.heat_capacity * capacity_share),
            (conducted - taken) / (self.heat_capacity * (1.0 - capacity_share)),
            (followed - sensor) / drive.lag_s.max(SHORTEST_LAG_S),
        ]
    }

    /// Advances the simulated time, during which the inputs are constant. Returns the temperatures of block and
    /// thermistor, and the block's maximum temperature in that time.
    pub fn pass(&mut self, seconds: f64, block_c: f64, sensor_c: f64, load: &Load) -> (f64, f64, f64) {
        let steps = libm::ceil(seconds / STEP_S).max(1.0);
        let step = seconds / steps;
        let mut state = [self.celsius, block_c, sensor_c];
        let mut peak = block_c;
        for _ in 0..steps as u64 {
            let at = |rates: Temperatures, time: f64| {
                [state[0] + time * rates[0], state[1] + time * rates[1], state[2] + time * rates[2]]
            };
            let first = self.rates(state, load);
            let second = self.rates(at(first, 0.5 * step), load);
            let third = self.rates(at(second, 0.5 * step), load);
            let fourth = self.rates(at(third, step), load);
            for (part, celsius) in state.iter_mut().enumerate() {
                *celsius += step / 6.0 * (first[part] + 2.0 * (second[part] + third[part]) + fourth[part]);
            }
            peak = peak.max(state[1]);
        }
        self.celsius = state[0];
        (state[1], state[2], peak)
    }
}

/// Resistances of the thermistor 104GT-2 of Semitec (100 kilo-ohm), kilo-ohm, from -50 degrees Celsius on in steps of
/// 10 degrees, as printed in the maker's leaflet "GT-2 glass thermistors".
const KILO_OHM: [f64; 36] = [
    8743.0, 4218.0, 2132.0, 1127.0, 620.0, 353.7, 208.6, 126.8, 79.36, 50.96, 33.49, 22.51, 15.44, 10.80, 7.686, 5.556,
    4.082, 3.043, 2.298, 1.758, 1.360, 1.064, 0.8414, 0.6714, 0.5408, 0.4393, 0.3597, 0.2969, 0.2468, 0.2065, 0.1740,
    0.1475, 0.1258, 0.1079, 0.09305, 0.08065,
];
const TABLE_FROM_C: f64 = -50.0;
const TABLE_STEP_C: f64 = 10.0;

/// Steinhart-Hart coefficients of the thermistor 104GT-2 of Semitec, for a robot's description. They are solved for the
/// resistances of the maker's table at 30, 150 and 250 degrees Celsius, and agree with the table within 0.1 degrees
/// from 0 to 260.
pub const STEINHART_HART_104GT_2: [f64; 3] = [8.109974e-4, 2.114126e-4, 7.144945e-8];

/// Returns the resistance of the thermistor 104GT-2 at a temperature, ohm. The logarithm of the resistance is
/// interpolated linearly between the values of the maker's table, and extrapolated linearly beyond them.
pub(super) fn resistance_104gt_2(celsius: f64) -> f64 {
    let place = (celsius - TABLE_FROM_C) / TABLE_STEP_C;
    let line = (libm::floor(place).max(0.0) as usize).min(KILO_OHM.len() - 2);
    let (low, high) = (libm::log(KILO_OHM[line]), libm::log(KILO_OHM[line + 1]));
    1000.0 * libm::exp(low + (high - low) * (place - line as f64))
}

#[cfg(test)]
mod tests {
    use super::*;

    const PARTS: CartridgeParameters =
        CartridgeParameters { capacity_share: 0.2, coupling_w_per_k: 2.0, radiation_share: 0.25 };

    fn drive(power_w: f64) -> NozzleInputs {
        NozzleInputs { power_w, loss_w_per_k: 0.12, lag_s: 2.0, share: 1.0 }
    }

    /// Returns the temperatures of cartridge, block and thermistor of a nozzle with a heat capacity of 12 J/K, which
    /// starts at 22 degrees and is heated with this power for this time, in `looks` calls.
    fn after(seconds: f64, power_w: f64, flow_w_per_k: f64, looks: u32) -> Temperatures {
        let mut cartridge = Cartridge::new(PARTS, 12.0, 0.12, 200.0, 22.0);
        let (mut block, mut sensor) = (22.0, 22.0);
        let load = Load { drive: &drive(power_w), flow_w_per_k };
        for _ in 0..looks {
            (block, sensor, _) = cartridge.pass(seconds / f64::from(looks), block, sensor, &load);
        }
        [cartridge.celsius, block, sensor]
    }

    #[test]
    fn heat_loss_matches_the_description_at_the_target_and_falls_below_it() {
        let still = drive(0.0);
        let cartridge = Cartridge::new(PARTS, 12.0, 0.12, 200.0, ROOM_C);
        assert!((cartridge.loss(200.0, &still) - 0.12 * 175.0).abs() < 1e-9);
        assert!(cartridge.loss(ROOM_C, &still).abs() < 1e-9);
        let half = cartridge.loss(ROOM_C + 87.5, &still);
        // 0.75 of it by 0.5^1.25, a quarter by the fourth powers.
        let fourth = |kelvin: f64| kelvin * kelvin * kelvin * kelvin;
        let radiated = (fourth(385.65) - fourth(298.15)) / (fourth(473.15) - fourth(298.15));
        assert!((half - 21.0 * (0.75 * libm::pow(0.5, 1.25) + 0.25 * radiated)).abs() < 1e-9, "{half}");
        let fan = NozzleInputs { loss_w_per_k: 0.14, ..still };
        assert!((cartridge.loss(200.0, &fan) - 0.14 * 175.0).abs() < 1e-9);
    }

    #[test]
    fn in_equilibrium_loss_equals_power_and_the_cartridge_is_hotter() {
        let [cartridge, block, sensor] = after(3000.0, 20.0, 0.0, 1);
        let loss = Cartridge::new(PARTS, 12.0, 0.12, 200.0, 22.0).loss(block, &drive(20.0));
        assert!((loss - 20.0).abs() < 1e-6 && (cartridge - block - 10.0).abs() < 1e-6 && (sensor - block).abs() < 1e-6);
    }

    #[test]
    fn energy_is_conserved() {
        // Without loss and flow, all heat stays in the nozzle.
        let mut cartridge = Cartridge::new(PARTS, 12.0, 0.0, 200.0, 22.0);
        let lossless = NozzleInputs { loss_w_per_k: 0.0, ..drive(50.0) };
        let (block, _, peak) = cartridge.pass(7.0, 22.0, 22.0, &Load { drive: &lossless, flow_w_per_k: 0.0 });
        let held = 2.4 * (cartridge.celsius - 22.0) + 9.6 * (block - 22.0);
        assert!((held - 350.0).abs() < 1e-9 && peak == block, "{held}");
        // The part of the filament in the steady state.
        let [_, block, _] = after(3000.0, 20.0, 0.03, 1);
        let loss = Cartridge::new(PARTS, 12.0, 0.12, 200.0, 22.0).loss(block, &drive(20.0));
        assert!((loss + 0.03 * (block - 22.0) - 20.0).abs() < 1e-6);
    }

    #[test]
    fn temperatures_do_not_depend_on_the_sampling() {
        let once = after(30.0, 45.0, 0.02, 1);
        for looks in [7, 300, 3001, 30_000] {
            let often = after(30.0, 45.0, 0.02, looks);
            assert!(once.iter().zip(often).all(|(one, other)| (one - other).abs() < 1e-4), "{once:?} {often:?}");
        }
    }

    #[test]
    fn the_block_lags_the_cartridge_and_overshoots_without_power() {
        let mut cartridge = Cartridge::new(PARTS, 12.0, 0.12, 200.0, 22.0);
        let on = Load { drive: &drive(50.0), flow_w_per_k: 0.0 };
        let (block, sensor, _) = cartridge.pass(10.0, 22.0, 22.0, &on);
        let off = Load { drive: &drive(0.0), flow_w_per_k: 0.0 };
        let (later, _, peak) = cartridge.pass(30.0, block, sensor, &off);
        assert!(cartridge.celsius < later + 1.0 && peak > block + 2.0 && peak > later, "{block} {later} {peak}");
    }

    #[test]
    fn the_table_is_interpolated_and_extrapolated() {
        for (line, kilo_ohm) in KILO_OHM.into_iter().enumerate() {
            let celsius = TABLE_FROM_C + TABLE_STEP_C * line as f64;
            assert!((resistance_104gt_2(celsius) / kilo_ohm / 1000.0 - 1.0).abs() < 1e-12, "{celsius}");
        }
        let middle = resistance_104gt_2(205.0);
        assert!((middle - libm::sqrt(439.3 * 359.7)).abs() < 1e-6, "{middle}");
        assert!((resistance_104gt_2(25.0) / 100_000.0 - 1.0).abs() < 0.01);
        assert!(resistance_104gt_2(400.0) < 80.0 && resistance_104gt_2(-80.0) > 8.743e6);
    }

    #[test]
    fn steinhart_hart_matches_the_table() {
        let [a, b, c] = STEINHART_HART_104GT_2;
        for celsius in (0..=260).step_by(10).map(f64::from) {
            let log = libm::log(resistance_104gt_2(celsius));
            let found = 1.0 / (a + b * log + c * log * log * log) - ZERO_C;
            assert!((found - celsius).abs() < 0.1, "{celsius} comes out as {found}");
        }
    }
}
