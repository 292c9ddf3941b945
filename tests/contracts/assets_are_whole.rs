//! The octopus that comes with the project: about 5k vertices and 10k triangles, 300 particles, 750 edges, in one piece.

use polpo_scenes::octopus_asset;

#[test]
fn the_octopus_and_its_rig_belong_together() {
    let (mesh, rig) = octopus_asset();
    mesh.validate().unwrap();
    rig.validate().unwrap();
    rig.check_mesh(&mesh).unwrap();
    assert!((4_500..=5_600).contains(&mesh.positions.len()), "{} vertices", mesh.positions.len());
    assert!((9_000..=11_200).contains(&mesh.triangles.len()), "{} triangles", mesh.triangles.len());
    assert!((290..=310).contains(&rig.particles.len()), "{} particles", rig.particles.len());
    assert!((700..=800).contains(&rig.edges.len()), "{} edges", rig.edges.len());
}

#[test]
fn every_particle_holds_on_to_the_body() {
    let (_, rig) = octopus_asset();
    let mut root: Vec<usize> = (0..rig.particles.len()).collect();
    fn find(root: &mut [usize], i: usize) -> usize {
        if root[i] == i {
            i
        } else {
            let top = find(root, root[i]);
            root[i] = top;
            top
        }
    }
    for &[i, j] in &rig.edges {
        let (i, j) = (find(&mut root, i as usize), find(&mut root, j as usize));
        root[i] = j;
    }
    let first = find(&mut root, 0);
    assert!((0..root.len()).all(|i| find(&mut root, i) == first));
}
