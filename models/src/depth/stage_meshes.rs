//! The meshes of a batch on their way through the stages.

use std::sync::Arc;

use autodiff_lite::Var;
use mesh_core::TriMesh;
use nets::{MeshRefinementStage, RefinedVertices};

use super::packed::{Packed, Shape};

/// The meshes of a batch after one stage.
#[derive(Clone, Debug)]
pub(super) struct StageMeshes<'t> {
    pub(super) packed: Packed,
    /// `[1, ΣV, 3]`
    pub(super) positions: Var<'t>,
    /// Where they were before the stage.
    pub(super) before: Var<'t>,
}

/// The only mesh of a batch.
pub(super) fn mesh(meshes: &StageMeshes<'_>, colors: Option<Var<'_>>) -> TriMesh {
    let rows = |x: Var<'_>| x.value().as_slice().as_chunks::<3>().0.to_vec();
    let faces = meshes.packed.shapes[0].faces.clone();
    TriMesh { colors: colors.map(rows), ..TriMesh::new(rows(meshes.positions), faces) }
}

/// Meshes and what their vertices know on finer shapes. Like [`moved`] not generic, so that it is compiled here for both systems.
#[inline(never)]
pub(super) fn divided<'t>(
    meshes: &StageMeshes<'t>,
    hidden: Option<Var<'t>>,
    shapes: Vec<Arc<Shape>>,
) -> (StageMeshes<'t>, Option<Var<'t>>) {
    let (packed, up) = meshes.packed.divided(shapes);
    let positions = meshes.positions.sparse_matmul(&up);
    (
        StageMeshes { packed, positions, before: positions },
        hidden.map(|hidden| hidden.sparse_matmul(&up)),
    )
}

/// Moves meshes by what a stage makes of the maps at their vertices' places and of what these know.
#[inline(never)]
pub(super) fn moved<'t>(
    stage: &MeshRefinementStage,
    meshes: &mut StageMeshes<'t>,
    maps: &[Var<'t>],
    (place, told, hidden): (Var<'t>, Var<'t>, Option<Var<'t>>),
) -> RefinedVertices<'t> {
    let packed = &meshes.packed;
    let seen = packed.gathered(stage.look(maps, place));
    let refined = stage.refine(seen, packed.gathered(told), hidden, &packed.graph);
    meshes.before = meshes.positions;
    meshes.positions = meshes.positions + refined.offset;
    refined
}
