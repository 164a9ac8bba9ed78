//! What reading a mesh left out, for the one line that a program says about it.

use std::fmt;

/// Something in a mesh file that the mesh does not have; each kind comes once, with a count.
///
/// `Display` gives one line, with names from the file escaped and cut.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Remark {
    /// Faces of fewer than three corners, which other programs take for points and lines.
    ShortFaces {
        /// How many.
        count: usize,
        /// The line of the first, in text formats.
        line: Option<usize>,
    },
    /// Triangles that name a vertex twice.
    RepeatedVertices {
        /// How many.
        count: usize,
    },
    /// Corners without a texture coordinate, or with one that is not in the file: they take `(0, 0)`.
    MissingTexcoords {
        /// How many.
        count: usize,
    },
    /// A material library or a texture that was not read.
    NotRead {
        /// Its name, as the file has it.
        name: String,
        /// Why.
        why: NotRead,
        /// How many more there are, whatever their reason.
        others: usize,
    },
    /// Textures beyond the one that a mesh holds; of OBJ files, whose textures become one, those that are damaged or too large for it.
    OtherTextures {
        /// How many, or how many parts would have them.
        count: usize,
    },
    /// Parts whose texture would be multiplied by colours of their vertices, or by another colour than the first part's.
    OtherTints {
        /// How many.
        count: usize,
    },
    /// Corners whose vertex has the colour of another material, of which a face is before theirs.
    BetweenColors {
        /// How many.
        count: usize,
    },
    /// Faces with a colour of their own, of formats whose colours are those of vertices otherwise.
    FaceColors {
        /// How many.
        count: usize,
    },
    /// Parts that consist of lines.
    Lines {
        /// How many.
        count: usize,
    },
}

/// Why a file that a mesh names was not read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum NotRead {
    /// It is not there, or not to be opened.
    Missing,
    /// It is outside the folder of the mesh: see [`Limits::outside_links`](crate::Limits::outside_links).
    Outside,
    /// A folder, a device or a pipe.
    NotAFile,
    /// An image that is neither PNG nor JPEG.
    UnknownKind,
}

impl fmt::Display for NotRead {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Missing => "no such file",
            Self::Outside => "outside the folder of the mesh",
            Self::NotAFile => "not a regular file",
            Self::UnknownKind => "neither PNG nor JPEG",
        })
    }
}

impl fmt::Display for Remark {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::ShortFaces { count, line } => {
                let faces = crate::counted(*count, "face");
                write!(f, "{faces} of fewer than three corners left out")?;
                line.map_or(Ok(()), |line| write!(f, " (the first in line {line})"))
            }
            Self::RepeatedVertices { count } => {
                let triangles = plural(*count, "triangle that names", "triangles that name");
                write!(f, "{count} {triangles} a vertex twice left out")
            }
            Self::MissingTexcoords { count } => {
                let take = plural(*count, "corner takes", "corners take");
                write!(f, "{count} {take} (0, 0) for want of texture coordinates")
            }
            Self::NotRead { name, why, others } => {
                write!(f, "{} not read: {why}", quoted(name))?;
                if *others > 0 { write!(f, " (and {others} more)") } else { Ok(()) }
            }
            Self::OtherTextures { count } => {
                let textures = crate::counted(*count, "other texture");
                write!(f, "{textures} left out: damaged, or more than one mesh holds")
            }
            Self::OtherTints { count } => {
                let parts = plural(*count, "part", "parts");
                write!(
                    f,
                    "{count} {parts}: colours that its texture would be multiplied by left out"
                )
            }
            Self::BetweenColors { count } => {
                let take = plural(*count, "corner takes", "corners take");
                write!(f, "{count} {take} the colour of another material at the same vertex")
            }
            Self::FaceColors { count } => {
                let colors = plural(*count, "colour of a face", "colours of faces");
                write!(f, "{count} {colors} left out")
            }
            Self::Lines { count } => {
                let parts = plural(*count, "part that consists", "parts that consist");
                write!(f, "{count} {parts} of lines left out")
            }
        }
    }
}

fn plural<'a>(count: usize, one: &'a str, many: &'a str) -> &'a str {
    if count == 1 { one } else { many }
}

/// A text from a file in quotes: no control characters, at most about 80 characters.
fn quoted(text: &str) -> String {
    let cut: String = text.chars().take(80).collect();
    let dots = if cut.len() < text.len() { "..." } else { "" };
    format!("{cut:?}{dots}")
}

/// Adds a file that was not read to the one remark about such files.
pub(super) fn not_read(remarks: &mut Vec<Remark>, name: &str, why: NotRead) {
    for remark in remarks.iter_mut() {
        if let Remark::NotRead { others, .. } = remark {
            *others += 1;
            return;
        }
    }
    let name = name.chars().take(200).collect();
    remarks.push(Remark::NotRead { name, why, others: 0 });
}

/// Adds counts that are not zero.
pub(super) fn counted(
    remarks: &mut Vec<Remark>,
    count: usize,
    remark: impl FnOnce(usize) -> Remark,
) {
    if count > 0 {
        remarks.push(remark(count));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_escaped_cut_and_counted() {
        let mut remarks = Vec::new();
        not_read(&mut remarks, &format!("\u{1b}[2J{}", "x".repeat(65_000)), NotRead::Missing);
        not_read(&mut remarks, "other", NotRead::Outside);
        assert_eq!(remarks.len(), 1);
        let line = remarks[0].to_string();
        assert!(line.len() < 150 && !line.contains('\u{1b}') && line.contains("1 more"), "{line}");
    }
}
