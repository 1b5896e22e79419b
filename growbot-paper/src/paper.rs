//! Data that Del Dottore et al. 2019 print: robots, results and quoted p-values. Lengths are in cm, as in the paper.

use growbot_core::plan::Planner;

/// Planner of the paper, which is used in the comparison.
pub(super) const PAPERS_PLANNER: Planner = Planner::TwoPlane;

/// A mean and its standard deviation, as the paper prints them.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MeanSd {
    /// Mean.
    pub mean: f64,
    /// Standard deviation.
    pub sd: f64,
}

const fn mean_sd((mean, sd): (f64, f64)) -> MeanSd {
    MeanSd { mean, sd }
}

/// A robot of Tables 1 and 3.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PaperRobot {
    /// Name in the paper, after "Robot".
    pub name: &'static str,
    /// Name of the built-in description.
    pub file: &'static str,
    /// Time for one step of growth, s.
    pub dt_s: f64,
    /// Growth velocity, cm/s.
    pub g_cm_per_s: f64,
    /// Radius of the arcs, cm.
    pub radius_cm: f64,
    /// Bending rate, rad/s, as printed.
    pub phi_rad_per_s: f64,
    /// Bend of one step, `g dt / R_c`, radians, as printed.
    pub k: f64,
    /// Table 2: mean and standard deviation of the position error over the path's length, in each of [`GROUPS`].
    /// `None` if Table 2 does not contain the robot.
    pub position_error: Option<[MeanSd; 4]>,
}

/// Groups: distances from start to goal, in radii.
pub const GROUPS: [u32; 4] = [4, 8, 16, 32];
/// Number of repetitions in each group.
pub const REPEAT: usize = 50;
/// Number of repetitions at each level of noise.
pub const REPEAT_NOISE: usize = 70;
/// Levels of noise: the largest deviation of a layer's growth, as a share of it.
pub const NOISE: [f64; 4] = [0.01, 0.02, 0.05, 0.1];

const fn robot(
    name: &'static str,
    file: &'static str,
    [dt_s, g_cm_per_s, radius_cm, phi_rad_per_s, k]: [f64; 5],
    position_error: Option<[(f64, f64); 4]>,
) -> PaperRobot {
    let position_error = match position_error {
        Some([a, b, c, d]) => Some([mean_sd(a), mean_sd(b), mean_sd(c), mean_sd(d)]),
        None => None,
    };
    PaperRobot { name, file, dt_s, g_cm_per_s, radius_cm, phi_rad_per_s, k, position_error }
}

/// Robots of Tables 1 and 3, with the results of Table 2.
#[rustfmt::skip]
pub const ROBOTS: [PaperRobot; 11] = [
    robot("A", "growbot-a", [18.0, 0.0043, 10.0, 0.0004, 0.0077],
        Some([(0.0084, 0.0069), (0.0119, 0.0052), (0.0160, 0.0079), (0.0198, 0.0105)])),
    robot("A1", "growbot-a1", [1.8, 0.0430, 10.0, 0.0043, 0.0077],
        Some([(0.0086, 0.0045), (0.0135, 0.0065), (0.0150, 0.0087), (0.0179, 0.0106)])),
    robot("A2", "growbot-a2", [0.18, 0.4300, 10.0, 0.0430, 0.0077],
        Some([(0.0089, 0.0063), (0.0126, 0.0064), (0.0129, 0.0058), (0.0164, 0.0110)])),
    robot("A3", "growbot-a3", [18.0, 0.0043, 30.0, 0.0001, 0.0026],
        Some([(0.0031, 0.0019), (0.0025, 0.0010), (0.0038, 0.0022), (0.0059, 0.0028)])),
    robot("A4", "growbot-a4", [1.8, 0.0430, 30.0, 0.0014, 0.0026],
        Some([(0.0026, 0.0013), (0.0031, 0.0028), (0.0042, 0.0026), (0.0059, 0.0039)])),
    robot("A5", "growbot-a5", [0.18, 0.4300, 30.0, 0.0143, 0.0026],
        Some([(0.0031, 0.0016), (0.0031, 0.0021), (0.0045, 0.0026), (0.0059, 0.0040)])),
    robot("A6", "growbot-a6", [18.0, 0.0043, 3.33, 0.0013, 0.0232],
        Some([(0.0223, 0.0152), (0.0411, 0.0181), (0.0459, 0.0243), (0.0445, 0.0223)])),
    robot("A7", "growbot-a7", [1.8, 0.0430, 3.33, 0.0129, 0.0232],
        Some([(0.0250, 0.0156), (0.0557, 0.0427), (0.0472, 0.0397), (0.0440, 0.0332)])),
    robot("A8", "growbot-a8", [0.18, 0.4300, 3.33, 0.1290, 0.0232],
        Some([(0.0291, 0.0224), (0.0370, 0.0183), (0.0447, 0.0290), (0.0399, 0.0277)])),
    robot("B", "growbot-b", [522.0, 0.012, 68.0, 0.01, 0.0921], None),
    robot("C", "growbot-c", [0.0020, 1000.0, 3.8, 4.47, 0.5263], None),
];

/// Index of robot A in [`ROBOTS`].
pub const ROBOT_A: usize = 0;
/// Index of robot B in [`ROBOTS`].
pub const B: usize = 9;
/// Index of robot C in [`ROBOTS`].
pub const C: usize = 10;
/// Sets of robots with the same `k`, as indexes into [`ROBOTS`].
pub const CONSTANT_K: [[usize; 3]; 3] = [[0, 1, 2], [3, 4, 5], [6, 7, 8]];

/// Mean heading error of robot A over the groups, with its standard deviation, degrees.
pub const HEADING_ERROR_DEG: MeanSd = mean_sd((1.89, 0.28));
/// Mean pitch error of robot A over the groups, with its standard deviation, degrees.
pub const PITCH_ERROR_DEG: MeanSd = mean_sd((1.77, 0.09));
/// Position error of robot B over the path's length in the groups from 8 radii on, mean and standard deviation.
pub const LONG_PATHS_B: MeanSd = mean_sd((0.0043, 0.0023));
/// Position error of robot C over the path's length in the groups from 8 radii on, mean and standard deviation.
pub const LONG_PATHS_C: MeanSd = mean_sd((0.1655, 0.1089));

/// p-value that the paper quotes for a difference between the heading errors of robot A's groups.
pub const P_HEADING_A: f64 = 0.4327;
/// p-value that the paper quotes for a difference between the pitch errors of robot A's groups.
pub const P_PITCH_A: f64 = 0.6420;
/// p-value that the paper quotes for a difference between the heading errors of all simulations of Tables 1 and 3.
pub const P_HEADING_ALL: f64 = 0.5578;
/// p-value that the paper quotes for a difference between the pitch errors of all simulations of Tables 1 and 3.
pub const P_PITCH_ALL: f64 = 0.1490;
/// p-value that the paper quotes for a difference between the position errors of robot B's groups from 8 radii on.
pub const P_LONG_B: f64 = 0.7719;
/// p-value that the paper quotes for a difference between the position errors of robot C's groups from 8 radii on.
pub const P_LONG_C: f64 = 0.9160;
