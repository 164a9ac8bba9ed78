//! A mesh from a user's image, with its depth and intrinsics.

use std::path::Path;

use autodiff_lite::Tape;
use datasets::{ReadOptions, View, read_depth_file, read_disparity_file};
use mesh_core::{DepthMap, Lens, TriMesh};
use ndarray::ArrayD;
use nets::onnx::OnnxModel;
use recon::fit::RefineConfig;
use train::{DataError, PredictError, Subset};

use super::canonical::Canonical;
use super::{DepthKind, MeshInit, PlaceKind, Refined, Scene, Scenes};
use crate::parts::of_each;
use crate::predict::{Features, PredictInput, Prediction, Predictor, Request, Sighting, strongest};

/// The least disparity that stands for an estimate's farthest pixel; the nearest is 1.
const FARTHEST: f32 = 0.1;

impl<B: MeshInit> Predictor for Refined<B> {
    const ABOUT: &'static str = B::ABOUT;
    const TRAINING: &'static str = B::TRAINING;
    const REFINE: usize = B::REFINE;

    fn refinement(steps: usize) -> RefineConfig {
        RefineConfig { steps, symmetry: B::SYMMETRY, ..RefineConfig::default() }
    }

    fn load(&self, request: &Request<'_>) -> Result<PredictInput, DataError> {
        let options = ReadOptions { depth: true, ..request.options.clone() };
        let mut input = PredictInput::one(&Request { options, ..request.clone() })?;
        let view = &mut input.given[0];
        if let Some(intrinsics) = request.intrinsics {
            look_through(view, intrinsics)?;
            input.warnings.retain(|warning| !warning.starts_with("the camera of a single"));
        }
        if let Some(path) = request.depth {
            let estimated = B::refine(self.config()).depth == DepthKind::Estimated;
            view.depth = Some(if estimated { guessed(path, view)? } else { measured(path, view)? });
        }
        Ok(input)
    }

    fn input(config: &B::Config) -> String {
        let depth = match B::refine(config).depth {
            DepthKind::None => return "one image with its mask, without depth".to_owned(),
            DepthKind::True => "measured",
            DepthKind::Estimated => "estimated",
        };
        format!(
            "one image with its mask and its {depth} depth, which `predict` takes as --depth (--set depth=false --set \
             place=fixed --set 'reach=[0.42,1.72]' trains without)"
        )
    }

    fn features_of(
        &self,
        data: &Scenes,
        subset: Subset,
        most: usize,
    ) -> Result<Vec<Sighting>, DataError> {
        of_each(data.pairs().listed(subset).len(), most, |k| {
            let (object, scene) = data.trial(subset, 1, k)?;
            let family = data.pairs().name(object)[0].to_owned();
            Ok(Sighting { family, features: self.features(&scene) })
        })
    }

    fn to_onnx(&self) -> Option<OnnxModel> {
        self.image_side_to_onnx()
    }

    fn onnx_outputs(&self, inputs: &[ArrayD<f32>]) -> Vec<ArrayD<f32>> {
        B::instance(self).image_side_outputs(inputs)
    }

    fn apply(&self, input: &PredictInput) -> Result<Prediction, PredictError> {
        B::instance(self).apply(input)
    }
}

impl<B: MeshInit> Refined<B> {
    /// The mesh and its way there, in the world of the given camera.
    pub(super) fn applied(&self, input: &PredictInput) -> Result<Prediction, PredictError> {
        let Brought { scene, canonical } = self.brought(&input.given)?;
        let (mesh, stages) = self.mesh_and_stages_of(&scene);
        let in_world = |mesh| Self::in_world(&scene, canonical.as_ref(), mesh);
        Ok(Prediction {
            features: self.features(&scene),
            mesh: in_world(self.refine().pairs.finished(mesh)),
            sequence: stages.into_iter().map(in_world).collect(),
            details: canonical.iter().flat_map(Canonical::details).collect(),
            warnings: canonical.iter().map(Canonical::remark).collect(),
            ..Prediction::default()
        })
    }

    fn features(&self, scene: &Scene) -> Features {
        let tape = Tape::eval();
        let [.., before, last] = self.encoder.maps(&tape, &[scene]);
        strongest(&[before, last])
    }

    /// The mesh of the first view, in the world of its camera.
    pub(super) fn predicted(&self, views: &[View]) -> Result<TriMesh, PredictError> {
        let Brought { scene, canonical } = self.brought(views)?;
        let (mesh, _) = self.mesh_of(&scene);
        Ok(Self::in_world(&scene, canonical.as_ref(), mesh))
    }

    /// The first view as the network takes it; where measured depth says that its camera is not one that was learned from,
    /// brought to one.
    fn brought(&self, views: &[View]) -> Result<Brought, PredictError> {
        let config = self.refine();
        let measured = config.place == PlaceKind::Seen && config.depth == DepthKind::True;
        let first = views.first().filter(|_| measured);
        let Some((view, canonical)) = first.and_then(|v| Canonical::of(v, config.pairs.scale))
        else {
            return Ok(Brought { scene: self.scene(views)?, canonical: None });
        };
        Ok(Brought { scene: self.scene(&[view])?, canonical: Some(canonical) })
    }

    fn in_world(scene: &Scene, canonical: Option<&Canonical>, mesh: TriMesh) -> TriMesh {
        let mesh = scene.depth_targets.frame.mesh_in_world(mesh);
        match canonical {
            Some(canonical) => canonical.back(mesh),
            None => mesh,
        }
    }
}

/// A view as the network takes it, and how it was brought there.
struct Brought {
    scene: Scene,
    canonical: Option<Canonical>,
}

/// Replaces a view's lens.
fn look_through(view: &mut View, [fx, fy, cx, cy]: [f64; 4]) -> Result<(), DataError> {
    let sound =
        [fx, fy].iter().all(|f| *f > 0.0 && f.is_finite()) && cx.is_finite() && cy.is_finite();
    if !sound {
        let text = format!(
            "--intrinsics {fx},{fy},{cx},{cy}: expected focal lengths above 0, then a point"
        );
        return Err(DataError::Unfit(text));
    }
    view.camera.lens = Lens::Perspective { fx, fy, cx, cy };
    Ok(())
}

fn measured(path: &Path, view: &View) -> Result<DepthMap, DataError> {
    let depth = read_depth_file(path, 1.0).map_err(DataError::read)?;
    Ok(fitted(&depth, view))
}

/// An estimate as a depth: one over a disparity that was brought to 0.1 to 1. Scale and shift mean nothing to the network.
fn guessed(path: &Path, view: &View) -> Result<DepthMap, DataError> {
    let map = read_disparity_file(path).map_err(DataError::read)?;
    let finite = || map.data.iter().copied().filter(|d| d.is_finite());
    let low = finite().fold(f32::INFINITY, f32::min);
    let span = finite().fold(f32::NEG_INFINITY, f32::max) - low;
    let depth = |&d: &f32| {
        let share = if span > 0.0 { (d - low) / span } else { 0.5 };
        if d.is_finite() { (FARTHEST + (1.0 - FARTHEST) * share).recip() } else { f32::INFINITY }
    };
    let data = map.data.iter().map(depth).collect();
    Ok(fitted(&DepthMap { height: map.height, width: map.width, data }, view))
}

/// The nearest pixels, in the size of the image.
fn fitted(depth: &DepthMap, view: &View) -> DepthMap {
    let (height, width) = (view.color.height, view.color.width);
    let at = |i: usize, from: usize, to: usize| (2 * i + 1) * from / (2 * to);
    let pixel = |p: usize| {
        let (row, column) =
            (at(p / width, depth.height, height), at(p % width, depth.width, width));
        depth.data[row * depth.width + column]
    };
    DepthMap { height, width, data: (0..height * width).map(pixel).collect() }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use mesh_core::{ByteImage, Camera, Image, write_pfm};
    use train::System as _;

    use super::*;
    use crate::depth::{DepthPixel2Mesh, MeshRcnn, SphereConfig};
    use crate::img2mesh::Img2Mesh;

    fn view() -> View {
        let camera = Camera::from_r2n2(0.0, 27.5, 0.8, 8, 8);
        let mask = ByteImage { data: vec![255; 64], ..ByteImage::new(8, 8, 1) };
        View { name: "a".into(), color: ByteImage::new(8, 8, 3), mask, camera, depth: None }
    }

    fn file(folder: &Path, name: &str, value: impl Fn(usize) -> f32) -> std::path::PathBuf {
        let path = folder.join(name);
        let image = Image { height: 4, width: 4, channels: 1, data: (0..16).map(value).collect() };
        write_pfm(&path, &image).unwrap();
        path
    }

    /// Depth comes in the size of the image; an estimate means the same in any scale and with any shift.
    #[test]
    fn depth_is_fitted_and_estimates_have_no_unit() {
        let folder = tempfile::tempdir().unwrap();
        let view = view();
        let metric = file(folder.path(), "metric.pfm", |p| if p == 5 { 0.0 } else { p as f32 });
        let depth = measured(&metric, &view).unwrap();
        assert_eq!((depth.height, depth.width), (8, 8));
        assert_eq!((depth.data[63], depth.data[2 * 8 + 2]), (15.0, f32::INFINITY));
        let one = guessed(&file(folder.path(), "one.pfm", |p| p as f32), &view).unwrap();
        let other =
            guessed(&file(folder.path(), "two.pfm", |p| 7.5 * p as f32 - 30.0), &view).unwrap();
        assert!(one.data.iter().zip(&other.data).all(|(a, b)| (a - b).abs() < 1e-4));
        // Nearer is less deep, and the nearest is at 1.
        assert!((one.data[63] - 1.0).abs() < 1e-6 && (one.data[0] - 10.0).abs() < 1e-4);
        let flat = guessed(&file(folder.path(), "flat.pfm", |_| 3.0), &view).unwrap();
        assert!(flat.data.iter().all(|z| z.is_finite() && *z > 0.0));
    }

    #[test]
    fn a_picture_with_depth_becomes_a_mesh_and_without_it_a_message() {
        let folder = tempfile::tempdir().unwrap();
        let picture = folder.path().join("picture.png");
        let data = (0..32 * 32).flat_map(|p| {
            let inside = (8..24).contains(&(p % 32)) && (8..24).contains(&(p / 32));
            [200, 90, 40, if inside { 255 } else { 0 }]
        });
        let image = ByteImage { height: 32, width: 32, channels: 4, data: data.collect() };
        std::fs::write(&picture, mesh_core::encode_png(&image)).unwrap();
        let depth = file(folder.path(), "depth.pfm", |_| 1.4);
        let (_, text) = DepthPixel2Mesh::PRESETS[0];
        let config: train::Configuration<SphereConfig> = toml::from_str(text).unwrap();
        let system = DepthPixel2Mesh::new(&config.system, 0);
        let request = Request::new(&picture);
        let input = system.load(&request).unwrap();
        let error = system.apply(&input).unwrap_err();
        assert!(error.to_string().contains("--depth"), "{error}");
        let intrinsics = Some([60.0, 60.0, 16.0, 16.0]);
        let given = Request { depth: Some(&depth), intrinsics, ..request.clone() };
        let input = system.load(&given).unwrap();
        assert!(input.warnings.is_empty());
        let Prediction { mesh, sequence, .. } = system.apply(&input).unwrap();
        assert!(
            mesh.colors.is_some() && mesh.positions.as_flattened().iter().all(|x| x.is_finite())
        );
        assert_eq!(sequence.len(), 4);
        assert_eq!(sequence[3].positions, mesh.positions);
        assert_eq!(mesh, system.predict(&input.given).unwrap());
        let wrong = Request { intrinsics: Some([0.0, 1.0, 2.0, 3.0]), ..given.clone() };
        assert!(system.load(&wrong).unwrap_err().to_string().contains("--intrinsics"));
        // Systems that take no depth say so.
        let (_, text) = Img2Mesh::PRESETS[0];
        let config: train::Configuration<_> = toml::from_str(text).unwrap();
        let other = Img2Mesh::new(&config.system, 0);
        let error = other.load(&given).unwrap_err().to_string();
        assert!(error.contains(MeshRcnn::NAME), "{error}");
    }
}
