//! A body for exports: its layers, with the tip's frame before and after each of them.

use growbot_core::kinematics::advance;
use growbot_core::layer::Layer;
use growbot_core::layer_bytes::decode;
use growbot_core::pose::{Frame, Pose};
use growbot_core::robot::Robot;
use growbot_core::slicing::{SlicedLayer, Slicing, layers};
use growbot_plan::plan::Plan;
use growbot_plan::run_log::RecordedRun;

/// Source of a layer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LayerSource {
    /// The layer is as planned.
    Planned,
    /// The layer is as built, according to the report of the board.
    AsBuilt,
    /// The layer is as the plastic of the simulated tip lies.
    Simulated,
}

impl LayerSource {
    /// Returns the name of the source in exported files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Planned => "planned",
            Self::AsBuilt => "as-built",
            Self::Simulated => "laid-simulated",
        }
    }
}

/// A layer of a body.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BodyLayer {
    /// The layer.
    pub layer: Layer,
    /// Source of the layer.
    pub source: LayerSource,
    /// Pose of the tip in the base's frame after the layer, mm.
    pub base_from_tip: Frame,
}

/// A body: the wall of one robot, layer by layer.
#[derive(Debug, Clone, PartialEq)]
pub struct ExportedBody {
    /// The robot's name.
    pub robot: String,
    /// Pose of the tip in the base's frame before the first layer, mm.
    pub base_from_start: Frame,
    /// The layers, from the first on.
    pub layers: Vec<BodyLayer>,
    /// Mean radius of the wall, mm.
    pub wall_radius: f64,
    /// Thickness of the wall, mm.
    pub wall_thickness: f64,
    /// Volume of filament per mm of body, mm^3.
    pub filament_per_length: f64,
}

impl ExportedBody {
    /// Returns the body of a plan, by exact slicing.
    pub fn planned(robot: &Robot, plan: &Plan) -> Self {
        let planned =
            layers(&plan.path, robot, Slicing::Exact).map(|SlicedLayer { layer, .. }| (layer, LayerSource::Planned));
        Self::new(robot, &plan.start, planned)
    }

    /// Returns the body that the board's steps have built, according to a run log, up to the last layer laid. A layer
    /// without a report is as it was sent to the board.
    pub fn as_built(robot: &Robot, start: &Pose, record: &RecordedRun) -> Self {
        let laid = record.commanded().zip(&record.as_built).map(|(layer, as_built)| {
            (decode(&layer), if as_built.is_some() { LayerSource::AsBuilt } else { LayerSource::Planned })
        });
        Self::new(robot, start, laid)
    }

    /// Returns the body as the plastic of a simulated tip lies, including the unfinished layer. `None` for a real
    /// robot.
    pub fn simulated(robot: &Robot, start: &Pose, record: &RecordedRun) -> Option<Self> {
        let laid = record.simulated()?.into_iter().enumerate();
        let source =
            |index| if record.has_simulated_layer(index) { LayerSource::Simulated } else { LayerSource::AsBuilt };
        Some(Self::new(robot, start, laid.map(|(index, layer)| (layer, source(index)))))
    }

    /// Returns a body of these layers, laid in a simulation.
    pub fn laid(robot: &Robot, start: &Pose, layers: &[Layer]) -> Self {
        Self::new(robot, start, layers.iter().map(|layer| (*layer, LayerSource::Simulated)))
    }

    fn new(robot: &Robot, start: &Pose, layers: impl Iterator<Item = (Layer, LayerSource)>) -> Self {
        let base_from_start = start.frame();
        let mut base_from_tip = base_from_start;
        let layers = layers.map(|(layer, source)| {
            base_from_tip = advance(&base_from_tip, &layer.step());
            BodyLayer { layer, source, base_from_tip }
        });
        Self {
            robot: robot.name().to_string(),
            base_from_start,
            layers: layers.collect(),
            wall_radius: robot.tip_radius(),
            wall_thickness: robot.description().wall.width_mm,
            filament_per_length: robot.filament_area() * robot.filament_per_length(),
        }
    }

    /// Returns true if the tips of both bodies were ever farther apart than `max` (mm) after the same number of layers.
    pub fn parts_from(&self, other: &Self, max: f64) -> bool {
        let places =
            |body: &Self| body.layers.iter().map(|layer| layer.base_from_tip.translation.vector).collect::<Vec<_>>();
        places(self).iter().zip(places(other)).any(|(one, other)| (one - other).norm() > max)
    }

    /// Returns the length of the centreline, mm.
    pub fn length(&self) -> f64 {
        self.layers.iter().map(|layer| layer.layer.height).sum()
    }

    /// Returns the volume of the filament that the body took, mm^3.
    pub fn filament_volume(&self) -> f64 {
        self.length() * self.filament_per_length
    }

    /// Returns the poses of the tip in the base's frame, before the first layer and after each layer.
    pub fn tips(&self) -> impl Iterator<Item = Frame> {
        std::iter::once(self.base_from_start).chain(self.layers.iter().map(|layer| layer.base_from_tip))
    }

    /// Returns each layer with the pose of the tip in the base's frame before the layer.
    pub fn layers_with_base(&self) -> impl Iterator<Item = (Frame, &BodyLayer)> {
        self.tips().zip(&self.layers)
    }
}

#[cfg(test)]
impl ExportedBody {
    /// Returns a body of these layers that starts straight up from the origin.
    pub(super) fn of_layers(robot: &Robot, layers: impl IntoIterator<Item = (Layer, LayerSource)>) -> Self {
        let up = growbot_plan::pose_text::parse_pose("0,0,0,0,90").unwrap();
        Self::new(robot, &up, layers.into_iter())
    }
}
