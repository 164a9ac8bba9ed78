//! 3MF packages, taken apart again.
#![cfg(feature = "3mf")]
#![allow(clippy::unwrap_used, reason = "tests")]

mod samples;

use std::io::{Cursor, Read};

use mesh_core::io::threemf;
use mesh_core::{TriMesh, decode_image, primitives, write_mesh};

/// The parts of a package, in order.
fn parts(bytes: &[u8]) -> Vec<(String, Vec<u8>)> {
    let mut zip = zip::ZipArchive::new(Cursor::new(bytes)).unwrap();
    (0..zip.len())
        .map(|k| {
            let mut file = zip.by_index(k).unwrap();
            let mut part = Vec::new();
            file.read_to_end(&mut part).unwrap();
            (file.name().unwrap().into_owned(), part)
        })
        .collect()
}

fn model(bytes: &[u8]) -> String {
    let part = parts(bytes).into_iter().find(|(name, _)| name == "3D/3dmodel.model").unwrap();
    String::from_utf8(part.1).unwrap()
}

/// The values of these attributes in each element of a name.
fn values<const N: usize>(model: &str, element: &str, names: [&str; N]) -> Vec<[String; N]> {
    let begin = format!("<{element} ");
    let elements = model.split(&begin).skip(1).map(|rest| rest.split("/>").next().unwrap());
    elements
        .map(|text| {
            names.map(|name| {
                let text = format!(" {text}");
                let at = text.find(&format!(" {name}=\"")).unwrap() + name.len() + 3;
                text[at..].split('"').next().unwrap().to_owned()
            })
        })
        .collect()
}

fn numbers<T: std::str::FromStr, const N: usize>(rows: &[[String; N]]) -> Vec<[T; N]> {
    let number = |text: &String| text.parse().ok().unwrap();
    rows.iter().map(|row| std::array::from_fn(|k| number(&row[k]))).collect()
}

#[test]
fn a_plain_mesh_is_three_parts() {
    let ball = primitives::icosphere(2).scaled([1.0, 1e-6, 1e7]);
    let bytes = threemf::encode(&ball).unwrap();
    assert_eq!(bytes, threemf::encode(&ball).unwrap(), "the same bytes");
    let names: Vec<String> = parts(&bytes).into_iter().map(|(name, _)| name).collect();
    assert_eq!(names, ["[Content_Types].xml", "_rels/.rels", "3D/3dmodel.model"]);
    let model = model(&bytes);
    assert!(model.contains("unit=\"millimeter\"") && !model.contains("pid"));
    assert_eq!(numbers::<f32, 3>(&values(&model, "vertex", ["x", "y", "z"])), ball.positions);
    assert_eq!(numbers::<u32, 3>(&values(&model, "triangle", ["v1", "v2", "v3"])), ball.faces);
    let item = values(&model, "item", ["objectid"]);
    assert!(model.contains(&format!("<object id=\"{}\"", item[0][0])));
}

#[test]
fn colors_and_textures_are_properties_of_corners() {
    let mut ball = primitives::icosphere(1);
    let count = ball.positions.len();
    ball.colors = Some((0..count).map(|k| [k as f32 / 255.0, 1.0, -1.0]).collect());
    ball.faces.push([0, 0, 1]); // which the format forbids
    let text = model(&threemf::encode(&ball).unwrap());
    let colors = values(&text, "m:color", ["color"]);
    assert_eq!((colors.len(), colors[10][0].as_str()), (count, "#0AFF00"));
    assert_eq!(numbers::<u32, 3>(&values(&text, "triangle", ["p1", "p2", "p3"])), ball.faces[..80]);

    let folder = tempfile::tempdir().unwrap();
    let textured = samples::textured();
    write_mesh(folder.path().join("a.3mf"), &textured).unwrap();
    let bytes = std::fs::read(folder.path().join("a.3mf")).unwrap();
    let text = model(&bytes);
    let texture = textured.texture.as_ref().unwrap();
    assert_eq!(numbers::<f32, 2>(&values(&text, "m:tex2coord", ["u", "v"])), texture.uvs);
    assert_eq!(numbers::<u32, 3>(&values(&text, "triangle", ["p1", "p2", "p3"])), texture.faces);
    let path = &values(&text, "m:texture2d", ["path"])[0][0];
    let parts = parts(&bytes);
    let image = parts.iter().find(|(name, _)| name == &path[1..]).unwrap();
    let found = decode_image(&image.1, "a.png").unwrap();
    assert_eq!(found.data, texture.image.to_bytes().data);
    let names = parts.iter().find(|(name, _)| name == "3D/_rels/3dmodel.model.rels").unwrap();
    assert!(String::from_utf8_lossy(&names.1).contains(&format!("Target=\"{path}\"")));

    let damaged = TriMesh::new(vec![[f32::NAN; 3]], Vec::new());
    assert!(threemf::encode(&damaged).unwrap_err().to_string().contains("vertex 0"));
}
