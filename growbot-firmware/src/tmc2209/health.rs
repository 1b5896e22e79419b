//! The health of a stepper driver, determined from its registers.

use growbot_core::link::message::DriverProblem;
use tmc2209::reg::{DRV_STATUS, GSTAT, SG_RESULT, TSTEP};

use super::settings::STALL_MAX_STEP_TIME;

/// Number of consecutive samples of a moving motor with the open-load flag after which an open wire is reported. The
/// samples take some 0.3 s, because the flag is also set as a motor starts (data sheet of the TMC2209, rev. 1.09,
/// 10.3).
const OPEN_LOOKS: u8 = 10;
/// Number of consecutive samples below the stall threshold after which a stall is reported. The samples take some 0.1
/// s, because a measurement covers one full step and is noisy.
const STALL_LOOKS: u8 = 3;

/// Registers of a stepper driver, read in one sample.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct HealthSample {
    /// Register GSTAT: reset, shut-down and charge pump.
    pub global: GSTAT,
    /// Register DRV_STATUS: shorts, open loads, temperature and standstill.
    pub status: DRV_STATUS,
    /// Register TSTEP: time between two 256ths of a step.
    pub step_time: TSTEP,
    /// Register SG_RESULT: load of the motor by StallGuard4.
    pub load: SG_RESULT,
}

/// Counters of the consecutive samples that show an open load, and a stall.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct HealthMonitor {
    open: u8,
    stalled: u8,
}

fn count(counter: &mut u8, is_so: bool) -> u8 {
    *counter = if is_so { counter.saturating_add(1) } else { 0 };
    *counter
}

impl HealthMonitor {
    /// Evaluates a sample of the driver's registers. Returns the problem that the samples show, or `None`. A stall is
    /// checked only if `threshold` is given.
    pub(super) fn look(&mut self, look: &HealthSample, threshold: Option<u8>) -> Option<DriverProblem> {
        let status = look.status;
        let moves = !status.stst();
        let open = count(&mut self.open, moves && (status.ola() || status.olb())) >= OPEN_LOOKS;
        let measures = moves && status.stealth() && look.step_time.get() <= STALL_MAX_STEP_TIME;
        let stalled = threshold.is_some_and(|threshold| measures && look.load.get() <= 2 * u16::from(threshold));
        let stalled = count(&mut self.stalled, stalled) >= STALL_LOOKS;
        let found = [
            (status.s2ga() || status.s2gb(), DriverProblem::ShortToGround),
            (status.s2vsa() || status.s2vsb(), DriverProblem::ShortToSupply),
            (status.ot(), DriverProblem::OverTemperature),
            (status.otpw(), DriverProblem::Hot),
            (look.global.uv_cp(), DriverProblem::Undervoltage),
            (look.global.drv_err(), DriverProblem::ShutDown),
            (stalled, DriverProblem::Stall),
            (open, DriverProblem::OpenLoad),
        ];
        found.iter().find(|(is_so, _)| *is_so).map(|(_, problem)| *problem)
    }
}
