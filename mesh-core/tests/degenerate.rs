//! Meshes that are none: every function has a value or an error for them, none panics.
#![allow(clippy::unwrap_used, reason = "tests")]

use std::panic::{AssertUnwindSafe, catch_unwind};

use mesh_core::io::{glb, obj, ply};
use mesh_core::{
    ClosestPoint, DiffusionSolver, EmptyGrid, ImproveOptions, RemeshOptions, Subdivision, Topology,
    TriMesh, VoxelGrid, combinatorial_laplacian, cotangent_laplacian, cubify, face_areas,
    face_normals, improve, nearest, primitives, remesh, sample_points, sample_surface, subdivide,
    uniform_laplacian, vertex_areas, vertex_normals, voxelize_enclosed, voxelize_parity,
    voxelize_solid, voxelize_surface,
};

fn meshes() -> Vec<(&'static str, TriMesh)> {
    let triangle =
        |a: [f32; 3], b: [f32; 3], c: [f32; 3]| TriMesh::new(vec![a, b, c], vec![[0, 1, 2]]);
    let (o, x, y) = ([0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]);
    let square = TriMesh::new(vec![o, x, y, [1.0, 1.0, 0.0]], vec![[0, 1, 2], [2, 1, 3]]);
    let ball = primitives::icosphere(1);
    let with = |value: f32| {
        let mut mesh = ball.clone();
        mesh.positions[3][1] = value;
        mesh
    };
    let mut list = vec![
        ("nothing", TriMesh::default()),
        ("a vertex", TriMesh::new(vec![x], vec![])),
        ("two vertices at one place", TriMesh::new(vec![x, x], vec![])),
        ("a face of one vertex", TriMesh::new(vec![x], vec![[0, 0, 0]])),
        ("a face of two vertices", TriMesh::new(vec![x, y], vec![[0, 1, 1]])),
        ("a triangle", triangle(o, x, y)),
        ("a point of a triangle", triangle(x, x, x)),
        ("a line of a triangle", triangle(o, x, [2.0, 0.0, 0.0])),
        ("the same face twice", TriMesh::new(vec![o, x, y], vec![[0, 1, 2], [0, 1, 2]])),
        ("a face and its back", TriMesh::new(vec![o, x, y], vec![[0, 1, 2], [2, 1, 0]])),
        (
            "three faces on an edge",
            TriMesh::new(
                vec![o, x, y, [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]],
                vec![[0, 1, 2], [0, 1, 3], [1, 0, 4]],
            ),
        ),
        ("a flat square", square.clone()),
        ("a flat square far away", square.translated([1e6, 1e6, 1e6])),
        ("a flat ball", ball.clone().scaled([1.0, 0.0, 1.0])),
        ("a ball at one place", ball.clone().scaled([0.0; 3])),
        ("a tiny ball", ball.clone().scaled([1e-40; 3])),
        ("a huge ball", ball.clone().scaled([3e38; 3])),
        ("not a number", with(f32::NAN)),
        ("infinite", with(f32::INFINITY)),
        ("infinite the other way", with(f32::NEG_INFINITY)),
        ("nothing but not numbers", TriMesh::new(vec![[f32::NAN; 3]; 3], vec![[0, 1, 2]])),
        ("nothing but infinities", TriMesh::new(vec![[f32::INFINITY; 3]; 3], vec![[0, 1, 2]])),
    ];
    let colored: Vec<_> =
        list.iter().map(|(name, mesh)| (*name, mesh.clone().colored([f32::NAN; 3]))).collect();
    list.extend(colored);
    list
}

/// Takes a value and is content with it.
fn done<T>(_: T) {}

type Function = (&'static str, fn(&TriMesh));

fn functions() -> Vec<Function> {
    fn topology(m: &TriMesh) -> Topology {
        Topology::new(m.positions.len(), &m.faces)
    }
    fn bounds(m: &TriMesh) -> ([f32; 3], [f32; 3]) {
        m.bounds().unwrap_or(([0.0; 3], [0.0; 3]))
    }
    vec![
        ("validate", |m| done(m.validate())),
        ("require_faces", |m| done(m.require_faces())),
        ("bounds", |m| done(m.bounds())),
        ("area and volume", |m| done((m.area(), m.volume()))),
        ("normalized", |m| done(m.clone().normalized(1.0).scaled([-1.0; 3]))),
        ("append", |m| {
            let mut two = m.clone();
            done(two.append(m));
            done(two.append(&primitives::icosphere(0)));
        }),
        ("health", |m| done(m.health().to_string())),
        ("self_intersections", |m| done(m.self_intersections())),
        ("topology", |m| {
            let t = topology(m);
            done((t.euler_number(), t.is_closed(), t.face_pairs(&m.faces), t.edge_between(0, 1)));
        }),
        ("normals", |m| {
            for n in face_normals(&m.positions, &m.faces) {
                assert!(n.iter().all(|x| x.is_finite()), "{n:?}");
            }
            for n in vertex_normals(&m.positions, &m.faces) {
                assert!(n.iter().all(|x| x.is_finite()), "{n:?}");
            }
        }),
        ("areas", |m| {
            done((face_areas(&m.positions, &m.faces), vertex_areas(&m.positions, &m.faces)));
        }),
        ("laplacians", |m| {
            let t = topology(m);
            done(uniform_laplacian(&t).apply(&m.positions));
            done(combinatorial_laplacian(&t).apply(&m.positions));
            done(cotangent_laplacian(&m.positions, &m.faces, &t).apply(&m.positions));
        }),
        ("diffusion", |m| {
            let t = topology(m);
            for mut solver in [DiffusionSolver::new(&t, 10.0), DiffusionSolver::factored(&t, 10.0)]
            {
                let mut x = m.positions.clone();
                solver.solve(&m.positions, &mut x, 1e-6, 50);
            }
        }),
        ("subdivide", |m| {
            done(subdivide(m));
            done(Subdivision::of(m.positions.len(), &m.faces).apply(&m.positions));
        }),
        ("sampling", |m| {
            for point in sample_surface(m, 50, 1) {
                assert!(point.barycentric.iter().all(|w| w.is_finite()));
            }
            done(sample_points(m, 50, 1));
        }),
        ("closest", |m| {
            let tree = ClosestPoint::new(m);
            for p in [[0.0; 3], [f32::NAN; 3], [f32::INFINITY; 3], [3e38; 3]] {
                done(tree.find(p));
            }
        }),
        ("nearest", |m| {
            done(nearest(&m.positions, &m.positions));
            // Without points there is no nearest one, and nothing to give: as in indexing.
            if !m.positions.is_empty() {
                done(nearest(&[[f32::NAN; 3], [f32::INFINITY; 3]], &m.positions));
            }
        }),
        ("voxels", |m| {
            for voxelize in [voxelize_solid, voxelize_surface, voxelize_parity, voxelize_enclosed] {
                let grid = voxelize(m, [6, 5, 4], bounds(m));
                assert!(grid.cell.iter().all(|&side| side > 0.0 && side.is_finite()));
                assert!(grid.iou(&grid) == 1.0 && grid.volume() >= 0.0);
                done(cubify(&grid, EmptyGrid::CentralBlock));
            }
        }),
        ("improve", |m| done(improve(&mut m.clone(), &ImproveOptions::default()))),
        ("remesh", |m| done(remesh(m, &RemeshOptions { edge_length: 0.5, passes: 2 }))),
        ("files", |m| {
            let folder = tempfile::tempdir().unwrap();
            let written = obj::write(folder.path().join("a.obj"), m).is_ok();
            assert_eq!(written, glb::encode(m).is_ok());
            assert_eq!(written, ply::encode(m, ply::Encoding::Binary).is_ok());
            if written {
                mesh_core::read_mesh(folder.path().join("a.obj")).unwrap().validate().unwrap();
                glb::decode(&glb::encode(m).unwrap(), "a").unwrap().validate().unwrap();
            }
        }),
    ]
}

#[test]
fn every_function_has_an_answer() {
    let mut panics = Vec::new();
    for (mesh_name, mesh) in meshes() {
        for (name, function) in functions() {
            if catch_unwind(AssertUnwindSafe(|| function(&mesh))).is_err() {
                panics.push(format!("{name} of {mesh_name}"));
            }
        }
    }
    assert!(panics.is_empty(), "{panics:#?}");
}

#[test]
fn a_flat_mesh_lies_in_the_middle_of_its_voxels() {
    let square = TriMesh::new(
        vec![[0.0; 3], [4.0, 0.0, 0.0], [4.0, 2.0, 0.0], [0.0, 2.0, 0.0]],
        vec![[0, 1, 2], [0, 2, 3]],
    );
    let grid = voxelize_surface(&square, [4, 4, 3], square.bounds().unwrap());
    assert_eq!((grid.cell, grid.origin), ([1.0, 0.5, 1.0], [0.0, 0.0, -1.5]));
    assert_eq!(grid.count(), 16);
    assert!((0..4).all(|x| grid.get([x, 0, 1])));
    // A point, at the origin and elsewhere.
    assert_eq!(VoxelGrid::new([2; 3], ([0.0; 3], [0.0; 3])).cell, [1.0; 3]);
    let far = VoxelGrid::new([2; 3], ([1024.0; 3], [1024.0; 3]));
    assert_eq!((far.cell, far.origin), ([1.0; 3], [1023.0; 3]));
}
