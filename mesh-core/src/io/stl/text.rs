//! STL as text: words, whatever lines they stand in.

use super::Soup;
use crate::io::ReadMeshError;

/// Bytes of a word that a message quotes.
const QUOTED: usize = 100;

/// The words of a text. Where lines end means nothing but for names and messages: files have LF, CR LF, CR or no
/// ends of lines at all.
#[derive(Clone, Copy)]
pub(super) struct Words<'a> {
    rest: &'a [u8],
    /// The line of the last word.
    line: usize,
}

impl<'a> Words<'a> {
    /// Of the bytes of a text that begins as STL does.
    pub(super) fn of(bytes: &'a [u8]) -> Option<Self> {
        // Some editors of Windows begin every file with this mark.
        let rest = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
        let solid = rest.trim_ascii_start().get(..5)?.eq_ignore_ascii_case(b"solid");
        (solid && !rest.contains(&0)).then_some(Self { rest, line: 1 })
    }

    fn next(&mut self) -> Option<&'a [u8]> {
        let is_space = |byte: &u8| byte.is_ascii_whitespace() || *byte == 0x0b;
        let start = self.rest.iter().position(|b| !is_space(b)).unwrap_or(self.rest.len());
        let (space, rest) = self.rest.split_at(start);
        let ends = |(k, &byte): (usize, &u8)| {
            byte == b'\n' || (byte == b'\r' && space.get(k + 1) != Some(&b'\n'))
        };
        self.line += space.iter().enumerate().filter(|&at| ends(at)).count();
        let (word, rest) = rest.split_at(rest.iter().position(is_space).unwrap_or(rest.len()));
        self.rest = rest;
        (!word.is_empty()).then_some(word)
    }

    /// The word after this one, which stays where it is.
    fn peek(mut self) -> Option<&'a [u8]> {
        self.next()
    }

    /// Takes the next word if it is this one.
    fn take(&mut self, word: &str) -> bool {
        let found = self.peek().is_some_and(|next| next.eq_ignore_ascii_case(word.as_bytes()));
        if found {
            self.next();
        }
        found
    }
}

/// What a text consists of, beside numbers and names.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Keyword {
    /// Or its end: a name follows.
    Solid,
    Facet,
    Outer,
    Vertex,
    EndLoop,
    EndFacet,
    Color,
}

impl Keyword {
    fn of(word: &[u8]) -> Option<Self> {
        let words = [
            ("vertex", Self::Vertex),
            ("facet", Self::Facet),
            ("outer", Self::Outer),
            ("endloop", Self::EndLoop),
            ("endfacet", Self::EndFacet),
            ("solid", Self::Solid),
            ("endsolid", Self::Solid),
            ("color", Self::Color),
        ];
        let found = words.into_iter().find(|(text, _)| word.eq_ignore_ascii_case(text.as_bytes()));
        found.map(|(_, keyword)| keyword)
    }
}

fn number(word: &[u8]) -> Option<f32> {
    std::str::from_utf8(word).ok()?.parse().ok().filter(|x: &f32| x.is_finite())
}

/// A word of a file for a message: what is long stays out of memory.
fn quoted(word: Option<&[u8]>) -> String {
    word.map_or_else(
        || "the end of the file".to_owned(),
        |word| format!("{:?}", String::from_utf8_lossy(&word[..word.len().min(QUOTED)])),
    )
}

/// Reads the triangles of a text.
pub(super) fn read(words: Words<'_>, soup: &mut Soup<'_>) -> Result<(), ReadMeshError> {
    Text { words, soup, corners: Vec::with_capacity(3), hidden: None }.read()
}

/// A text on its way to triangles.
struct Text<'a, 'b> {
    words: Words<'a>,
    soup: &'a mut Soup<'b>,
    /// Of the facet that is not yet closed.
    corners: Vec<[f32; 3]>,
    /// The first line where `vertex` stands in the name of a solid.
    hidden: Option<usize>,
}

impl Text<'_, '_> {
    fn read(mut self) -> Result<(), ReadMeshError> {
        while let Some(word) = self.words.next() {
            match Keyword::of(word) {
                Some(Keyword::Vertex) => self.vertex()?,
                // Its loop has ended before.
                Some(Keyword::EndFacet) if self.corners.is_empty() => {}
                Some(Keyword::EndLoop | Keyword::EndFacet) => self.end()?,
                Some(_) if !self.corners.is_empty() => return Err(self.unfinished()),
                Some(Keyword::Facet) => self.normal(),
                Some(Keyword::Color) => self.color(),
                Some(Keyword::Solid) => self.name(),
                Some(Keyword::Outer) if self.words.take("loop") => {}
                Some(Keyword::Outer) | None => {
                    let expected = "solid, facet, outer loop, vertex or their ends";
                    return Err(self.wrong("word", quoted(Some(word)), expected));
                }
            }
        }
        if !self.corners.is_empty() {
            let found = format!("{} vertices, then the end of the file", self.corners.len());
            let path = self.soup.path;
            return Err(ReadMeshError::at_line(path, None, "facet", found, "three and endloop"));
        }
        match self.hidden.filter(|_| self.soup.mesh.faces.is_empty() && self.soup.repeated == 0) {
            Some(line) => {
                self.words.line = line;
                let expected = "a name, then facet normal and what belongs to it";
                Err(self.wrong("solid", "no triangle, and vertex in a name", expected))
            }
            None => Ok(()),
        }
    }

    fn vertex(&mut self) -> Result<(), ReadMeshError> {
        if self.corners.len() == 3 {
            return Err(self.wrong("facet", "a fourth vertex", "three, then endloop"));
        }
        let mut corner = [0.0; 3];
        for x in &mut corner {
            let word = self.words.next();
            *x = word
                .and_then(number)
                .ok_or_else(|| self.wrong("vertex", quoted(word), "three finite numbers"))?;
        }
        self.corners.push(corner);
        Ok(())
    }

    /// The end of a facet, or of its only loop.
    fn end(&mut self) -> Result<(), ReadMeshError> {
        let &[a, b, c] = self.corners.as_slice() else { return Err(self.unfinished()) };
        self.corners.clear();
        self.soup.push([a, b, c])
    }

    /// Passes over the normal of a facet, whose numbers may be none: facets without area have such.
    fn normal(&mut self) {
        let count = if self.words.take("normal") { 3 } else { 0 };
        for _ in 0..count {
            if self.words.peek().is_some_and(|word| Keyword::of(word).is_none()) {
                self.words.next();
            }
        }
    }

    /// Passes over the numbers of a colour.
    fn color(&mut self) {
        while self.words.peek().is_some_and(|word| number(word).is_some()) {
            self.words.next();
        }
    }

    /// Passes over the name of a solid: the rest of its line, up to where facets begin in the same line.
    fn name(&mut self) {
        let line = self.words.line;
        let mut ahead = self.words;
        while let Some(word) = ahead.next().filter(|_| ahead.line == line) {
            let followed = |by: &str| ahead.clone().take(by);
            match Keyword::of(word) {
                Some(Keyword::Facet) if followed("normal") || followed("outer") => return,
                Some(Keyword::Outer) if followed("loop") => return,
                Some(Keyword::Vertex) => _ = self.hidden.get_or_insert(line),
                _ => {}
            }
            self.words = ahead;
        }
    }

    /// A facet that has not three vertices where it ends.
    fn unfinished(&self) -> ReadMeshError {
        let found = format!("{} vertices", self.corners.len());
        self.wrong("facet", found, "three, then endloop")
    }

    fn wrong(&self, field: &str, found: impl ToString, expected: &str) -> ReadMeshError {
        ReadMeshError::at_line(self.soup.path, Some(self.words.line), field, found, expected)
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use crate::io::stl::decode;
    use crate::{TriMesh, primitives};

    /// A ball whose words are parted so.
    fn ball(ending: &str) -> String {
        let solid = primitives::icosphere(0);
        let facets = solid.faces.iter().map(|face| {
            let corners = face.map(|v| {
                let [x, y, z] = solid.positions[v as usize];
                format!("vertex {x} {y} {z:e}{ending}")
            });
            let corners = corners.concat();
            format!("facet normal 0 nan -1.#IND{ending}outer loop{ending}{corners}endloop{ending}endfacet{ending}")
        });
        let facets: String = facets.collect();
        format!("solid of facets{ending}{facets}endsolid of facets{ending}")
    }

    #[test]
    fn ends_of_lines_and_marks_of_every_system() {
        let expected = decode(ball("\n").as_bytes(), "a.stl").unwrap();
        assert_eq!((expected.positions.len(), expected.faces.len()), (12, 20));
        for ending in ["\r\n", "\r", " ", "\t", " \n\n  "] {
            let text = ball(ending);
            for text in [&text, &format!("\u{feff}{text}"), &text.to_uppercase()] {
                assert_eq!(decode(text.as_bytes(), "a.stl").unwrap(), expected, "{ending:?}");
            }
            let twice = format!("{text}{}", text.replace("facets", "more"));
            assert_eq!(decode(twice.as_bytes(), "a.stl").unwrap().faces.len(), 40, "{ending:?}");
        }
        // Two vertices in a line, a loop in a line.
        let packed = "solid\nfacet normal 0 0 1\nouter loop vertex 0 0 0 vertex 1 0 0\nvertex 0 1 0 endloop\n\
                      endfacet facet\nouter loop vertex 0 0 1 vertex 1 0 1 vertex 0 1 1 endfacet\nendsolid";
        assert_eq!(decode(packed.as_bytes(), "a.stl").unwrap().faces.len(), 2);
    }

    #[test]
    fn what_is_left_over_is_refused() {
        let message = |text: &str| match decode(text.as_bytes(), "a.stl") {
            Ok(mesh) => panic!("{text:?}: {} faces", mesh.faces.len()),
            Err(error) => error.to_string(),
        };
        let corners = "vertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\n";
        for (text, expected) in [
            (format!("{corners}vertex 1 1 0\nendloop"), "a.stl:5: facet: found a fourth"),
            (corners.replace("0 1 0", "0 1 0 7"), "a.stl:4: word: found \"7\""),
            (format!("{corners}facet normal 0 0 1\nendloop"), "a.stl:5: facet: found 3 vertices"),
            (corners.replace("0 1 0\n", "0 1"), "a.stl:4: vertex: found the end of the file"),
            (format!("{corners}endloop\nendloop"), "a.stl:6: facet: found 0 vertices"),
            (format!("outer ring\n{corners}endloop"), "a.stl:2: word: found \"outer\""),
            (format!("{corners}endloop 0.5"), "a.stl:5: word: found \"0.5\""),
        ] {
            let found = message(&format!("solid\n{text}"));
            assert!(found.contains(expected), "{text}: {found}");
        }
        let packed = format!("solid name {}", corners.replace('\n', " "));
        assert!(message(&packed).contains("a.stl:1: solid: found no triangle"), "{packed}");
        // A name may be anything as long as nothing is lost by it.
        let named = format!("solid vertex\nfacet\n{corners}endloop\nendsolid vertex");
        assert_eq!(decode(named.as_bytes(), "a.stl").unwrap().faces.len(), 1);
        assert_eq!(decode(b"solid nothing\nendsolid", "a.stl").unwrap(), TriMesh::default());
    }
}
