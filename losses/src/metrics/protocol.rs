//! The published ways to compare two meshes, each stating what it does.

use std::str::FromStr;

use serde::Serialize;

use super::mcmr::GRID;

/// A named, published protocol.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
#[non_exhaustive]
pub enum Preset {
    /// Pixel2Mesh, as the Mesh R-CNN code evaluates it.
    P2m,
    /// Mesh R-CNN on ShapeNet.
    MeshRcnn,
    /// Occupancy Networks.
    OccNet,
    /// Multi-category mesh reconstruction: 3D IoU.
    Mcmr,
}

/// A name that is none of the presets'.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("unknown preset \"{found}\": expected one of p2m, meshrcnn, occnet, mcmr")]
#[non_exhaustive]
pub struct UnknownPreset {
    /// What was given.
    pub found: String,
}

impl Preset {
    /// All of them.
    pub const ALL: [Self; 4] = [Self::P2m, Self::MeshRcnn, Self::OccNet, Self::Mcmr];

    /// The name that [`FromStr`] takes and the output carries.
    pub fn name(self) -> &'static str {
        match self {
            Self::P2m => "p2m",
            Self::MeshRcnn => "meshrcnn",
            Self::OccNet => "occnet",
            Self::Mcmr => "mcmr",
        }
    }

    /// What the preset does, with the given seed for its samples.
    pub fn protocol(self, seed: u64) -> Protocol {
        match self {
            Self::P2m => Protocol::p2m(seed),
            Self::MeshRcnn => Protocol::mesh_rcnn(seed),
            Self::OccNet => Protocol::occ_net(seed),
            Self::Mcmr => Protocol::mcmr(seed),
        }
    }
}

impl FromStr for Preset {
    type Err = UnknownPreset;

    fn from_str(name: &str) -> Result<Self, UnknownPreset> {
        let found = Self::ALL.into_iter().find(|p| p.name() == name);
        found.ok_or_else(|| UnknownPreset { found: name.into() })
    }
}

/// Which points stand for a mesh.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
#[non_exhaustive]
pub enum Points {
    /// Its vertices (what Pixel2Mesh compares; depends on the tessellation).
    Vertices,
    /// Points drawn uniformly by area, with replacement.
    Surface {
        /// How many.
        samples: usize,
    },
}

/// What is done to both meshes before they are compared; always the same to both.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
#[non_exhaustive]
pub enum Normalization {
    /// Nothing.
    AsGiven,
    /// Multiply by a number.
    Scale {
        /// The number.
        factor: f64,
    },
    /// Scale so that the longest edge of the truth's bounding box has this length.
    LongestEdge {
        /// The length.
        length: f64,
    },
    /// Move the centre of the truth's bounding box to the origin and scale its longest edge to this length.
    Centered {
        /// The length.
        length: f64,
    },
}

/// How the two directions become one distance.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum Combination {
    /// `mean(prediction -> truth) + mean(truth -> prediction)`.
    Sum,
    /// Half of that.
    Mean,
}

/// How volumes are compared.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
#[non_exhaustive]
pub enum IouProtocol {
    /// Solid voxels on one grid over the common bounding box, nothing aligned: see [`voxel_iou`](super::voxel_iou).
    CommonBox {
        /// Cells along the longest edge of the box.
        resolution: usize,
    },
    /// Aligned by bounding boxes, voxelised at 32³ and filled, as published: see [`mcmr_iou`](super::mcmr_iou).
    McmrAligned,
}

/// Everything that a figure depends on; serialised beside the figures.
///
/// Both meshes are sampled with the same seed, so a mesh compared with itself gives exactly zero. (Two
/// meshes of the same faces that differ a little are sampled at corresponding places, so their distance
/// has no sampling noise; published figures, made with independent samples, carry a noise floor.)
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Protocol {
    /// The preset's name, or any other for a protocol of one's own.
    pub name: String,
    /// Where it was published.
    pub source: String,
    /// What is computed, in one line.
    pub formula: String,
    /// What is done to the meshes first.
    pub normalization: Normalization,
    /// The points compared; `None` when no distances are computed.
    pub points: Option<Points>,
    /// Whether distances are squared before the mean.
    pub squared: bool,
    /// How the two means are combined.
    pub combination: Combination,
    /// The F-score's distances after normalisation, never squared.
    pub thresholds: Vec<f64>,
    /// Whether the normals at nearest points are compared.
    pub normals: bool,
    /// How the volumes are compared, if they are.
    pub iou: Option<IouProtocol>,
    /// The seed of the samples.
    pub seed: u64,
}

impl Protocol {
    /// What a distance of this protocol is counted in, in words: without it, figures of two protocols look alike and
    /// differ a hundredfold.
    pub fn distance_unit(&self) -> String {
        let length = match self.normalization {
            Normalization::AsGiven => "the meshes' own unit".to_owned(),
            Normalization::Scale { factor } => format!("the meshes' own unit times {factor}"),
            Normalization::LongestEdge { length } | Normalization::Centered { length } => {
                format!("the truth's longest side is {length}")
            }
        };
        if self.squared {
            format!("squared distance; {length}")
        } else {
            format!("distance; {length}")
        }
    }

    /// What its volumes are compared as, in words; none where they are not.
    pub fn volume_unit(&self) -> Option<String> {
        Some(match self.iou? {
            IouProtocol::CommonBox { resolution } => {
                format!("solids as they lie, {resolution} cells along their box")
            }
            IouProtocol::McmrAligned => {
                format!("solids moved and scaled onto each other, {GRID}\u{b3} cells")
            }
        })
    }

    /// Pixel2Mesh: scale 0.57, squared distances, `τ = 1e-4` and `2e-4` of squared distance.
    ///
    /// The original compares the predicted vertices with given ground-truth points; `meshrcnn
    /// --eval-p2m` and this preset take 10,000 surface points of both. For the original, set `points` to
    /// [`Points::Vertices`]. Papers print the distance times 1000. The factor expects meshes in
    /// ShapeNet's own scale.
    pub fn p2m(seed: u64) -> Self {
        Self {
            name: "p2m".into(),
            source: "Wang et al. 2018, Pixel2Mesh; evaluated as by meshrcnn --eval-p2m".into(),
            formula: "chamfer = mean d²(prediction→truth) + mean d²(truth→prediction); F at d² < 1e-4, 2e-4"
                .into(),
            normalization: Normalization::Scale { factor: 0.57 },
            points: Some(Points::Surface { samples: 10_000 }),
            squared: true,
            combination: Combination::Sum,
            thresholds: vec![1e-2, 2e-4f64.sqrt()],
            normals: true,
            iou: None,
            seed,
        }
    }

    /// Mesh R-CNN on ShapeNet: longest edge of the truth 10, `τ = 0.1, 0.3, 0.5`.
    ///
    /// The paper prints F-scores in per cent; here they are shares.
    pub fn mesh_rcnn(seed: u64) -> Self {
        Self {
            name: "meshrcnn".into(),
            source: "Gkioxari, Malik, Johnson 2019, Mesh R-CNN; compare_meshes, scale gt-10".into(),
            formula: "chamfer = mean d²(prediction→truth) + mean d²(truth→prediction); F at d < 0.1, 0.3, \
                      0.5; normals: mean |cos| of both ways"
                .into(),
            normalization: Normalization::LongestEdge { length: 10.0 },
            points: Some(Points::Surface { samples: 10_000 }),
            squared: true,
            combination: Combination::Sum,
            thresholds: vec![0.1, 0.3, 0.5],
            normals: true,
            iou: None,
            seed,
        }
    }

    /// Occupancy Networks: the unit cube, 100,000 points, Chamfer-L1.
    ///
    /// The paper's tables take a tenth of the longest edge as unit: multiply by ten. The F-score at one
    /// per cent of the longest edge is that of later work under the same protocol. The paper's IoU tests
    /// 100,000 random points; here volumes are compared on a grid of 64 cells, without that noise.
    pub fn occ_net(seed: u64) -> Self {
        Self {
            name: "occnet".into(),
            source: "Mescheder et al. 2019, Occupancy Networks".into(),
            formula:
                "chamfer = (mean d(prediction→truth) + mean d(truth→prediction)) / 2, unsquared; \
                      F at d < 0.01; normals: mean |cos| of both ways; iou of solid voxels"
                    .into(),
            normalization: Normalization::Centered { length: 1.0 },
            points: Some(Points::Surface { samples: 100_000 }),
            squared: false,
            combination: Combination::Mean,
            thresholds: vec![0.01],
            normals: true,
            iou: Some(IouProtocol::CommonBox { resolution: 64 }),
            seed,
        }
    }

    /// MCMR on Pascal3D+: 3D IoU at 32³ after aligning the bounding boxes.
    ///
    /// The published figure uses one alignment per class, the mean over its test instances
    /// ([`McmrAlignment`](super::McmrAlignment)); for one pair of meshes it is that pair's own. The grid
    /// covers the unit cube, where the data set's models lie; other meshes are first brought there, with a
    /// margin of one cell, since a surface on the very border of the grid would leave the solid open.
    pub fn mcmr(seed: u64) -> Self {
        Self {
            name: "mcmr".into(),
            source: "Simoni et al. 2021, Multi-Category Mesh Reconstruction; 3D IoU of the U-CMR code".into(),
            formula: "iou = |A ∩ B| / |A ∪ B| of filled surface voxels at 32³; prediction aligned to the \
                      truth by (centre, cube root of volume) of the bounding boxes"
                .into(),
            normalization: Normalization::Centered { length: 30.0 / 32.0 },
            points: None,
            squared: false,
            combination: Combination::Mean,
            thresholds: Vec::new(),
            normals: false,
            iou: Some(IouProtocol::McmrAligned),
            seed,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn figures_have_a_unit() {
        let [p2m, mesh_rcnn, occ_net, mcmr] = Preset::ALL.map(|preset| preset.protocol(0));
        assert_eq!(p2m.distance_unit(), "squared distance; the meshes' own unit times 0.57");
        assert_eq!(mesh_rcnn.distance_unit(), "squared distance; the truth's longest side is 10");
        assert_eq!(occ_net.distance_unit(), "distance; the truth's longest side is 1");
        assert_eq!((p2m.volume_unit(), mesh_rcnn.volume_unit()), (None, None));
        let [a, b] = [occ_net, mcmr].map(|p| p.volume_unit().expect("volumes are compared"));
        assert!(a.contains("as they lie, 64") && b.contains("onto each other, 32"), "{a}, {b}");
    }

    #[test]
    fn names_lead_back_to_their_presets() {
        for preset in Preset::ALL {
            assert_eq!(preset.name().parse(), Ok(preset));
            assert_eq!(preset.protocol(7).name, preset.name());
        }
        let unknown = "emd".parse::<Preset>().expect_err("not a preset");
        assert!(unknown.to_string().contains("\"emd\"") && unknown.to_string().contains("occnet"));
    }
}
