//! What is predicted from one photograph.

use autodiff_lite::Tape;
use datasets::View;
use mesh_core::{Camera, TriMesh};

use train::{PredictError, Subset};

use super::model::Predicted;
use super::photo::{Masking, Photo, Rough, cropped, lens_of};
use super::pose::Pose;
use super::texture::Globe;
use super::{Mcmr, Sample};
use crate::predict::{Features, strongest};

/// A mesh with its texture, where it is seen from, and what it was made of.
#[derive(Clone, Debug)]
pub struct McmrPrediction {
    /// The shape in its own frame: upright, symmetric in x as far as training made it so, with a texture.
    pub mesh: TriMesh,
    /// How much of each mean shape is in it; they add up to 1.
    pub weights: Vec<f32>,
    /// Where the square around the object shows it.
    pub pose: Pose,
    /// What the encoder says of the photograph.
    pub features: Features,
    /// From the mesh's frame to the world of the image's camera: rows of `[3, 4]`.
    pub to_world: [[f64; 4]; 3],
}

impl McmrPrediction {
    /// The mesh in the world of the image's camera, where that camera sees it as the image shows it.
    pub fn mesh_in_world(&self) -> TriMesh {
        self.mesh.clone().transformed(&self.to_world)
    }
}

impl Mcmr {
    /// Applies the network to one photograph, cropped to its mask.
    pub(super) fn predict_view(&self, view: &View) -> Result<McmrPrediction, PredictError> {
        let photo = Photo::new(view, &Rough::Exact, 0, Masking::of(&self.config))?;
        let sample = photo.plain(Subset::Test, &self.config);
        let tape = Tape::eval();
        let predicted = self.predicted(&tape, &[&sample]);
        let pose = self.poses(&tape, &predicted, std::slice::from_ref(&sample))[0];
        let camera: Camera = cropped(
            &view.camera,
            photo.square(self.config.margin_in(Subset::Test)),
            self.config.image_size,
        );
        Ok(McmrPrediction {
            mesh: self.mesh_of(&predicted, 0),
            weights: row(&predicted.weights.value(), 0),
            features: self.features(&sample),
            to_world: pose.in_world(&camera, lens_of(&self.config)),
            pose,
        })
    }

    /// What the encoder says of a sample.
    pub(super) fn features(&self, sample: &Sample) -> Features {
        let tape = Tape::eval();
        let [.., before, last] = self.model.encoder_maps(self.images(&tape, &[sample]));
        strongest(&[before, last])
    }

    /// The textured mesh of a sample, in its own frame.
    pub fn mesh_of_sample(&self, sample: &Sample) -> TriMesh {
        let tape = Tape::eval();
        self.mesh_of(&self.predicted(&tape, &[sample]), 0)
    }

    /// The textured mesh of one image of a batch, in its own frame.
    pub(super) fn mesh_of(&self, predicted: &Predicted<'_>, index: usize) -> TriMesh {
        let mesh = self.bare_mesh_of(predicted, index);
        Globe::of(predicted.texture, index, self.config.closed_texture)
            .on(mesh, &self.template.sphere)
    }

    /// The same without texture.
    pub(super) fn bare_mesh_of(&self, predicted: &Predicted<'_>, index: usize) -> TriMesh {
        let positions = row(&predicted.positions.value(), index);
        TriMesh::new(positions.as_chunks::<3>().0.to_vec(), self.template.corners.clone())
    }

    /// The mean shapes as they are now.
    pub fn mean_shapes(&self) -> Vec<TriMesh> {
        let values = self.model.shapes.as_slice();
        values
            .chunks_exact(3 * self.template.sphere.len())
            .map(|shape| {
                TriMesh::new(shape.as_chunks::<3>().0.to_vec(), self.template.corners.clone())
            })
            .collect()
    }

    /// Batches of samples through the network, without training; `weights` may say those of the mean shapes for a range of them.
    pub(super) fn in_batches<R>(
        &self,
        samples: &[Sample],
        batch: usize,
        weights: &dyn Fn(std::ops::Range<usize>) -> Option<Vec<f32>>,
        mut f: impl for<'t> FnMut(&'t Tape, Predicted<'t>, usize, &[Sample]) -> R,
    ) -> Vec<R> {
        samples
            .chunks(batch)
            .enumerate()
            .map(|(i, chunk)| {
                let tape = Tape::eval();
                let first = i * batch;
                let weights = weights(first..first + chunk.len());
                let chosen: Vec<&Sample> = chunk.iter().collect();
                let predicted = self.predicted_from(&tape, &chosen, weights.as_deref());
                f(&tape, predicted, first, chunk)
            })
            .collect()
    }
}

/// One row of an array whose first axis is the batch.
pub(super) fn row(values: &autodiff_lite::Tensor<f32>, index: usize) -> Vec<f32> {
    let width = values.len() / values.shape()[0].max(1);
    values.as_slice()[index * width..][..width].to_vec()
}
