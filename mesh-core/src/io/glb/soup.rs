//! What the nodes of a scene add up to, before seams are joined.

use crate::{Budget, Image, OverLimit, Texture, TriMesh};

pub(super) struct Soup {
    pub(super) positions: Vec<[f32; 3]>,
    /// sRGB; as many as positions up to the last part that has colours, empty where none has.
    pub(super) colors: Vec<[f32; 3]>,
    /// Likewise of the parts on which the image lies.
    pub(super) uvs: Vec<[f32; 2]>,
    pub(super) faces: Vec<[u32; 3]>,
    /// Whether any part was split at seams.
    pub(super) split: bool,
    /// The image in use, and its number.
    pub(super) image: Option<(usize, Image)>,
    /// What it is multiplied by, in linear light.
    pub(super) tint: [f32; 3],
}

impl Default for Soup {
    fn default() -> Self {
        let (positions, colors, uvs, faces) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
        Self { positions, colors, uvs, faces, split: false, image: None, tint: [1.0; 3] }
    }
}

impl Soup {
    /// One mesh, its seams joined, and how many triangles name a vertex twice and are left out.
    pub(super) fn joined(
        mut self,
        image: Option<Image>,
        budget: &mut Budget,
    ) -> Result<(TriMesh, usize), OverLimit> {
        let count = self.positions.len();
        if !self.colors.is_empty() {
            budget.fill(&mut self.colors, count, [1.0; 3], 0)?;
        }
        let mut texture = None;
        if let Some(image) = image {
            budget.fill(&mut self.uvs, count, [0.0; 2], 0)?;
            let mut faces = Vec::new();
            budget.reserve(&mut faces, self.faces.len())?;
            faces.extend_from_slice(&self.faces);
            texture = Some(Texture { uvs: std::mem::take(&mut self.uvs), faces, image });
        }
        if self.split {
            self.join(budget)?;
        }
        let repeated = drop_repeated(&mut self.faces, texture.as_mut().map(|t| &mut t.faces));
        let colors = (!self.colors.is_empty()).then_some(self.colors);
        let mesh = TriMesh { positions: self.positions, faces: self.faces, colors, texture };
        Ok((mesh, repeated))
    }

    /// Keeps, of vertices with the same position and colour, the first.
    fn join(&mut self, budget: &mut Budget) -> Result<(), OverLimit> {
        let count = self.positions.len();
        let key = |v: u32| {
            let v = v as usize;
            let (p, c) = (self.positions[v], self.colors.get(v).copied().unwrap_or_default());
            // Adding zero makes -0 and 0 the same.
            [p[0], p[1], p[2], c[0], c[1], c[2]].map(|v| (v + 0.0).to_bits())
        };
        let mut order: Vec<u32> = Vec::new();
        budget.reserve(&mut order, count)?;
        order.extend(0..count as u32);
        order.sort_unstable_by_key(|&v| (key(v), v));
        // For each vertex the first that is equal to it, then its place in the shorter list.
        let mut target: Vec<u32> = Vec::new();
        budget.fill(&mut target, count, 0, 0)?;
        for group in order.chunk_by(|&a, &b| key(a) == key(b)) {
            for &v in group {
                target[v as usize] = group[0];
            }
        }
        let mut kept = 0;
        for v in 0..count {
            let first = target[v] as usize;
            if first == v {
                self.positions[kept] = self.positions[v];
                if let Some(&color) = self.colors.get(v) {
                    self.colors[kept] = color;
                }
                target[v] = kept as u32;
                kept += 1;
            } else {
                target[v] = target[first];
            }
        }
        self.positions.truncate(kept);
        self.colors.truncate(kept);
        for v in self.faces.iter_mut().flatten() {
            *v = target[*v as usize];
        }
        Ok(())
    }
}

/// Leaves out triangles that name a vertex twice, and their texture coordinates; how many they are.
fn drop_repeated(faces: &mut Vec<[u32; 3]>, mut uv_faces: Option<&mut Vec<[u32; 3]>>) -> usize {
    let mut kept = 0;
    for k in 0..faces.len() {
        let [a, b, c] = faces[k];
        if a == b || b == c || c == a {
            continue;
        }
        faces[kept] = faces[k];
        if let Some(uv_faces) = &mut uv_faces {
            uv_faces[kept] = uv_faces[k];
        }
        kept += 1;
    }
    let repeated = faces.len() - kept;
    faces.truncate(kept);
    if let Some(uv_faces) = uv_faces {
        uv_faces.truncate(kept);
    }
    repeated
}
