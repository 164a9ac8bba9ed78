//! Reading GLB.

use nalgebra::{Matrix4, Quaternion, UnitQuaternion, Vector3, Vector4};

use super::accessor::Items;
use super::container::{Glb, LeftOut};
use super::document::{Node, Primitive};
use super::material::{Look, tinted};
use super::soup::Soup;
use crate::io::open::{self, Contents, readers};
use crate::io::remark::{counted, not_read};
use crate::io::{ReadMeshError, Remark};
use crate::{Budget, TriMesh, linear_to_srgb};

readers! {
    /// Reads the triangles of a GLB file's scene as one mesh, nodes' transforms applied.
    ///
    /// Vertices that files split at seams of normals or texture coordinates are joined again where
    /// position and colour are the same bits; what this crate wrote without a texture has no such seams
    /// and stays as it is. Vertex colours come back as sRGB. One texture is kept, multiplied by its material's colour; on parts
    /// without it its corner (0, 0) lies. `KHR_texture_transform` is applied, and of `KHR_materials_pbrSpecularGlossiness` the
    /// diffuse part is read. Lines, triangles that name a vertex twice, and images that are neither PNG nor JPEG, or neither in
    /// the file (in base 64 too) nor in its folder, are left out: see [`read_with`].
    ///
    /// # Errors
    /// The file cannot be read, is no GLB 2.0, needs an extension that changes its geometry
    /// (compression), keeps its geometry in other files, or holds an index or a length out of range, or a
    /// position that is not finite; or the default [`Limits`](crate::Limits) are not enough.
    read,
    /// The mesh in the bytes of a GLB file.
    decode,
    assemble
}

/// What showing a part of a mesh is counted as, beside its vertices and triangles.
const PER_PART: u64 = 32;

pub(in crate::io) fn assemble(
    contents: Contents<'_>,
    remarks: &mut Vec<Remark>,
) -> Result<TriMesh, ReadMeshError> {
    let Contents { bytes, path, limits, mut budget, root, only_uvs } = contents;
    let budget = &mut budget;
    let over = ReadMeshError::over_limit(path);
    let glb = Glb { root, only_uvs, ..Glb::open(&bytes, path, limits, budget)? };
    let mut soup = Soup::default();
    let mut left_out = LeftOut::default();
    for (node, transform) in glb.placed(budget)? {
        let Some(mesh) = glb.document.nodes[node].mesh else { continue };
        let mesh = glb.get(&glb.document.meshes, mesh, "mesh")?;
        for primitive in &mesh.primitives {
            // A part that shows nothing takes time all the same when it is shown again and again.
            budget.take(PER_PART).map_err(&over)?;
            glb.primitive(primitive, &transform, &mut soup, budget, &mut left_out)?;
        }
    }
    let image = if only_uvs {
        (!soup.uvs.is_empty()).then(open::blank)
    } else {
        soup.image.take().map(|(_, image)| tinted(image, soup.tint))
    };
    if image.is_some() {
        // A mesh has colours or a texture; one that gets its texture still has those that no view will show.
        if !only_uvs {
            soup.colors.clear();
        }
        counted(remarks, left_out.bare, |count| Remark::MissingTexcoords { count });
    }
    let (mesh, repeated) = soup.joined(image, budget).map_err(&over)?;
    for (name, why) in left_out.unread {
        not_read(remarks, &name, why);
    }
    counted(remarks, left_out.lines, |count| Remark::Lines { count });
    counted(remarks, left_out.textures, |count| Remark::OtherTextures { count });
    counted(remarks, left_out.tints, |count| Remark::OtherTints { count });
    counted(remarks, repeated, |count| Remark::RepeatedVertices { count });
    Ok(mesh)
}

impl Glb<'_> {
    /// The nodes of the scene and where each stands in the world.
    fn placed(&self, budget: &mut Budget) -> Result<Vec<(usize, Matrix4<f64>)>, ReadMeshError> {
        let document = &self.document;
        let count = document.nodes.len();
        // Two lists of nodes with a matrix each, and two of marks.
        budget.take(count as u64 * 320).map_err(ReadMeshError::over_limit(self.path))?;
        let mut seen = vec![false; count];
        let mut placed = Vec::with_capacity(count);
        let mut stack: Vec<(usize, Matrix4<f64>)> = Vec::with_capacity(count);
        let mut visit = |index: usize, parent: Matrix4<f64>, stack: &mut Vec<_>| {
            self.get(&document.nodes, index, "node")?;
            if std::mem::replace(&mut seen[index], true) {
                return Err(self.bad("nodes", format!("node {index} twice"), "a tree"));
            }
            stack.push((index, parent));
            Ok(())
        };
        if let Some(scene) = document.scenes.get(document.scene.unwrap_or(0)) {
            for &root in scene.nodes.iter().rev() {
                visit(root, Matrix4::identity(), &mut stack)?;
            }
        } else {
            let mut is_child = vec![false; count];
            for &child in document.nodes.iter().flat_map(|n| &n.children) {
                if let Some(flag) = is_child.get_mut(child) {
                    *flag = true;
                }
            }
            for root in (0..count).rev().filter(|&i| !is_child[i]) {
                visit(root, Matrix4::identity(), &mut stack)?;
            }
        }
        while let Some((index, parent)) = stack.pop() {
            let node = &document.nodes[index];
            let transform = parent * local(node);
            placed.push((index, transform));
            for &child in node.children.iter().rev() {
                visit(child, transform, &mut stack)?;
            }
        }
        Ok(placed)
    }

    fn primitive(
        &self,
        primitive: &Primitive,
        transform: &Matrix4<f64>,
        soup: &mut Soup,
        budget: &mut Budget,
        left_out: &mut LeftOut,
    ) -> Result<(), ReadMeshError> {
        let mode = primitive.mode.unwrap_or(4);
        let Some(position) = primitive.attributes.position else {
            return Ok(()); // nothing to show, says the standard
        };
        if matches!(mode, 1..=3) {
            left_out.lines += 1;
            return Ok(());
        }
        let base = soup.positions.len();
        self.positions(position, transform, soup, budget)?;
        let count = soup.positions.len() - base;
        let material =
            primitive.material.map(|m| self.get(&self.document.materials, m, "material"));
        let material = material.transpose()?;
        let Look { texture, factor } = Look::of(material);
        let mut textured = false;
        if self.only_uvs {
            // Whatever image lies there, and on parts that have none yet.
            if let Some(texcoord) = primitive.attributes.texcoord {
                self.texcoords(texcoord, None, base, soup, budget)?;
                textured = true;
            }
        } else if let Some(info) = texture {
            let is_first = soup.image.is_none();
            match primitive.attributes.texcoord {
                None => left_out.textures += 1,
                Some(texcoord) if self.lies(info, soup, left_out)? => {
                    if is_first {
                        soup.tint = factor;
                    }
                    let transform = info.extensions.transform.as_deref();
                    self.texcoords(texcoord, transform, base, soup, budget)?;
                    textured = true;
                }
                Some(_) => {}
            }
        }
        let own = self.document.asset.generator.starts_with(super::GENERATOR);
        soup.split |= primitive.attributes.normal.is_some() && !own;
        let color = primitive.attributes.color;
        if textured && !self.only_uvs {
            left_out.tints += usize::from(color.is_some() || factor != soup.tint);
        } else if color.is_some() || factor != [1.0; 3] {
            self.vertex_colors(color, factor, base, count, soup, budget)?;
        }
        let before = soup.faces.len();
        self.faces(primitive, mode, transform, base, soup, budget)?;
        left_out.bare += if textured { 0 } else { 3 * (soup.faces.len() - before) };
        Ok(())
    }

    fn positions(
        &self,
        accessor: usize,
        transform: &Matrix4<f64>,
        soup: &mut Soup,
        budget: &mut Budget,
    ) -> Result<(), ReadMeshError> {
        let positions = self.floats::<3>(accessor, "POSITION")?;
        let (base, count) = (soup.positions.len(), positions.count());
        if u32::try_from(base + count).is_err() {
            return Err(self.bad("scene", "more", "at most 2^32 vertices"));
        }
        let reserved = budget.reserve(&mut soup.positions, count);
        reserved.map_err(ReadMeshError::over_limit(self.path))?;
        for k in 0..count {
            let p: [f32; 3] = self.row(&positions, k, "POSITION")?;
            let v = transform * Vector4::new(p[0].into(), p[1].into(), p[2].into(), 1.0);
            let placed = [v.x as f32, v.y as f32, v.z as f32];
            if !placed.iter().all(|v| v.is_finite()) {
                return Err(self.bad("POSITION", format!("{placed:?}"), "finite numbers"));
            }
            soup.positions.push(placed);
        }
        Ok(())
    }

    fn vertex_colors(
        &self,
        accessor: Option<usize>,
        factor: [f32; 3],
        base: usize,
        count: usize,
        soup: &mut Soup,
        budget: &mut Budget,
    ) -> Result<(), ReadMeshError> {
        let colors = accessor.map(|accessor| self.floats::<3>(accessor, "COLOR_0")).transpose()?;
        if let Some(colors) = &colors {
            self.as_many(colors, count, "COLOR_0")?;
        }
        let filled = budget.fill(&mut soup.colors, base, [1.0; 3], count);
        filled.map_err(ReadMeshError::over_limit(self.path))?;
        for k in 0..count {
            let color: [f32; 3] = match &colors {
                Some(colors) => self.row(colors, k, "COLOR_0")?,
                None => [1.0; 3],
            };
            let linear: [f32; 3] = std::array::from_fn(|c| color[c] * factor[c]);
            soup.colors.push(linear.map(|v| linear_to_srgb(v.clamp(0.0, 1.0))));
        }
        Ok(())
    }

    fn faces(
        &self,
        primitive: &Primitive,
        mode: u32,
        transform: &Matrix4<f64>,
        base: usize,
        soup: &mut Soup,
        budget: &mut Budget,
    ) -> Result<(), ReadMeshError> {
        if !matches!(mode, 4..=6) {
            // Points, and modes that nobody knows; looking at indices takes time that no budget counts.
            return Ok(());
        }
        let vertices = soup.positions.len() - base;
        let indices = primitive.indices.map(|index| self.items(index, "indices")).transpose()?;
        let count = indices.as_ref().map_or(vertices, Items::count);
        let index = |k: usize| match &indices {
            Some(indices) => self.vertex(indices, k, vertices),
            None => Ok(k as u32),
        };
        let triangles = match mode {
            4 => count / 3,
            _ => count.saturating_sub(2),
        };
        budget.reserve(&mut soup.faces, triangles).map_err(ReadMeshError::over_limit(self.path))?;
        let mirrored = transform.fixed_view::<3, 3>(0, 0).determinant() < 0.0;
        let first = base as u32;
        for k in 0..triangles {
            let corners = match mode {
                4 => [3 * k, 3 * k + 1, 3 * k + 2],
                5 if k % 2 == 0 => [k, k + 1, k + 2],
                5 => [k + 1, k, k + 2],
                _ => [0, k + 1, k + 2],
            };
            let [a, b, c] = [index(corners[0])?, index(corners[1])?, index(corners[2])?];
            let [a, b, c] = [first + a, first + b, first + c];
            soup.faces.push(if mirrored { [a, c, b] } else { [a, b, c] });
        }
        Ok(())
    }
}

fn local(node: &Node) -> Matrix4<f64> {
    if let Some(columns) = &node.matrix {
        return Matrix4::from_column_slice(&columns[..]);
    }
    let [x, y, z, w] = node.rotation.as_deref().copied().unwrap_or([0.0, 0.0, 0.0, 1.0]);
    let rotation = UnitQuaternion::try_new(Quaternion::new(w, x, y, z), 0.0).unwrap_or_default();
    Matrix4::new_translation(&Vector3::from(
        node.translation.as_deref().copied().unwrap_or_default(),
    )) * rotation.to_homogeneous()
        * Matrix4::new_nonuniform_scaling(&Vector3::from(
            node.scale.as_deref().copied().unwrap_or([1.0; 3]),
        ))
}
