//! A mesh from a user's image, with its depth and intrinsics.

use std::path::Path;

use autodiff_lite::Tape;
use datasets::{ReadOptions, View};
use mesh_core::{Camera, Lens, TriMesh};
use ndarray::ArrayD;
use nets::onnx::OnnxModel;
use recon::fit::RefineConfig;
use train::{DataError, PredictError, Subset};

use super::canonical::Canonical;
use super::given_depth::GivenDepth;
use super::{DepthKind, MeshInit, PlaceKind, Refined, Scene, Scenes};
use crate::parts::of_each;
use crate::predict::{
    Choice, Features, PredictInput, Prediction, Predictor, Request, Sighting, strongest,
};

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
        if let Some(intrinsics) = request.intrinsics {
            let size = size_as_it_is(request, &input)?;
            look_through(&mut input.given[0], intrinsics, size)?;
            if input.camera_assumed {
                input.warnings.retain(|warning| !warning.starts_with("the camera of a single"));
                let text = "where the camera of a single image stands is assumed: the object is seen from 27.5 degrees above";
                input.warnings.push(text.to_owned());
            }
        }
        let view = &mut input.given[0];
        if let Some(path) = request.depth {
            let depth = GivenDepth::read(path, view, B::refine(self.config()).depth)?;
            view.depth = Some(depth.map);
            input.warnings.extend(depth.warning);
        }
        self.check_scale(request.depth.unwrap_or(&input.source), &input.given[0])?;
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
        let Some((view, canonical)) = views.first().and_then(|view| self.canonical(view)) else {
            return Ok(Brought { scene: self.scene(views)?, canonical: None });
        };
        Ok(Brought { scene: self.scene(&[view])?, canonical: Some(canonical) })
    }

    fn canonical(&self, view: &View) -> Option<(View, Canonical)> {
        let config = self.refine();
        let measured = config.place == PlaceKind::Seen && config.depth == DepthKind::True;
        if measured { Canonical::of(view, config.pairs.scale) } else { None }
    }

    /// Refuses depth, read from `path`, in whose unit no object is: the mesh would be shreds.
    fn check_scale(&self, path: &Path, view: &View) -> Result<(), DataError> {
        let absurd = self.canonical(view).and_then(|(_, canonical)| canonical.absurd());
        absurd.map_or(Ok(()), |why| Err(DataError::Unfit(format!("{}: {why}", path.display()))))
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
/// Columns and rows of the given image as it is, of which reading may have made less.
fn size_as_it_is(request: &Request<'_>, input: &PredictInput) -> Result<[usize; 2], DataError> {
    let size = |view: &View| [view.color.width, view.color.height];
    let (options, given) = (&request.options, &input.given[0]);
    if options.max_size.is_none() && !options.shrink_to_limit {
        return Ok(size(given));
    }
    // Of a single image there is nothing to choose.
    let only = (!input.camera_assumed).then(|| vec![given.name.clone()]);
    let options = ReadOptions { max_size: None, shrink_to_limit: false, only, ..options.clone() };
    let (choice, score) = (Choice::First(1), None);
    let whole = PredictInput::one(&Request { options, choice, score, ..request.clone() })?;
    Ok(size(&whole.given[0]))
}

/// Gives a view these intrinsics, which count the pixels of the image as it is.
fn look_through(
    view: &mut View,
    [fx, fy, cx, cy]: [f64; 4],
    [width, height]: [usize; 2],
) -> Result<(), DataError> {
    let sound =
        [fx, fy].iter().all(|f| *f > 0.0 && f.is_finite()) && cx.is_finite() && cy.is_finite();
    if !sound {
        let text = format!(
            "--intrinsics {fx},{fy},{cx},{cy}: expected focal lengths above 0, then a point"
        );
        return Err(DataError::Unfit(text));
    }
    let lens = Lens::Perspective { fx, fy, cx, cy };
    let camera = Camera { lens, width, height, ..view.camera.clone() };
    view.camera = camera.resized(view.color.width, view.color.height);
    Ok(())
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use mesh_core::{ByteImage, DepthMap, Image, write_pfm};
    use train::System as _;

    use super::*;
    use crate::depth::{DepthPixel2Mesh, MeshRcnn, SphereConfig, VoxelConfig};
    use crate::img2mesh::Img2Mesh;

    fn file(folder: &Path, name: &str, value: impl Fn(usize) -> f32) -> std::path::PathBuf {
        let path = folder.join(name);
        let image = Image { height: 4, width: 4, channels: 1, data: (0..16).map(value).collect() };
        write_pfm(&path, &image).unwrap();
        path
    }

    /// A system that takes measured depth refuses what no measurement is.
    #[test]
    fn depth_in_no_unit_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        // `tiny` has places that do not depend on depth.
        let (_, text) = MeshRcnn::PRESETS[1];
        let config: train::Configuration<VoxelConfig> = toml::from_str(text).unwrap();
        let system = MeshRcnn::new(&config.system, 0);
        let camera = Camera::from_r2n2(0.0, 27.5, 0.8, 4, 4);
        let (color, mask) =
            (ByteImage::new(4, 4, 3), ByteImage { data: vec![255; 16], ..ByteImage::new(4, 4, 1) });
        let at = |z: f32| {
            let depth = Some(DepthMap { height: 4, width: 4, data: vec![z; 16] });
            let (color, mask, camera) = (color.clone(), mask.clone(), camera.clone());
            let view = View { name: "a".into(), color, mask, camera, depth, crop: None };
            system.check_scale(&folder.path().join("depth.exr"), &view)
        };
        for z in [1e-3, 1.4, 1400.0] {
            at(z).unwrap();
        }
        for z in [1e-6, 3e6] {
            let error = at(z).unwrap_err().to_string();
            assert!(error.contains("depth.exr") && error.contains("unit"), "{error}");
        }
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
        // 4 x 4 numbers for 32 x 32 pixels.
        let [camera, warning] = input.warnings.as_slice() else { panic!("{:?}", input.warnings) };
        assert!(camera.starts_with("where the camera") && warning.contains("depth.pfm"));
        let Prediction { mesh, sequence, .. } = system.apply(&input).unwrap();
        assert!(
            mesh.colors.is_some() && mesh.positions.as_flattened().iter().all(|x| x.is_finite())
        );
        assert_eq!(sequence.len(), 4);
        assert_eq!(sequence[3].positions, mesh.positions);
        assert_eq!(mesh, system.predict(&input.given).unwrap());
        // They count the pixels of the image as it is.
        let options = ReadOptions { max_size: Some(16), ..given.options.clone() };
        let smaller = system.load(&Request { options, depth: None, ..given.clone() });
        let lens = smaller.unwrap().given[0].camera.lens.numbers();
        assert_eq!(lens, [30.0, 30.0, 8.0, 8.0]);
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
