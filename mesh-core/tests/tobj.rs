//! Why OBJ files are not read by the crate `tobj`: what people with real files would lose.
//!
//! Each test shows one loss that cannot be mended around the crate without going through the lines of the
//! file oneself, which is what a reader is. Where a test fails because a later version of the crate does
//! better, its claim is to be struck out, here and in the README.
#![allow(clippy::unwrap_used, clippy::print_stdout, reason = "tests")]

mod counting;

use std::fs;

use counting::{alone, limit, peak};
use mesh_core::TriMesh;
use mesh_core::io::obj;
use tobj::{LoadError, LoadOptions, LoadResult};

/// The options under which it comes closest to one mesh with shared vertices.
const OPTIONS: LoadOptions =
    LoadOptions { single_index: false, triangulate: true, ignore_points: true, ignore_lines: true };

fn theirs(bytes: &[u8]) -> LoadResult {
    tobj::load_obj_buf(&mut &bytes[..], &OPTIONS, |_| Err(LoadError::OpenFileFailed))
}

fn refused(bytes: &[u8]) -> LoadError {
    theirs(bytes).unwrap_err()
}

fn ours(bytes: &[u8]) -> TriMesh {
    let mesh = obj::decode(bytes, "a.obj").unwrap();
    mesh.validate().unwrap();
    mesh
}

const TRIANGLE: &str = "v 0 0 0\nv 1 0 0\nv 0 1 0\n";

/// Templates, correspondences and meshes of one topology name vertices by their place in the file.
#[test]
fn vertices_lose_their_order_and_the_unused_are_lost() {
    let text = b"v 9 9 9\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 4 3 2\n";
    let mesh = ours(text);
    assert_eq!((mesh.positions.len(), mesh.positions[0]), (4, [9.0; 3]));
    assert_eq!(mesh.faces, [[3, 2, 1]]);
    let (models, _) = theirs(text).unwrap();
    assert_eq!(models[0].mesh.positions, [0.0, 1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
    assert_eq!(models[0].mesh.indices, [0, 1, 2]);
}

/// Exporters begin groups and materials in the middle of a surface.
#[test]
fn closed_surfaces_are_torn_where_a_group_or_a_material_begins() {
    let vertices = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\n";
    let text = format!("{vertices}g below\nf 1 3 2\nf 1 2 4\ng above\nf 2 3 4\nf 3 1 4\n");
    assert!(ours(text.as_bytes()).health().is_watertight());
    let (models, _) = theirs(text.as_bytes()).unwrap();
    assert_eq!(models.len(), 2);
    let places: usize = models.iter().map(|m| m.mesh.positions.len() / 3).sum();
    assert_eq!(places, 8, "the four vertices of a tetrahedron");
}

/// It lists colours apart from vertices, so those after one without take the next one's.
#[test]
fn colors_move_where_some_vertices_have_none() {
    let text = b"v 0 0 0\nv 1 0 0 1 0 0\nv 0 1 0 0 1 0\nv 1 1 0 0 0 1\nf 1 2 3\nf 2 4 3\n";
    let colors = ours(text).colors.unwrap();
    assert_eq!(colors, [[1.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]);
    assert_eq!(refused(text), LoadError::FaceColorOutOfBounds);
    let (models, _) = theirs(&text[..text.len() - "f 2 4 3\n".len()]).unwrap();
    assert_eq!(models[0].mesh.vertex_color[..3], [1.0, 0.0, 0.0], "of the vertex without one");
}

#[test]
fn files_of_many_programs_are_refused() {
    let plain = ours(format!("{TRIANGLE}f 1 2 3\n").as_bytes());
    let with = |rest: &str| format!("{TRIANGLE}{rest}").into_bytes();
    for (what, text, error) in [
        (
            "CR line ends",
            b"v 0 0 0\rv 1 0 0\rv 0 1 0\rf 1 2 3\r".to_vec(),
            LoadError::ColorParseError,
        ),
        (
            "names in Latin-1",
            [b"o Tisch\xfc\n", &with("f 1 2 3\n")[..]].concat(),
            LoadError::ReadError,
        ),
        ("a line that goes on", with("f 1 2 \\\n3\n"), LoadError::FaceParseError),
        ("a comment behind a face", with("f 1 2 3 # the only one\n"), LoadError::FaceParseError),
        (
            "no number of Windows",
            with("vt -1.#IND 0\nf 1/1 2/1 3/1\n"),
            LoadError::TexcoordParseError,
        ),
        ("one texture coordinate", with("vt 0.5\nf 1/1 2/1 3/1\n"), LoadError::TexcoordParseError),
        (
            "no texture coordinate there",
            with("vt 0 0\nf 1/1 2/9 3/1\n"),
            LoadError::FaceTexCoordOutOfBounds,
        ),
        ("no normal there", with("vn 0 0 1\nf 1//1 2//9 3//1\n"), LoadError::FaceNormalOutOfBounds),
        (
            "a weight of zero",
            b"v 0 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n".to_vec(),
            LoadError::ScalingByZeroError,
        ),
        (
            "a colour with alpha",
            b"v 0 0 0 1 1 1 1\nv 1 0 0\nv 0 1 0\nf 1 2 3\n".to_vec(),
            LoadError::ColorParseError,
        ),
        ("a line of no corner", with("f\nf 1 2 3\n"), LoadError::InvalidPolygon),
        ("a material without a name", with("usemtl\nf 1 2 3\n"), LoadError::MaterialParseError),
        (
            "a group before its vertices",
            b"f 1 2 3\ng a\nv 0 0 0\nv 1 0 0\nv 0 1 0\n".to_vec(),
            LoadError::FaceVertexOutOfBounds,
        ),
        // The first vertex is behind the mark, and not seen.
        (
            "a byte order mark",
            [b"\xef\xbb\xbf", &with("f 1 2 3\n")[..]].concat(),
            LoadError::FaceVertexOutOfBounds,
        ),
    ] {
        let mesh = ours(&text);
        assert_eq!((&mesh.positions, &mesh.faces), (&plain.positions, &plain.faces), "{what}");
        assert_eq!(refused(&text), error, "{what}");
    }
}

/// What is wrong with a file is told without where.
#[test]
fn mistakes_have_no_line_and_some_are_taken() {
    let text = format!("{TRIANGLE}f 1 2 3\nf 1 2 x\n");
    let error = obj::decode(text.as_bytes(), "a.obj").unwrap_err().to_string();
    assert!(error.contains("a.obj:5") && error.contains("\"x\""), "{error}");
    assert_eq!(refused(text.as_bytes()).to_string(), "face parse error");
    let text = b"v 0 0 0\nv nan 0 0\nv 0 inf 0\nf 1 2 3\n";
    assert!(obj::decode(text, "a.obj").unwrap_err().to_string().contains("a.obj:2"));
    assert!(theirs(text).unwrap().0[0].mesh.positions[3].is_nan());
}

/// Small mistakes end the program instead of the reading.
#[test]
fn some_files_make_it_panic() {
    let folder = tempfile::tempdir().unwrap();
    let file = |name: &str, text: &str| {
        let path = folder.path().join(name);
        fs::write(&path, text).unwrap();
        path
    };
    file("short.mtl", "newmtl a\nKd 1 0\n");
    let short = file("short.obj", &format!("mtllib short.mtl\n{TRIANGLE}f 1 2 3\n"));
    assert_eq!(obj::read(&short).unwrap().faces.len(), 1);
    let result = std::panic::catch_unwind(|| tobj::load_obj(&short, &OPTIONS).map(drop));
    assert!(result.is_err(), "a colour of two numbers");
}

/// A library may name any file of the machine, and `tobj` opens it.
#[test]
fn libraries_are_not_confined_to_the_folder() {
    let place = tempfile::tempdir().unwrap();
    let inner = place.path().join("inner");
    fs::create_dir(&inner).unwrap();
    fs::write(place.path().join("secret.mtl"), "newmtl a\nKd 1 0 0\n").unwrap();
    let path = inner.join("a.obj");
    fs::write(&path, format!("mtllib ../secret.mtl\n{TRIANGLE}usemtl a\nf 1 2 3\n")).unwrap();
    let mut remarks = Vec::new();
    obj::read_with(&path, &mesh_core::Limits::default(), &mut remarks).unwrap();
    assert!(remarks[0].to_string().contains("secret.mtl\" not read"), "{}", remarks[0]);
    let (_, materials) = tobj::load_obj(&path, &OPTIONS).unwrap();
    assert_eq!(materials.unwrap()[0].diffuse, Some([1.0, 0.0, 0.0]));
}

/// Whatever a file holds, our reader holds at most 256 MB and 20 bytes for each of its own.
#[test]
fn memory_is_out_of_proportion() {
    let _alone = alone();
    let text = [TRIANGLE.as_bytes(), &b"f 1\n".repeat(3_000_000), b"f 1 2 3\n"].concat();
    let most = limit(text.len());
    let (own, mesh) = peak(|| ours(&text));
    assert_eq!(mesh.faces.len(), 1);
    assert!(own < most / 10, "{own} of {most}");
    let (taken, _) = peak(|| theirs(&text).unwrap());
    assert!(taken > most, "{taken} of {most}");
}

#[test]
#[ignore = "needs UNSPHERE_DATA"]
fn real_files_lose_their_order_of_vertices() {
    let folder = std::path::PathBuf::from(std::env::var("UNSPHERE_DATA").unwrap());
    for name in
        ["meshes/avocado.obj", "meshes/cow/cow.obj", "meshes/spot.obj", "rendered_clock/sphere.obj"]
    {
        let bytes = fs::read(folder.join(name)).unwrap();
        let position = |line: &str| -> [f32; 3] {
            let numbers: Vec<f32> = line.split_whitespace().map(|w| w.parse().unwrap()).collect();
            numbers.try_into().unwrap()
        };
        let text = std::str::from_utf8(&bytes).unwrap();
        let listed: Vec<[f32; 3]> =
            text.lines().filter_map(|line| line.strip_prefix("v ")).map(position).collect();
        let start = std::time::Instant::now();
        let mesh = ours(&bytes);
        let (own, start) = (start.elapsed(), std::time::Instant::now());
        let (models, _) = theirs(&bytes).unwrap();
        println!("{name}: {own:?}, tobj {:?}, {} models", start.elapsed(), models.len());
        assert_eq!(mesh.positions, listed, "{name}");
        let theirs: Vec<f32> = models.into_iter().flat_map(|m| m.mesh.positions).collect();
        assert!(theirs.as_chunks().0 != listed, "{name}");
    }
}
