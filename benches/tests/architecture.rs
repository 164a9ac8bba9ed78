//! The rules of ARCHITECTURE.md that a test can hold.
//!
//! They live in this crate because it alone may depend on every other.

#![allow(clippy::unwrap_used, reason = "tests")]

use std::collections::BTreeMap;
use std::fs;
use std::path::PathBuf;

use benches::workspace::{packages, root, sources};

/// What each crate may depend on within the workspace: "Who may know whom" of ARCHITECTURE.md, as data.
const MAY_USE: &[(&str, &str)] = &[
    ("pickle", ""),
    ("mesh-core", ""),
    ("autodiff-lite", ""),
    ("datasets", "pickle mesh-core"),
    ("diff-raster", "mesh-core autodiff-lite"),
    ("losses", "mesh-core autodiff-lite"),
    ("nets", "pickle autodiff-lite"),
    ("ode-deform", "mesh-core autodiff-lite nets"),
    ("train", "mesh-core autodiff-lite"),
    ("synth", "mesh-core datasets diff-raster train"),
    ("recon", "mesh-core datasets diff-raster losses train synth"),
    (
        "models",
        "mesh-core autodiff-lite datasets diff-raster losses nets ode-deform train synth recon",
    ),
    ("studies", "mesh-core autodiff-lite datasets losses nets ode-deform train synth recon models"),
    ("cli", "mesh-core datasets losses train synth recon models studies"),
    (
        "benches",
        "mesh-core autodiff-lite datasets diff-raster losses nets ode-deform train synth recon models",
    ),
    (
        "docs",
        "pickle mesh-core autodiff-lite datasets diff-raster losses nets ode-deform train synth recon models studies",
    ),
    ("python", "mesh-core autodiff-lite datasets diff-raster losses ode-deform train recon"),
];

/// Crates from outside that are for these members alone.
const RESERVED: &[(&str, &[&str])] = &[
    ("clap", &["cli"]),
    ("clap_complete", &["cli"]),
    ("clap_mangen", &["cli"]),
    ("numpy", &["python"]),
    ("pyo3", &["python"]),
    ("indicatif", &["cli"]),
    ("ctrlc", &["cli"]),
    ("signal-hook", &["cli"]),
    ("toml", &["train"]),
    ("mpi", &["cli"]),
    ("gif", &["recon"]),
    ("image", &["mesh-core"]),
    ("exr", &["mesh-core"]),
    ("nalgebra", &["mesh-core"]),
    ("gemm-common", &["autodiff-lite"]),
    ("gemm-f32", &["autodiff-lite"]),
    ("gemm-f64", &["autodiff-lite"]),
    ("safetensors", &["autodiff-lite"]),
    ("zip", &["datasets", "mesh-core", "nets"]),
];

/// Words of our own that the field has others for: folder, the word, the field's. ARCHITECTURE.md has the glossary.
const REPLACED: &[(&str, &str, &str)] = &[
    ("train", "Course", "Trainer"),
    ("studies", "Course", "StudyRunner"),
    ("train", "Moment", "StepInfo"),
    ("train", "Moments", "OptimizerState"),
    ("models", "Moment", "StepInfo"),
    ("train", "Slope", "StepGradient"),
    ("train", "Standing", "TrainState"),
    ("train", "blame", "locate_non_finite"),
    ("train", "culprit", "first_non_finite"),
    ("train", "Located", "CheckpointPath"),
    ("train", "Noted", "RunMetadata"),
    ("train", "adopt", "init_from_data"),
    ("models", "adopt", "init_from_data"),
    ("models/src/depth", "Beginning", "MeshInit"),
    ("models/src/depth", "Begun", "InitialMeshes"),
    ("models/src/depth", "Relief", "DepthTargets"),
    ("models", "Shelf", "ViewCache"),
    ("autodiff-lite", "Shelf", "FreeList"),
    ("models", "Judge", "PerceptualMetrics"),
    ("models", "Eye", "ViewSampler"),
    ("recon", "Eye", "MaskView"),
    ("recon/src/fit", "Picture", "GrayImage"),
    ("models", "Picture", "InputImage"),
    ("datasets", "Picture", "ImageFile"),
    ("studies", "Picture", "CaptionedImage"),
    ("models/src/img2mesh", "Stage", "Renderer"),
    ("models/src/mcmr", "Stage", "Renderer"),
    ("models/src/predict", "Material", "PredictInput"),
    ("models/src/predict", "gather", "load"),
    ("autodiff-lite/src/ops", "Way", "ConvDirection"),
    ("datasets", "Doubtful", "OnInconsistent"),
    ("diff-raster", "texel_middles", "texel_centers"),
    ("diff-raster", "Spares", "ScratchPool"),
    ("ode-deform", "asking", "save_at"),
    ("ode-deform/src/deform", "pieces", "segments"),
    ("losses", "slope", "derivative"),
    ("diff-raster", "slope", "derivative"),
    ("ode-deform", "slope", "derivative"),
    ("recon", "slope", "derivative"),
    ("models/src/img2mesh", "slope", "gradient"),
    ("recon", "cones", "bounding_sphere"),
    ("recon/src/inspect", "ball", "sphere"),
    ("mesh-core/src", "way", "direction"),
    ("losses/src/kernels", "way_to_triangle", "offset_to_triangle"),
];

/// How identifiers are spelt: as Rust's own are. Sentences are British.
const SPELT: &[(&str, &str)] = &[
    ("colour", "color"),
    ("centre", "center"),
    ("neighbour", "neighbor"),
    ("normalis", "normaliz"),
    ("rasteris", "rasteriz"),
    ("optimis", "optimiz"),
    ("grey", "gray"),
];

/// Lines of the longest function, from its name to its closing brace.
const LONGEST: usize = 70;

/// Functions that are longer, each with why it is.
const LONG: &[(&str, &str, &str)] = &[
    ("pickle/src/machine.rs", "step", "a table of opcodes"),
    ("synth/src/shapes/airplane/engine.rs", "engines", "data: parts with their sizes"),
    ("synth/src/shapes/airplane/plan.rs", "draw", "data: ranges of sizes"),
    ("synth/src/shapes/airplane/wing.rs", "wings", "data: parts with their sizes"),
    ("synth/src/shapes/alarm_clock/family.rs", "top", "data: parts with their sizes"),
    ("synth/src/shapes/bicycle.rs", "draw", "data: ranges of sizes"),
    ("synth/src/shapes/motorbike.rs", "upper", "data: parts with their sizes"),
    ("synth/src/shapes/motorbike/fairing.rs", "fairing", "data: parts with their sizes"),
];

/// The folder of a package: `unsphere-losses` is in `losses`, the program in `cli`.
fn folder(package: &str) -> String {
    match package {
        "unsphere" => "cli".to_owned(),
        _ => package.strip_prefix("unsphere-").unwrap_or(package).to_owned(),
    }
}

/// For each member of the workspace its dependencies (not those of its tests).
fn members() -> BTreeMap<String, Vec<String>> {
    let text = |value: &serde_json::Value| value.as_str().unwrap().to_owned();
    let dependencies = |package: &serde_json::Value| {
        let all = package["dependencies"].as_array().unwrap().iter();
        all.filter(|d| d["kind"].is_null()).map(|d| folder(&text(&d["name"]))).collect()
    };
    let all = packages();
    all.iter().map(|package| (folder(&text(&package["name"])), dependencies(package))).collect()
}

fn library_sources() -> Vec<(PathBuf, String)> {
    MAY_USE
        .iter()
        // The program may do what libraries may not; the bindings hand memory to NumPy, in one block.
        .filter(|(member, _)| !["cli", "python"].contains(member))
        .flat_map(|(member, _)| sources(&root().join(member).join("src")))
        // A program reads what it is told.
        .filter(|(path, _)| !path.parent().is_some_and(|folder| folder.ends_with("src/bin")))
        .collect()
}

/// The code of a file without its comments, line by line.
fn code(text: &str) -> impl Iterator<Item = (usize, &str)> {
    let lines = text.lines().enumerate().map(|(i, line)| (i + 1, line.trim_start()));
    lines.filter(|(_, line)| !line.starts_with("//"))
}

/// The name of the function that a line begins, if it begins one.
fn declared(line: &str) -> Option<&str> {
    let (before, after) = line.split_once("fn ")?;
    let qualifier = |word: &str| {
        ["const", "async", "unsafe", "extern", "\"C\""].contains(&word)
            || word.starts_with("pub")
            || word.ends_with(')')
    };
    let end = after.find(|c: char| !c.is_alphanumeric() && c != '_')?;
    // Not what a macro names.
    (end > 0 && before.split_whitespace().all(qualifier)).then(|| &after[..end])
}

/// A line without what is remarked behind its code.
fn said(line: &str) -> &str {
    line.split(" // ").next().unwrap_or_default().trim_end()
}

/// The functions of a formatted file and how many lines each has, from its name to its closing brace.
fn functions(text: &str) -> impl Iterator<Item = (&str, usize)> {
    let lines: Vec<&str> = text.lines().collect();
    (0..lines.len()).filter_map(move |begin| {
        let (line, rest) = (lines[begin], &lines[begin..]);
        let name = declared(line)?;
        let head = rest.iter().position(|line| said(line).ends_with(['{', '}', ';']))?;
        let body = said(rest[head]).ends_with('{');
        let closing = format!("{}}}", &line[..line.len() - line.trim_start().len()]);
        let end = if body { rest.iter().position(|line| *line == closing)? } else { head };
        Some((name, end + 1))
    })
}

#[test]
fn dependencies_point_one_way() {
    let members = members();
    let named: Vec<_> = MAY_USE.iter().map(|(name, _)| (*name).to_owned()).collect();
    assert!(members.keys().all(|m| named.contains(m)), "a new crate: place it in MAY_USE");
    for (member, allowed) in MAY_USE {
        for dependency in members[*member].iter().filter(|d| members.contains_key(*d)) {
            assert!(
                allowed.split(' ').any(|name| name == dependency),
                "{member} must not use {dependency}"
            );
        }
    }
}

#[test]
fn some_dependencies_have_one_owner() {
    for (member, dependencies) in members() {
        for (name, owners) in RESERVED {
            let uses = dependencies.iter().any(|d| d == name);
            assert!(!uses || owners.contains(&member.as_str()), "{member} must not use {name}");
        }
    }
}

#[test]
fn unsafe_code_stays_in_kernels() {
    for (path, text) in library_sources() {
        let in_kernels = path.iter().any(|part| part == "kernels" || part == "kernels.rs");
        for (line, code) in code(&text) {
            let found = code.contains("unsafe ") && !code.contains("unsafe_");
            assert!(in_kernels || !found, "{}:{line}: {code}", path.display());
        }
    }
}

#[test]
fn libraries_leave_the_process_alone() {
    let never = ["process::exit", "env::var", "env::args", "env::set_current_dir", "thread_rng"];
    for (path, text) in library_sources() {
        for (line, code) in code(&text) {
            let found = never.iter().find(|word| code.contains(**word));
            assert!(found.is_none(), "{}:{line}: {found:?}", path.display());
        }
    }
}

/// So that what can be had without threads has the same bits: the same loops, in one place.
#[test]
fn threads_are_known_in_one_place() {
    let without = ["mesh-core", "autodiff-lite", "diff-raster", "losses", "nets", "ode-deform"];
    for member in without {
        for (path, text) in sources(&root().join(member).join("src")) {
            let place = path.ends_with("kernels/threads.rs");
            for (line, code) in code(&text).filter(|(_, code)| code.contains("rayon::")) {
                assert!(
                    place || code.contains("ThreadPoolBuilder"),
                    "{}:{line}: {code}",
                    path.display()
                );
            }
        }
    }
}

/// Cargo gives the seed to the tests, from `.cargo/config.toml` unless it is set.
#[test]
fn property_tests_draw_the_same_cases_in_every_run() {
    let seed = std::env::var("PROPTEST_RNG_SEED").unwrap();
    assert!(seed.parse::<u64>().is_ok(), "PROPTEST_RNG_SEED={seed}");
}

#[test]
fn kernels_never_see_a_tape() {
    for (path, text) in library_sources() {
        if path.iter().any(|part| part == "kernels") {
            for (line, code) in code(&text) {
                let found = ["Tape<", "Var<", "Backward<"].iter().any(|word| code.contains(word));
                assert!(!found, "{}:{line}: {code}", path.display());
            }
        }
    }
}

#[test]
fn the_solver_knows_neither_adjoints_nor_networks_nor_meshes() {
    for (path, text) in sources(&root().join("ode-deform/src/solve")) {
        for (line, code) in code(&text) {
            let never = ["nets::", "mesh_core::", "adjoint", "Adjoint", "VectorField", "deform::"];
            let found =
                never.iter().find(|word| code.replace("ode_deform::solve", "").contains(**word));
            assert!(found.is_none(), "{}:{line}: {found:?}", path.display());
        }
    }
}

#[test]
fn files_and_names_stay_small_and_plain() {
    let vague = ["Manager", "Helper", "Utils", "Util"];
    for (member, _) in MAY_USE {
        for (path, text) in sources(&root().join(member).join("src")) {
            let lines = text.lines().count();
            assert!(lines <= 500, "{}: {lines} lines; split it by noun", path.display());
            let name = path.file_stem().unwrap().to_string_lossy().into_owned();
            assert!(!["utils", "util", "helpers", "misc"].contains(&&*name), "{}", path.display());
            for (line, code) in code(&text) {
                let kinds = ["struct ", "enum ", "trait "];
                let declared = kinds.iter().find_map(|kind| code.split_once(kind)).map(|(_, n)| n);
                let name = declared.and_then(|n| n.split(|c: char| !c.is_alphanumeric()).next());
                let bad = name.is_some_and(|n| vague.iter().any(|word| n.ends_with(word)));
                assert!(!bad, "{}:{line}: {code}", path.display());
            }
        }
    }
}

#[test]
fn functions_stay_short() {
    let mut excused = Vec::new();
    let folders = ["src", "benches", "examples"];
    let folders =
        MAY_USE.iter().flat_map(|(member, _)| folders.map(|name| root().join(member).join(name)));
    for (path, text) in folders.flat_map(|folder| sources(&folder)) {
        let path = path.strip_prefix(root()).unwrap().to_string_lossy().replace('\\', "/");
        let mut parts = path.trim_end_matches(".rs").split('/');
        if parts.any(|part| part == "kernels" || part == "tests" || part.ends_with("_tests")) {
            continue;
        }
        for (name, lines) in functions(&text).filter(|&(_, lines)| lines > LONGEST) {
            let exception =
                LONG.iter().find(|(file, function, _)| (*file, *function) == (&*path, name));
            assert!(
                exception.is_some(),
                "{path}: `{name}` has {lines} lines; split it, or say in LONG why not"
            );
            excused.extend(exception);
        }
    }
    for exception in LONG {
        assert!(excused.contains(&exception), "{exception:?} is gone, or short: take it from LONG");
    }
}

#[test]
fn functions_are_measured_from_name_to_brace() {
    let text = "trait A {\n    fn a(\n        &self,\n    ) -> u8;\n    fn b(&self) {}\n}\n\n\
                pub(in crate::x) const fn c<T>()\nwhere\n    T: Copy,\n{\n    if true {\n    }\n}\n\
                // fn d() {\nlet f: fn (u8) = e;\n";
    let found: Vec<_> = functions(text).collect();
    assert_eq!(found, [("a", 3), ("b", 1), ("c", 7)]);
}

#[test]
fn the_words_are_those_of_the_field() {
    for (folder, word, instead) in REPLACED {
        assert!(root().join(folder).is_dir(), "{folder} has moved: so must its words");
        for (path, text) in sources(&root().join(folder)) {
            for (line, code) in code(&text) {
                let mut words = code.split(|c: char| !c.is_alphanumeric() && c != '_');
                let found = words.any(|found| found == *word);
                assert!(!found, "{}:{line}: `{word}`, say `{instead}`", path.display());
            }
        }
    }
}

#[test]
fn identifiers_have_one_spelling() {
    let keywords =
        ["fn", "struct", "enum", "trait", "mod", "type", "const", "static", "let", "mut"];
    for (member, _) in MAY_USE {
        for (path, text) in sources(&root().join(member)) {
            for (line, code) in code(&text).filter(|(_, code)| !code.contains('"')) {
                let words: Vec<_> =
                    code.split(|c: char| !c.is_alphanumeric() && c != '_').collect();
                let declared = words.windows(2).filter(|pair| keywords.contains(&pair[0]));
                for name in declared.map(|pair| pair[1].to_lowercase()) {
                    let found = SPELT.iter().find(|(word, _)| name.contains(word));
                    assert!(found.is_none(), "{}:{line}: `{name}`, {found:?}", path.display());
                }
            }
        }
    }
}

/// `cargo run` starts the binary only where it is the workspace's only one.
#[test]
fn there_is_one_binary() {
    for (member, _) in MAY_USE.iter().filter(|(member, _)| *member != "cli") {
        let folder = root().join(member);
        assert!(!folder.join("src/bin").exists(), "{member}: make it an example");
        assert!(!folder.join("src/main.rs").exists(), "{member}: make it an example");
        let manifest = fs::read_to_string(folder.join("Cargo.toml")).unwrap();
        assert!(!manifest.contains("[[bin]]"), "{member}: make it an example");
    }
}

/// An operation that is not named there is compiled anew by every crate that calls it, at that crate's level.
#[test]
fn operations_are_compiled_where_they_are_written() {
    for member in ["autodiff-lite", "diff-raster"] {
        let folder = root().join(member).join("src");
        let instances = fs::read_to_string(folder.join("instances.rs")).unwrap();
        let named: Vec<&str> =
            instances.split(|c: char| !c.is_alphanumeric() && c != '_').collect();
        for (path, text) in sources(&folder.join("ops")) {
            let lines: Vec<&str> = text.lines().map(str::trim).collect();
            for pair in lines.windows(2).filter(|pair| pair[0] == "#[inline(never)]") {
                let name = pair[1].strip_prefix("pub fn ").unwrap_or_default();
                let end = name.find(|c: char| !c.is_alphanumeric() && c != '_');
                // Not what a macro makes.
                let name = &name[..end.unwrap_or(name.len())];
                assert!(
                    name.is_empty() || named.contains(&name),
                    "{}: `{name}` is missing in {member}/src/instances.rs",
                    path.display()
                );
            }
        }
    }
}

#[test]
fn every_crate_explains_itself() {
    for (member, _) in
        MAY_USE.iter().filter(|(member, _)| !["benches", "docs", "python"].contains(member))
    {
        let folder = root().join(member);
        let readme = fs::read_to_string(folder.join("README.md")).unwrap_or_default();
        assert!(readme.lines().count() > 10, "{member}: the README says nothing");
        if *member != "cli" {
            let docs = fs::read_to_string(folder.join("src/lib.rs")).unwrap();
            assert!(docs.contains("//! ```"), "{member}: the crate docs open without an example");
            let examples = sources(&folder.join("examples"));
            assert!(!examples.is_empty(), "{member}: no example to run");
        }
    }
    let map = fs::read_to_string(root().join("ARCHITECTURE.md")).unwrap();
    for (member, _) in MAY_USE {
        assert!(
            map.contains(&format!("### {member}")),
            "ARCHITECTURE.md: no paragraph on {member}"
        );
    }
}
