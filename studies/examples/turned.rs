//! Whether img2mesh finds from which side an object is seen, when its world is turned about the vertical.
//!
//! `cargo run --release -p unsphere-studies --example turned -- WEIGHTS data=FOLDER[,FOLDER ..] [families=a,b] [views=1,5] [count=N] [subset=validation]`:
//! a row for each object, number of given views and turn of the world (0, 90, 180 degrees), with the mask IoU at the given views and at
//! the others of one pass, and whether the world was turned.
//!
//! docs/img2mesh.md has its means over `data=ours,people families=airplane,car,chair,table,lamp`, made by
//! `unsphere data generate -o ours --families airplane,car,chair,table,lamp --objects 6 --seed 4242 --set 'split=[0.0,1.0,0.0]'` and
//! `unsphere data generate -o people --from objects --splits objects.csv --normalize unit-diagonal --seed 5`, both with `--set layout=kaolin
//! --set cameras=r2n2 --set views=8 --set width=128 --set height=128`.

use std::error::Error;
use std::io::Write as _;
use std::path::PathBuf;

use datasets::{ReadOptions, Subsets, Views};
use mesh_core::nalgebra::{Rotation3, SimilarityMatrix3, Vector3};
use models::img2mesh::Img2Mesh;
use models::predict::{Choice, PredictInput, Predictor as _};
use recon::evaluate::score_views;
use train::Checkpoint;

type Failure = Box<dyn Error>;

fn turned(mut views: Views, degrees: f64) -> Views {
    let rotation = Rotation3::from_axis_angle(&Vector3::y_axis(), degrees.to_radians());
    let similarity = SimilarityMatrix3::from_parts(Vector3::zeros().into(), rotation, 1.0);
    for view in &mut views.views {
        view.camera = view.camera.transformed(&similarity);
    }
    views
}

fn main() -> Result<(), Failure> {
    let mut arguments = std::env::args().skip(1);
    let weights = PathBuf::from(arguments.next().ok_or("WEIGHTS is expected")?);
    let (mut data, mut families, mut views, mut count) = (Vec::new(), Vec::new(), vec![1, 5], 1000);
    let mut validation = true;
    for argument in arguments {
        let (key, value) = argument.split_once('=').ok_or("KEY=VALUE is expected")?;
        let list = || value.split(',').map(str::to_owned);
        match key {
            "data" => data = list().collect(),
            "families" => families = list().collect(),
            "views" => views = list().map(|v| v.parse()).collect::<Result<_, _>>()?,
            "count" => count = value.parse()?,
            "subset" => validation = value == "validation",
            _ => return Err(format!("no option called {key}").into()),
        }
    }
    let (system, _) = Checkpoint::read(&weights)?.load::<Img2Mesh>()?;
    let mut out = std::io::stdout().lock();
    writeln!(out, "object,views,turn,given,others,turned")?;
    for folder in &data {
        let dataset = datasets::open(std::path::Path::new(folder))?;
        let subsets = Subsets::of(dataset.entries(), Some(5))?;
        let mut list = if validation { subsets.validation } else { subsets.test };
        list.retain(|o| families.is_empty() || families.contains(&dataset.entries()[*o].category));
        for object in list.into_iter().take(count) {
            let all = dataset.views(object, None, &ReadOptions::default(), &|_, _| ())?;
            for &given in &views {
                for degrees in [0.0, 90.0, 180.0] {
                    let input =
                        PredictInput::part(turned(all.clone(), degrees), Choice::First(given))?;
                    let found = system.apply(&input)?;
                    let score = |views: &[datasets::View]| {
                        score_views(&found.mesh, &views.iter().collect::<Vec<_>>(), &|_, _| ())
                            .map(|s| s.mask_iou)
                    };
                    let name = dataset.entries()[object].object_name();
                    let was_turned = !found.warnings.is_empty();
                    let (near, far) = (score(&input.given)?, score(&input.others)?);
                    writeln!(out, "{name},{given},{degrees},{near:.3},{far:.3},{was_turned}")?;
                    out.flush()?;
                }
            }
        }
    }
    Ok(())
}
