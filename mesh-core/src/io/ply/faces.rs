//! Faces and strips of triangles.

use super::header::{Element, Property};
use super::numbers::Numbers;
use super::read::Parts;
use crate::io::ReadMeshError;
use crate::{Budget, OverLimit};

/// Whether a property lists vertices.
fn lists_vertices(property: &Property) -> bool {
    property.length.is_some() && matches!(property.name.as_str(), "vertex_indices" | "vertex_index")
}

/// Polygons, as fans of triangles that are noted.
pub(super) fn faces(
    element: &Element,
    numbers: &mut Numbers<'_>,
    parts: &mut Parts,
    budget: &mut Budget,
) -> Result<(), ReadMeshError> {
    let over = ReadMeshError::over_limit(numbers.path);
    let (mut polygon, mut texcoord) = (Vec::<u32>::new(), Vec::<f32>::new());
    let mut corner_uvs = Vec::new();
    let lists_texcoord =
        element.properties.iter().any(|p| p.length.is_some() && p.name == "texcoord");
    let is_colored = element.properties.iter().any(|p| p.length.is_none() && p.name == "red");
    let mut has_texcoord = false;
    for item in 0..element.count {
        numbers.item = item;
        polygon.clear();
        texcoord.clear();
        let line = numbers.line();
        for p in &element.properties {
            match p.length {
                Some(length) if lists_vertices(p) => {
                    let count = numbers.length(length)?;
                    polygon.clear();
                    budget.reserve(&mut polygon, count).map_err(&over)?;
                    for _ in 0..count {
                        let v = numbers.number(p.scalar)?;
                        let v = index(v)
                            .ok_or_else(|| numbers.wrong("vertex_indices", v, "an index"))?;
                        polygon.push(v);
                    }
                }
                Some(length) if p.name == "texcoord" => {
                    let count = numbers.length(length)?;
                    texcoord.clear();
                    budget.reserve(&mut texcoord, count).map_err(&over)?;
                    for _ in 0..count {
                        texcoord.push(numbers.number(p.scalar)? as f32);
                    }
                }
                _ => numbers.skip(p)?,
            }
        }
        if polygon.len() < 3 {
            parts.short += 1;
            parts.first_short = parts.first_short.or(line);
            continue;
        }
        parts.face_colors += usize::from(is_colored);
        let uv = |k: usize| [texcoord[2 * k], texcoord[2 * k + 1]];
        let placed = texcoord.len() == 2 * polygon.len() && texcoord.iter().all(|v| v.is_finite());
        has_texcoord |= placed;
        let first = parts.faces.len();
        for k in 1..polygon.len() - 1 {
            let is_whole = parts.triangle([polygon[0], polygon[k], polygon[k + 1]], budget);
            if !is_whole.map_err(&over)? {
                parts.repeated += 1;
            } else if lists_texcoord {
                let corners = if placed { [uv(0), uv(k), uv(k + 1)] } else { [[0.0; 2]; 3] };
                parts.bare += if placed { 0 } else { 3 };
                budget.push(&mut corner_uvs, corners).map_err(&over)?;
            }
        }
        if parts.faces.len() - first == polygon.len() - 2 {
            parts.polygons.note(first..parts.faces.len(), budget).map_err(&over)?;
        }
    }
    parts.corner_uvs = has_texcoord.then_some(corner_uvs);
    Ok(())
}

/// Strips of triangles: each vertex makes one with the two before it, turned round every other
/// time, and -1 begins anew.
pub(super) fn strips(
    element: &Element,
    numbers: &mut Numbers<'_>,
    parts: &mut Parts,
    budget: &mut Budget,
) -> Result<(), ReadMeshError> {
    let over = ReadMeshError::over_limit(numbers.path);
    for item in 0..element.count {
        numbers.item = item;
        for p in &element.properties {
            let Some(length) = p.length.filter(|_| lists_vertices(p)) else {
                numbers.skip(p)?;
                continue;
            };
            let mut last: [Option<u32>; 2] = [None; 2];
            let mut odd = false;
            for _ in 0..numbers.length(length)? {
                let v = numbers.number(p.scalar)?;
                if v == -1.0 {
                    (last, odd) = ([None; 2], false);
                    continue;
                }
                let v = index(v).ok_or_else(|| {
                    numbers.wrong("vertex_indices", v, "an index, or -1 between strips")
                })?;
                if let [Some(a), Some(b)] = last {
                    // One that names a vertex twice only leads on: strips are sewn with them.
                    let face = if odd { [b, a, v] } else { [a, b, v] };
                    parts.triangle(face, budget).map_err(&over)?;
                    odd = !odd;
                }
                last = [last[1], Some(v)];
            }
        }
    }
    Ok(())
}

fn index(value: f64) -> Option<u32> {
    ((0.0..=f64::from(u32::MAX)).contains(&value) && value.fract() == 0.0).then_some(value as u32)
}

impl Parts {
    /// Adds a triangle, unless it names a vertex twice; whether it did.
    fn triangle(&mut self, face: [u32; 3], budget: &mut Budget) -> Result<bool, OverLimit> {
        let [a, b, c] = face;
        if a == b || b == c || c == a {
            return Ok(false);
        }
        budget.push(&mut self.faces, face)?;
        Ok(true)
    }
}
