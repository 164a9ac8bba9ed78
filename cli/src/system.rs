//! The systems that can be trained, by name.

use std::path::Path;

use clap::ValueEnum;
use models::predict::Predictor;
use train::settings::{self, SettingsError};
use train::{Configuration, System};

use crate::args::{Global, SystemSettings};
use crate::failure::Failure;

macro_rules! systems {
    ($($(#[$attribute:meta])+ $name:ident => $system:ty,)+) => {
        /// A system on the command line.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
        pub(crate) enum SystemName {
            $($(#[$attribute])+ $name,)+
        }

        impl SystemName {
            /// Does something with the system of this name.
            pub(crate) fn visit<F: ForSystem>(self, work: F) -> F::Output {
                match self {
                    $(Self::$name => work.run::<$system>(),)+
                }
            }
        }
    };
}

systems! {
    /// Several views to one mesh, learned from images and masks.
    Img2mesh => models::img2mesh::Img2Mesh,
    /// One photograph to a textured mesh, learned from photo collections of many categories.
    Mcmr => models::mcmr::Mcmr,
    /// One image to a mesh in continuous time, learned from true surfaces.
    #[value(name = "ode-pixel2mesh")]
    OdePixel2mesh => models::pixel2mesh::OdePixel2Mesh,
    /// One image to a mesh in three stages, learned from true surfaces.
    #[value(name = "pixel2mesh")]
    Pixel2mesh => models::pixel2mesh::Pixel2Mesh,
    /// One image, with or without depth, to a mesh from a sphere.
    #[value(name = "depth-pixel2mesh")]
    DepthPixel2mesh => models::depth::DepthPixel2Mesh,
    /// One image, with or without depth, to a mesh through voxels.
    #[value(name = "mesh-rcnn")]
    MeshRcnn => models::depth::MeshRcnn,
}

/// Something that can be done with any system.
pub(crate) trait ForSystem {
    /// What comes of it.
    type Output;

    /// Does it.
    fn run<S: Predictor>(self) -> Self::Output;
}

/// The configuration that the command line asks for, read but not yet checked as a whole.
pub(crate) fn configuration<S: System>(
    asked: &SystemSettings,
    global: Global,
) -> Result<Configuration<S::Config>, Failure> {
    let mut config: Configuration<S::Config> = match &asked.config {
        // `-` stands for no file at all: the defaults.
        Some(path) if path.as_os_str() == "-" => settings::read(None, &asked.set),
        Some(path) => settings::read(Some(path), &asked.set),
        None => {
            let presets = S::PRESETS;
            let Some((name, text)) = presets.iter().find(|(name, _)| *name == asked.preset) else {
                let names = presets.iter().map(|(name, _)| *name).collect::<Vec<_>>().join(", ");
                let text = format!("--preset {}: expected one of {names}", asked.preset);
                return Err(Failure::Usage(text));
            };
            let name = format!("preset {name}");
            settings::read_text(Path::new(&name), text, &asked.set)
        }
    }
    .map_err(|error| match error {
        SettingsError::Setting { .. } => Failure::Usage(format!("--set: {error}")),
        _ => Failure::input(error),
    })?;
    if let Some(seed) = global.seed {
        config.train.seed = seed;
    }
    let mut problems = config.train.check();
    problems.extend(S::check(&config.system).err().unwrap_or_default());
    match (problems.is_empty(), &asked.config) {
        (true, _) => Ok(config),
        (false, Some(path)) if asked.set.is_empty() => {
            Err(Failure::Input(format!("{}: {}", path.display(), problems.join("; "))))
        }
        (false, _) => Err(Failure::Usage(problems.join("; "))),
    }
}
