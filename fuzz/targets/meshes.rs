//! Meshes and voxels.

use mesh_core::io::{binvox, glb, obj, off, ply, stl};
use mesh_core::{ByteImage, Image, Texture, TriMesh, VoxelGrid, encode_png, primitives};

use super::scratch::{packed, unpacked, with_files};

/// A small mesh with colours.
fn mesh() -> TriMesh {
    primitives::cuboid([1.0, 2.0, 3.0])
}

/// What a program does next with whatever was read.
fn used(mesh: &TriMesh) {
    let _ = (
        mesh.bounds(),
        mesh_core::face_areas(&mesh.positions, &mesh.faces),
        mesh_core::vertex_normals(&mesh.positions, &mesh.faces),
    );
}

/// An OBJ with its materials and textures: `mesh.obj` among packed files.
pub(crate) fn obj(bytes: &[u8]) {
    if let Ok(mesh) = obj::decode(bytes, "a.obj") {
        used(&mesh);
    }
    with_files(&unpacked(bytes), |root| {
        if let Ok(mesh) = mesh_core::read_mesh(root.join("mesh.obj")) {
            used(&mesh);
        }
    });
}

pub(crate) fn obj_seeds() -> Vec<Vec<u8>> {
    let text = b"mtllib m.mtl\nv 0 0 0 1 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nvn 0 0 1\n\
                 o part\ng a b\ns 1\nusemtl red\nf 1/1/1 2/2/1 3/3/1\nf -3 -2//1 -1/1\nf 1 2 4 3\nl 1 2\n";
    let material = b"newmtl red\nKd 1 0 0\nd 0.5\nmap_Kd -s 1 1 1 m.png\nnewmtl blue\nKd 0 0 1\n";
    let png = encode_png(&ByteImage::new(2, 2, 3));
    vec![text.to_vec(), packed(&[("mesh.obj", text), ("m.mtl", material), ("m.png", &png)])]
}

pub(crate) fn ply(bytes: &[u8]) {
    if let Ok(mesh) = ply::decode(bytes, "a.ply") {
        used(&mesh);
    }
}

pub(crate) fn ply_seeds() -> Vec<Vec<u8>> {
    let strips = b"ply\nformat ascii 1.0\ncomment x\nelement vertex 4\nproperty float x\nproperty double y\n\
                   property float32 z\nproperty uchar red\nproperty uchar green\nproperty uchar blue\n\
                   element tristrips 1\nproperty list int int vertex_indices\nend_header\n\
                   0 0 0 1 2 3\n1 0 0 1 2 3\n0 1 0 1 2 3\n1 1 0 1 2 3\n4 0 1 2 3\n";
    let place = tempfile::tempdir().expect("a place for seeds");
    let path = place.path().join("a.ply");
    let written =
        mesh_core::write_mesh(&path, &mesh()).ok().and_then(|()| std::fs::read(&path).ok());
    written.into_iter().chain([strips.to_vec()]).collect()
}

pub(crate) fn glb(bytes: &[u8]) {
    if let Ok(mesh) = glb::decode(bytes, "a.glb") {
        used(&mesh);
    }
}

pub(crate) fn glb_seeds() -> Vec<Vec<u8>> {
    let plain = mesh();
    let corners = vec![[0.25, 0.75]; 3 * plain.faces.len()];
    let mut textured = plain.clone();
    textured.texture = Some(Texture {
        image: Image::new(2, 2, 3),
        uvs: corners.clone(),
        faces: (0..plain.faces.len() as u32).map(|f| [3 * f, 3 * f + 1, 3 * f + 2]).collect(),
    });
    let place = tempfile::tempdir().expect("a place for seeds");
    let path = place.path().join("a.glb");
    let file = |mesh: &TriMesh| {
        mesh_core::write_mesh(&path, mesh).ok()?;
        std::fs::read(&path).ok()
    };
    [plain, textured].iter().filter_map(file).collect()
}

pub(crate) fn off(bytes: &[u8]) {
    if let Ok(mesh) = off::decode(bytes, "a.off") {
        used(&mesh);
    }
}

pub(crate) fn off_seeds() -> Vec<Vec<u8>> {
    vec![
        b"OFF\n# a square\n4 2 0\n0 0 0\n1 0 0\n0 1 0\n1 1 0\n3 0 1 2\n4 0 1 3 2 255 0 0\n"
            .to_vec(),
    ]
}

pub(crate) fn stl(bytes: &[u8]) {
    if let Ok(mesh) = stl::decode(bytes, "a.stl") {
        used(&mesh);
    }
}

pub(crate) fn stl_seeds() -> Vec<Vec<u8>> {
    let text = "solid a\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\n\
                endfacet\nendsolid a\n";
    let cube = stl::encode(&mesh_core::primitives::cuboid([1.0; 3]));
    [Ok(text.into()), cube].into_iter().flatten().collect()
}

pub(crate) fn binvox(bytes: &[u8]) {
    let _ = binvox::decode(bytes, "a.binvox");
}

pub(crate) fn binvox_seeds() -> Vec<Vec<u8>> {
    let mut grid = VoxelGrid::new([4; 3], ([0.0; 3], [1.0; 3]));
    grid.bits[20..40].fill(true);
    binvox::encode(&grid).into_iter().collect()
}
