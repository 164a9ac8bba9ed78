//! What a dataset is to be.

use serde::{Deserialize, Serialize};
use train::settings::{LARGEST, Options as _};

use crate::shapes::Family;
use crate::{Lighting, Monocular, NormalSpace, PoseNoise, RenderOptions};

/// What the images of all objects that are drawn at the same time may take.
const MOST_BYTES: u64 = 16_000_000_000;

/// The configuration, in the root of the dataset.
pub(super) const MANIFEST: &str = "dataset.toml";

train::options! {
    /// What [`generate`](super::generate) makes; the same bytes for the same values.
    #[serde(deny_unknown_fields)]
    pub struct GenerateConfig {
        /// Families of shapes; not used where a model is given.
        #[serde(with = "names")]
        pub families: Vec<Family> = Family::ALL.to_vec();
        /// Objects of each family.
        pub objects: usize = 20, in 1..=1_000_000;
        /// How files are laid out.
        pub layout: OutputLayout = OutputLayout::Kaolin;
        /// How cameras are distributed.
        pub cameras: CameraSet = CameraSet::R2n2;
        /// Views of each object.
        pub views: usize = 24, in 1..=10_000;
        /// Width of the images.
        pub width: usize = 137, in 8..=8192;
        /// Height of the images.
        pub height: usize = 137, in 8..=8192;
        /// Where the principal point is off the middle, as a share of width and height: right and down. Only
        /// `transforms.json` can say it.
        pub principal: [f64; 2] = [0.0; 2], in -0.4..=0.4;
        /// What is behind the object, sRGB; under alpha 0 where images have alpha.
        pub background: [f32; 3] = [0.0; 3], in 0.0..=1.0;
        /// Samples per pixel and axis; odd.
        pub supersample: usize = 3, in 1..=15;
        /// Whether true planar depth is written.
        pub depth: bool = false;
        /// Whether and in which frame normals are written.
        pub normals: Option<NormalSpace> = None;
        /// Points on the surface with normals, where the layout has a place for them.
        pub points: usize = 10_000, in 0..=10_000_000;
        /// Cells along each side of the voxel grid, where the layout has a place for it.
        pub voxels: usize = 32, in 0..=512;
        /// Shares of objects for training, validation and test.
        pub split: [f64; 3] = [0.7, 0.1, 0.2], in 0.0..=1.0;
        /// Seed of everything that is drawn.
        pub seed: u64 = 0, in ..=LARGEST;
        /// The light.
        pub lighting: Lighting = Lighting::studio();
        /// How far rough poses are from the true ones, for photo collections.
        pub noise: PoseNoise = PoseNoise::default();
        /// Whether and how depth is guessed as a network would.
        pub monocular: Option<Monocular> = None;
    }
}

/// How a generated dataset is laid out.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum OutputLayout {
    /// A folder of kaolin's synthetic views for each object.
    #[default]
    Kaolin,
    /// ShapeNet with 3D-R2N2's renderings.
    R2n2,
    /// A folder with a `transforms.json` for each object.
    Transforms,
}

/// How cameras stand around an object.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum CameraSet {
    /// As in 3D-R2N2's renderings: from a little above, all around.
    #[default]
    R2n2,
    /// Evenly from everywhere, also from below.
    Sphere,
    /// As in collections of photographs, with a rough pose beside the true one.
    Collection,
}

impl GenerateConfig {
    /// What is wrong with the values, one sentence each.
    pub fn check(&self) -> Vec<String> {
        let mut wrong = self.out_of_range();
        let mut expect = |fits: bool, text: String| {
            if !fits {
                wrong.push(text);
            }
        };
        let twice =
            (1..self.families.len()).any(|i| self.families[..i].contains(&self.families[i]));
        expect(!self.families.is_empty(), "`families`: none, expected at least one".into());
        expect(!twice, "`families`: one is named twice".into());
        expect(self.supersample % 2 == 1, format!("`supersample`: {} is even", self.supersample));
        expect(
            self.principal == [0.0; 2] || self.layout == OutputLayout::Transforms,
            "`principal`: only the layout `transforms` can say it".into(),
        );
        expect(
            self.normals != Some(NormalSpace::World) || self.layout != OutputLayout::R2n2,
            "`normals`: the layout `r2n2` keeps those of the camera's frame".into(),
        );
        let whole = (self.split.iter().sum::<f64>() - 1.0).abs() < 1e-9;
        expect(whole, format!("`split`: found {:?}, expected the sum 1", self.split));
        let PoseNoise { rotation, scale, translation } = self.noise;
        let noise = [rotation, scale, translation].iter().all(|v| (0.0..=180.0).contains(v));
        expect(noise, format!("`noise`: found {:?}, expected 0 to 180 each", self.noise));
        let Lighting { ambient, lamps, crease } = &self.lighting;
        let bright = |strength: f32| (0.0..=1000.0).contains(&strength);
        expect(
            bright(*ambient),
            format!("`lighting.ambient`: found {ambient}, expected 0 to 1000"),
        );
        expect(
            (0.0..=180.0).contains(crease),
            format!("`lighting.crease`: found {crease}, expected 0 to 180"),
        );
        for lamp in lamps {
            let found = format!("`lighting.lamps`: found {lamp:?}, expected");
            let length: f32 = lamp.direction.iter().map(|x| x * x).sum();
            expect(bright(lamp.strength), format!("{found} a strength of 0 to 1000"));
            expect(
                length > 0.0 && length.is_finite(),
                format!("{found} a finite direction that is not zero"),
            );
        }
        let bytes = self.bytes_of_an_object();
        let images = format!("the images of one object take {} GB", bytes / 1_000_000_000);
        expect(
            bytes <= MOST_BYTES,
            format!(
                "`views`, `width`, `height`: {images} of memory, expected at most 16: fewer views, or smaller ones"
            ),
        );
        for text in self.monocular.iter().flat_map(Monocular::check) {
            wrong.push(format!("`monocular`: {text}"));
        }
        wrong
    }

    /// How many objects may be drawn at the same time for their images to stay within the memory that they may take: at least one.
    pub(super) fn objects_at_once(&self) -> usize {
        let most = MOST_BYTES / self.bytes_of_an_object().max(1);
        usize::try_from(most).unwrap_or(usize::MAX).max(1)
    }

    /// What all images of an object take, which are held together until they are written.
    fn bytes_of_an_object(&self) -> u64 {
        let options = self.render_options();
        let kept =
            [(true, 4), (options.depth, 4), (options.alpha, 4), (options.normals.is_some(), 12)];
        let a_pixel: u64 = kept.into_iter().filter(|(is_kept, _)| *is_kept).map(|(_, n)| n).sum();
        // Values out of their range are told by themselves.
        let sides = [self.views, self.width, self.height].map(|n| n as u64);
        sides.into_iter().fold(a_pixel, u64::saturating_mul)
    }

    /// How images are drawn.
    pub(super) fn render_options(&self) -> RenderOptions {
        RenderOptions {
            lighting: self.lighting.clone(),
            background: self.background,
            supersample: self.supersample,
            depth: self.depth || self.monocular.is_some(),
            alpha: self.layout == OutputLayout::R2n2,
            normals: self.normals,
            ..RenderOptions::default()
        }
    }
}

/// Families by their names.
mod names {
    use super::Family;
    use serde::de::{Deserialize, Deserializer, Error};
    use serde::ser::Serializer;

    pub(super) fn serialize<S: Serializer>(families: &[Family], to: S) -> Result<S::Ok, S::Error> {
        to.collect_seq(families.iter().map(|family| family.name()))
    }

    pub(super) fn deserialize<'de, D: Deserializer<'de>>(from: D) -> Result<Vec<Family>, D::Error> {
        let names = Vec::<String>::deserialize(from)?;
        names.iter().map(|name| name.parse().map_err(D::Error::custom)).collect()
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use super::*;

    #[test]
    fn survives_as_toml() {
        let mut config = GenerateConfig {
            families: vec![Family::AlarmClock, Family::Car],
            normals: Some(NormalSpace::World),
            ..GenerateConfig::default()
        };
        for monocular in [None, Some(Monocular::default())] {
            config.monocular = monocular;
            let text = train::settings::to_toml(&config);
            let folder = tempfile::tempdir().unwrap();
            let path = folder.path().join("c.toml");
            std::fs::write(&path, text).unwrap();
            let read: GenerateConfig = train::settings::read(Some(&path), &[]).unwrap();
            assert_eq!(read, config);
        }
    }

    #[test]
    fn what_cannot_be_is_named() {
        assert!(GenerateConfig::default().check().is_empty());
        let wrong = GenerateConfig {
            families: vec![],
            views: 0,
            supersample: 2,
            principal: [0.1, 0.0],
            split: [0.5, 0.1, 0.1],
            monocular: Some(Monocular { ground: [0.0, 2.0], ..Monocular::default() }),
            ..GenerateConfig::default()
        };
        let wrong = wrong.check();
        let names = ["views", "families", "supersample", "principal", "split", "monocular"];
        assert_eq!(wrong.len(), names.len(), "{wrong:?}");
        let named = |(text, name): (&String, &str)| text.starts_with(&format!("`{name}`"));
        assert!(wrong.iter().zip(names).all(named), "{wrong:?}");
    }

    #[test]
    fn what_would_take_all_memory_is_refused() {
        let large = |views| GenerateConfig {
            views,
            width: 8192,
            height: 8192,
            ..GenerateConfig::default()
        };
        assert!(large(24).check().is_empty());
        assert_eq!((large(24).objects_at_once(), large(59).objects_at_once()), (2, 1));
        assert!(GenerateConfig::default().objects_at_once() > 1000);
        let wrong = large(1000).check();
        assert!(
            wrong.len() == 1 && wrong[0].contains("268 GB") && wrong[0].contains("fewer views"),
            "{wrong:?}"
        );
    }
}
