//! Files that name other files: which of those are opened, and which are refused.

use std::path::Path;
use std::process::Command;
use std::sync::mpsc;
use std::time::Duration;

use crate::common::ball;
use datasets::{
    ColmapForm, Pix3d, ReadOptions, read_depth_file, read_views, write_colmap, write_kaolin,
    write_photos, write_transforms,
};

/// Runs a reader that must not wait for anybody, and gives its message.
fn at_once<T: Send + 'static>(
    read: impl FnOnce() -> Result<T, datasets::ReadViewsError> + Send + 'static,
) -> String {
    let (send, receive) = mpsc::channel();
    std::thread::spawn(move || send.send(read().map(drop).map_err(|error| error.to_string())));
    let found = receive.recv_timeout(Duration::from_secs(20)).expect("a reader that waits");
    found.expect_err("a pipe was read")
}

fn views(path: &Path) -> Result<datasets::Views, datasets::ReadViewsError> {
    read_views(path, &ReadOptions { depth: true, ..ReadOptions::default() }, &|_, _| {})
}

/// What writes a layout.
type Write = fn(&[datasets::View], &Path);

/// Puts a pipe in place of a file; not where there are none.
fn pipe(path: &Path) -> bool {
    let _ = std::fs::remove_file(path);
    Command::new("mkfifo").arg(path).status().is_ok_and(|status| status.success())
}

#[test]
fn pipes_are_not_opened() {
    let place = tempfile::tempdir().unwrap();
    let root = place.path();
    if !pipe(&root.join("probe")) {
        return;
    }
    let layouts: [(&str, Write, &[&str]); 4] = [
        (
            "kaolin",
            |v, f| write_kaolin(v, f).unwrap(),
            &["0_rgb.png", "0_metadata.json", "0_semantic.npy"],
        ),
        (
            "transforms",
            |v, f| write_transforms(v, f).unwrap(),
            &["images/0000.png", "masks/0000.png", "transforms.json"],
        ),
        (
            "photos",
            |v, f| write_photos(v, f).unwrap(),
            &["images/0000.png", "masks/0000.png", "cameras.json"],
        ),
        (
            "colmap",
            |v, f| write_colmap(v, f, ColmapForm::Text).unwrap(),
            &["images/0000.png", "sparse/0/cameras.txt"],
        ),
    ];
    for (layout, write, files) in layouts {
        for file in files {
            let folder = root.join(format!("{layout}-{}", file.replace('/', "-")));
            write(&ball(3), &folder);
            assert!(pipe(&folder.join(file)));
            let message = at_once(move || views(&folder));
            assert!(
                message.contains("pipe")
                    || message.contains("missing")
                    || message.contains("no known layout"),
                "{layout} {file}: {message}"
            );
        }
    }
    let depth = root.join("depth.npy");
    pipe(&depth);
    let message = at_once(move || read_depth_file(&depth, 1.0));
    assert!(message.contains("depth.npy") && message.contains("a pipe"), "{message}");
    let probe = root.join("probe");
    let message = at_once(move || views(&probe));
    assert!(message.contains("probe") && message.contains("a pipe"), "{message}");
}

#[test]
fn names_that_leave_the_folder_are_refused() {
    let place = tempfile::tempdir().unwrap();
    let root = place.path().join("a/b/c/set");
    write_photos(&ball(3), &root).unwrap();
    let secret = place.path().join("secret.png");
    std::fs::copy(root.join("images/0000.png"), &secret).unwrap();
    std::fs::copy(&secret, place.path().join("a/b/near.png")).unwrap();
    let text = std::fs::read_to_string(root.join("cameras.json")).unwrap();
    let with = |name: &str| {
        std::fs::write(root.join("cameras.json"), text.replacen("images/0000.png", name, 1))
            .unwrap();
        views(&root)
    };
    for name in
        ["../../../../secret.png", secret.to_str().unwrap(), "images/../../../../../secret.png"]
    {
        let error = with(name).unwrap_err().to_string();
        assert!(error.contains("outside of the folder") && error.contains("views[0]"), "{error}");
    }
    // Two folders up is as far as poses beside their images need.
    with("../../near.png").unwrap();
    // The same names, in a dataset whose files are all below it.
    let photos =
        Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures/photos/pix3d/pix3d.json");
    let text = std::fs::read_to_string(photos).unwrap();
    let field = |key: &str| {
        let start = text.find(&format!("\"{key}\": \"")).unwrap() + key.len() + 5;
        text[start..start + text[start..].find('"').unwrap()].to_owned()
    };
    let folder = place.path().join("a/pix3d");
    std::fs::create_dir_all(&folder).unwrap();
    for key in ["img", "model"] {
        let text = text.replace(&field(key), "../../secret.png");
        std::fs::write(folder.join("pix3d.json"), text).unwrap();
        let set = Pix3d::open(&folder).unwrap();
        let error = match key {
            "img" => datasets::Dataset::views(&set, 0, None, &ReadOptions::default(), &|_, _| {})
                .map(drop),
            _ => datasets::Dataset::truth(&set, 0).map(drop),
        };
        let error = error.unwrap_err().to_string();
        assert!(error.contains("outside of the folder"), "{key}: {error}");
    }
}
