//! Mesh files as people and their programs write them: what is read, what is left out, what is refused.
#![allow(clippy::unwrap_used, reason = "tests")]

mod samples;

use std::fs;

use mesh_core::io::{glb, obj, ply};
use mesh_core::{Limits, TriMesh, read_mesh};
use samples::{close, colored, corner_uvs, textured};

fn obj_of(text: &str) -> TriMesh {
    obj::decode(text.as_bytes(), "people.obj").unwrap()
}

#[test]
fn obj_polygons_negative_indices_and_mixed_corners() {
    let mesh = obj_of(
        "# a comment\r\no thing\r\nv 0 0 0\r\nv 1 0 0\r\nv 1 1 0\r\nv 0 1 0\r\nvt 0 0\r\n\
         vn 0 0 1\r\nf 1/1/1 2//1 3 4/1\r\nf -4 -3/-1 \\\r\n -2//-1\r\ns off\r\nl 1 2\r\ng x\r\n",
    );
    assert_eq!(mesh.positions.len(), 4);
    assert_eq!(mesh.faces, [[0, 1, 2], [0, 2, 3], [0, 1, 2]]);
    assert_eq!(mesh.colors, None);
}

#[test]
fn obj_weights_and_partly_colored_vertices() {
    let mesh = obj_of("v 0 0 0 1\nv 1 0 0 0.5 0.25 0\nv 1 1 0\nf 1 2 3 # end");
    assert_eq!(mesh.colors, Some(vec![[1.0; 3], [0.5, 0.25, 0.0], [1.0; 3]]));
    // A channel of 1 is nearly black there, and a vertex without a colour white.
    let bytes = obj_of("v 0 0 0 1 200 30\nv 1 0 0 0 0 0\nv 1 1 0\nf 1 2 3");
    close(
        &bytes.colors.unwrap(),
        &[[1.0 / 255.0, 200.0 / 255.0, 30.0 / 255.0], [0.0; 3], [1.0; 3]],
        1e-6,
    );
    let bytes = obj_of("v 0 0 0 255 0 51\nv 1 0 0 0 0 0\nv 1 1 0 102 0 0\nf 1 2 3");
    assert_eq!(bytes.colors, Some(vec![[1.0, 0.0, 0.2], [0.0; 3], [0.4, 0.0, 0.0]]));
}

#[test]
fn obj_faces_may_name_vertices_that_come_later() {
    let mesh = obj_of("f 1 2 3\nv 0 0 0\nv 1 0 0\nv 0 1 0");
    assert_eq!(mesh.faces, [[0, 1, 2]]);
}

/// An arrowhead whose fan from the first corner lies half outside.
#[test]
fn polygons_that_are_not_convex_keep_their_outline() {
    let obj = obj_of("f 2 3 4 1\nv 2 1 0\nv 0 2 0\nv 0.5 1 0\nv 0 0 0");
    let vertices = "2 1 0\n0 2 0\n0.5 1 0\n0 0 0\n";
    let off = format!("OFF\n4 1 0\n{vertices}4 0 1 2 3\n");
    let off = mesh_core::io::off::decode(off.as_bytes(), "arrow.off").unwrap();
    let ply = format!(
        "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\n\
         property float z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n\
         {vertices}4 1 2 3 0\n"
    );
    let ply = ply::decode(ply.as_bytes(), "arrow.ply").unwrap();
    assert_eq!(off.faces, [[0, 1, 2], [0, 2, 3]], "the fan from the tip will do");
    for mesh in [obj, ply, off] {
        assert!((mesh.area() - 1.5).abs() < 1e-6, "{}", mesh.area());
    }
}

/// What reading leaves out, as a program says it.
fn remarks_of(bytes: &[u8]) -> (TriMesh, Vec<String>) {
    let mut remarks = Vec::new();
    let mesh = obj::decode_with(bytes, "people.obj", &Limits::default(), &mut remarks).unwrap();
    mesh.validate().unwrap();
    (mesh, remarks.iter().map(ToString::to_string).collect())
}

#[test]
fn obj_faces_of_two_corners_are_left_out_and_counted() {
    let v = "v 0 0 0\nv 1 0 0\nv 0 1 0\n";
    let text = format!("{v}f 1 2\nf 1 2 3\nf 2 3\nf 1//1\nf\nf 1 1 2\nf 1 2 2 3\np 1\nl 1 2 3\n");
    let (mesh, remarks) = remarks_of(text.as_bytes());
    assert_eq!(mesh.faces, [[0, 1, 2], [0, 1, 2]]);
    let short = "4 faces of fewer than three corners left out (the first in line 4)";
    assert_eq!(remarks, [short, "2 triangles that name a vertex twice left out"]);
    // Another reader takes the same triangles of it.
    let options = tobj::LoadOptions { triangulate: true, ignore_lines: true, ..Default::default() };
    let (models, _) =
        tobj::load_obj_buf(&mut format!("{v}f 1 2\nf 1 2 3\nf 2 3\n").as_bytes(), &options, |_| {
            Err(tobj::LoadError::GenericFailure)
        })
        .unwrap();
    assert!(models.iter().any(|m| m.mesh.indices == [0, 1, 2]));
}

#[test]
fn obj_as_exporters_of_all_systems_write_it() {
    let plain = obj_of("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n");
    for text in [
        &b"\xef\xbb\xbfv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"[..],
        b"v 0 0 0\rv 1 0 0\rv 0 1 0\rf 1 2 3\r",
        b"# C:\\models\\\r\nv 0 0 0\r\nv 1 0 0\r\nv 0 1 0\r\nf 1 2 3 \\",
        b"o Tisch\xfc\nusemtl M\xe9tal\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1/1/1 2/2/2 3/3/3\n",
        b"v\t0 0 0\nv 1 0 0 1.0\nv 0 1 0\nvn 0 0 0\nf -3//-9 -2//7 -1//1\nl 1 2\np 1 2 3\n",
        b"v 0 0 0\nv 1 0 0\nv 0 1 0\nvt nan -1.#IND\nvt inf 1.#QNAN 0\nf 1/1 2/2 3/1\n",
        b"v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nf 1/0 2/9 3/-4\ncurv 0 1 1 2\nend\n",
    ] {
        let (mesh, remarks) = remarks_of(text);
        assert_eq!((&mesh, remarks.len()), (&plain, 0), "{:?}", String::from_utf8_lossy(text));
    }
}

#[test]
fn colors_of_materials_are_those_of_their_vertices() {
    let folder = tempfile::tempdir().unwrap();
    let library =
        "newmtl red\nKd 1 0 0\nnewmtl sky\nKd 0.25 0.5 1\nnewmtl odd\nKd spectral a.rfl\n";
    fs::write(folder.path().join("m.mtl"), library).unwrap();
    let corners = "mtllib m.mtl\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 2 2 2\n";
    let read = |faces: &str| {
        let file = folder.path().join("m.obj");
        fs::write(&file, format!("{corners}{faces}")).unwrap();
        let mut remarks = Vec::new();
        let mesh = obj::read_with(&file, &Limits::default(), &mut remarks).unwrap();
        (mesh.colors, remarks.iter().map(ToString::to_string).collect::<Vec<_>>())
    };
    let (red, sky, white) = ([1.0, 0.0, 0.0], [0.25, 0.5, 1.0], [1.0; 3]);
    let (colors, remarks) = read("usemtl red\nf 1 2 3\nusemtl sky\nf 1 3 4\n");
    assert_eq!(colors, Some(vec![red, red, red, sky, white]));
    assert_eq!(remarks, ["2 corners take the colour of another material at the same vertex"]);
    assert_eq!(read("usemtl odd\nf 1 2 3\nusemtl none\nf 1 3 4\n"), (None, vec![]));
}

#[test]
fn texture_coordinates_that_are_not_there_are_noted() {
    let folder = tempfile::tempdir().unwrap();
    let file = |name: &str, text: &str| fs::write(folder.path().join(name), text).unwrap();
    let image = textured().texture.unwrap().image.to_bytes();
    mesh_core::write_png(folder.path().join("t#1.png"), &image).unwrap();
    file("m.mtl", "newmtl wood#2\nmap_Kd t#1.png\nnewmtl steel\nmap_Kd gone.png\n");
    file(
        "a.obj",
        "mtllib m.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0.5 1\nusemtl steel\nf 1 2 3\n\
         usemtl wood#2\nf 1/1 2/7 3\n",
    );
    let mut remarks = Vec::new();
    let mesh =
        obj::read_with(folder.path().join("a.obj"), &Limits::default(), &mut remarks).unwrap();
    let texture = mesh.texture.as_ref().unwrap();
    assert_eq!(
        (&texture.uvs[..], &texture.faces[..]),
        (&[[0.5, 1.0], [0.0; 2]][..], &[[1; 3], [0, 1, 1]][..])
    );
    let lines: Vec<String> = remarks.iter().map(ToString::to_string).collect();
    assert_eq!(
        lines,
        [
            "\"gone.png\" not read: no such file",
            "5 corners take (0, 0) for want of texture coordinates"
        ]
    );
}

/// Two materials with images, one with a colour, one that is in no library, and one whose image is scaled and moved.
#[test]
fn every_material_of_an_obj_has_its_own_look() {
    let folder = tempfile::tempdir().unwrap();
    let file = |name: &str, text: &str| fs::write(folder.path().join(name), text).unwrap();
    let image = |name: &str, data: &[u8]| {
        let (width, data) = (data.len() / 3, data.to_vec());
        let image = mesh_core::ByteImage { height: 1, width, channels: 3, data };
        mesh_core::write_png(folder.path().join(name), &image).unwrap();
    };
    image("a.png", &[255, 0, 0, 0, 255, 0]);
    image("b.png", &[0, 0, 255]);
    let library = "newmtl a\nmap_Kd a.png\nnewmtl b\nmap_Kd b.png\nnewmtl c\nKd 0.2 0.4 0.6\n\
        newmtl d\nKd 1 0 0\nmap_Kd -s 0.5 1 1 -o 0.5 0 0 a.png\nnewmtl e\nKd 0 1 1\nmap_Kd e.tga\nnewmtl f\nmap_Kd f.png\n";
    file("m.mtl", library);
    fs::write(folder.path().join("f.png"), &fs::read(folder.path().join("a.png")).unwrap()[..40])
        .unwrap();
    file("e.tga", "an image of another kind");
    let head = "mtllib m.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 0.5 0\nvt 0.5 1\n";
    let read = |materials: &str| {
        let face = |c: char| format!("usemtl {c}\nf 1/1 2/2 3/3\n");
        let faces: String = materials.chars().map(face).collect();
        file("m.obj", &format!("{head}{faces}"));
        let mut remarks = Vec::new();
        let mesh = obj::read_with(folder.path().join("m.obj"), &Limits::default(), &mut remarks);
        let mesh = mesh.unwrap();
        mesh.validate().unwrap();
        (mesh, remarks.iter().map(ToString::to_string).collect::<Vec<_>>())
    };
    let (mesh, remarks) = read("abcxde");
    let texture = mesh.texture.unwrap();
    let at = |face, barycentric| {
        texture.color_at(&mesh_core::SurfacePoint { face, barycentric }).map(|c| (5.0 * c).round())
    };
    let middle = [0.5, 0.5, 0.0];
    let found: Vec<[f32; 3]> = (0..6).map(|face| at(face, middle)).collect();
    let (red, blue) = ([5.0, 0.0, 0.0], [0.0, 0.0, 5.0]);
    // The fifth has 0.5 to 0.75 of the first image: its middle is three quarters green.
    assert_eq!(found, [red, blue, [1.0, 2.0, 3.0], [5.0; 3], [1.0, 4.0, 0.0], [0.0, 5.0, 5.0]]);
    assert_eq!(remarks, ["\"e.tga\" not read: neither PNG nor JPEG"]);
    // A damaged one takes none of the others away.
    let (mesh, remarks) = read("afb");
    assert_eq!(
        mesh.texture.unwrap().color_at(&mesh_core::SurfacePoint { face: 2, barycentric: middle }),
        [0.0, 0.0, 1.0]
    );
    assert_eq!(remarks, ["1 other texture left out: damaged, or more than one mesh holds"]);
    // One image on all faces stays what it is.
    let (mesh, remarks) = read("aax");
    let texture = mesh.texture.unwrap();
    assert_eq!((texture.uvs.len(), texture.image.width, remarks.len()), (3, 2, 0));
    let (mesh, _) = read("d");
    let texture = mesh.texture.unwrap();
    assert_eq!((texture.uvs[2], texture.image.width), ([0.75, 1.0], 2));
}

#[test]
fn files_that_a_mesh_names_must_be_below_it() {
    let place = tempfile::tempdir().unwrap();
    let inner = place.path().join("inner");
    fs::create_dir_all(inner.join("tex")).unwrap();
    let image = textured().texture.unwrap().image.to_bytes();
    let secret = place.path().join("secret.png");
    for path in [&secret, &inner.join("tex/t.png"), &inner.join("t.png")] {
        mesh_core::write_png(path, &image).unwrap();
    }
    fs::write(place.path().join("m.mtl"), "newmtl a\nmap_Kd inner/t.png\n").unwrap();
    fs::write(inner.join("tex/up.mtl"), "newmtl a\nmap_Kd ../t.png\n").unwrap();
    #[cfg(unix)]
    std::os::unix::fs::symlink(&secret, inner.join("link.png")).unwrap();
    let absolute = secret.to_str().unwrap().to_owned();
    let read = |library: &str, map: &str, outside: bool| {
        fs::write(inner.join("own.mtl"), format!("newmtl a\nmap_Kd {map}\n")).unwrap();
        let text = format!("mtllib {library}\n{}", "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\n");
        fs::write(inner.join("a.obj"), format!("{text}usemtl a\nf 1/1 2/1 3/1\n")).unwrap();
        let limits = Limits { outside_links: outside, ..Limits::default() };
        let mut remarks = Vec::new();
        let mesh = obj::read_with(inner.join("a.obj"), &limits, &mut remarks).unwrap();
        (mesh.texture.is_some(), remarks.iter().map(ToString::to_string).collect::<String>())
    };
    // Below the folder of the mesh, by whatever way.
    for (library, map) in
        [("own.mtl", "tex/t.png"), ("own.mtl", "tex\\..\\t.png"), ("tex/up.mtl", "")]
    {
        assert_eq!(read(library, map, false), (true, String::new()), "{library} {map}");
    }
    let mut outside =
        vec![("own.mtl", "../secret.png"), ("own.mtl", absolute.as_str()), ("../m.mtl", "")];
    if cfg!(unix) {
        outside.push(("own.mtl", "link.png"));
    }
    for (library, map) in outside {
        let (textured, remark) = read(library, map, false);
        assert!(!textured && remark.contains("outside the folder of the mesh"), "{map}: {remark}");
        assert_eq!(read(library, map, true), (true, String::new()), "{library} {map}");
    }
    let ply = "ply\nformat ascii 1.0\ncomment TextureFile ../secret.png\nelement vertex 3\n\
        property float x\nproperty float y\nproperty float z\nproperty float u\nproperty float v\n\
        element face 1\nproperty list uchar int vertex_indices\nend_header\n\
        0 0 0 0 0\n1 0 0 0 0\n0 1 0 0 0\n3 0 1 2\n";
    fs::write(inner.join("a.ply"), ply).unwrap();
    let mut remarks = Vec::new();
    let mut read = |outside| {
        let limits = Limits { outside_links: outside, ..Limits::default() };
        ply::read_with(inner.join("a.ply"), &limits, &mut remarks).unwrap().texture.is_some()
    };
    assert!(!read(false) && read(true));
    assert_eq!(remarks.len(), 1);
}

#[test]
fn obj_errors_name_the_line_and_what_was_found() {
    let v = "v 0 0 0\nv 1 0 0\nv 0 1 0\n";
    for (text, line, found) in [
        ("f 1 2 4".to_owned(), 4, "index 4"),
        ("f 0 1 2".to_owned(), 4, "\"0\""),
        ("f 1 2 -4".to_owned(), 4, "\"-4\""),
        ("f 1/x 2 3".to_owned(), 4, "\"1/x\""),
        ("f 1 2 99999999999999999999".to_owned(), 4, "9999"),
        ("\nv 0 nan 0".to_owned(), 5, "\"nan\""),
        ("v 0 1".to_owned(), 4, "\"0 1\""),
        ("vt a".to_owned(), 4, "\"a\""),
    ] {
        let error = obj::decode(format!("{v}{text}").as_bytes(), "bad.obj").unwrap_err();
        let error = error.to_string();
        assert!(error.starts_with(&format!("bad.obj:{line}: ")), "{error}");
        assert!(error.contains(found) && error.contains("expected"), "{error}");
    }
}

#[test]
fn a_texture_that_is_not_there_is_noted_and_one_that_is_damaged_is_an_error() {
    let folder = tempfile::tempdir().unwrap();
    let file = |name: &str, text: &str| fs::write(folder.path().join(name), text).unwrap();
    file("a.obj", "mtllib my lib.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nusemtl m\nf 1/1 2/1 3\n");
    file("my lib.mtl", "newmtl m\nmap_Kd -s 1 1 1 none.png\n");
    let mut notes = Vec::new();
    let mesh = obj::read_with(folder.path().join("a.obj"), &Limits::default(), &mut notes).unwrap();
    assert!(mesh.texture.is_none() && notes[0].to_string().contains("none.png"), "{notes:?}");
    file("none.png", "no png");
    let mut notes = Vec::new();
    let mesh = obj::read_with(folder.path().join("a.obj"), &Limits::default(), &mut notes).unwrap();
    assert!(mesh.texture.is_none());
    assert_eq!(notes[0].to_string(), "\"none.png\" not read: neither PNG nor JPEG");
    let png = mesh_core::encode_png(&textured().texture.unwrap().image.to_bytes());
    fs::write(folder.path().join("none.png"), &png[..png.len() / 2]).unwrap();
    let error = read_mesh(folder.path().join("a.obj")).unwrap_err().to_string();
    assert!(error.contains("a.obj") && error.contains("none.png"), "{error}");
}

#[test]
fn ply_types_orders_polygons_and_strangers() {
    let header = "ply\r\nformat ascii 1.0\r\ncomment hello\r\nelement camera 1\r\n\
        property list uchar float view\r\nelement face 2\r\nproperty uchar flags\r\n\
        property list int uint vertex_index\r\nelement vertex 4\r\nproperty double z\r\n\
        property float nx\r\nproperty short y\r\nproperty int8 x\r\nproperty float red\r\n\
        property float green\r\nproperty float blue\r\nelement nothing 99999999999\r\nend_header\r\n";
    let body = "2 0.5 0.5\r\n7 4 0 1 2 3\r\n7 3 2 1 0\r\n\
        0.5 9 0 0 1 0 0\r\n0 9 0 1 0.5 0 0\r\n0 9 1 1 0 2 0\r\n0 9 1 0 0 0 1\r\n";
    let mesh = ply::decode(format!("{header}{body}").as_bytes(), "a.ply").unwrap();
    assert_eq!(mesh.positions[0], [0.0, 0.0, 0.5]);
    assert_eq!(mesh.positions[2], [1.0, 1.0, 0.0]);
    assert_eq!(mesh.faces, [[0, 1, 2], [0, 2, 3], [2, 1, 0]]);
    assert_eq!(mesh.colors.unwrap()[1..3], [[0.5, 0.0, 0.0], [0.0, 1.0, 0.0]]);
}

#[test]
fn ply_colors_are_bytes_in_any_kind_of_number() {
    let read = |kind: &str, colors: [&str; 3]| {
        let text = format!(
            "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n\
             property {kind} red\nproperty {kind} green\nproperty {kind} blue\nelement face 1\n\
             property list uchar int vertex_indices\nproperty uchar red\nend_header\n\
             0 0 0 {}\n1 0 0 {}\n0 1 0 {}\n3 0 1 2 9\n",
            colors[0], colors[1], colors[2]
        );
        let mut remarks = Vec::new();
        let mesh = ply::decode_with(text.as_bytes(), "a.ply", &Limits::default(), &mut remarks);
        assert_eq!(remarks[0].to_string(), "1 colour of a face left out");
        mesh.unwrap().colors.unwrap()
    };
    let bytes = vec![[1.0, 0.2, 0.0], [0.0; 3], [0.4, 0.4, 0.4]];
    for kind in ["uchar", "short", "ushort", "int", "uint", "float", "double"] {
        assert_eq!(read(kind, ["255 51 0", "0 0 0", "102 102 102"]), bytes, "{kind}");
    }
    for kind in ["ushort", "int", "uint"] {
        assert_eq!(read(kind, ["65535 13107 0", "0 0 0", "26214 26214 26214"]), bytes, "{kind}");
    }
    assert_eq!(read("float", ["1 0.2 0", "0 0 0", "0.4 0.4 0.4"]), bytes);
    // Dark bytes, and light above 1.
    assert_eq!(read("float", ["3 0 0", "0 0 0", "0 0 0"])[0], [3.0 / 255.0, 0.0, 0.0]);
    assert_eq!(read("float", ["20.5 0.2 0", "0 0 0", "0.4 0.4 0.4"]), bytes);
    assert_eq!(read("char", ["127 0 0", "0 0 0", "0 0 0"])[0], [1.0, 0.0, 0.0]);
}

#[test]
fn ply_strips_turn_every_other_triangle_and_begin_anew() {
    let head = |kind: &str, list: &str| {
        format!(
            "ply\nformat {kind} 1.0\nelement vertex 6\nproperty float x\nproperty float y\n\
             property float z\nelement tristrips 1\nproperty list int {list} vertex_indices\nend_header\n"
        )
    };
    let places = [[0, 0], [1, 0], [0, 1], [1, 1], [0, 2], [1, 2]];
    let rows = places.map(|[x, y]| format!("{x} {y} 0\n")).concat();
    // Two strips, and one that turns back over a vertex named twice.
    let strip = [0, 1, 2, 3, -1, 2, 3, 4, 5, -1, -1, 1, 0, 0, 2, 1];
    let words = strip.map(|i| format!(" {i}")).concat();
    let text = format!("{}{rows}{}{words}\n", head("ascii", "int"), strip.len());
    let mesh = ply::decode(text.as_bytes(), "strips.ply").unwrap();
    let faces = [[0, 1, 2], [2, 1, 3], [2, 3, 4], [4, 3, 5], [0, 2, 1]];
    assert_eq!(mesh.faces, faces);
    // All of the first four face the same way.
    for normal in &mesh_core::face_normals(&mesh.positions, &mesh.faces)[..4] {
        assert_eq!(*normal, [0.0, 0.0, 1.0]);
    }
    let mut bytes = head("binary_big_endian", "short").into_bytes();
    for [x, y] in places {
        bytes.extend([x as f32, y as f32, 0.0].map(f32::to_be_bytes).as_flattened());
    }
    bytes.extend((strip.len() as i32).to_be_bytes());
    bytes.extend(strip.map(|i| (i as i16).to_be_bytes()).as_flattened());
    assert_eq!(ply::decode(&bytes, "strips.ply").unwrap(), mesh);
    for (wrong, found) in [("-2", "-2"), ("6", "6"), ("1.5", "1.5")] {
        let text = text.replace(" 5 ", &format!(" {wrong} "));
        let error = ply::decode(text.as_bytes(), "strips.ply").unwrap_err().to_string();
        assert!(error.contains("strips.ply") && error.contains(found), "{error}");
    }
}

#[test]
fn ply_faces_of_two_corners_are_left_out_and_counted() {
    let text = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\n\
        property float z\nelement face 4\nproperty list uchar int vertex_indices\nend_header\n\
        0 0 0\n1 0 0\n0 1 0\n2 0 1\n3 0 1 2\n3 0 1 1\n0\n";
    let mut remarks = Vec::new();
    let mesh =
        ply::decode_with(text.as_bytes(), "a.ply", &Limits::default(), &mut remarks).unwrap();
    assert_eq!(mesh.faces, [[0, 1, 2]]);
    let lines: Vec<String> = remarks.iter().map(ToString::to_string).collect();
    let short = "2 faces of fewer than three corners left out (the first in line 12)";
    assert_eq!(lines, [short, "1 triangle that names a vertex twice left out"]);
    let points = text.replace("element face 4", "element nothing 4");
    let mesh = ply::decode(points.as_bytes(), "a.ply").unwrap();
    let error = mesh.require_faces().unwrap_err().to_string();
    assert_eq!(error, "found 3 vertices and no faces, expected a surface");
}

#[test]
fn ply_big_endian_is_little_endian_turned_round() {
    let mut bytes = b"ply\nformat binary_big_endian 1.0\nelement vertex 3\nproperty float x\n\
        property float y\nproperty double z\nelement face 1\n\
        property list uchar ushort vertex_indices\nend_header\n"
        .to_vec();
    for v in [[0.0_f32, 0.0, 2.0], [1.0, 0.0, 0.0], [0.0, 1.5, 0.0]] {
        bytes.extend(v[0].to_be_bytes());
        bytes.extend(v[1].to_be_bytes());
        bytes.extend(f64::from(v[2]).to_be_bytes());
    }
    bytes.extend([3, 0, 0, 0, 1, 0, 2]);
    let mesh = ply::decode(&bytes, "a.ply").unwrap();
    assert_eq!(mesh.positions, [[0.0, 0.0, 2.0], [1.0, 0.0, 0.0], [0.0, 1.5, 0.0]]);
    assert_eq!(mesh.faces, [[0, 1, 2]]);
}

/// A texture that lies on some faces only is kept, and said.
#[test]
fn ply_faces_without_texture_coordinates_are_counted() {
    let folder = tempfile::tempdir().unwrap();
    mesh_core::write_png(folder.path().join("t.png"), &mesh_core::ByteImage::new(1, 1, 3)).unwrap();
    let text = "ply\nformat ascii 1.0\ncomment TextureFile t.png\nelement vertex 4\nproperty float x\n\
                property float y\nproperty float z\nelement face 2\nproperty list uchar int vertex_indices\n\
                property list uchar float texcoord\nend_header\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n\
                3 0 1 2 6 0 0 1 0 1 1\n3 0 2 3 0\n";
    let file = folder.path().join("m.ply");
    fs::write(&file, text).unwrap();
    let mut remarks = Vec::new();
    let mesh = ply::read_with(&file, &Limits::default(), &mut remarks).unwrap();
    assert_eq!(mesh.texture.unwrap().faces.len(), 2);
    assert!(remarks.len() == 1 && remarks[0].to_string().starts_with("3 corners"), "{remarks:?}");
}

#[test]
fn ply_textures_by_vertex_and_by_corner() {
    let folder = tempfile::tempdir().unwrap();
    let image = textured().texture.unwrap().image.to_bytes();
    mesh_core::write_png(folder.path().join("t.png"), &image).unwrap();
    let path = folder.path().join("m.ply");
    let vertices = "element vertex 3\nproperty float x\nproperty float y\nproperty float z\n";
    let start = "ply\nformat ascii 1.0\ncomment TextureFile t.png\n";
    let uv = "property float texture_u\nproperty float texture_v\n";
    let list = "element face 1\nproperty list uchar int vertex_indices\n";
    let corners = "property list uchar float texcoord\n";
    for text in [
        format!(
            "{start}{vertices}{uv}{list}end_header\n0 0 0 0 0.5\n1 0 0 1 0.5\n0 1 0 0 1\n3 0 1 2\n"
        ),
        format!(
            "{start}{vertices}{list}{corners}end_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2 6 0 0.5 1 0.5 0 1\n"
        ),
    ] {
        fs::write(&path, text).unwrap();
        let mesh = read_mesh(&path).unwrap();
        assert_eq!(corner_uvs(&mesh), [[0.0, 0.5], [1.0, 0.5], [0.0, 1.0]]);
        assert_eq!(mesh.texture.unwrap().image.to_bytes(), image);
    }
}

#[test]
fn headers_that_claim_terabytes_are_refused_at_once() {
    let header = |count: &str, kind: &str| {
        format!(
            "ply\nformat {kind} 1.0\nelement vertex {count}\nproperty float x\nproperty float y\n\
             property float z\nproperty list uint float w\nend_header\n"
        )
    };
    for kind in ["ascii", "binary_little_endian", "binary_big_endian"] {
        let text = header("1000000000000", kind);
        let error = ply::decode(text.as_bytes(), "huge.ply").unwrap_err().to_string();
        assert!(error.contains("huge.ply") && error.contains("end of the file"), "{error}");
    }
    let mut bytes = header("1", "binary_little_endian").into_bytes();
    bytes.extend([0; 12]);
    bytes.extend(u32::MAX.to_le_bytes());
    let error = ply::decode(&bytes, "huge.ply").unwrap_err().to_string();
    assert!(error.contains("length of a list"), "{error}");
    assert!(ply::decode(header("-1", "ascii").as_bytes(), "a.ply").is_err());
    assert!(ply::decode(header("1e30", "ascii").as_bytes(), "a.ply").is_err());

    let mut bytes = glb::encode(&colored()).unwrap();
    let at = bytes.windows(9).position(|w| w == b"\"count\":4").unwrap();
    bytes[at..at + 9].copy_from_slice(b"\"count\":9");
    let error = glb::decode(&bytes, "huge.glb").unwrap_err().to_string();
    assert!(error.contains("huge.glb") && error.contains("9 items"), "{error}");
    let mut bytes = glb::encode(&colored()).unwrap();
    bytes[12..16].copy_from_slice(&u32::MAX.to_le_bytes());
    assert!(glb::decode(&bytes, "huge.glb").unwrap_err().to_string().contains("4294967295"));
}
