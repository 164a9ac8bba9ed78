//! Where arrays pass, the documentation says of which shape: a section `# Shapes` of the function, or of the `impl` or trait
//! around it.

#![allow(clippy::unwrap_used, reason = "tests")]

use benches::workspace::{root, sources};

/// Members of the workspace, and how many functions with arrays each offers at least: fewer would be a test that does not
/// see them.
const MEMBERS: &[(&str, usize)] = &[
    ("autodiff-lite", 85),
    ("nets", 55),
    ("losses", 50),
    ("diff-raster", 25),
    ("ode-deform", 10),
    ("mesh-core", 3),
    ("models", 7),
    ("train", 1),
    ("recon", 0),
    ("synth", 0),
    ("datasets", 0),
];

/// A public function as its source has it.
struct Function {
    /// From 1.
    line: usize,
    signature: String,
    docs: String,
    /// The line that opens the `impl` or trait, and what stands above that.
    owner: String,
    owner_docs: String,
}

impl Function {
    /// Whether it takes or gives arrays: `Var`, `Tensor`, or an array of ndarray.
    fn has_arrays(&self) -> bool {
        let mut words = self.signature.split(|c: char| !c.is_alphanumeric());
        let named = words.any(|word| {
            let word = word.strip_prefix("Arc").unwrap_or(word);
            ["Var", "Tensor"].contains(&word) || word.starts_with("Array")
        });
        let of_variable = self.owner.contains(" Var<") && !self.owner.contains(" for ");
        named || of_variable && self.signature.contains("self")
    }

    /// Whether a section says something.
    fn tells_shapes(&self) -> bool {
        [&self.docs, &self.owner_docs].iter().any(|docs| {
            let section = docs.split("# Shapes\n").nth(1);
            section.and_then(|text| text.lines().next()).is_some_and(|line| !line.trim().is_empty())
        })
    }
}

/// All public functions of a file, with those of public traits and those that the macro `forward!` makes.
fn functions(text: &str) -> Vec<Function> {
    let lines: Vec<&str> = text.lines().collect();
    let mut found = Vec::new();
    let (mut docs, mut owner, mut owner_docs) = (String::new(), String::new(), String::new());
    let mut in_macro = false;
    for (i, line) in lines.iter().enumerate() {
        let code = line.trim();
        if let Some(said) = code.strip_prefix("///") {
            docs.push_str(said.strip_prefix(' ').unwrap_or(said));
            docs.push('\n');
            continue;
        }
        // Within a macro: said where the macro is used, where it is looked at too.
        if code == "$(#[$doc])+" {
            docs.push_str("# Shapes\nat its uses\n");
        }
        if ["impl", "pub trait"].iter().any(|start| line.starts_with(start)) {
            (owner, owner_docs) = ((*line).to_owned(), std::mem::take(&mut docs));
        } else if *line == "}" {
            (owner, owner_docs) = (String::new(), String::new());
        }
        let offered = ["pub fn ", "pub const fn "].iter().any(|start| code.starts_with(start))
            || owner.starts_with("pub trait") && line.starts_with("    fn ");
        if offered || in_macro && code.starts_with("|self") {
            let rest = lines[i..].iter().map(|line| line.trim());
            let end = rest.clone().position(|line| line.ends_with(['{', '}', ';'])).unwrap_or(0);
            let mut signature: String = rest.take(end + 1).collect::<Vec<_>>().join(" ");
            if in_macro {
                signature.insert_str(0, "fn forward: Var ");
            }
            let docs = std::mem::take(&mut docs);
            let (owner, owner_docs) = (owner.clone(), owner_docs.clone());
            found.push(Function { line: i + 1, signature, docs, owner, owner_docs });
        }
        in_macro = code == "forward! {" || in_macro && code.starts_with("///");
        let attribute = code.starts_with("#[") || code.starts_with("$(#[") || code == ")]";
        if !attribute && !code.ends_with(',') && !code.starts_with("reason") {
            docs.clear();
        }
    }
    found
}

/// What of a file says no shapes, and how many functions have some.
fn silent(text: &str) -> (Vec<String>, usize) {
    let all: Vec<_> = functions(text).into_iter().filter(Function::has_arrays).collect();
    let wrong = all.iter().filter(|function| !function.tells_shapes());
    (wrong.map(|f| format!("{}: {}", f.line, f.signature)).collect(), all.len())
}

#[test]
fn every_function_with_arrays_says_of_which_shape() {
    let mut wrong = Vec::new();
    for (member, least) in MEMBERS {
        let mut seen = 0;
        for (path, text) in sources(&root().join(member).join("src")) {
            let (found, count) = silent(&text);
            seen += count;
            wrong.extend(found.into_iter().map(|found| format!("{}:{found}", path.display())));
        }
        assert!(seen >= *least, "{member}: only {seen} functions with arrays were seen");
    }
    assert!(wrong.is_empty(), "no `# Shapes`:\n{}", wrong.join("\n"));
}

#[test]
fn one_that_says_nothing_would_be_found() {
    let text = "\
/// Says it.
///
/// # Shapes
/// `x [N, 3]` → a scalar.
#[track_caller]
#[allow(
    clippy::unused,
    reason = \"made up\"
)]
pub fn says<'t, F: Real>(x: Var<'t, F>) -> Var<'t, F> {}

/// Does not, and is over more than one line.
pub fn silent<'t>(
    x: Var<'t>,
) -> f32 {}

/// No array passes.
pub fn other(x: f32) -> f32 {}

/// # Shapes
/// Any.
impl<F: Real> Var<'_, F> {
    /// Said above.
    pub fn rank(self) -> usize {}
}

impl<F: Real> Var<'_, F> {
    /// # Shapes
    ///
    pub fn empty(self) -> Self {}
}

pub trait Field {
    /// The derivative.
    fn eval(&self, y: &ArrayD<f32>);
}

impl Layer {
    forward! {
        /// Features.
        |self, x, activation| {
        }
    }
}
";
    let (wrong, count) = silent(text);
    let lines: Vec<&str> = wrong.iter().map(|w| w.split(':').next().unwrap()).collect();
    assert_eq!((lines, count), (vec!["13", "30", "35", "41"], 6));
}
