//! What is said where no layout of views is recognised: what is there instead, and what to do with it.

use std::path::Path;

use crate::error::{ReadViewsError, ViewsProblem};
use crate::source::{Source, names_of};

/// Every layout by the files that give it away.
const LOOKED_FOR: &str = "looked for 0_rgb.png with 0_metadata.json (kaolin's views), transforms.json \
    or transforms_{train,val,test}.json, cameras.json (photographs), <name>_par.txt (Middlebury), \
    cameras_sphere.npz or cameras.npz (NeuS), projections.txt or txt (projection matrices), cameras \
    and images as .bin or .txt in sparse/0, sparse or here (COLMAP), each in a folder or a zip; \
    scene_camera.json in the folders of scenes (BOP); rendering/rendering_metadata.txt (R2N2); \
    .dat (Pixel2Mesh); pix3d.json; Annotations (Pascal3D+); CMR's cache for CUB; annotations/*.yaml \
    (MCMR); for pictures from a turntable say so (--turntable); photographs without cameras get them by `unsphere capture`";

const MESHES: [&str; 7] = ["obj", "ply", "glb", "gltf", "stl", "off", "3mf"];
const IMAGES: [&str; 3] = ["png", "jpg", "jpeg"];
/// Images that browsers and telephones make, and that are not read.
const OTHER_IMAGES: [&str; 9] =
    ["gif", "webp", "bmp", "tif", "tiff", "heic", "heif", "avif", "dng"];
/// What cameras of whatever form are written in.
const RECORDS: [&str; 9] = ["json", "txt", "npz", "npy", "bin", "csv", "xml", "yaml", "yml"];

const FOR_MESHES: &str = "expected views, a folder of images with cameras (docs/views.md); a mesh is for `unsphere fit --truth`, \
    `unsphere render` and `unsphere data generate --from`";
const FOR_MANY_MESHES: &str = "expected views, images with cameras (docs/views.md): `unsphere data generate --from` makes a dataset of \
    views of such a folder; `unsphere check` and `unsphere render` take one mesh";
const FOR_ONE_IMAGE: &str = "expected a folder of views with cameras (docs/views.md); one image is enough for `unsphere predict` with \
    pixel2mesh, ode-pixel2mesh or mcmr";
const FOR_OTHER_IMAGES: &str = "expected PNG or JPEG, no other images are read: convert them";
const FOR_IMAGES: &str = "expected cameras beside them: `unsphere capture` finds some, docs/views.md says in which layouts they are \
    read, --turntable makes some for pictures from a turntable";
const FOR_NOTHING: &str = "expected views, images with cameras (docs/views.md)";

/// The error of a folder or a file without views, but not without anything.
pub(crate) fn unknown(path: &Path) -> ReadViewsError {
    if path.is_file() {
        return of_file(path, "a file that holds none of these");
    }
    let names = match Source::folder(path).root_names() {
        Ok(names) => names,
        Err(error) => return error,
    };
    let (found, remedy) = of_folder(path, &names);
    because(path, found, remedy)
}

/// The error of a file whose name may say what it is; `otherwise` is what is known of it where it does not.
pub(crate) fn of_file(path: &Path, otherwise: &str) -> ReadViewsError {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let is = |extensions: &[&str]| ends_in(&name, extensions);
    let (found, remedy) = if is(&MESHES) {
        ("a mesh", FOR_MESHES)
    } else if is(&IMAGES) {
        ("one image", FOR_ONE_IMAGE)
    } else if is(&OTHER_IMAGES) {
        ("an image of another kind", FOR_OTHER_IMAGES)
    } else {
        (otherwise, LOOKED_FOR)
    };
    because(path, found.to_owned(), remedy)
}

/// The error that names all that was looked for.
pub(crate) fn looked_for(path: &Path, found: String) -> ReadViewsError {
    because(path, found, LOOKED_FOR)
}

/// What is in a folder, and what to do with it.
fn of_folder(path: &Path, names: &[String]) -> (String, &'static str) {
    let [first, ..] = names else {
        return ("an empty folder, there is nothing in it".to_owned(), FOR_NOTHING);
    };
    let inner = names_of(&path.join("images")).unwrap_or_default();
    let all = || names.iter().chain(&inner).map(String::as_str);
    let of = |extensions: &'static [&str]| all().filter(move |name| ends_in(name, extensions));
    // Where each has an image, as most, they are its textures.
    let meshes: Vec<&str> = of(&MESHES).collect();
    if !meshes.is_empty() && of(&IMAGES).count() <= meshes.len() {
        let found = match meshes.as_slice() {
            [first, .., last] => format!("{} meshes from {first} to {last}", meshes.len()),
            _ => format!("the mesh {}", meshes[0]),
        };
        return (found, FOR_MANY_MESHES);
    }
    if of(&RECORDS).next().is_none() {
        let images: Vec<&str> = of(&IMAGES).collect();
        if let [first, .., last] = images.as_slice() {
            let found = format!("{} images from {first} to {last} without cameras", images.len());
            return (found, FOR_IMAGES);
        }
        if let [only] = images.as_slice() {
            return (format!("the image {only} without a camera"), FOR_IMAGES);
        }
        if let Some(first) = of(&OTHER_IMAGES).next() {
            return (format!("images of another kind, like {first}"), FOR_OTHER_IMAGES);
        }
    }
    let found = match names {
        [.., last] if names.len() > 1 => format!("{} files from {first} to {last}", names.len()),
        _ => first.clone(),
    };
    (found, LOOKED_FOR)
}

fn ends_in(name: &str, extensions: &[&str]) -> bool {
    let extension = Path::new(name).extension().and_then(|extension| extension.to_str());
    extension.is_some_and(|found| extensions.iter().any(|e| e.eq_ignore_ascii_case(found)))
}

fn because(path: &Path, found: String, remedy: &str) -> ReadViewsError {
    ReadViewsError::new(path, ViewsProblem::UnknownLayout { found, remedy: remedy.to_owned() })
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use crate::open;

    /// What is said of a file of this name, and of a folder with files of these names.
    fn said(names: &[&str], opened: &str) -> String {
        let folder = tempfile::tempdir().unwrap();
        std::fs::create_dir(folder.path().join("images")).unwrap();
        if !names.iter().any(|name| name.starts_with("images/")) {
            std::fs::remove_dir(folder.path().join("images")).unwrap();
        }
        for name in names {
            std::fs::write(folder.path().join(name), "x").unwrap();
        }
        open(&folder.path().join(opened)).unwrap_err().to_string()
    }

    #[test]
    fn files_that_are_no_views_are_called_by_their_kind() {
        for (name, words) in [
            ("a.ply", ["a mesh", "--truth"]),
            ("a.GLB", ["a mesh", "unsphere render"]),
            ("a.png", ["one image", "ode-pixel2mesh"]),
            ("a.JPG", ["one image", "docs/views.md"]),
            ("a.heic", ["of another kind", "PNG or JPEG"]),
            ("a.webp", ["of another kind", "convert"]),
        ] {
            let text = said(&[name], name);
            assert!(words.iter().all(|word| text.contains(word)), "{text}");
            assert!(text.contains(name) && !text.contains("Middlebury"), "{text}");
        }
        assert!(said(&["a.dbf"], "a.dbf").contains("Middlebury"));
    }

    #[test]
    fn folders_without_cameras_are_told_from_unknown_ones() {
        let empty = said(&[], ".");
        assert!(empty.contains("an empty folder") && !empty.contains("Middlebury"), "{empty}");
        for names in [&["0.png", "1.png"][..], &["images/0.jpg", "images/1.jpg"], &["0.png"]] {
            let text = said(names, ".");
            assert!(text.contains("without ") && text.contains("unsphere capture"), "{text}");
            assert!(text.contains("docs/views.md") && !text.contains("Middlebury"), "{text}");
        }
        for names in [
            &["a.obj", "a.mtl", "a.png", "b.ply", "notes.txt"][..],
            &["a.GLB", "b.glb"],
            &["images/a.stl", "images/b.stl"],
        ] {
            let text = said(names, ".");
            assert!(text.contains("2 meshes from ") && text.contains("generate --from"), "{text}");
            assert!(!text.contains("Middlebury"), "{text}");
        }
        let photographed = said(&["0.png", "1.png", "truth.ply"], ".");
        assert!(photographed.contains("unsphere capture"), "{photographed}");
        let telephone = said(&["0.HEIC", "1.HEIC"], ".");
        assert!(telephone.contains("0.HEIC") && telephone.contains("JPEG"), "{telephone}");
        // Cameras of a form that is not known are not missing.
        let other = said(&["0.png", "1.png", "poses.csv"], ".");
        assert!(other.contains("3 files") && other.contains("Middlebury"), "{other}");
    }
}
