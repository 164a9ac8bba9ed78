//! Views as a COLMAP project.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::Path;

use mesh_core::{ColmapCamera, DepthMap, encode_png};
use rayon::prelude::*;

use crate::assemble::{put, remove};
use crate::error::WriteViewsError;
use crate::view::View;

/// The two forms of a COLMAP model.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ColmapForm {
    /// `cameras.bin`, `images.bin`, `points3D.bin`: exact.
    #[default]
    Binary,
    /// `cameras.txt`, `images.txt`, `points3D.txt`: for people; exact too, as we write them.
    Text,
}

impl ColmapForm {
    pub(crate) fn extension(self) -> &'static str {
        match self {
            Self::Binary => "bin",
            Self::Text => "txt",
        }
    }
}

/// What is written of one view.
struct Shot {
    camera_id: u32,
    pose: ColmapCamera,
    name: String,
}

/// Writes views as `images/`, `masks/` and a model in `sparse/0/`, without points.
///
/// Masks are named as COLMAP has them, `masks/0000.png.png`; depth becomes
/// `stereo/depth_maps/0000.png.geometric.bin`, 0 where there is none. The folder is made where it
/// does not exist; files of the same name are replaced, each atomically, the model last. Cameras
/// of one lens and size are one camera. What a reader prefers, a model of the other form, is
/// removed, and so are the rigs and frames of an earlier one, and the depth of views that have none now.
///
/// # Errors
/// If a file cannot be written, or a camera has parallel rays, which COLMAP cannot say.
pub fn write_colmap(
    views: &[View],
    folder: &Path,
    form: ColmapForm,
) -> Result<(), WriteViewsError> {
    let model = folder.join("sparse/0");
    let poses = views
        .iter()
        .map(|view| {
            let fails =
                |e| WriteViewsError::new(&model.join("images"), format!("view {}: {e}", view.name));
            view.camera.to_colmap().map_err(fails)
        })
        .collect::<Result<Vec<_>, _>>()?;
    let results: Vec<Result<(), WriteViewsError>> = views
        .par_iter()
        .enumerate()
        .map(|(i, view)| {
            let name = format!("{i:04}.png");
            put(&folder.join("images").join(&name), &encode_png(&view.color))?;
            put(&folder.join(format!("masks/{name}.png")), &encode_png(&view.mask))?;
            let [own, other] = ["geometric", "photometric"]
                .map(|kind| folder.join(format!("stereo/depth_maps/{name}.{kind}.bin")));
            remove(&other)?;
            match &view.depth {
                Some(depth) => put(&own, &encode_depth_map(depth)),
                None => remove(&own),
            }
        })
        .collect();
    results.into_iter().collect::<Result<(), _>>()?;
    // Keyed by the bits, so that equal lenses are one camera.
    let mut ids: BTreeMap<(usize, usize, [u64; 4]), u32> = BTreeMap::new();
    let mut cameras: Vec<([usize; 2], [f64; 4])> = Vec::new();
    let mut shots = Vec::new();
    for (i, (view, pose)) in views.iter().zip(poses).enumerate() {
        let (width, height) = (view.camera.width, view.camera.height);
        let camera_id =
            *ids.entry((width, height, pose.params.map(f64::to_bits))).or_insert_with(|| {
                cameras.push(([width, height], pose.params));
                cameras.len() as u32
            });
        shots.push(Shot { camera_id, pose, name: format!("{i:04}.png") });
    }
    let [cameras, images, points] = match form {
        ColmapForm::Binary => binary(&cameras, &shots),
        ColmapForm::Text => text(&cameras, &shots),
    };
    let other = match form {
        ColmapForm::Binary => ColmapForm::Text,
        ColmapForm::Text => ColmapForm::Binary,
    };
    for (noun, bytes) in [("points3D", points), ("images", images), ("cameras", cameras)] {
        put(&model.join(format!("{noun}.{}", form.extension())), &bytes)?;
        remove(&model.join(format!("{noun}.{}", other.extension())))?;
    }
    for noun in ["rigs", "frames"] {
        [form, other]
            .iter()
            .try_for_each(|form| remove(&model.join(format!("{noun}.{}", form.extension()))))?;
    }
    Ok(())
}

fn text(cameras: &[([usize; 2], [f64; 4])], shots: &[Shot]) -> [Vec<u8>; 3] {
    let words =
        |values: &[f64]| values.iter().map(|v| format!("{v}")).collect::<Vec<_>>().join(" ");
    let mut camera_lines = String::from("# CAMERA_ID MODEL WIDTH HEIGHT PARAMS[]\n");
    for (k, ([width, height], params)) in cameras.iter().enumerate() {
        let _ = writeln!(camera_lines, "{} PINHOLE {width} {height} {}", k + 1, words(params));
    }
    let mut image_lines =
        String::from("# IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME, then POINTS2D[]\n");
    for (k, shot) in shots.iter().enumerate() {
        let pose = [words(&shot.pose.quaternion), words(&shot.pose.translation)].join(" ");
        let _ = writeln!(image_lines, "{} {pose} {} {}\n", k + 1, shot.camera_id, shot.name);
    }
    let points = "# POINT3D_ID X Y Z R G B ERROR TRACK[]\n".to_owned();
    [camera_lines, image_lines, points].map(String::into_bytes)
}

fn binary(cameras: &[([usize; 2], [f64; 4])], shots: &[Shot]) -> [Vec<u8>; 3] {
    const PINHOLE: u32 = 1;
    let floats = |out: &mut Vec<u8>, values: &[f64]| {
        out.extend(values.iter().flat_map(|v| v.to_le_bytes()));
    };
    let mut camera_bytes = (cameras.len() as u64).to_le_bytes().to_vec();
    for (k, (size, params)) in cameras.iter().enumerate() {
        camera_bytes.extend_from_slice(&(k as u32 + 1).to_le_bytes());
        camera_bytes.extend_from_slice(&PINHOLE.to_le_bytes());
        camera_bytes.extend(size.iter().flat_map(|&n| (n as u64).to_le_bytes()));
        floats(&mut camera_bytes, params);
    }
    let mut image_bytes = (shots.len() as u64).to_le_bytes().to_vec();
    for (k, shot) in shots.iter().enumerate() {
        image_bytes.extend_from_slice(&(k as u32 + 1).to_le_bytes());
        floats(&mut image_bytes, &shot.pose.quaternion);
        floats(&mut image_bytes, &shot.pose.translation);
        image_bytes.extend_from_slice(&shot.camera_id.to_le_bytes());
        image_bytes.extend_from_slice(shot.name.as_bytes());
        image_bytes.extend_from_slice(&[0; 9]);
    }
    [camera_bytes, image_bytes, 0u64.to_le_bytes().to_vec()]
}

fn encode_depth_map(depth: &DepthMap) -> Vec<u8> {
    let mut bytes = format!("{}&{}&1&", depth.width, depth.height).into_bytes();
    for &d in &depth.data {
        let d = if d.is_finite() { d } else { 0.0 };
        bytes.extend_from_slice(&d.to_le_bytes());
    }
    bytes
}
