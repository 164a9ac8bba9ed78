//! The report in a real browser: it draws the mesh and writes no error to the console.
#![allow(
    clippy::unwrap_used,
    clippy::print_stderr,
    reason = "a test, which says when it is skipped"
)]

use std::path::{Path, PathBuf};
use std::process::Command;

use mesh_core::{ByteImage, Image, Texture, TriMesh, primitives};
use recon::scene::scene_of;
use train::report::{Chart, Figure, Report, Series, Table, ViewPair};

const BROWSERS: [&str; 3] = ["chromium", "chromium-browser", "google-chrome"];

fn browser() -> Option<PathBuf> {
    let path = std::env::var_os("PATH")?;
    std::env::split_paths(&path)
        .flat_map(|folder| BROWSERS.map(|name| folder.join(name)))
        .find(|candidate| candidate.is_file())
}

/// The page's document after its scripts ran, and what the browser logged.
fn visit(browser: &Path, page: &str) -> (String, String) {
    let place = tempfile::tempdir().unwrap();
    let file = place.path().join("report.html");
    std::fs::write(&file, page).unwrap();
    // A browser that hangs must not hang the tests.
    let output = Command::new("timeout")
        .arg("90")
        .arg(browser)
        .args(["--headless", "--no-sandbox", "--disable-quic", "--no-first-run"])
        .args(["--disable-background-networking", "--disable-component-update", "--disable-sync"])
        .args(["--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--enable-logging=stderr"])
        .args(["--window-size=1200,900", "--virtual-time-budget=3000", "--dump-dom"])
        .arg(format!("--user-data-dir={}", place.path().join("profile").display()))
        .arg(format!("file://{}", file.display()))
        .output()
        .unwrap();
    (
        String::from_utf8_lossy(&output.stdout).into_owned(),
        String::from_utf8_lossy(&output.stderr).into_owned(),
    )
}

fn attribute(document: &str, name: &str) -> Option<String> {
    let rest = document.split(&format!("{name}=\"")).nth(1)?;
    rest.split('"').next().map(str::to_owned)
}

fn report(mesh: &TriMesh) -> Report {
    let picture = ByteImage { height: 8, width: 8, channels: 3, data: vec![90; 192] };
    Report {
        title: "A sphere".into(),
        summary: "One sphere, for the test.".into(),
        command: "unsphere demo".into(),
        scene: scene_of(mesh),
        figures: vec![Figure { value: "0.97".into(), label: "mask IoU".into() }],
        warnings: vec!["This is a test.".into()],
        views: vec![ViewPair { caption: "4".into(), model: picture.clone(), truth: picture }],
        charts: vec![Chart {
            title: "Loss".into(),
            x_label: "step".into(),
            logarithmic: true,
            series: vec![Series { name: "mask".into(), points: vec![(0.0, 1.0), (9.0, 0.1)] }],
        }],
        tables: vec![Table { title: "Run".into(), rows: vec![("seed".into(), "0".into())] }],
        turntable: None,
    }
}

/// What the page says of the pixels of its viewer: the mean colour, and how much the brightness varies. None without a
/// browser.
fn check(mesh: &TriMesh) -> Option<([f64; 3], f64)> {
    let Some(browser) = browser() else {
        eprintln!("skipped: no Chromium on the PATH");
        return None;
    };
    let (document, log) = visit(&browser, &report(mesh).to_html());
    assert_eq!(attribute(&document, "data-status").as_deref(), Some("drawn"), "{log}");
    let pixels: usize = attribute(&document, "data-pixels").unwrap().parse().unwrap();
    assert!(pixels > 10_000, "the mesh covers {pixels} pixels");
    // The driver remarks that reading the image back, which the check itself asks for, is slow.
    let complaints: Vec<&str> = log
        .lines()
        .filter(|l| l.contains("CONSOLE") && !l.contains("GL Driver Message (OpenGL, Performance"))
        .collect();
    assert!(complaints.is_empty(), "{complaints:#?}");
    let mean = attribute(&document, "data-mean").unwrap();
    let mean: Vec<f64> = mean.split(' ').map(|v| v.parse().unwrap()).collect();
    Some((mean.try_into().unwrap(), attribute(&document, "data-spread").unwrap().parse().unwrap()))
}

#[test]
fn a_colored_mesh_is_drawn() {
    let mut mesh = primitives::icosphere(3);
    mesh.colors = Some(vec![[0.8, 0.4, 0.2]; mesh.positions.len()]);
    let Some((mean, spread)) = check(&mesh) else { return };
    // As they are, without any light on them.
    let near = mean.iter().zip([204.0, 102.0, 51.0]).all(|(a, b)| (a - b).abs() < 3.0);
    assert!(near && spread < 2.0, "{mean:?}, {spread}");
}

#[test]
fn a_mesh_without_colors_shows_its_shape() {
    let Some((mean, spread)) = check(&primitives::icosphere(3)) else { return };
    assert!(mean.iter().all(|v| (80.0..235.0).contains(v)) && spread > 15.0, "{mean:?}, {spread}");
}

#[test]
fn a_textured_mesh_is_drawn() {
    let mut mesh = primitives::icosphere(3);
    let uvs = mesh.positions.iter().map(|p| [0.5 + 0.5 * p[0], 0.5 + 0.5 * p[1]]).collect();
    let mut image = Image::new(16, 16, 3);
    image.data.chunks_exact_mut(3).for_each(|p| p.copy_from_slice(&[0.2, 0.6, 0.4]));
    mesh.texture = Some(Texture { uvs, faces: mesh.faces.clone(), image });
    let Some((mean, _)) = check(&mesh) else { return };
    let near = mean.iter().zip([51.0, 153.0, 102.0]).all(|(a, b)| (a - b).abs() < 3.0);
    assert!(near, "{mean:?}");
}
