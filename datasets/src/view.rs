//! What every reader returns: images of one object, its masks, its cameras.

use std::path::PathBuf;

use mesh_core::{ByteImage, Camera, DepthMap, Mask};

use crate::convention::{CameraAxes, Convention, PoseDirection};
use crate::crop::Crop;

/// One image of the object, where it was taken from, and which pixels are the object.
///
/// `color`, `mask`, `depth` and `camera` always have the same size.
#[derive(Clone, Debug, PartialEq)]
pub struct View {
    /// What the view is called in its source: the index or the file's stem.
    pub name: String,
    /// Colours, `[H, W, 3]`, sRGB.
    pub color: ByteImage,
    /// The object, `[H, W, 1]`: 255 where it is seen, 0 elsewhere, nothing in between.
    pub mask: ByteImage,
    /// Where the image was taken from.
    pub camera: Camera,
    /// Planar depth, where the source has it and was asked for it.
    pub depth: Option<DepthMap>,
    /// Which part of its image this is, where it is not all of it ([`View::cropped_to_object`]).
    pub crop: Option<Crop>,
}

/// The views of one object, in the order of their source.
#[derive(Clone, Debug, PartialEq)]
pub struct Views {
    /// At least one view.
    pub views: Vec<View>,
    /// The file or folder that was read.
    pub source: PathBuf,
    /// How it was laid out.
    pub layout: Layout,
    /// What a user should know although it stopped nothing, one sentence each.
    pub warnings: Vec<String>,
    /// Indices of the views that the source keeps for tests, ascending; empty where it does not say.
    pub test: Vec<usize>,
}

/// A way of laying views out on disk.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Layout {
    /// **kaolin's synthetic views**: `{i}_rgb.png`, `{i}_metadata.json` and, for masks, `{i}_semantic.npy` (any
    /// number type; above 0 is object); depth as `{i}_depth.exr` or `{i}_depth_linear.npy`. A folder, or the zip as
    /// it is shipped. The numbers may begin anywhere; between the first and the last none is missing, unless that is
    /// allowed.
    KaolinFolder,
    /// The same in a zip archive.
    KaolinZip,
    /// **`transforms.json`** of NeRF, instant-ngp and nerfstudio: one file, or those of
    /// `transforms_{train,val,test}.json` that are there, or the lists `{train,val,test}_filenames` of nerfstudio: frames of
    /// test are kept for tests ([`Views::test`]), and so are those of val where there are no others, which else are left out;
    /// in a folder or a zip. What a frame says wins over the top
    /// level; extensions may be missing; masks are alpha, `mask_path` or `masks/<stem>.png`. Distortion is undone:
    /// `k1 k2 k3 k4 p1 p2`, of a fisheye where `camera_model` or `is_fisheye` says so. Depth (`depth_file_path`) is in
    /// `depth_unit_scale_factor` where the file has one; else whole numbers are millimetres, as for nerfstudio, and floats are in the unit of
    /// the poses, of which nerfstudio takes a thousandth.
    Transforms,
    /// **ShapeNet with 3D-R2N2's renderings**: see [`r2n2`](crate::r2n2).
    R2n2,
    /// **COLMAP** ([`Colmap`](crate::Colmap)): cameras and images, `.bin` before `.txt`, in `sparse/0`, `sparse` or
    /// the folder itself; images in `images`, whose pixels, and those of masks, count as they are stored, whatever EXIF says; distortion is
    /// undone; poses are those of rigs and
    /// frames where there are `rigs` and `frames` (COLMAP 3.12 and later); masks are alpha, `masks/<image>.png` as COLMAP has them, or `masks/<stem>.png`; dense
    /// depth maps where asked.
    /// [`Colmap::points`](crate::Colmap::points) are the sparse points. A folder or a zip.
    Colmap,
    /// **BOP** ([`Bop`](crate::Bop)): a scene, a split or a dataset; objects by `obj_id`, in the frame of their
    /// model, millimetres. BlenderProc's `.hdf5` is refused: let it write BOP.
    Bop,
    /// **Photographs with `cameras.json`** ([`write_photos`](crate::write_photos) has its form): any camera can be
    /// said. A folder or a zip.
    Photos,
    /// **Middlebury's multi-view stereo**: photographs with a `<name>_par.txt`. Masks are alpha,
    /// `masks/<stem>.png`, or the black backdrop ([`Backdrop`](crate::MaskSource::Backdrop)). A folder or a zip.
    Middlebury,
    /// **Photographs with projection matrices**: `cameras_sphere.npz` or `cameras.npz` of IDR and NeuS; twelve numbers
    /// each in `projections.txt`, or in `txt/<stem>.txt` as PMVS has them; cells `P` in a `.mat` file. Images in
    /// `image`, `images`, `visualize` or beside it, masks in `mask` or `masks`. A small skew is undone; matrices of a
    /// projective frame are refused. A folder or a zip.
    Projections,
    /// **Photographs from a turntable** ([`Turntable`](crate::Turntable)): no cameras at all.
    Turntable,
    /// **Pixel2Mesh's samples**, and its ellipsoid: see [`pixel2mesh`](crate::pixel2mesh).
    Pixel2Mesh,
    /// **Pix3D** ([`Pix3d`](crate::Pix3d)): `pix3d.json`, or Mesh R-CNN's `pix3d_s{1,2}_{train,test}.json`; an object
    /// is a model, its views the photographs of it.
    Pix3d,
    /// **Pascal3D+** ([`Pascal3d`](crate::Pascal3d)): `Annotations/<class>_{imagenet,pascal}/*.mat`; an object is
    /// what is annotated in an image. Masks only where VOC has them. The lists of `Image_sets` and of VOC are the subsets.
    Pascal3d,
    /// **CUB with CMR's cache** ([`Cub`](crate::Cub)): `data/{train,val,test}_cub_cleaned.mat` and `sfm`;
    /// weak-perspective cameras in pixels of the whole image.
    Cub,
    /// **MCMR's form of Pascal3D+** ([`Mcmr`](crate::Mcmr)): `<class>/annotations/*.yaml` and the masks beside.
    Mcmr,
    /// Made in memory, never on disk.
    Memory,
}

impl Layout {
    /// What the layout's poses are; nothing where it has angles, or matrices that are no poses.
    pub fn convention(self) -> Option<Convention> {
        use CameraAxes::{OpenCv, OpenGl};
        use PoseDirection::{CameraToWorld, WorldToCamera};
        match self {
            Self::Transforms => Some((OpenGl, CameraToWorld)),
            Self::KaolinFolder | Self::KaolinZip | Self::Photos => Some((OpenGl, WorldToCamera)),
            Self::Colmap | Self::Bop | Self::Middlebury => Some((OpenCv, WorldToCamera)),
            _ => None,
        }
    }
}

impl std::fmt::Display for Layout {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::KaolinFolder => "kaolin synthetic views (folder)",
            Self::KaolinZip => "kaolin synthetic views (zip)",
            Self::Transforms => "transforms.json",
            Self::R2n2 => "ShapeNet with R2N2 renderings",
            Self::Colmap => "COLMAP model",
            Self::Bop => "BOP scene",
            Self::Photos => "photographs with cameras.json",
            Self::Middlebury => "Middlebury multi-view stereo",
            Self::Projections => "projection matrices",
            Self::Turntable => "turntable photographs",
            Self::Pixel2Mesh => "Pixel2Mesh .dat",
            Self::Pix3d => "Pix3D",
            Self::Pascal3d => "Pascal3D+",
            Self::Cub => "CUB with CMR's cache",
            Self::Mcmr => "MCMR's preprocessed Pascal3D+",
            Self::Memory => "made in memory",
        })
    }
}

impl View {
    /// How many pixels show the object.
    pub fn mask_pixels(&self) -> usize {
        self.mask.data.iter().filter(|&&m| m != 0).count()
    }

    /// The smallest rectangle that holds the object: first row, first column, height, width.
    ///
    /// `None` where the mask is empty.
    pub fn mask_bounds(&self) -> Option<[usize; 4]> {
        let (height, width) = (self.mask.height, self.mask.width);
        let row_has = |i: usize| self.mask.data[i * width..(i + 1) * width].iter().any(|&m| m != 0);
        let top = (0..height).find(|&i| row_has(i))?;
        let bottom = (top..height).rev().find(|&i| row_has(i))?;
        let (mut left, mut right) = (width, 0);
        for row in self.mask.data[top * width..(bottom + 1) * width].chunks_exact(width) {
            if let Some(first) = row.iter().position(|&m| m != 0) {
                left = left.min(first);
            }
            if let Some(last) = row.iter().rposition(|&m| m != 0) {
                right = right.max(last);
            }
        }
        Some([top, left, bottom + 1 - top, right + 1 - left])
    }

    /// The view averaged down so that its longer side has at most this many pixels; a part of an image is one by itself then.
    ///
    /// A pixel of the smaller mask is object where at least half of it was; depth is taken from
    /// the nearest pixel, because averages across an edge lie in the air.
    #[must_use]
    pub fn at_most(self, longest: usize) -> Self {
        let (height, width) = (self.color.height, self.color.width);
        if height.max(width) <= longest || longest == 0 {
            return self;
        }
        let [h, w] = self.color.size_within(longest);
        let mut mask = self.mask.resized(h, w);
        mask.data.iter_mut().for_each(|m| *m = if *m >= 128 { 255 } else { 0 });
        let depth = self.depth.map(|depth| depth.resized(h, w));
        let (color, camera) = (self.color.resized(h, w), self.camera.resized(w, h));
        Self { name: self.name, color, mask, camera, depth, crop: None }
    }

    /// The mask of the whole image, averaged down so that its longer side has at most this many pixels, object where at least half of it was,
    /// and the camera of it: `camera`, which is of the view's size, brought to that of the mask.
    pub fn mask_within(&self, longest: usize, camera: &Camera) -> (Mask, Camera) {
        let (mask, camera) = (self.whole_mask(), self.whole_camera(camera));
        let [height, width] = mask.size_within(longest);
        if [height, width] == [mask.height, mask.width] {
            return (Mask::at_least(&mask, 128), camera.into_owned());
        }
        (Mask::at_least(&mask.resized(height, width), 128), camera.resized(width, height))
    }

    /// The object's colours, `[H, W, 3]`, with one colour where the mask has none.
    pub fn over(&self, background: [u8; 3]) -> ByteImage {
        let mut color = self.color.clone();
        for (pixel, &mask) in color.data.chunks_exact_mut(3).zip(&self.mask.data) {
            if mask == 0 {
                pixel.copy_from_slice(&background);
            }
        }
        color
    }

    /// Bytes of pixels that this view holds.
    pub fn bytes(&self) -> usize {
        let depth = self.depth.as_ref().map_or(0, |d| d.data.len() * 4);
        self.color.data.len() + self.mask.data.len() + depth
    }
}

impl Views {
    /// Views that are in no file.
    pub fn in_memory(views: Vec<View>) -> Self {
        let (source, layout) = ("memory".into(), Layout::Memory);
        Self { views, source, layout, warnings: Vec::new(), test: Vec::new() }
    }

    /// How many views there are.
    pub fn len(&self) -> usize {
        self.views.len()
    }

    /// Whether there is no view at all, which no reader returns.
    pub fn is_empty(&self) -> bool {
        self.views.is_empty()
    }

    /// Bytes of pixels that all views hold.
    pub fn bytes(&self) -> usize {
        self.views.iter().map(View::bytes).sum()
    }
}
