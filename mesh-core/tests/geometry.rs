//! Properties that hold for any mesh of the kind.

use mesh_core::{
    ImproveOptions, Subdivision, Topology, TriMesh, coarsen, improve, nearest, primitives,
    sample_points, sample_surface, subdivide, uniform_laplacian, vertex_normals, voxelize_parity,
    voxelize_solid,
};
use proptest::prelude::*;

/// Closed meshes of several kinds, pulled out of shape.
fn closed() -> impl Strategy<Value = TriMesh> {
    let shape = prop_oneof![
        (0_u32..3).prop_map(primitives::icosphere),
        (2_usize..6, 3_usize..9).prop_map(|(rows, columns)| primitives::uv_sphere(rows, columns)),
        (3_usize..9, 3_usize..7)
            .prop_map(|(rings, sides)| primitives::torus(1.0, 0.4, rings, sides)),
        prop::array::uniform3(0.2_f32..2.0).prop_map(primitives::cuboid),
        (3_usize..9).prop_map(|segments| primitives::capsule(0.5, 1.0, 2, segments)),
    ];
    (shape, prop::array::uniform3(-0.3_f32..0.3)).prop_map(|(mesh, [a, b, c])| {
        mesh.map_positions(|[x, y, z]| [x + a * y * y, y + b * (3.0 * z).sin(), z * (1.0 + c * x)])
    })
}

/// A rotation by Euler angles, and a translation.
fn rigid() -> impl Strategy<Value = [[f64; 4]; 3]> {
    (prop::array::uniform3(-3.2_f64..3.2), prop::array::uniform3(-2.0_f64..2.0)).prop_map(
        |([x, y, z], t)| {
            let r = mesh_core::nalgebra::Rotation3::from_euler_angles(x, y, z);
            std::array::from_fn(|i| [r[(i, 0)], r[(i, 1)], r[(i, 2)], t[i]])
        },
    )
}

/// Any triangles at all over a few vertices.
fn soup() -> impl Strategy<Value = TriMesh> {
    let positions = prop::collection::vec(prop::array::uniform3(-1.0_f32..1.0), 8);
    let faces = prop::collection::vec(prop::array::uniform3(0_u32..8), 0..24);
    (positions, faces).prop_map(|(positions, faces)| TriMesh::new(positions, faces))
}

fn distance(a: [f32; 3], b: [f32; 3]) -> f32 {
    a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum::<f32>().sqrt()
}

#[test]
fn any_number_of_threads_gives_the_same() {
    let mut mesh = primitives::icosphere(4);
    mesh.append(&primitives::torus(0.9, 0.3, 40, 30)).expect("both plain");
    let (a, b) = (sample_points(&mesh, 1501, 1).0, sample_points(&mesh, 1777, 2).0);
    let run = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
        pool.install(|| (nearest(&a, &b), mesh.self_intersections()))
    };
    let one = run(1);
    assert!(!one.1.is_empty());
    assert_eq!(run(2), one);
    assert_eq!(run(3), one);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn subdivision_keeps_topology_and_shape(mesh in closed()) {
        let (before, after) = (mesh.health(), subdivide(&mesh).health());
        prop_assert_eq!(after.euler, before.euler);
        prop_assert_eq!(after.genus(), before.genus());
        prop_assert!(before.genus().is_some());
        prop_assert_eq!(after.faces, 4 * before.faces);
        prop_assert!((after.area - before.area).abs() < 1e-5 * before.area);
        prop_assert!((after.volume - before.volume).abs() < 1e-5 * before.area);
        // The angles of the four are those of the one.
        prop_assert!((after.smallest_angle_degrees - before.smallest_angle_degrees).abs() < 0.1);
    }

    #[test]
    fn subdivision_of_anything_agrees_with_its_edges(mesh in soup()) {
        let topology = Topology::new(8, &mesh.faces);
        let finer = Subdivision::along(&topology, &mesh.faces);
        prop_assert_eq!(finer.vertex_count(), 8 + topology.edges.len());
        prop_assert_eq!(finer.apply(&mesh.positions).len(), finer.vertex_count());
        prop_assert!(finer.faces.iter().flatten().all(|&v| (v as usize) < finer.vertex_count()));
        // Each edge of each face is found again by its ends.
        for (face, edges) in mesh.faces.iter().zip(&topology.face_edges) {
            for k in 0..3 {
                let (a, b) = (face[k], face[(k + 1) % 3]);
                let expected = topology.edge_between(a, b).unwrap_or(Topology::NONE);
                prop_assert_eq!(edges[k], expected);
            }
        }
        // And none of it panics.
        mesh.health();
        mesh.self_intersections();
    }

    #[test]
    fn measures_do_not_depend_on_where_the_mesh_is(mesh in closed(), rows in rigid()) {
        let moved = mesh.clone().transformed(&rows);
        let (before, after) = (mesh.health(), moved.health());
        prop_assert!((after.area - before.area).abs() < 1e-4 * before.area);
        prop_assert!((after.volume - before.volume).abs() < 1e-4 * before.area);
        prop_assert!((after.smallest_angle_degrees - before.smallest_angle_degrees).abs() < 0.01);
        prop_assert!((after.largest_dihedral_degrees - before.largest_dihedral_degrees).abs() < 0.05);
        prop_assert_eq!(after.euler, before.euler);

        // Normals and Laplacians turn with the mesh.
        let turn = |v: [f32; 3]| -> [f32; 3] {
            std::array::from_fn(|i| (0..3).map(|k| rows[i][k] as f32 * v[k]).sum())
        };
        let normals = vertex_normals(&mesh.positions, &mesh.faces);
        for (a, b) in normals.iter().zip(vertex_normals(&moved.positions, &moved.faces)) {
            prop_assert!(distance(turn(*a), b) < 1e-3);
        }
        let laplacian = uniform_laplacian(&Topology::new(mesh.positions.len(), &mesh.faces));
        let bent = laplacian.apply(&mesh.positions);
        for (a, b) in bent.iter().zip(laplacian.apply(&moved.positions)) {
            prop_assert!(distance(turn(*a), b) < 1e-5);
        }
    }

    #[test]
    fn samples_lie_on_the_surface(mesh in closed(), seed in any::<u64>()) {
        for point in sample_surface(&mesh, 50, seed) {
            prop_assert!(point.barycentric.iter().all(|&w| (0.0..=1.0).contains(&w)));
            prop_assert!((point.barycentric.iter().sum::<f32>() - 1.0).abs() < 1e-6);
            // In the plane of the face.
            let [a, b, c] = mesh.faces[point.face as usize].map(|v| mesh.positions[v as usize]);
            let minus = |p: [f32; 3], q: [f32; 3]| -> [f32; 3] { std::array::from_fn(|k| p[k] - q[k]) };
            let (u, v, w) = (minus(b, a), minus(c, a), minus(point.position(&mesh), a));
            let volume = u[0] * (v[1] * w[2] - v[2] * w[1])
                + u[1] * (v[2] * w[0] - v[0] * w[2])
                + u[2] * (v[0] * w[1] - v[1] * w[0]);
            prop_assert!(volume.abs() < 1e-5, "{}", volume);
        }
    }

    #[test]
    fn nearest_is_nearest(
        queries in prop::collection::vec(prop::array::uniform3(-1.0_f32..1.0), 1..40),
        points in prop::collection::vec(prop::array::uniform3(-1.0_f32..1.0), 1..70),
    ) {
        for (q, found) in queries.iter().zip(nearest(&queries, &points)) {
            let least = points.iter().map(|&p| distance(*q, p)).fold(f32::INFINITY, f32::min);
            prop_assert!((found.squared.sqrt() - least).abs() < 1e-6);
            prop_assert!((distance(*q, points[found.index as usize]) - least).abs() < 1e-6);
        }
        // A point is nearest to itself.
        for (i, found) in nearest(&points, &points).iter().enumerate() {
            prop_assert_eq!(points[found.index as usize], points[i]);
        }
    }

    #[test]
    fn winding_and_parity_agree_on_closed_meshes(mesh in closed(), rows in rigid()) {
        // Where the pulling has made the surface cross itself, they may differ.
        prop_assume!(mesh.self_intersections().is_empty());
        let mesh = mesh.transformed(&rows).normalized(1.9);
        let bounds = ([-1.0; 3], [1.0; 3]);
        let solid = voxelize_solid(&mesh, [20, 22, 24], bounds);
        prop_assert_eq!(&solid, &voxelize_parity(&mesh, [20, 22, 24], bounds));
        prop_assert!((solid.volume() - mesh.volume()).abs() < 0.06 * mesh.area());
    }

    #[test]
    fn improving_never_harms(mesh in closed()) {
        let before = mesh.health();
        let mut better = mesh.clone();
        improve(&mut better, &ImproveOptions::default()).expect("closed");
        let after = better.health();
        prop_assert_eq!(after.genus(), before.genus());
        prop_assert_eq!((after.vertices, after.faces), (before.vertices, before.faces));
        prop_assert!(
            after.smallest_angle_degrees >= before.smallest_angle_degrees.min(35.0) - 1e-3
        );
    }

    #[test]
    fn coarsening_leaves_a_closed_surface_of_the_same_kind(mesh in closed(), wish in 0.05_f64..0.8) {
        let fine = subdivide(&subdivide(&mesh));
        let before = fine.health();
        let lengths: Vec<f64> =
            fine.positions.iter().map(|p| if p[0] > 0.0 { wish } else { 0.2 * wish }).collect();
        let topology = Topology::of(&fine);
        let coarse = coarsen(&fine, &topology, &lengths).expect("closed");
        let after = coarse.health();
        prop_assert!(after.is_watertight() || !before.outward, "{after}");
        prop_assert_eq!((after.genus(), after.components), (before.genus(), before.components));
        prop_assert!(after.faces <= before.faces);
        prop_assert_eq!(coarsen(&fine, &topology, &lengths).expect("closed"), coarse);
        prop_assert!(coarsen(&fine, &topology, &lengths[1..]).is_err());
    }
}
