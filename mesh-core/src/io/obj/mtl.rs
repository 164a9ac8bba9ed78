//! The one thing that is read from material libraries: which image lies on which material.

use std::path::{Path, PathBuf};

/// A material and the file of its `map_Kd`, if any.
#[derive(Debug)]
pub(super) struct Material {
    pub(super) name: String,
    pub(super) image: Option<PathBuf>,
}

/// How many words follow an option of a texture statement.
fn words_after(option: &str) -> Option<usize> {
    match option {
        "-blendu" | "-blendv" | "-boost" | "-cc" | "-clamp" | "-imfchan" | "-texres" | "-bm"
        | "-type" => Some(1),
        "-mm" => Some(2),
        "-o" | "-s" | "-t" => Some(3),
        _ => None,
    }
}

/// The materials of a library, in order; `folder` is what its paths start from.
pub(super) fn materials(text: &str, folder: &Path) -> Vec<Material> {
    let mut list: Vec<Material> = Vec::new();
    for line in text.lines() {
        let (word, rest) = split_word(line);
        match word {
            "newmtl" => list.push(Material { name: rest.to_owned(), image: None }),
            "map_Kd" | "map_kd" => {
                if let (Some(material), Some(file)) = (list.last_mut(), file_name(rest)) {
                    material.image = Some(folder.join(file.replace('\\', "/")));
                }
            }
            _ => {}
        }
    }
    list
}

/// The first word of a line and what follows it, both trimmed, without the comment.
pub(super) fn split_word(line: &str) -> (&str, &str) {
    let line = line.split('#').next().unwrap_or(line).trim();
    match line.split_once(char::is_whitespace) {
        Some((word, rest)) => (word, rest.trim()),
        None => (line, ""),
    }
}

/// The file name of a texture statement: what stands after the options; it may hold spaces.
fn file_name(mut rest: &str) -> Option<&str> {
    while let Some(count) = words_after(split_word(rest).0) {
        // `-o`, `-s` and `-t` take one to three numbers; a word that is none ends them.
        rest = split_word(rest).1;
        for k in 0..count {
            let (word, after) = split_word(rest);
            if k > 0 && count == 3 && word.parse::<f32>().is_err() {
                break;
            }
            rest = after;
        }
    }
    (!rest.is_empty()).then_some(rest)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn images_are_found_behind_options_comments_and_backslashes() {
        let text = "# lib\nnewmtl a\r\n map_Kd -s 1 1 -bm 0.5 tex\\my image.png # it\n\
                    newmtl b\nKd 1 0 0\nnewmtl c d\nmap_Kd -o 1 2 3 x.png";
        let list = materials(text, Path::new("f"));
        let pairs: Vec<_> = list.iter().map(|m| (m.name.as_str(), m.image.as_deref())).collect();
        assert_eq!(
            pairs,
            [
                ("a", Some(Path::new("f/tex/my image.png"))),
                ("b", None),
                ("c d", Some(Path::new("f/x.png")))
            ]
        );
    }
}
