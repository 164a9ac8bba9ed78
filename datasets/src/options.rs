//! How views are read.

use std::path::PathBuf;

use mesh_core::Limits;
use serde::{Deserialize, Serialize};

use crate::convention::{CameraAxes, PoseDirection};

/// How views are read. The default takes what the layout offers and refuses what is incomplete.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
#[allow(clippy::struct_excessive_bools, reason = "each is a switch of its own")]
pub struct ReadOptions {
    /// Where masks come from.
    pub mask: MaskSource,
    /// A folder of masks, named as their images are, or `<stem>_mask`, `<stem>_seg`, `<image>.png`; goes before [`mask`](Self::mask).
    pub masks: Option<PathBuf>,
    /// Whether only the largest part of a mask that hangs together is the object.
    pub largest_part: bool,
    /// Whether background that a mask surrounds on all sides is object.
    pub fill_holes: bool,
    /// By how many pixels masks are dilated, with a disk, before the two above; 0 leaves them.
    pub dilate: usize,
    /// By how many pixels masks are eroded after that: as much as they were dilated is a closing.
    pub erode: usize,
    /// The only views that are read, by their names or their images' file names ([`is_called`](crate::is_called)); `None` reads all.
    pub only: Option<Vec<String>>,
    /// Views that are not read, by names like those; what cannot be read of them is no error.
    pub except: Vec<String>,
    /// Rows above and below, columns left and right that are no part of a scene with a plain backdrop: bars of a video. Found by
    /// itself where [`MaskSource::Backdrop`] has no colour.
    pub bars: [usize; 4],
    /// Whether masks of files and of alpha mark the background instead of the object.
    pub invert: bool,
    /// What lies behind pixels that are not opaque, sRGB.
    pub background: [u8; 3],
    /// Views larger than this, in pixels of the longer side, are averaged down to it.
    pub max_size: Option<usize>,
    /// Whether depth is read where the layout has it.
    pub depth: bool,
    /// Whether the distortion of lenses is undone; where it is not, a view's camera is the pinhole for which its file
    /// states the distortion.
    pub undistort: bool,
    /// Whether views with missing files, or without a mask, are left out, with a warning, instead of refused.
    pub allow_missing: bool,
    /// How many bytes the pixels of all views may take together, as they are kept ([`margin`](Self::margin)). The whole image of each view
    /// that is being read, one a thread, comes on top.
    pub memory_limit: u64,
    /// Whether views that would take more are averaged down together until they do not, with a warning, instead of refused.
    pub shrink_to_limit: bool,
    /// Which object is meant where there are several: its name, or `category/name`.
    pub object: Option<String>,
    /// How photographs without cameras were taken.
    pub turntable: Option<Turntable>,
    /// How much memory each file may make its reader take, where the views of one object are read
    /// from a folder, an archive or a list of them. What a dataset of many objects lists is held to
    /// the default, and its objects' views to this.
    #[serde(skip)]
    pub limits: Limits,
    /// Axes of the cameras, where they are not those that the layout has.
    pub axes: Option<CameraAxes>,
    /// Direction of the poses, where it is not the one that the layout has.
    pub poses: Option<PoseDirection>,
    /// What focal lengths are multiplied by, above 0.
    pub focal_scale: Option<f64>,
    /// What is kept of a view around its object, as a share of the longer side of the object's box
    /// ([`View::cropped_to_object`](crate::View::cropped_to_object)); `None` keeps all.
    #[serde(skip)]
    pub margin: Option<f64>,
    /// What becomes of views whose masks are all empty, or whose cameras look elsewhere.
    pub on_inconsistent: OnInconsistent,
}

/// What becomes of views that together make no sense, although each can be read.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum OnInconsistent {
    /// They are refused.
    #[default]
    Refuse,
    /// They are read: somebody wants to find out what is wrong with them.
    Accept,
}

/// Photographs of an object on a turntable: one after another, by equal angles, once around.
///
/// The world's origin is the point on the axis that the camera looks at, +Y is the axis, and the
/// first photograph is taken from +Z. The object turns clockwise seen from above, which is as if
/// the camera went round it counter-clockwise.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Turntable {
    /// How many photographs make a full turn.
    pub count: usize,
    /// How far above the object the camera stands, degrees, -90 to 90.
    pub elevation: f64,
    /// How far from the axis's point the camera stands; the unit of the mesh.
    pub distance: f64,
    /// Full vertical angle of view, degrees, between 0 and 180.
    pub fov: f64,
    /// Whether the object turns counter-clockwise seen from above instead.
    #[serde(default)]
    pub reverse: bool,
}

/// Where the masks of the object come from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum MaskSource {
    /// Files where the layout has them, else alpha where it is not opaque everywhere.
    #[default]
    Auto,
    /// The alpha channel: at least half opaque is object.
    Alpha,
    /// Every pixel is object, and nothing is checked: for when only images or cameras matter.
    Whole,
    /// Files of the layout: `_semantic.npy`, `mask_path`, or `masks/` beside the images.
    Files,
    /// Everything that differs from a plain backdrop; of that, the largest connected part.
    Backdrop {
        /// The backdrop's colour; `None` takes the median of the image's border.
        color: Option<[u8; 3]>,
        /// How far a channel may differ from it and still be backdrop.
        tolerance: u8,
    },
    /// What all views together show before whatever lies behind it, by its colours and by the cameras:
    /// [`segment_by_color`](crate::segment_by_color).
    ColorModel,
}

impl ReadOptions {
    /// Whether masks hold all pixels while views are read, so that they say nothing of the object.
    pub(crate) fn takes_all_pixels(&self) -> bool {
        self.masks.is_none() && matches!(self.mask, MaskSource::Whole | MaskSource::ColorModel)
    }

    /// Whether the layout's files of masks are taken.
    pub(crate) fn reads_mask_files(&self) -> bool {
        self.masks.is_none() && matches!(self.mask, MaskSource::Auto | MaskSource::Files)
    }
}

impl Default for ReadOptions {
    fn default() -> Self {
        Self {
            mask: MaskSource::Auto,
            masks: None,
            largest_part: false,
            fill_holes: false,
            dilate: 0,
            erode: 0,
            only: None,
            except: Vec::new(),
            bars: [0; 4],
            invert: false,
            background: [0; 3],
            max_size: None,
            depth: false,
            undistort: true,
            allow_missing: false,
            memory_limit: 8 << 30,
            shrink_to_limit: false,
            object: None,
            turntable: None,
            limits: Limits::default(),
            axes: None,
            poses: None,
            focal_scale: None,
            margin: None,
            on_inconsistent: OnInconsistent::Refuse,
        }
    }
}
